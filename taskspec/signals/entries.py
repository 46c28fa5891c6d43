"""The signals of the language, each stated once.

The order is that of the log's columns and of the tables in docs/language/signals.md. A docstring
is what a signal means, as the documentation has it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from taskspec.geometry.axis import AXES, PAIRS, ROTATIONS, TRANSLATIONS, Axis, entry_dimension
from taskspec.signals.operations import acos, clip, dot, norm, stack
from taskspec.signals.situation import Situation
from taskspec.signals.table import MEASURED, REFERENCE, WORLD, WRENCH, Index, condition, signal
from taskspec.text.units import (
    ANGLE,
    ANGULAR_VELOCITY,
    DAMPING,
    FORCE,
    FREQUENCY,
    LENGTH,
    MASS,
    MOMENT,
    NUMBER,
    POWER,
    STIFFNESS,
    TIME,
    VELOCITY,
    Dimension,
)

if TYPE_CHECKING:
    import casadi as ca

_Value = TypeVar("_Value")

#: Force above which the tool touches [N].
TOUCHING = 0.5

#: Why a controller does not decide by what is lost before it.
_OF_THE_LINK = "it is known of a run, not to its stages; what may be lost says `--stop-after`"


def _both(linear: _Value, angular: _Value) -> dict[str, _Value]:
    """One value for every translation, another for every rotation."""
    return {axis: angular if axis.is_rotation else linear for axis in AXES}


@signal("clock", TIME, of=Index.CLOCK, low=0.0)
def _clock(at: Situation) -> ca.SX:
    """Time since the run began."""
    return at.clock


@signal("t", TIME, of=Index.CLOCK, low=0.0)
def _t(at: Situation) -> ca.SX:
    """Time since the stage began."""
    return at.t


@signal(
    "force",
    of=dict.fromkeys(TRANSLATIONS, FORCE),
    limit="force",
    framed=True,
    anywhere=True,
    sensed=WRENCH,
    beside=(REFERENCE, MEASURED),
)
def _force(at: Situation) -> ca.SX:
    """Contact force that the robot applies."""
    return at.frame.T @ at.applied[:3]


@signal(
    "torque",
    of=dict.fromkeys(ROTATIONS, MOMENT),
    group="force",
    limit="torque",
    framed=True,
    anywhere=True,
    sensed=WRENCH,
    beside=(REFERENCE, MEASURED),
)
def _torque(at: Situation) -> ca.SX:
    """Contact moment about the control point."""
    return at.frame.T @ at.applied[3:]


@signal(
    "position",
    of=_both(LENGTH, ANGLE),
    meanings=_both(
        "coordinate of the control point, as its kind of frame counts",
        "rotation vector since the stage began",
    ),
    framed=True,
    beside=(REFERENCE,),
)
def _position(at: Situation) -> Mapping[Axis, ca.SX]:
    return at.position


@signal(
    "velocity",
    of=_both(VELOCITY, ANGULAR_VELOCITY),
    meanings=_both(
        "velocity of the control point in the world, in the frame's axes",
        "rates of the tool in the world, in the frame's axes",
    ),
    limit="speed",
    framed=True,
    anywhere=True,
    beside=(REFERENCE,),
)
def _velocity(at: Situation) -> ca.SX:
    return stack(at.frame.T @ at.twist[:3], at.frame.T @ at.twist[3:])


@signal(
    "error",
    of=_both(LENGTH, ANGLE),
    meanings=_both(
        "motion reference minus position",
        "the same of rotations, as the law's `orientation` has it",
    ),
    framed=True,
    reference="a reference cannot depend on the error against itself",
    absent="no motion reference",
)
def _error(at: Situation) -> Mapping[Axis, ca.SX]:
    return at.error


@signal("gap", LENGTH, sensed=WORLD, absent="no surface to be near to")
def _gap(at: Situation) -> ca.SX | None:
    """Signed distance of the tool's shape from the nominal contact's object."""
    return None if at.contact is None else at.objects[at.contact].distance


@signal("tilt", ANGLE, low=0.0, high=math.pi, framed=True)
def _tilt(at: Situation) -> ca.SX:
    """Angle between the tool's axis and −z of the frame."""
    return acos(clip(-dot(at.tip.R[:, 2], at.frame[:, 2]), -1, 1))


