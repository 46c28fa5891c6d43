"""How long stages last, and the way through them that is planned."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, TRANSLATIONS, Axis
from taskspec.prediction.at_start import StageAtStart
from taskspec.prediction.forecast import Forecast, Signal, coming, moved, touching
from taskspec.prediction.types import Duration, Equilibrium, Impact, StagePrediction
from taskspec.program.flow import good_end
from taskspec.program.interval import ANY, Interval, point
from taskspec.program.sensor import SensorModel
from taskspec.program.walk.held_motion import coordinate_rate
from taskspec.spec import Stage
from taskspec.text.expression import Expression
from taskspec.text.expression.tree import Name, walk

#: How far a guard is looked for in a stage that nothing bounds [s].
_HORIZON = 600.0
#: What a mechanism bears at its stop, beyond any number that a guard compares it with.
_STOPPED = 1e9
#: Signals that a sensor may show late.
_CONTACT_SIGNALS = ("force", "torque", "touching")
_ENDS = {False: "ends", True: "end"}


@dataclass(frozen=True, slots=True)
class Known:
    """What has been told of a stage before its duration.

    Attributes:
        met: the impact.
        forces: equilibria by signal.
        coordinate: of the held mechanism as it begins [rad, m]; None where that is unknown.
    """

    met: Impact | None
    forces: Mapping[str, Equilibrium]
    coordinate: float | None


def planned(here: StageAtStart) -> Duration | None:
    """Duration of a stage that ends by its moves, path and time; None for one with a guard."""
    spec = here.stage.plan.spec
    if spec.until is not None:
        return None
    lasts = [spec.time or 0.0]
    carried = here.carried
    moved = [
        plan.mode.duration(carried.get(axis, 0.0))
        for axis, plan in here.stage.plan.plans.items()
        if plan.motion
    ]
    lasts += [duration for duration in moved if duration is not None]
    along = _path_duration(here)
    if along is None:
        return Duration(None, None, "its path is as long as where it begins makes it")
    expected = max([*lasts, along])
    path = here.stage.plan.path
    if path is not None and path.slowed is not None:
        share, least = 100 * here.stage.plan.path_share, here.stage.plan.least_share
        why = f"its path at nominal signals, which let it go at {share:.0f} % of its greatest speed"
        # From the greatest speed, with which it begins, to the least one.
        slowest = max([*lasts, along * here.stage.plan.path_share / least]) if least else math.inf
        most = min(here.stage.plan.longest, slowest)
        return Duration(expected if expected <= most else None, most, why)
    return Duration(expected, expected, "its moves, path and time")


def _path_duration(here: StageAtStart) -> float | None:
    """Of a stage's path [s], 0 without one; None where its length depends on where it begins."""
    path, start = here.stage.plan.path, here.coordinates
    joints, passage = here.stage.plan.joint_path, here.passage
    if joints is not None:
        whole = None if passage is None else joints.timing(passage.instants[0].q)
        return joints.time if whole is None else float(whole.rests)
    if path is None:
        return 0.0
    if start is None and path.form.unknown_length:
        return path.time
    zero = dict.fromkeys(AXES, 0.0)
    lasts = float(path.plan(zero if start is None else dict(start)).duration)
    share = here.stage.plan.path_share
    return lasts / share if share > 0 else math.inf


def guarded(here: StageAtStart, known: Known) -> Duration:
    """Duration of a stage that a guard ends."""
    spec = here.stage.plan.spec
    assert spec.until is not None
    most = None if spec.within is None else spec.within.time
    forecast = Forecast(here, _signals(here, known))
    expected = forecast.first(spec.until, _HORIZON if most is None else most)
    if expected is not None and _measured(spec.until):
        context = here.context
        sensor = SensorModel.of(context.loaded.task.robot.sensor, context.period)
        expected += sensor.lag(context.period) - context.period
    if expected is not None and (most is None or expected <= most):
        met = known.met if here.gap is not None else None
        return Duration(expected, most, "its guard" if met is None else f"comes to {met.contact}")
    return Duration(None, most, "nothing tells when its guard holds")


