"""What the stages of a task came to in its trial, for `explain`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.text.units import FORCE, MASS, MOMENT, STIFFNESS, TIME, VELOCITY, scaled, show
from taskspec_runner.record.history import Visit
from taskspec_runner.trial.impact import Impact, first_impact
from taskspec_runner.trial.moment import Moment
from taskspec_runner.trial.trial import DONE, OPEN, Trial
from taskspec_runner.verdict.metrics import peaks
from taskspec_runner.verdict.summary import transition_text

#: So many visits of a stage are shown, the first ones.
_SHOWN = 3
#: A peak below this is shown as none [N, N m, m/s].
_NOTHING = 1e-3
_PEAKS = {"force": FORCE, "torque": MOMENT, "speed": VELOCITY}


@dataclass(frozen=True, slots=True)
class TrialVisit:
    """A visit of a stage in a trial.

    Attributes:
        begins: run time [s].
        lasts: [s].
        ended_by: the event, as a sentence; empty where the trial was broken off in it.
        to: the stage that it leads to, `end` or `fail`; empty where a limit stopped the run.
    """

    begins: float
    lasts: float
    ended_by: str
    to: str


@dataclass(frozen=True, slots=True)
class MeasuredImpact:
    """The first touch that begins in a stage.

    Attributes:
        touch: mass, speed and contact.
        clock: run time [s].
        force: the largest that the contact bears until the blow is at its peak [N].
    """

    touch: Impact
    clock: float
    force: float

    def as_data(self) -> dict[str, Any]:
        """For other programs [SI]."""
        t = self.touch
        return {
            "contact": t.contact, "clock": self.clock, "speed": t.speed, "mass": t.mass,
            "stiffness": t.stiffness, "blow": t.peak, "force": self.force,
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class StageTrial:
    """What a stage came to in a trial.

    Attributes:
        visits: in order; none of a stage that was not entered.
        peaks: of contact force [N], moment [N m] and tip speed [m/s] over all visits.
        touch: the first that begins in it; None where none does.
    """

    visits: tuple[TrialVisit, ...]
    peaks: dict[str, float]
    touch: MeasuredImpact | None

    def as_data(self) -> dict[str, Any]:
        """For other programs [SI]."""
        return {
            "visits": [
                {"begins": v.begins, "lasts": v.lasts, "ended_by": v.ended_by, "to": v.to}
                for v in self.visits
            ],
            "peaks": self.peaks,
            "touch": None if self.touch is None else self.touch.as_data(),
        }

    @property
    def rows(self) -> Iterator[tuple[str, str]]:
        """Pairs of what and how."""
        if not self.visits:
            yield "trial", "does not come to this stage"
            return
        for visit in self.visits[:_SHOWN]:
            leads = f" -> {visit.to}" if visit.to else ""
            ended = f", until {visit.ended_by}{leads}" if visit.ended_by else ""
            begins, lasts = show(visit.begins, TIME, 4), show(visit.lasts, TIME, 4)
            yield "trial", f"at {begins} for {lasts}{ended}"
        if len(self.visits) > _SHOWN:
            yield "trial", f"{len(self.visits)} visits in all"
        shown = [
            f"{name} {scaled(value, _PEAKS[name], 3)}"
            for name, value in self.peaks.items()
            if value > _NOTHING
        ]
        if shown:
            yield "peaks", ", ".join(shown)
        if self.touch is not None:
            touch = self.touch.touch
            yield (
                "first touch",
                (
                    f"{touch.contact} at {show(touch.speed, VELOCITY, 3)}: "
                    f"{scaled(self.touch.force, FORCE, 3)}; v sqrt(k m) = "
                    f"{scaled(touch.peak, FORCE, 3)} with {show(touch.mass, MASS, 3)} on "
                    f"{scaled(touch.stiffness, STIFFNESS)}"
                ),
            )


def stage_trials(trial: Trial) -> dict[str, StageTrial]:
    """What every stage of a program came to, in the order of the file."""
    stages = {stage.name: stage for stage in trial.program.stages}
    own: dict[str, list[tuple[Visit, TrialVisit]]] = {name: [] for name in stages}
    period, robot = trial.program.context.period, trial.program.context.robot
    for visit, end in zip_longest(trial.history.visits(), trial.transitions):
        if visit is None:
            break  # A stage that is left as it is entered has no tick.
        text = "" if end is None else transition_text(end, stages[end.stage], robot)
        lasts = (visit.last + 1 - visit.first) * period
        made = TrialVisit(visit.first * period, lasts, text, "" if end is None else end.to)
        own[visit.stage].append((visit, made))
    largest = peaks(trial.history, [*stages])
    return {
        name: StageTrial(
            tuple(made for _, made in visits),
            largest.get(name, {}),
            next((t for v, _ in visits if (t := _touch(trial, v)) is not None), None),
        )
        for name, visits in own.items()
    }


def _touch(trial: Trial, visit: Visit) -> MeasuredImpact | None:
    touch = first_impact(Moment(trial, visit))
    if touch is None:
        return None
    period = trial.program.context.period
    # A quarter of its period, and the tick at which it touches.
    rows = slice(touch.row, touch.row + round(touch.half_period / 2 / period) + 1)
    force = float(abs(trial.history.columns[f"{touch.contact}.force"][rows]).max())
    return MeasuredImpact(touch, touch.row * period, force)


def how_it_ended(trial: Trial) -> str:
    """A trial in one sentence."""
    outcome, took = trial.outcome, show(trial.outcome.clock, TIME, 4)
    if outcome.status == OPEN:
        return f"is aborted after {took} in stage {outcome.stage!r}"
    if outcome.status != DONE:
        does = "is stopped" if outcome.status == "stopped" else "fails"
        return f"{does} in stage {outcome.stage!r} after {took}: {outcome.text}"
    missed, of = sum(each.missed for each in trial.judged), len(trial.judged)
    parts = [f"comes to its end after {took}"]
    if of:
        parts.append(
            "all expectations met" if not missed else f"{missed} of {of} expectations missed"
        )
    return ", ".join([*parts, *(each.line for each in trial.faults)])