@signal("speed", VELOCITY, low=0.0, limit="speed")
def _speed(at: Situation) -> ca.SX:
    """Speed of the tip."""
    return norm(at.world.twist[:3])


@signal("travel", LENGTH, low=0.0)
def _travel(at: Situation) -> ca.SX:
    """Straight distance of the tip from the stage's start."""
    return norm(at.world.p - at.start)


@condition("touching", sensed=WRENCH)
def _touching(at: Situation) -> ca.SX:
    """The contact force exceeds 0.5 N."""
    return norm(at.applied[:3]) > TOUCHING


@signal("power", POWER, sensed=WRENCH)
def _power(at: Situation) -> ca.SX:
    """Force · velocity + moment · rate of turn."""
    force, velocity = at.six("force"), at.six("velocity")
    return dot(stack(*(force[a] for a in at.axes)), stack(*(velocity[a] for a in at.axes)))


@condition("path_done")
def _path_done(at: Situation) -> ca.SX:
    """The stage's path is at its end."""
    return at.path_done


@signal("force_inconsistent", FORCE, low=0.0)
def _force_inconsistent(at: Situation) -> ca.SX:
    """Of the force set points, what contacts cannot return; 0 without `solve: qp`."""
    return at.force_inconsistent


@signal(
    "joint_error",
    ANGLE,
    low=0.0,
    reference="a reference cannot depend on the error against itself",
)
def _joint_error(at: Situation) -> ca.SX:
    """Of the joint farthest from its reference on a path of `joints`; 0 in other stages."""
    return at.joint_error


@condition("limited")
def _limited(at: Situation) -> ca.SX:
    """A limit changed the torque; in guards, of the tick before."""
    return at.limited


@signal("position", ANGLE, of=Index.JOINT, beside=(REFERENCE,))
def _joint_position(at: Situation, number: str) -> ca.SX:
    """Position of joint N, counted from 1; `.ref` on a path of `joints`."""
    return at.q[int(number) - 1]


@signal("velocity", ANGULAR_VELOCITY, of=Index.JOINT)
def _joint_velocity(at: Situation, number: str) -> ca.SX:
    """Velocity of joint N."""
    return at.v[int(number) - 1]


@signal(
    "torque",
    MOMENT,
    of=Index.JOINT,
    reference="a reference cannot depend on the torque that follows from it",
)
def _joint_torque(at: Situation, number: str) -> ca.SX:
    """Torque commanded to joint N; of an arm that takes no torques, what its drive exerts."""
    return at.torque[int(number) - 1]


@signal(
    "disturbance",
    MOMENT,
    of=Index.JOINT,
    output="disturbance",
    reference="a reference cannot depend on an estimate that follows from it",
    absent="its law has no disturbance observer",
    given="law: {disturbance_observer: 20 Hz}",
)
def _joint_disturbance(at: Situation, number: str) -> ca.SX | None:
    """What a law's disturbance observer estimates to push joint N beside the measured force."""
    return None if at.disturbance is None else at.disturbance[int(number) - 1]


@signal("visits", NUMBER, of=Index.STAGE, low=0.0, counted=True)
def _visits(at: Situation, stage: str) -> ca.SX:
    """How often a stage has been entered."""
    return at.visits[stage]


@signal("late", TIME, of=Index.LINK, low=0.0, unmeasured=_OF_THE_LINK)
def _late(at: Situation) -> None:
    """How late what came for the tick came; 0 in the process and in lock-step."""


@signal("lost", NUMBER, of=Index.LINK, low=0.0, counted=True, unmeasured=_OF_THE_LINK)
def _lost(at: Situation) -> None:
    """How many in a row did not come, up to the tick; 0 in the process and in lock-step."""


