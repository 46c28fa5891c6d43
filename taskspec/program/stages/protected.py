"""Bounds of `robot.protection` that a run watches: speeds, and the wrench of the contact."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca

from taskspec.program import events
from taskspec.program.events import Condition, Event
from taskspec.program.plan import StagePlan
from taskspec.program.reference.measurement import Measurement
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.spec.protection import Protection
from taskspec.text.units import ANGULAR_VELOCITY, FORCE, MOMENT, VELOCITY, Dimension, show

#: The name of the events.
PROTECTION = "protection"
_SPEED = "speed of joint"
#: Groups with keys that are watched: what it is, and what it measures. Joints have their own units.
_TIP = "speed of the tip"
_TURN = "rate at which the tool turns"
_WATCHED = {
    ("tip", "speed"): (_TIP, VELOCITY),
    ("turn", "speed"): (_TURN, ANGULAR_VELOCITY),
    ("reflex", "force"): ("reflex at a force", FORCE),
    ("reflex", "torque"): ("reflex at a torque", MOMENT),
    ("sensor", "force"): ("range of the sensor, force", FORCE),
    ("sensor", "torque"): ("range of the sensor, torque", MOMENT),
}


def protection_conditions(plan: StagePlan, measurement: Measurement) -> Iterator[Condition]:
    """Conditions that end a run where a robot's own controller would; none without a protection.

    Speeds are those of the joints' and the tip's measured velocities against the world, forces
    those of the measured contact wrench at the tip.
    """
    protection = plan.context.loaded.task.robot.protection
    if protection is None:
        return
    yield from _joints(plan, measurement, protection)
    twist, wrench = measurement.world.twist, measurement.inputs.contact
    sizes = {
        ("tip", "speed"): ca.norm_2(twist[:3]),
        ("turn", "speed"): ca.norm_2(twist[3:]),
        **{
            (group, key): ca.norm_2(part)
            for group in ("reflex", "sensor")
            for key, part in (("force", wrench[:3]), ("torque", wrench[3:]))
        },
    }
    for key, group in protection.groups:
        for name, bound in group.given:
            if (key, name) in _WATCHED:
                words, dimension = _WATCHED[key, name]
                assert isinstance(bound, float)
                text = f"{PROTECTION}: {words}: {show(bound, dimension, 5)}"
                value = sizes[key, name]
                yield Condition(Event(events.LIMIT, PROTECTION, text), value > bound, value)


def _joints(
    plan: StagePlan, measurement: Measurement, protection: Protection
) -> Iterator[Condition]:
    robot, v = plan.context.robot, measurement.inputs.v
    speeds = () if protection.joints is None else protection.joints.speed or ()
    for i, joint in enumerate(robot.joint_names if speeds else ()):
        bound = speeds[i if len(speeds) > 1 else 0]
        unit = VELOCITY.on(rotation=turns_at(robot, i))
        text = f"{PROTECTION}: {_SPEED} {i + 1} ({joint}): {show(bound, unit, 5)}"
        yield Condition(Event(events.LIMIT, PROTECTION, text), ca.fabs(v[i]) > bound, v[i])


def dimension_watched(text: str, *, turns: bool) -> Dimension:
    """The dimension of the value of an event of a protection.

    Args:
        text: of the event.
        turns: whether the joint that it names is a hinge.
    """
    words = text.removeprefix(f"{PROTECTION}: ")
    for named, dimension in _WATCHED.values():
        if words.startswith(named):
            return dimension
    return VELOCITY.on(rotation=turns)


def about_force(text: str) -> bool:
    """Whether an event of a protection is about the wrench of the contact."""
    return dimension_watched(text, turns=True) in (FORCE, MOMENT)
