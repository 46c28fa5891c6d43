"""Response of a signal to its set point: overshoot, settling, time constant; and lost contact."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec_runner.record.file_array import full
from taskspec_runner.record.history import History
from taskspec_runner.record.history import Visit as Stay

Vector = NDArray[np.float64]

#: A signal has settled within this share of its set point, or of the step to it if that is larger.
SETTLED = 0.02
#: Bounds that are farther from a set point than this share of it are not there to settle within.
TIGHT = 0.1
#: A set point has to stay for so much of a visit, at its end [share].
_STAYS = 0.1
#: A change by less than this share of what it starts from or leads to is no step: what goes beyond
#: is no overshoot of it, but the blow of a touch or the start of a motion.
_STEP = 0.2
#: Smaller steps of a set point are not measured [N, N m].
_SMALLEST_STEP = 0.05
#: Two values of a set point that differ by less, relative to its size, are the same.
_SET_POINT_TOLERANCE = 1e-6
#: A decay is measured down to this share of where it began, and down to so many times what is
#: left of the error in the last fifth of a visit.
_DECAY_END, _ABOVE_REST = 0.02, 2.0
#: Ticks that a decay must last, and the factor by which it must fall, to be one.
_LEAST_TICKS, _LEAST_FALL = 10, np.e
#: Ticks of a longer decay that its line is fitted to, evenly spread.
_MOST_FITTED_TICKS = 1 << 17

Responses = dict[str, dict[str, dict[str, float | str | None]]]
#: Lowest and highest value that an expectation allows, by stage and signal.
Allowed = Mapping[tuple[str, str], tuple[float | None, float | None]]
#: Columns of the params that a set point follows from, by stage and signal.
Uses = Mapping[tuple[str, str], Collection[str]]


@dataclass(frozen=True, slots=True)
class Response:
    """The response to a set point.

    Attributes:
        set_point: value that the reference ends at [SI].
        step: to it, from the first tick [SI].
        overshoot: how far beyond it the signal went [SI], None without a step to it.
        settling_time: since the first tick, until the signal stays within `tolerance`; None if it
            never does [s].
        tolerance: largest distance from the set point that counts as settled, below and above [SI].
        time_constant: of the decay of the error once the set point stays; None where the error
            does not decay by itself [s].
        rest: mean over the last tenth of the visit [SI].
    """

    set_point: float
    step: float
    overshoot: float | None
    settling_time: float | None
    tolerance: tuple[float, float]
    time_constant: float | None
    rest: float


def response(
    values: Vector,
    reference: Vector,
    period: float,
    allowed: tuple[float | None, float | None] = (None, None),
    moves: Vector | None = None,
) -> Response | None:
    """The response of a visit or of its last part; None where the reference does not stay.

    Args:
        values: (n,) truth [SI].
        reference: (n,) of it [SI].
        period: between two ticks [s].
        allowed: lowest and highest value of an expectation [SI]; it takes the place of 2 % where
            the set point is between them and both are near to it.
        moves: (n,) reference of the motion that brings the signal about; the time constant counts
            from where it stays too.
    """
    known = np.isfinite(values) & np.isfinite(reference)
    if not known.any() or not known[-1]:
        return None
    target = float(reference[-1])
    steady = stays(reference)
    if len(values) - steady < max(_STAYS * len(values), 2):
        return None
    start = float(values[np.flatnonzero(known)[0]])
    step = target - start
    size = max(abs(step), abs(target))
    if size < _SMALLEST_STEP:
        return None
    low, high = allowed
    tolerance = (SETTLED * size, SETTLED * size)
    if low is not None and high is not None:
        sides = (target - low, high - target)
        if all(0 < side <= TIGHT * size for side in sides):
            tolerance = sides
    error = values - target
    outside = np.flatnonzero(~((error >= -tolerance[0]) & (error <= tolerance[1])))
    settled = int(outside[-1]) + 1 if len(outside) else 0
    return Response(
        target,
        step,
        max(float(np.nanmax(np.sign(step) * error)), 0.0) if abs(step) > _STEP * size else None,
        settled * period if settled < len(values) else None,
        tolerance,
        time_constant(error[max(steady, 0 if moves is None else stays(moves)) :], period),
        float(np.nanmean(values[-max(round(_STAYS * len(values)), 1) :])),
    )


def stays(reference: Vector) -> int:
    """The first tick from which a reference does not change any more."""
    last = reference[-1]
    changed = np.flatnonzero(
        ~(np.abs(reference - last) <= _SET_POINT_TOLERANCE * max(abs(last), _SET_POINT_TOLERANCE))
    )
    return int(changed[-1]) + 1 if len(changed) and np.isfinite(last) else 0


def time_constant(error: Vector, period: float) -> float | None:
    """The time in which the hull of a decaying error falls to 1/e of itself [s].

    The hull is the largest size that is still to come, so that an oscillation counts by its
    peaks. Its logarithm is fitted by a straight line down to 2 % of its beginning, or to twice
    what is left at the end. Of e^(-t/T) that is T, of a decaying oscillation the T of its hull.

    Args:
        error: (n,) from the set point, since that stays [SI].
        period: between two ticks [s].

    Returns:
        None where the error does not fall by e, or in fewer than ten ticks.
    """
    hull = np.maximum.accumulate(np.abs(error)[::-1])[::-1]
    # Until the largest error is reached nothing decays.
    hull = hull[int(np.argmax(hull < hull[0])) :] if len(hull) else hull
    if not len(hull) or not np.isfinite(hull).all() or hull[0] == 0.0:
        return None
    rest = float(hull[len(hull) - max(len(hull) // 5, 1)])
    floor = max(_DECAY_END * float(hull[0]), _ABOVE_REST * rest)
    rows = int(np.argmax(hull <= floor)) if (hull <= floor).any() else 0
    if rows < _LEAST_TICKS or floor * _LEAST_FALL > hull[0]:
        return None
    at = np.arange(0, rows, -(-rows // _MOST_FITTED_TICKS))
    slope = np.polyfit(at * period, np.log(hull[at]), 1)[0]
    return float(-1.0 / slope) if slope < 0 else None


def responses(
    history: History,
    signals: Mapping[str, Mapping[str, float | None]],
    period: float,
    allowed: Allowed,
    uses: Uses | None = None,
) -> Responses:
    """The responses of every visited stage; of several visits, the one that settled last.

    Where a set point was set meanwhile, the response is that to the last one, from where it began
    to go there.

    Args:
        history: the run.
        signals: stage to those of its signals that come to rest, and where; None where their
            reference says it [SI].
        period: between two ticks [s].
        allowed: what expectations allow.
        uses: columns of params that may be set, of the set points that follow from them.
    """
    found: Responses = {}
    for visit in history.visits():
        for name, target in signals.get(visit.stage, {}).items():
            columns = (uses or {}).get((visit.stage, name), ())
            began = _set_last(history, visit, columns)
            made = _of_rows(history, visit.stage, began, name, target, period, allowed)
            if made is None:
                continue
            own = found.setdefault(visit.stage, {})
            if name not in own or _later(made, own[name]):
                own[name] = made
    return found


def _set_last(history: History, visit: Stay, columns: Collection[str]) -> slice:
    """The rows of a visit since its params were last set; a param goes one way until it is."""
    first = visit.rows.start
    for column in columns:
        values = history.columns.get(column)
        if values is None:
            continue
        ways = np.sign(np.diff(values[visit.rows]))
        begins = np.flatnonzero((ways != 0) & (ways != np.concatenate([[0.0], ways[:-1]])))
        if len(begins):
            first = max(first, visit.rows.start + int(begins[-1]))
    return slice(first, visit.rows.stop)


def _of_rows(
    history: History,
    stage: str,
    rows: slice,
    name: str,
    target: float | None,
    period: float,
    allowed: Allowed,
) -> dict[str, float | str | None] | None:
    values, reference = (history.columns.get(column) for column in (name, f"{name}.ref"))
    if target is not None and values is not None:
        reference = full(len(values), target)
    if values is None or reference is None:
        return None
    band = allowed.get((stage, name), (None, None))
    motion = history.columns.get(f"position.{name.rpartition('.')[2]}.ref")
    moves = None if target is None or motion is None else motion[rows]
    made = response(values[rows], reference[rows], period, band, moves)
    if made is None:
        return None
    two_percent = SETTLED * max(abs(made.step), abs(made.set_point))
    by_band = made.tolerance != (two_percent, two_percent)
    return {
        "set_point": made.set_point,
        "step": made.step,
        # What a mechanism bears is no step that a loop is given: it follows from the motion.
        "overshoot": made.overshoot if target is None or of_an_axis(name) else None,
        "settling_time": made.settling_time,
        "below": made.tolerance[0],
        "above": made.tolerance[1],
        "settled_within": "expectation" if by_band else "2 %",
        "time_constant": made.time_constant,
        "rest": made.rest,
        "target": "set point" if target is None else "closed form",
    }


def of_an_axis(signal: str) -> bool:
    """Whether a force or moment is that of an axis, and not of a mechanism or an equation."""
    return signal.split(".")[0] in ("force", "torque")


def _later(one: Mapping[str, float | str | None], other: Mapping[str, float | str | None]) -> bool:
    times = (each["settling_time"] for each in (one, other))
    x, y = (np.inf if t is None else float(t) for t in times)
    return x > y


def contact_losses(
    history: History, stages: Sequence[str], period: float
) -> dict[str, dict[str, float]]:
    """Number and duration of the contact losses of stages.

    Args:
        history: the run.
        stages: those that are to hold a contact.
        period: between ticks [s].

    Returns:
        Stage to `losses`, how often contact ended after it had been made in the same visit, and
        `time` without contact after the first touch [s].
    """
    found: dict[str, dict[str, float]] = {}
    touching = history.columns.get("touching")
    if touching is None:
        return found
    for visit in history.visits():
        if visit.stage not in stages:
            continue
        on = touching[visit.rows] == 1
        own = found.setdefault(visit.stage, {"losses": 0, "time": 0.0})
        if on.any():
            since = on[int(np.argmax(on)) :]
            own["losses"] += int(np.count_nonzero(since[:-1] & ~since[1:]))
            own["time"] += float(np.count_nonzero(~since)) * period
    return found