def _gain(name: str, dimension: Dimension, what: str) -> None:
    """Enters a gain, on every entry of its matrix."""
    dimensions = {on: entry_dimension(dimension, on) for on in (*AXES, *PAIRS)}

    @signal(
        name,
        of=dimensions,
        meanings=dict.fromkeys(dimensions, what),
        unmeasured="a law makes its gains of measurements: write the gain's own expression",
        absent="a gain that does not vary",
    )
    def _value(at: Situation, on: str) -> None:
        """What the law had."""


_gain("mass", MASS, "apparent mass of a law, where it varies")
_gain("stiffness", STIFFNESS, "stiffness of a law, where it varies")
_gain("damping", DAMPING, "damping of a law, where it varies or follows what does")
_gain("force.proportional", NUMBER, "proportional gain of a force loop, where it varies")
_gain("force.integral", FREQUENCY, "integral gain of a force loop, where it varies or follows")
_gain("force.damping", DAMPING, "damping of a force loop, where it follows an estimate")


def _grip(name: str, dimension: Dimension, meaning: str) -> None:
    """Enters a signal of the gripper."""

    @signal(
        name,
        dimension,
        of=Index.GRIP,
        meanings={"": meaning},
        low=0.0,
        reference="a reference cannot depend on what the gripper reports",
        absent="no stage grips",
        given="a stage with grip: {object: NAME, force: 20 N}",
    )
    def _value(at: Situation) -> ca.SX | None:
        return at.grip.get(name)


_grip("force", FORCE, "what each jaw presses with, as the gripper reports it; 0 with nothing in it")
_grip("slip", LENGTH, "how far what is gripped has slid on the pads since the command last changed")
_grip("command", FORCE, "what each jaw is commanded to press with; 0 opens the gripper")
_grip("load", MASS, "mass that has been handed to the arm's model")


def _energy(name: str, meaning: str, unmeasured: str = "") -> None:
    """Enters an energy [J] or a power [W] of a stage's law, which states it (`laws.energy`)."""
    stored = name.startswith("energy.")

    @signal(
        name,
        MOMENT if stored else POWER,
        of=Index.ENERGY,
        meanings={"": meaning},
        unit="J" if stored else "",
        reference="a reference cannot depend on an energy that follows from it",
        unmeasured=unmeasured,
        absent="its law states no such energy, or the log lacks what it is worked out of",
        given="a law that stores energy, such as law: {kind: impedance}",
    )
    def _value(at: Situation) -> ca.SX | None:
        return at.energies().get(name)


def _payload(name: str, dimension: Dimension, meaning: str, number: int) -> None:
    """Enters a number of the payload that laws adapt to (`laws.adaptation`)."""

    @signal(
        f"payload.{name}",
        dimension,
        of=Index.PAYLOAD,
        meanings={"": meaning},
        reference="a reference cannot depend on what is estimated while it is followed",
        absent="no law adapts to a payload",
        given="law: {adapt: payload}",
    )
    def _value(at: Situation) -> ca.SX | None:
        known = at.payload is not None and at.payload.numel()
        return at.payload[number] if known else None


_payload("mass", MASS, "mass of the payload, as a law that adapts has it", 0)
for _number, _axis in enumerate("xyz", start=1):
    _payload(_axis, LENGTH, f"its centre along the tool's {_axis}, from the tip", _number)


