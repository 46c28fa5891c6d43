"""Where a run starts, and what is wrong with a start that cannot be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from taskspec.robot.errors import RobotError
from taskspec.robot.inverse_kinematics import SOLVED, InverseKinematics, Target
from taskspec.robot.types import RobotModel

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

_POSITION_FIRST = 300.0


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
            that can turn it about every axis straight down, turned about the vertical as at home,
            and leaves other arms free. Of a planar arm's tool the yaw is the direction in the
            plane, counted from x; roll and pitch are zero.
        joints: (n,) joint positions instead [rad or m].

    Returns:
        Joint positions (n,) inside the limits: the solution nearest home whose pose is exact to
        1e-9 m and 1e-9 rad; home itself when nothing is asked for.

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
    target = Target(np.array(xyz, dtype=float), _rotation(model, solver, rpy))
    q, missing = solver.nearest_home(target)
    if missing <= SOLVED:
        return q
    closest, short = solver.nearest_home(Target(target.position))
    if short > SOLVED:
        raise _out_of_reach(model, solver, closest, target.position, short)
    raise _turned(solver, target, given=rpy is not None)


def _rotation(
    model: RobotModel, solver: InverseKinematics, rpy: Sequence[float] | None
) -> Array | None:
    if rpy is None:
        if not {"rx", "ry", "rz"} <= set(model.axes):
            return None
        # Of all rotations diag(1, -1, -1) turned about z, the one that is the least turn from
        # home's.
        A = np.diag([1.0, -1.0, -1.0]) @ solver.pose(model.home).rotation.T
        yaw = float(np.arctan2(A[0, 1] - A[1, 0], A[0, 0] + A[1, 1]))
        down: Array = pin.rpy.rpyToMatrix(np.pi, 0.0, yaw)
        return down
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


def _turned(solver: InverseKinematics, target: Target, *, given: bool) -> RobotError:
    """The error of a point that is reached, but not with the tool turned as it is asked for."""
    q, _ = solver.nearest_home(Target(target.position, target.rotation, _POSITION_FIRST))
    short = np.degrees(np.linalg.norm(solver.error(q, target)[3:]))
    asked = "as rpy asks" if given else "straight down"
    x, y, z = target.position
    return RobotError(
        "TS413",
        f"the arm reaches [{x:.3f}, {y:.3f}, {z:.3f}] m, but not with the tool {asked}: "
        f"it misses that by {short:.1f} deg",
        "move the start towards the arm's base, or give another rpy"
        if given
        else "move the start towards the arm's base, or give an rpy",
        ("start", "rpy" if given else "xyz"),
    )


def _out_of_reach(
    model: RobotModel, solver: InverseKinematics, closest: Array, wanted: Array, short: float
) -> RobotError:
    """The error of a point that is not reached with any orientation."""
    base = np.array(model.pin.jointPlacements[1].translation)
    nearest = solver.pose(closest).translation
    reach, asked = (float(np.linalg.norm(point - base)) for point in (nearest, wanted))
    x, y, z = nearest
    side = "reaches" if asked > reach else "comes no nearer than"
    return RobotError(
        "TS412",
        f"the tool tip cannot get to the start: it misses it by {1e3 * short:.1f} mm",
        f"that way the arm {side} {reach:.3f} m from its first joint, and the start is "
        f"{asked:.3f} m from it; the nearest point is [{x:.3f}, {y:.3f}, {z:.3f}] m",
        ("start", "xyz"),
    )


def _checked(model: RobotModel, joints: Sequence[float]) -> Array:
    q = np.array(joints, dtype=float)
    if q.shape != model.home.shape:
        raise RobotError(
            "TS411",
            f"the start has {q.size} joint positions, '{model.name}' has {model.home.size} joints",
            f"in this order: {', '.join(model.joint_names)}",
            ("start", "joints"),
        )
    outside = np.flatnonzero((q < model.lower) | (q > model.upper))
    if outside.size:
        i = int(outside[0])
        unit, k = ("deg", 180 / np.pi) if _turns(model, i) else ("mm", 1e3)
        raise RobotError(
            "TS411",
            f"joint {i + 1} ('{model.joint_names[i]}') cannot start at {q[i] * k:.6g} {unit}",
            f"it moves between {model.lower[i] * k:.6g} and {model.upper[i] * k:.6g} {unit}",
            ("start", "joints"),
        )
    return q


def _turns(model: RobotModel, i: int) -> bool:
    return "Revolute" in model.pin.joints[i + 1].shortname()