def _measured(guard: Expression) -> bool:
    """Whether a guard waits for a force, which a sensor may show late."""
    return any(isinstance(n, Name) and n.path[0] in _CONTACT_SIGNALS for n in walk(guard.tree))


def _signals(here: StageAtStart, known: Known) -> dict[str, Signal]:
    """All signals of a stage that can be told."""
    rates, along = _rates(here), _path_duration(here)
    found: dict[str, Signal] = {"t": point}
    if here.stage.plan.spec.path is not None and along is not None:
        found["path_done"] = lambda t: point(float(t >= along))
    found |= coming(rates, here.coordinates)
    met = known.met
    if met is not None and here.gap is not None and met.drag is not None:
        own = here.stage.plan.spring_of(met.axis, met.mass)
        if own > 0:
            found |= touching(here, met, own)
        # Where it is stopped by what it meets, the reference goes on alone.
        found |= {f"position.{a}": _unknown for a in TRANSLATIONS if rates.get(a)}
    found |= _mechanism(here, known)
    return found


def _unknown(_: float) -> Interval:
    return ANY


def _rates(here: StageAtStart) -> dict[Axis, float]:
    """Rates of motion axes that are constant [m/s, rad/s]."""
    found = {}
    for axis, plan in here.stage.plan.plans.items():
        if not plan.motion or plan.axis.has_force:
            continue
        rate = plan.mode.constant_rate(here.stage.plan.known)
        if rate is not None and math.isfinite(rate):
            found[axis] = rate
    return found


def _mechanism(here: StageAtStart, known: Known) -> dict[str, Signal]:
    """Coordinate of the held mechanism, and what it bears until it comes to its stop."""
    name, start = here.stage.plan.contacts.held, known.coordinate
    rate = mechanism_rate(here)
    if rate is None or start is None:
        return {}
    held = here.context.loaded.task.mechanisms[name]
    signal = f"{name}.{'torque' if held.angular else 'force'}"
    goes = known.forces[signal].value if signal in known.forces else 0.0
    low, high = held.stop or (-math.inf, math.inf)

    def coordinate(t: float) -> Interval:
        return point(min(max(start + moved(rate, t), low), high))

    def effort(t: float) -> Interval:
        if low < start + moved(rate, t) < high:
            return ANY if held.detent is not None else point(goes)
        return point(math.copysign(_STOPPED, rate))

    found: dict[str, Signal] = {signal: effort}
    found[f"{name}.{'angle' if held.angular else 'travel'}"] = coordinate
    return found


def mechanism_rate(here: StageAtStart) -> float | None:
    """Rate of the held mechanism [rad/s, m/s]; None where none is held, or it is not known."""
    if not here.stage.plan.contacts.held:
        return None
    return coordinate_rate(here.stage.plan)


def _times(duration: float | None, count: int) -> float | None:
    return None if duration is None else count * duration


def whole(stages: Mapping[str, Stage], found: Sequence[StagePrediction]) -> Duration:
    """Of the run, along the way on which every stage ends as planned."""
    durations = {stage.name: stage.duration for stage in found}
    way: list[str] = []
    name: str | None = next(iter(stages))
    while name is not None and name not in way:
        way.append(name)
        name = good_end(stages, name)
    if name is not None:
        return Duration(None, None, f"it comes back to {name!r}")
    turns = [n for n in way if stages[n].on_fail not in (None, "fail", "end")]
    branching = next((n for n in way if len(stages[n].next) > 1), None)
    if branching is not None:
        return Duration(None, None, f"conditions tell where {branching!r} leads")
    expected = [_times(durations[n].expected, stages[n].repeat) for n in way]
    most = [_times(durations[n].most, stages[n].repeat) for n in way]
    open_ = [n for n, time in zip(way, expected, strict=True) if time is None]
    why = "the stages in order"
    if open_:
        why = f"nothing tells when {' and '.join(map(repr, open_))} {_ENDS[len(open_) > 1]}"
    bounded = not turns and not any(time is None for time in most)
    return Duration(
        None if open_ else sum(t for t in expected if t is not None),
        sum(t for t in most if t is not None) if bounded else None,
        why,
    )