_OF_A_RUN = "it is worked out of ticks that are past; judge it in 'expect'"
_energy("energy.kinetic", "of the mass that the law moves: the arm's own, or its apparent one")
_energy("energy.spring", "of the law's springs, ½ eᵀ K e")
_energy("energy.stored", "the law's storage function: the sum of both")
_energy("energy.contact", "of the surfaces that are pressed in, ½ k d² each", _OF_A_RUN)
_energy(
    "energy.lyapunov",
    "stored, with that of the contact, less what both are at rest: (4.22), (4.28)",
    _OF_A_RUN,
)
_energy("power.contact", "of the environment on the tool, force · velocity: into the storage")
_energy("power.reference", "what a reference that moves puts into the storage")
_energy("power.force", "what set points and errors of forces put in")
_energy("power.integral", "what the integrals of force loops put in")
_energy("power.dissipated", "what the law's dampers take out")
_energy("power.gains", "what gains that vary put in: ½ eᵀ K' e", _OF_A_RUN)


def _tank(name: str, dimension: Dimension, meaning: str, **facts: Any) -> None:
    """Enters what a tick makes of a law's energy tank (`laws.tank`)."""

    @signal(
        f"tank.{name}",
        dimension,
        of=Index.TANK,
        meanings={"": meaning},
        reference="a reference cannot depend on a tank that pays for it",
        absent="its law has no tank",
        given="law: {tank: 2 J}",
        **facts,
    )
    def _value(at: Situation) -> ca.SX | None:
        return at.tank.get(f"tank.{name}")


_SHARE = {"low": 0.0, "high": 1.0}
_tank("energy", MOMENT, "what is in the energy tank of the law", unit="J")
_tank("power", POWER, "what has left it over the last period for what is not passive")
_tank("filled", POWER, "what dampers have put into it over the last period")
_tank("spring", NUMBER, "share of the law's springs that it grants", **_SHARE)
_tank("share", NUMBER, "share of what else the law commands that it grants", **_SHARE)
_tank("refused", NUMBER, "1 less the smaller of both: what it refuses", **_SHARE)


def _estimate(name: str) -> None:
    """Enters what a law estimates along its force axes; see `laws.contact_stiffness`."""

    @signal(
        name,
        STIFFNESS,
        of=Index.ESTIMATE,
        meanings={"": _ESTIMATES[name]},
        low=0.0,
        reference="a reference that follows what is estimated from it would close another loop",
        absent="an axis without a force, or a law without `estimate`",
        given="law: {estimate: 1..200 kN/m}, on an axis with a force",
    )
    def _value(at: Situation, axis: str) -> ca.SX | None:
        return at.estimates.get(name, {}).get(Axis(axis))


_ESTIMATES = {
    "stiffness": "stiffness of the contact along an axis, as it is estimated",
    "deviation": "standard deviation of that",
    "followed": "stiffness that designed gains of the axis are those for",
}
for _each in _ESTIMATES:
    _estimate(_each)


@signal(
    "gap",
    of={
        "equation": LENGTH,
        "rotation equation": ANGLE,
        "joint equation": ANGLE,
        "exact equation": LENGTH,
        "exact rotation equation": ANGLE,
        "exact joint equation": ANGLE,
    },
    meanings={
        "equation": "distance of the tip along the unit gradient, left minus right over its "
        "gradient; `.ref` is that of the joints' references",
        "rotation equation": "the same of the tip's rotation",
        "joint equation": "the same in joint space",
        "exact equation": "its drift, as of an `equation`",
        "exact rotation equation": "its drift, as of a `rotation equation`",
        "exact joint equation": "its drift, as of a `joint equation`",
    },
    beside=(REFERENCE,),
)
@signal(
    "gap", of={"shape": LENGTH}, meanings={"shape": "signed distance of the tool's shape from it"}
)
def _object_gap(at: Situation, name: str) -> ca.SX | None:
    return at.objects[name].distance


@signal("angle", of={"hinge": ANGLE, "screw": ANGLE})
def _object_angle(at: Situation, name: str) -> ca.SX | None:
    """Its coordinate, over several turns."""
    return at.objects[name].coordinate


@signal(
    "travel",
    of={"slide": LENGTH, "screw": LENGTH},
    meanings={"slide": "its coordinate", "screw": "its travel along the axis"},
)
def _object_travel(at: Situation, name: str) -> ca.SX | None:
    return at.objects[name].travel


