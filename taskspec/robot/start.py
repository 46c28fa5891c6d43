"""The start of a run, and the errors of an impossible one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from taskspec.robot.errors import RobotError
from taskspec.robot.inverse_kinematics import (
    SOLVED,
    InverseKinematics,
    Target,
    least_turn,
    turns_at,
)
from taskspec.robot.types import RobotModel
from taskspec.text.codes import register
from taskspec.text.units import ANGLE, LENGTH, describe, fitting, in_unit, noun, number, show

register(
    {
        "TS411": "joint positions that do not fit the robot",
        "TS412": "a start out of reach",
        "TS413": "an orientation that the robot cannot take at its start",
    }
)

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

_POSITION_FIRST = 300.0
_ROTATION_FIRST = 0.003
_FEWER_RESTARTS = 10
_FARTHEST_TARGET = 100.0


def solve_start(
    model: RobotModel,
    xyz: Sequence[float] | None = None,
    rpy: Sequence[float] | None = None,
    joints: Sequence[float] | None = None,
) -> Array:
    """The configuration in which a run starts.

    Args:
        model: The robot.
        xyz: (3,) position of the tool tip in the world [m].
        rpy: (3,) orientation of the tip frame in the world [rad]. None points the tool of an arm
            that can turn it about every axis straight down, turned about the vertical as at home
            or, where that is out of reach, with another orientation; it leaves other arms free. Of
            a planar arm's tool the yaw is the direction in the plane, counted from x; roll and
            pitch are zero.
        joints: (n,) joint positions instead [rad or m]; those that carry a dimension have to be
            angles for hinges and lengths for slides.

    Returns:
        Joint positions (n,) inside the limits: the solution nearest home whose pose is exact to
        1e-9 m and 1e-9 rad; home itself when nothing is given.

    Raises:
        RobotError: TS411 for joint positions that do not fit, TS412 for a position out of reach,
            TS413 for an orientation that cannot be taken there.
    """
    if joints is not None:
        return _checked(model, joints)
    if xyz is None:
        if rpy is not None:
            raise RobotError(
                "TS413", "the start has an orientation and no position", "add xyz", ("start", "rpy")
            )
        return model.home.copy()
    solver = InverseKinematics(model)
    position = np.array(xyz, dtype=float)
    target = Target(_aim(model, position), _rotation(model, solver, rpy))
    q, missing = solver.nearest_home(target)
    if missing <= SOLVED:
        return q
    closest, short = solver.nearest_home(Target(target.position), _FEWER_RESTARTS)
    if short > SOLVED:
        raise _out_of_reach(model, solver, closest, position)
    spatial = "z" in model.axes
    if spatial:
        turned = replace(target, any_yaw=True)
        q, missing = solver.nearest_home(turned, _FEWER_RESTARTS)
        if missing <= SOLVED:
            if rpy is None:
                return q
            raise _other_yaw(solver, target, q)
        target = turned
    raise _turned(solver, target, closest, given=rpy is not None)


def _aim(model: RobotModel, position: Array) -> Array:
    """The point (3,), brought to 100 m from the first joint if it is farther away."""
    base = model.pin.jointPlacements[1].translation
    distance = math.dist(position, base)
    if distance <= _FARTHEST_TARGET:
        return position
    aim: Array = base + (position - base) * (_FARTHEST_TARGET / distance)
    return aim


def _rotation(
    model: RobotModel, solver: InverseKinematics, rpy: Sequence[float] | None
) -> Array | None:
    if rpy is None:
        if not {"rx", "ry", "rz"} <= set(model.axes):
            return None
        return least_turn(np.diag([1.0, -1.0, -1.0]), solver.pose(model.home).rotation)
    if "z" in model.axes:
        turned: Array = pin.rpy.rpyToMatrix(*(float(angle) for angle in rpy))
        return turned
    if "rz" not in model.axes:
        raise RobotError(
            "TS413",
            f"'{model.name}' cannot choose an orientation, only {' and '.join(model.axes)}",
            "leave rpy out",
            ("start", "rpy"),
        )
    if rpy[0] or rpy[1]:
        raise RobotError(
            "TS413",
            f"'{model.name}' turns about z alone, so roll and pitch are zero",
            "rpy: [0, 0, yaw] points the tool in the plane, yaw counted from x",
            ("start", "rpy"),
        )
    at_home = solver.pose(model.home).rotation
    heading = at_home[:, 2] if abs(at_home[2, 2]) < 0.5 else at_home[:, 0]
    yaw = float(rpy[2]) - float(np.arctan2(heading[1], heading[0]))
    planar: Array = pin.rpy.rpyToMatrix(0.0, 0.0, yaw) @ at_home
    return planar


def _other_yaw(solver: InverseKinematics, target: Target, q: Array) -> RobotError:
    """The error of an orientation that is reached at `q` (n,), but with another yaw."""
    assert target.rotation is not None
    possible = solver.pose(q).rotation
    turn = np.degrees(np.linalg.norm(pin.log3(possible @ target.rotation.T)))
    about_z = least_turn(target.rotation, possible) @ target.rotation.T
    yaw = np.degrees(np.arctan2(about_z[1, 0], about_z[0, 0]))
    return RobotError(
        "TS413",
        f"the arm reaches {_point(target.position)}, but not with this yaw",
        f"with the tool turned about the vertical by {yaw:+.1f} deg it does"
        if turn > 0.05
        else "give another yaw",
        ("start", "rpy"),
    )


def _turned(solver: InverseKinematics, target: Target, q: Array, *, given: bool) -> RobotError:
    """The error of a point that is reached, at `q` (n,), but not with the orientation given."""
    q, _ = solver.descend(q, replace(target, weight=_POSITION_FIRST))
    short = np.degrees(np.linalg.norm(solver.error(q, target)[3:]))
    orientation = "as rpy asks" if given else "straight down"
    choice = "give another rpy" if given else "give an rpy"
    aside = next((r.hint for r in solver.robot.remarks if r.code == "TS441"), "")
    if aside:
        choice = (
            f"the tool does not go where the arm does: {aside.partition(';')[0]}; else {choice}"
        )
    place = _place_for(solver, target, q)
    return RobotError(
        "TS413",
        f"the arm reaches {_point(target.position)}, but not with the tool {orientation}: "
        f"it misses that by {short:.1f} deg",
        choice if place is None else f"{choice}, or start at {_point(place)}, where it can",
        ("start", "rpy" if given else "xyz"),
    )


def _place_for(solver: InverseKinematics, target: Target, q: Array) -> Array | None:
    """A point (3,) near the target, in whole millimetres, at which its rotation is possible."""
    for start in (q, solver.robot.home):
        nearest, _ = solver.descend(start, replace(target, weight=_ROTATION_FIRST))
        found = solver.pose(nearest).translation
        inwards = solver.pose(solver.robot.home).translation - found
        for share in (0.0, 0.02, 0.1):
            place: Array = np.round(found + share * inwards, 3)
            if "z" not in solver.robot.axes:
                place[2] = target.position[2]
            if solver.descend(nearest, replace(target, position=place))[1] <= SOLVED:
                return place
    return None


def _out_of_reach(
    model: RobotModel, solver: InverseKinematics, closest: Array, wanted: Array
) -> RobotError:
    """The error of a point that is not reached with any orientation."""
    base = model.pin.jointPlacements[1].translation
    nearest = solver.pose(closest).translation
    reach, wanted_distance = math.dist(nearest, base), math.dist(wanted, base)
    side = "reaches" if wanted_distance > reach else "comes no nearer than"
    return RobotError(
        "TS412",
        f"the tool tip cannot get to the start: it misses it by "
        f"{_length(math.dist(wanted, nearest))}",
        f"that way the arm {side} {reach:.3f} m from its first joint, and the start is "
        f"{_metres(wanted_distance)} m from it; the nearest point is {_point(nearest)}",
        ("start", "xyz"),
    )


def _point(point: Array) -> str:
    x, y, z = (_metres(float(value)) for value in point)
    return f"[{x}, {y}, {z}] m"


def _metres(length: float) -> str:
    return f"{length:z.3f}" if abs(length) < 1e4 else f"{length:.4g}"


def _length(length: float) -> str:
    return f"{1e3 * length:.1f} mm" if length < 10 else f"{_metres(length)} m"


def check_joints(
    model: RobotModel, joints: Sequence[float], of: str, field: tuple[str, ...]
) -> None:
    """Checks that joint positions of a task file fit the robot's joints, but not their limits.

    Args:
        model: The robot.
        joints: (n,) joint positions [rad or m]; one that carries a `dimension` has to be an angle
            for a hinge and a length for a slide.
        of: What they belong to, such as `the start`.
        field: Where in a task file's `robot` section they stand.

    Raises:
        RobotError: TS411 if there are too many or too few, or one is of the wrong kind.
    """
    if len(joints) != model.home.size:
        raise RobotError(
            "TS411",
            f"{of} has {len(joints)} joint positions, '{model.name}' has {model.home.size} joints",
            "; ".join(
                (
                    f"in this order: {', '.join(model.joint_names)}",
                    *(each.message for each in model.remarks if each.code == "TS449"),
                )
            ),
            field,
        )
    for i, value in enumerate(joints):
        hinge = turns_at(model, i)
        dimension = getattr(value, "dimension", None)
        if dimension is not None and dimension != (ANGLE if hinge else LENGTH):
            needed = LENGTH.on(rotation=hinge)
            raise RobotError(
                "TS411",
                f"joint {i + 1} ('{model.joint_names[i]}') {'turns' if hinge else 'slides'}, "
                f"and {of} gives it "
                f"{describe(dimension)}",
                f"give it {noun(needed)}, in {fitting(needed)[0]}",
                field,
            )


def _checked(model: RobotModel, joints: Sequence[float]) -> Array:
    check_joints(model, joints, "the start", ("start", "joints"))
    return inside_limits(model, joints, "start at", ("start", "joints"))


def inside_limits(
    model: RobotModel, joints: Sequence[float], does: str, field: tuple[str, ...]
) -> Array:
    """Joint positions (n,) of a task file, within the limits of the joints.

    Args:
        model: The robot.
        joints: (n,) joint positions [rad or m].
        does: What a joint does there, such as `start at`.
        field: Where in a task file's `robot` section they stand.

    Raises:
        RobotError: TS411 if one is beyond its limits.
    """
    q = np.array(joints, dtype=float)
    outside = np.flatnonzero((q < model.lower) | (q > model.upper))
    if outside.size:
        i = int(outside[0])
        unit = LENGTH.on(rotation=turns_at(model, i))
        at, high = (show(float(x[i]), unit, 6) for x in (q, model.upper))
        low = number(in_unit(float(model.lower[i]), fitting(unit)[0]), 6)
        raise RobotError(
            "TS411",
            f"joint {i + 1} ('{model.joint_names[i]}') cannot {does} {at}",
            f"it moves between {low} and {high}",
            field,
        )
    return q
