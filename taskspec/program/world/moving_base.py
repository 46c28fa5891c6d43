"""Objects that move by themselves: where the clock has taken them, and the tool as they see it.

The base moves the world that was declared: a point that is at x there is at A x + a now. In its
coordinates the object stands still where it was declared, so whatever is fixed on it or follows it
is written there as if nothing moved; only the tool's kinematics are relative ones.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.expression.tree import Name
from taskspec.geometry import rotation
from taskspec.geometry.axis import ROTATIONS, Axis
from taskspec.program.algebra import CasadiAlgebra, constants
from taskspec.robot.model_terms import TermSymbols
from taskspec.spec import Shape, Task
from taskspec.spec.world import MOTION

Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MovingBase:
    """The motion of one object.

    Attributes:
        name: of the object.
        clock: symbol of the run's time [s], on which the others depend.
        A, a: (3, 3), (3,) [m] from declared to present places in the world.
        numbers: clock -> A (9), a (3), and d/dt and d2/dt2 of both.
        turns: whether it rotates.
    """

    name: str
    clock: ca.SX
    A: ca.SX
    a: ca.SX
    numbers: ca.Function
    turns: bool

    def at(self, clock: ca.SX) -> BaseMotion:
        """The moving base at an instant [s]."""
        A, a, A_rate, a_rate, A_bend, a_bend = self.numbers(clock)
        return BaseMotion(
            *(ca.reshape(A, 3, 3), a),
            *(ca.reshape(A_rate, 3, 3), a_rate),
            *(ca.reshape(A_bend, 3, 3), a_bend),
        )

    def pose(self, clock: float) -> tuple[Matrix, Matrix]:
        """(3, 3) A and (3,) a [m] at a time [s]."""
        found = [np.array(value) for value in self.numbers(clock)]
        return found[0].reshape(3, 3, order="F"), found[1].ravel()

    def twist(self, clock: float, point: Matrix) -> Matrix:
        """(6,) velocity that the moving base has at a point (3,) of the world [m/s, rad/s]."""
        A, a, A_rate, a_rate, *_ = (np.array(value) for value in self.numbers(clock))
        spin = A_rate.reshape(3, 3, order="F") @ A.reshape(3, 3, order="F").T
        away = np.asarray(point) - a.ravel()
        turning = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        return np.concatenate([a_rate.ravel() + spin @ away, turning])


@dataclass(frozen=True, slots=True)
class BaseMotion:
    """A moving base at an instant: A, a and their first and second time derivatives."""

    A: ca.SX
    a: ca.SX
    A_rate: ca.SX
    a_rate: ca.SX
    A_bend: ca.SX
    a_bend: ca.SX

    def place(self, p: ca.SX) -> ca.SX:
        """A world point (3,) in the moving base's coordinates."""
        return self.A.T @ (p - self.a)

    def world(self, p: ca.SX) -> ca.SX:
        """A point (3,) of the moving base's coordinates in the world."""
        return self.A @ p + self.a

    def twist(self, p: ca.SX) -> ca.SX:
        """(6,) velocity that the moving base has at a world point (3,) [m/s, rad/s]."""
        spin = self.A_rate @ self.A.T
        return ca.vertcat(self.a_rate + spin @ (p - self.a), rotation.unskew(spin))

    def wrench(self, wrench: ca.SX) -> ca.SX:
        """A wrench (6,) in the moving base's axes."""
        return ca.vertcat(self.A.T @ wrench[:3], self.A.T @ wrench[3:])

    def relative(self, terms: TermSymbols) -> TermSymbols:
        """The tool's kinematics against the moving base, in its coordinates.

        With p' = A^T (p - a) and A' the rate of A: v' = A^T (v - a') + A'^T (p - a); the drift
        is the rate of that at zero joint acceleration, with Coriolis and centripetal terms.
        """
        A, A_rate = self.A, self.A_rate
        away, v = terms.p - self.a, terms.twist[:3] - self.a_rate
        spin = rotation.unskew(A_rate @ A.T)
        spin_rate = rotation.unskew(self.A_bend @ A.T + A_rate @ A_rate.T)
        w = terms.twist[3:] - spin
        linear = A.T @ (terms.drift[:3] - self.a_bend) + 2 * A_rate.T @ v + self.A_bend.T @ away
        angular = A.T @ (terms.drift[3:] - spin_rate) + A_rate.T @ w
        return replace(
            terms,
            p=A.T @ away,
            R=A.T @ terms.R,
            J=ca.vertcat(A.T @ terms.J[:3, :], A.T @ terms.J[3:, :]),
            drift=ca.vertcat(linear, angular),
            twist=ca.vertcat(A.T @ v + A_rate.T @ away, A.T @ w),
            world=terms,
        )


def moving_bases(task: Task) -> dict[str, MovingBase]:
    """The moving bases of all objects that move by themselves, by name."""
    return {
        name: _moving_base(task, name, shape)
        for name, shape in task.shapes.items()
        if shape.motion is not None
    }


def displacements(task: Task, shape: Shape, clock: ca.SX) -> dict[Axis, ca.SX]:
    """The displacement of a shape at a time [s]: along its moving axes [m], or about one [rad]."""
    assert shape.motion is not None
    params = {name: quantity.value for name, quantity in task.params.items()}
    known = {**constants(params), "clock": clock}
    algebra = CasadiAlgebra(None, 0.0)

    def lookup(found: Name) -> ca.SX:
        return known[found.path[0]]

    return {a: algebra.translate(e, lookup) for a, e in shape.motion.axes.items()}


def _moving_base(task: Task, name: str, shape: Shape) -> MovingBase:
    clock = ca.SX.sym("clock")
    by_axis = displacements(task, shape, clock)
    moved = [by_axis.get(axis, ca.SX(0)) for axis in MOTION]
    R = ca.DM(rotation.from_rpy(shape.rpy))
    origin = ca.DM(np.array(shape.xyz, dtype=float))
    turning = [axis for axis in by_axis if axis.is_rotation]
    A = ca.SX.eye(3)
    if turning:
        A = R @ _about(turning[0], by_axis[turning[0]]) @ R.T
    a = origin + R @ ca.vertcat(*moved[:3]) - A @ origin
    values = [ca.densify(ca.vec(A)), ca.densify(a)]
    for _ in range(2):
        values += [ca.densify(ca.jacobian(value, clock)) for value in values[-2:]]
    return MovingBase(name, clock, A, a, ca.Function("moving_base", [clock], values), bool(turning))


def _about(axis: Axis, angle: ca.SX) -> ca.SX:
    """Rotation (3, 3) by an angle [rad] about one of the axes rx, ry, rz."""
    unit = ca.DM([float(axis == other) for other in ROTATIONS])
    K = ca.skew(unit)
    return ca.SX.eye(3) + ca.sin(angle) * K + (1 - ca.cos(angle)) * (K @ K)
