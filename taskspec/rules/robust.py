"""Sliding terms and disturbance observers: what their conditions ask of a file."""

from __future__ import annotations

import math
from collections.abc import Iterator

from taskspec.geometry.axis import Axis
from taskspec.laws import disturbance, sliding
from taskspec.laws.gains import SLIDING_GAIN, SLIDING_LAYER, value_of
from taskspec.program.plan import StagePlan
from taskspec.program.sensor import SensorModel
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.spec import KeyPath, key_of
from taskspec.stability.gain_paths import gain_path, law_path
from taskspec.statics.sliding_layer import sliding_layers
from taskspec.text.units import FREQUENCY, TIME, number, scaled, show

#: From here on s grows from tick to tick.
_GROWS = 2.0
#: An observer is to be stable with an arm of 1 / this inertia, whose torque is so many ticks late.
_LIGHTER, _LATE = 2.0, 1
#: The greatest part of a contact's force that an estimate may have.
_MOST_LEFT = 0.5
#: What is proposed is inside of a boundary by this part.
_INSIDE = 0.95


@rule({}, also=("TS143", "TS414"), phase=Phase.AXES)
def fitting_keys(stage: StagePlan) -> Iterator[Finding]:
    """Numbers for another arm, a sliding term without real roots or in a mechanism's own form."""
    context, law = stage.context, stage.law
    place, n = law_path(context, stage.name), context.robot.n
    slides, observer = law.sliding, law.disturbance_observer
    owned = {
        key_of(place.sliding.joint_torque): () if slides is None else slides.joint_torque,
        key_of(place.disturbance_observer.torque): () if observer is None else observer.torque,
    }
    for where, given in owned.items():
        if given and len(given) not in (1, n):
            yield error(
                "TS414",
                f"{len(given)} values for the {n} joints of {context.robot.name!r}",
                where,
                "one value for all joints, or one for each",
                unless=("TS414",),
                stops=True,
            )
    if slides is None or stage.joint_path is not None:
        return
    for axis in sliding.sliding_axes(stage.gains):
        ratio = value_of(stage.gains, "damping_ratio", axis)
        if ratio < 1:
            yield error(
                "TS143",
                f"a sliding term needs a motion loop of real roots, and {axis!r} has a damping "
                f"ratio of {number(ratio, 3)}",
                gain_path(context, stage.name, "damping_ratio", axis),
                "damping_ratio: 1, or leave it out",
                unless=("TS143",),
            )
    if stage.consistent:
        yield error(
            "TS143",
            f"stage {stage.name!r} holds a mechanism, and the form of its law for that does not "
            "slide: what the mechanism pushes with is no error of the arm's model",
            key_of(place.sliding),
            "give the stage a law of its own, without 'sliding'",
            unless=("TS143",),
        )


@rule(
    {
        "TS351": "a boundary layer that a tick overshoots",
        "TS352": "a switching gain that its bounds do not allow",
    },
    phase=Phase.PATH,
)
def layers(stage: StagePlan) -> Iterator[Finding]:
    """The conditions of a sliding term: K reaches the layer, and no tick leaps over it."""
    for each in sliding_layers(stage):
        if each.left <= 0:
            yield error(
                "TS352",
                f"no switching gain holds against these bounds in stage {stage.name!r}: what it "
                f"commands would add {number(1 - each.left, 3)} of itself to what is not known",
                key_of(law_path(stage.context, stage.name).sliding),
                "state a smaller payload or uncertainty",
                unless=("TS352",),
            )
            return
        if each.least > each.gain:
            yield _short(stage, each.axis, each.gain, each.least)
        if each.taken > 1:
            yield _thin(stage, each.axis, each.gain, each.taken)


def _short(stage: StagePlan, axis: Axis, K: float, least: float) -> Finding:
    shown = (SLIDING_GAIN.text(value, angular=axis.is_rotation) for value in (K, least))
    given, wanted = shown
    text = f"the switching gain of {axis!r} is {given}, and its bounds need {wanted}: the layer is "
    place = gain_path(stage.context, stage.name, SLIDING_GAIN.name, axis)
    hint = "leave the gain out, so that it follows from the bounds"
    return warning("TS352", text + "left", place, hint, unless=("TS352",))


def _thin(stage: StagePlan, axis: Axis, K: float, steps: float) -> Finding:
    gains, turns = stage.gains, axis.is_rotation
    thinnest = sliding.least_layer(gains, axis, K, stage.context.period) / _INSIDE
    layer = SLIDING_LAYER.text(value_of(gains, SLIDING_LAYER.name, axis), angular=turns)
    what = "and grows" if steps >= _GROWS else "and comes back by the next"
    text = (
        f"the layer of {layer} on {axis!r} is too thin for a switching gain of "
        f"{SLIDING_GAIN.text(K, angular=turns)}: each tick takes off {number(steps, 3)} times the "
        f"distance from s = 0, so that s changes its sign {what}"
    )
    place = gain_path(stage.context, stage.name, SLIDING_LAYER.name, axis)
    hint = f"a layer of {SLIDING_LAYER.text(thinnest, angular=turns)}, or smaller bounds"
    kind = error if steps >= _GROWS else warning
    return kind("TS351", text, place, hint, unless=("TS351",))


@rule(
    {
        "TS519": "a disturbance observer that is quicker than its loop",
        "TS520": "a disturbance observer that is quicker than the force sensor",
    },
    phase=Phase.PATH,
)
def quick_observers(stage: StagePlan) -> Iterator[Finding]:
    """Bandwidths of observers, against a lighter arm with late torques, and against the sensor."""
    observer, context = stage.observer, stage.context
    if observer is None:
        return
    place = _bandwidth_of(stage)
    T, f = context.period, observer.bandwidth
    step, largest = 1 - observer.pole, disturbance.largest_step(_LATE)
    if _LIGHTER * step > largest:
        most = -math.log(1 - largest / _LIGHTER) / (2 * math.pi * T)
        yield warning(
            "TS519",
            f"the observer takes {number(step, 2)} of what is new in each tick: with half the "
            f"inertia, and torques that come a tick late, {number(_LIGHTER * step, 3)} is more "
            f"than the {number(largest, 3)} up to which that is stable",
            place,
            f"a bandwidth of {show(_INSIDE * most, 'Hz', 3)} or less",
            unless=("TS519",),
        )
    lag = SensorModel.of(context.loaded.task.robot.sensor, T).lag(T) - T
    left = disturbance.share_left(f, lag)
    if stage.contacts.pressed and left > _MOST_LEFT:
        yield warning(
            "TS520",
            f"the force sensor is {scaled(lag, TIME, 2)} late, and up to {number(100 * left, 2)} % "
            f"of a contact's force counts as a disturbance in stage {stage.name!r}",
            place,
            f"a bandwidth of {scaled(1 / (2 * math.pi * lag), FREQUENCY, 2)} or less, or a quicker "
            "sensor",
            unless=("TS520",),
        )


def _bandwidth_of(stage: StagePlan) -> KeyPath:
    """Where the file has it; its short form has no key of its own."""
    place = law_path(stage.context, stage.name).disturbance_observer
    has = stage.context.loaded.has(place.bandwidth)
    return place.bandwidth if has else place
