"""The robot's model terms: what a tick reads of them, and Pinocchio's numbers for it.

`symbols` gives the tick's inputs, `ModelTerms` arrays that fill them. Pinocchio judges: starts,
rules and tests use `PinocchioTerms`. The loop evaluates `rigid_body.RigidBody`, the same terms as
expressions, which a function of the loop's own can take in.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.rotation import cross
from taskspec.robot import RobotModel
from taskspec.robot.poses import columns, mirrored
from taskspec.robot.rebuild import GRAVITY

Vector = NDArray[np.float64]


def lengths(n: int) -> tuple[int, ...]:
    """Lengths of H, C q' + g, g, J, p, R and J' q' as vectors, of an arm with n joints.

    H is packed: its upper triangle, column after column, as R and J are whole.
    """
    return (n * (n + 1) // 2, n, n, 6 * n, 3, 9, 6)


class ModelTerms(ABC):
    """H, C q' + g, g and the tip's J, pose and J' q' of one robot, in arrays that stay in place.

    Attributes:
        q, v: (n,) where the terms are evaluated [rad or m], [rad/s or m/s].
        arrays: 1-D arrays in the order of `lengths` and of `TermSymbols.inputs`, renewed by
            `update`.
    """

    def __init__(
        self,
        robot: RobotModel,
        q: Vector | None = None,
        v: Vector | None = None,
        load: Vector | None = None,
    ) -> None:
        """Takes the arrays to read q and v from; without them it makes its own.

        Args:
            robot: of which they are.
            q, v: (n,).
            load: (1,) mass of a point at the tip that the arm carries in addition [kg].
        """
        self.load = load
        n = robot.n
        self.q = np.zeros(n) if q is None else q
        self.v = np.zeros(n) if v is None else v
        self.arrays = tuple(np.zeros(length) for length in lengths(n))

    @abstractmethod
    def update(self) -> None:
        """Evaluates all terms at `q` and `v`."""

    def group(self) -> None:  # noqa: B027 - there may be nothing to group
        """Takes less time for an evaluation from now on, where that can be had."""

    def at(self, q: Vector, v: Vector) -> None:
        """Evaluates all terms at q (n,) [rad or m] and v (n,) [rad/s or m/s]."""
        self.q[:], self.v[:] = q, v
        self.update()

    @property
    def inertia(self) -> Vector:
        """(n, n) H, both triangles, as last evaluated."""
        n = len(self.q)
        H = np.zeros((n, n))
        # The rows of the lower triangle are the columns of the upper one.
        H[np.tril_indices(n)] = self.arrays[0]
        return np.asarray(H + np.tril(H, -1).T)

    @property
    def bias(self) -> Vector:
        """(n,) C q' + g, as last evaluated [N m]."""
        return self.arrays[1]

    @property
    def gravity(self) -> Vector:
        """(n,) torque that carries the arm where it was last evaluated [N m]."""
        return self.arrays[2]

    @property
    def jacobian(self) -> Vector:
        """(6, n) of the tip in world axes, linear above angular, as last evaluated."""
        return self.arrays[3].reshape(6, -1, order="F")

    @property
    def rotation(self) -> Vector:
        """(9,) axes of the tip in the world, column after column, as last evaluated."""
        return self.arrays[5]

    @property
    def position(self) -> Vector:
        """(3,) of the tip in the world, as last evaluated."""
        return self.arrays[4]

    def tip(self) -> tuple[Vector, Vector]:
        """Position (3,) and rotation (3, 3) of the tool tip in the world, as last evaluated."""
        return self.position.copy(), self.rotation.reshape(3, 3, order="F").copy()


class PinocchioTerms(ModelTerms):
    """The model terms as Pinocchio has them: ready at once, and what others are held against."""

    def __init__(
        self,
        robot: RobotModel,
        q: Vector | None = None,
        v: Vector | None = None,
        load: Vector | None = None,
    ) -> None:
        super().__init__(robot, q, v, load)
        self._model, self._data = robot.pin, robot.pin.createData()
        self._joint, self._tip, self._coupling = robot.tip_joint, robot.tip, robot.coupling
        self._upper = np.tril_indices(robot.n)[::-1]

    def update(self) -> None:
        """Evaluates all terms at `q` and `v`."""
        data, joint, whole = self._data, self._joint, self._coupling
        pin.computeAllTerms(self._model, data, whole.joints(self.q), whole.rates(self.v))
        H, bias, gravity, J, p, R, drift = self.arrays
        M = whole.by_coordinates(whole.on_coordinates(mirrored(data.M)))
        H[:] = M[self._upper]
        bias[:], gravity[:] = whole.on_coordinates(data.nle), whole.on_coordinates(data.g)
        pose = data.oMi[joint]
        tip = pose * self._tip
        p[:], R[:] = tip.translation, tip.rotation.ravel(order="F")
        # Pinocchio's world Jacobian gives the velocity of the body point at the world's origin.
        at_tip = columns(data.J)
        at_tip[:3] -= pin.skew(p) @ at_tip[3:]
        at_tip = whole.by_coordinates(at_tip)
        J[:] = at_tip.ravel(order="F")
        # a_gf is the joint's spatial acceleration in its own axes, in a field that falls with g.
        a = data.a_gf[joint]
        linear = a.linear + pose.rotation.T @ self._model.gravity.linear
        twist = at_tip @ self.v
        drift[:3] = pose.rotation @ (linear + cross(a.angular, self._tip.translation))
        drift[:3] += cross(twist[3:], twist[:3])
        drift[3:] = pose.rotation @ a.angular
        if self.load is not None:
            self._carry(float(self.load[0]))

    def _carry(self, mass: float) -> None:
        """Adds a point mass at the tip, as `loaded` does."""
        H, bias, gravity, _, _, _, drift = self.arrays
        J, g = self.jacobian[:3], self._model.gravity.linear
        H += (mass * J.T @ J)[self._upper]
        bias += mass * J.T @ (drift[:3] - g)
        gravity -= mass * J.T @ g


