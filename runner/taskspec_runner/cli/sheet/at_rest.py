"""What the signals of a stage settle at, measured and in closed form, for `explain`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.explain import RestValue
from taskspec.program.signals import applied
from taskspec.program.stages.stage import CompiledStage
from taskspec.text.units import FORCE, LENGTH, TIME, scaled, show
from taskspec_runner.record.history import Vector, Visit
from taskspec_runner.trial.trial import Trial
from taskspec_runner.verdict.response import of_an_axis, response, stays

#: A force or moment, a position or gap below this is shown as none [N, N m], [m, rad].
_NO_EFFORT, _NO_WAY = 1e-3, 1e-6
#: A reference that stays for this share of a visit, at its end, is a set point; over as much the
#: value at rest is averaged.
_STAYS = 0.1
_POSITION = "position."


@dataclass(frozen=True, slots=True)
class RestRow:
    """A signal at rest.

    Attributes:
        signal: its name in the file.
        set_point: that its reference ends at [SI]; None where it has none.
        rest: mean over the last tenth of the stage's last visit [SI]; None without a trial.
        overshoot: beyond the set point [SI]; None without a step to it.
        settling_time: since the visit began, until it stays within 2 % [s]; None where it never
            does, or has no step.
        law: its closed form; None where the law has none.
    """

    signal: str
    set_point: float | None = None
    rest: float | None = None
    overshoot: float | None = None
    settling_time: float | None = None
    law: RestValue | None = None

    @property
    def cells(self) -> tuple[str, ...]:
        """Set point, rest, overshoot, settling time, closed form and its source, in words."""
        after = "-" if self.settling_time is None else show(self.settling_time, TIME, 3)
        values = [self._shown(v) for v in (self.set_point, self.rest, self.overshoot)]
        if self.law is None:
            return (*values, after, "-", "")
        return (*values, after, self._shown(self.law.value), self.law.source)

    def _shown(self, value: float | None) -> str:
        if value is None:
            return "-"
        kind, _, what = self.signal.partition(".")
        place = kind == "position" or what == "gap"
        if abs(value) < (_NO_WAY if place else _NO_EFFORT):
            return "0"
        if place:
            return scaled(value, LENGTH.on(rotation=what.startswith("r")), 3)
        return scaled(value, FORCE.on(rotation="torque" in (kind, what)), 3)


def rest_rows(
    stage: CompiledStage, law: Mapping[str, RestValue], trial: Trial | None
) -> Iterator[RestRow]:
    """Forces, moments and positions of a stage that come to rest.

    Args:
        stage: the stage.
        law: closed forms by signal.
        trial: of the program; None to have the closed forms alone.
    """
    visits = [] if trial is None else [v for v in trial.history.visits() if v.stage == stage.name]
    if trial is None or not visits:
        yield from (RestRow(signal, law=at) for signal, at in law.items())
        return
    plans = stage.plan.plans
    names = [applied(axis) for axis, plan in plans.items() if plan.set_point]
    names += [*law]
    names += [
        _POSITION + axis for axis, plan in plans.items()
        if plan.motion and not plan.force and axis in stage.plan.spec.axes
    ]  # fmt: skip
    found = [_row(trial, visits[-1], name, law.get(name)) for name in dict.fromkeys(names)]
    rows = [row for row in found if row is not None]
    yield from rows
    if any(not row.signal.startswith(_POSITION) for row in rows):
        yield from _pressed_in(trial, visits[-1], stage.plan.contacts.touched)


def _row(trial: Trial, visit: Visit, name: str, law: RestValue | None) -> RestRow | None:
    """One signal in a visit; None where it has neither a set point nor a closed form."""
    values, wanted = (_column(trial, visit, n) for n in (name, f"{name}.ref"))
    set_point = None
    if wanted is not None and len(wanted) - stays(wanted) >= _STAYS * len(wanted):
        set_point = float(wanted[-1])
    if values is None or (set_point is None and law is None):
        return None
    rest = _mean_at_end(values)
    if name.startswith(_POSITION):
        return RestRow(name, set_point, rest)
    if set_point is None or wanted is None:
        assert law is not None
        wanted = np.full(len(values), law.value)
    found = response(values, wanted, trial.program.context.period)
    if found is None:
        return RestRow(name, set_point, rest, law=law)
    # What a mechanism bears is no step that a loop is given: it follows from the motion.
    overshoot = found.overshoot if of_an_axis(name) else None
    return RestRow(name, set_point, rest, overshoot, found.settling_time, law)


def _pressed_in(trial: Trial, visit: Visit, touched: Sequence[str]) -> Iterator[RestRow]:
    """Gaps of the objects that a stage has pressed in at its end."""
    for name in touched:
        gap = _column(trial, visit, f"{name}.gap")
        if gap is not None and gap[-1] < 0:
            yield RestRow(f"{name}.gap", rest=_mean_at_end(gap))


def _mean_at_end(values: Vector) -> float:
    return float(np.mean(values[-max(round(_STAYS * len(values)), 1) :]))


def _column(trial: Trial, visit: Visit, name: str) -> Vector | None:
    """(k,) a column in a visit; None where there is none, or no value at its end."""
    values = trial.history.columns.get(name)
    if values is None or not np.isfinite(values[visit.last]):
        return None
    return np.asarray(values[visit.rows])


def grouped(rows: Sequence[RestRow]) -> Iterator[tuple[str, ...]]:
    """The rows in words, those that say the same of several signals together."""
    groups: dict[tuple[str, ...], list[str]] = {}
    for row in rows:
        groups.setdefault(row.cells, []).append(row.signal)
    for cells, signals in groups.items():
        yield " ".join(signals), *cells