@signal(
    "force",
    of={"shape": FORCE},
    low=0.0,
    unmeasured="the robot does not measure the force of one object; use norm(force)",
)
def _object_force(at: Situation, name: str) -> ca.SX | None:
    """Magnitude of the contact force with it."""
    return at.objects[name].effort


@signal(
    "force",
    of={"equation": FORCE, "exact equation": FORCE},
    meanings={
        "equation": "what the robot applies along the unit gradient",
        "exact equation": "as of an `equation`",
    },
    beside=(REFERENCE, MEASURED),
)
@signal(
    "torque",
    of={
        "rotation equation": MOMENT,
        "joint equation": MOMENT,
        "exact rotation equation": MOMENT,
        "exact joint equation": MOMENT,
    },
    meanings={
        "rotation equation": "the moment that the robot applies along the unit gradient",
        "joint equation": "the same in joint space",
        "exact rotation equation": "as of a `rotation equation`",
        "exact joint equation": "as of a `joint equation`",
    },
    beside=(REFERENCE, MEASURED),
)
@signal(
    "lambda",
    of={
        "exact equation": FORCE,
        "exact rotation equation": MOMENT,
        "exact joint equation": MOMENT,
    },
    meanings={
        "exact equation": "the multiplier of (4.77) along the unit gradient, with the sign of "
        "`force`, of which it is the true value",
        "exact rotation equation": "the same of the tip's rotation, with the sign of `torque`",
        "exact joint equation": "the same in joint space, with the sign of `torque`",
    },
    unmeasured="the robot does not know a multiplier; what it measures of it is the force or "
    "torque of the equation",
)
@signal(
    "force",
    of={"slide": FORCE},
    meanings={"slide": "what the robot applies to it along its axis"},
)
@signal(
    "torque",
    of={"hinge": MOMENT, "screw": MOMENT},
    meanings={
        "hinge": "what the robot applies to it about its axis",
        "screw": "what the robot applies to its coordinate",
    },
)
def _object_effort(at: Situation, name: str) -> ca.SX | None:
    return at.objects[name].effort


_RESIDUALS = {
    "equation": "what its constraint cannot make of its `generalised` set point: "
    "the length of u_φ,d − J_φᵀ λ_d",
    "rotation equation": "the same",
    "joint equation": "the same",
    "exact equation": "as of an `equation`",
    "exact rotation equation": "as of a `rotation equation`",
    "exact joint equation": "as of a `joint equation`",
}


@signal(
    "residual",
    of=dict.fromkeys(_RESIDUALS, MOMENT),
    meanings=_RESIDUALS,
    low=0.0,
    output="reaction_residual",
    unmeasured="it says how a set point fits its constraint, which nothing measured changes; judge "
    "it in 'expect'",
)
def _object_residual(at: Situation, name: str) -> None:
    """Joint torques that no force of the constraint makes."""


def _of_bushings() -> None:
    """Enters the components of what bushings have along and about their own axes."""
    for axis in AXES:
        about = "about" if axis.is_rotation else "along"

        def place(at: Situation, name: str, row: int = axis.row) -> ca.SX | None:
            found = at.objects[name].displacement
            return None if found is None else found[row]

        def effort(at: Situation, name: str, row: int = axis.row) -> ca.SX | None:
            found = at.objects[name].wrench
            return None if found is None else found[row]

        meaning = "rotation vector of the tip" if axis.is_rotation else "place of the tip"
        signal(
            f"position.{axis}",
            of={"bushing": axis.of(LENGTH)},
            meanings={"bushing": f"{meaning} from the rest pose, {about} its {axis.letter}"},
        )(place)
        signal(
            f"{axis.effort}.{axis}",
            of={"bushing": axis.of(FORCE)},
            meanings={
                "bushing": f"what the robot applies to it at the tip, {about} its {axis.letter}"
            },
            unmeasured="the robot does not measure the force of one object; use norm(force)",
        )(effort)


_of_bushings()