@dataclass(frozen=True, slots=True)
class TermSymbols:
    """The model terms as expressions: symbols for `ModelTerms.arrays`, or of q and q'.

    Attributes:
        inputs: CasADi vectors, in the order of `ModelTerms.arrays`; empty for expressions of q and
            q'.
        H: (n, n) joint inertia.
        bias: (n,) C q' + g.
        gravity: (n,) g.
        p, R: (3,), (3, 3) tip pose in the world.
        J: (6, n) geometric Jacobian of the tip in world axes, linear above angular.
        drift: (6,) J' q', the tip's acceleration at zero joint acceleration, world axes.
        twist: (6,) J q'.
        world: where these are relative to a moving object, the terms against the world.
    """

    inputs: tuple[ca.SX, ...]
    H: ca.SX
    bias: ca.SX
    gravity: ca.SX
    p: ca.SX
    R: ca.SX
    J: ca.SX
    drift: ca.SX
    twist: ca.SX
    world: TermSymbols | None = None

    def vectors(self) -> tuple[ca.SX, ...]:
        """Dense vectors in the order of `ModelTerms.arrays`: what fills another one's inputs."""
        packed = ca.densify(self.H)[_upper(self.H.shape[0])]
        parts = (self.bias, self.gravity, ca.vec(self.J), self.p, ca.vec(self.R), self.drift)
        return (packed, *(ca.densify(part) for part in parts))


def loaded(
    terms: TermSymbols, mass: ca.SX, centre: ca.SX | None = None, *, moves: bool = True
) -> TermSymbols:
    """The model terms of an arm that carries a point at its tip, or fixed to it.

    With the Jacobian J_c of the point's velocity, its J_c' q', and gravity g,

        H + m J_c^T J_c,    C q' + g + m J_c^T (J_c' q' - g),    g - m J_c^T g.

    Args:
        terms: of the arm without it.
        mass: m [kg].
        centre: (3,) the point, from the tip along its axes [m]; None for the tip itself.
        moves: whether the mass is accelerated with the arm, or its weight alone counts.
    """
    J, drift, g = terms.J[:3, :], terms.drift[:3], ca.DM([float(x) for x in GRAVITY])
    if centre is not None:
        lever, turning = terms.R @ centre, terms.twist[3:]
        J = J - ca.skew(lever) @ terms.J[3:, :]
        drift = drift + ca.cross(terms.drift[3:], lever)
        drift += ca.cross(turning, ca.cross(turning, lever))
    gravity = terms.gravity - mass * (J.T @ g)
    if not moves:
        return replace(terms, bias=terms.bias - mass * (J.T @ g), gravity=gravity)
    return replace(
        terms,
        H=terms.H + mass * (J.T @ J),
        bias=terms.bias + mass * (J.T @ (drift - g)),
        gravity=gravity,
    )


def _upper(n: int) -> list[int]:
    """Indices of the upper triangle of an (n, n), column after column."""
    return [j * n + i for j in range(n) for i in range(j + 1)]


def symbols(robot: RobotModel, v: ca.SX) -> TermSymbols:
    """Symbols of the model terms, for joint velocities v (n,)."""
    n = robot.n
    inputs = tuple(
        ca.SX.sym(name, length)
        for name, length in zip(("H", "nle", "g", "J", "p", "R", "a"), lengths(n), strict=True)
    )
    H, bias, gravity, J, p, R, drift = inputs
    J = ca.reshape(J, 6, n)
    return TermSymbols(
        inputs=inputs,
        H=ca.triu2symm(ca.SX(ca.Sparsity.upper(n), H)),
        bias=bias,
        gravity=gravity,
        p=p,
        R=ca.reshape(R, 3, 3),
        J=J,
        drift=drift,
        twist=J @ v,
    )


def kinematic_terms(p: ca.SX, R: ca.SX, twist: ca.SX) -> TermSymbols:
    """The terms of a tip whose motion is given, without joints: for kinematics alone.

    Args:
        p, R: (3,), (3, 3) its pose in the world.
        twist: (6,) its velocity.
    """
    nothing = ca.SX(0, 1)
    return TermSymbols(
        inputs=(),
        H=ca.SX(0, 0),
        bias=nothing,
        gravity=nothing,
        p=p,
        R=R,
        J=ca.SX(6, 0),
        drift=ca.SX.zeros(6),
        twist=twist,
    )
