"""The robot's model terms: Pinocchio's arrays as the controller's inputs.

Pinocchio keeps its results in place. `ModelTerms` hands out 1-D views of that memory, so a compiled
tick reads H, C q' + g, g, J and the pose without a copy; `symbols` gives the matching expressions.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.robot import RobotModel

Vector = NDArray[np.float64]


class ModelTerms:
    """H, C q' + g, g, J and the tool's pose of one robot, evaluated by Pinocchio.

    Attributes:
        arrays: 1-D views of Pinocchio's memory, in the order of `symbols`; valid as long as
            this object lives, renewed by `update`.
    """

    def __init__(self, robot: RobotModel) -> None:
        self._model, self._tip = robot.pin, robot.tip
        self._data = robot.pin.createData()
        data, joint = self._data, robot.tip_joint
        self._pose, self._acceleration = data.oMi[joint], data.a_gf[joint]
        self.arrays: tuple[Vector, ...] = (
            data.M.reshape(-1, order="F"),
            data.nle,
            data.g,
            data.J.reshape(-1, order="F"),
            self._pose.translation,
            self._pose.rotation.reshape(-1, order="F"),
            self._acceleration.vector,
        )

    def update(self, q: Vector, v: Vector) -> None:
        """Evaluates all terms at q (n,) [rad or m] and v (n,) [rad/s or m/s]."""
        pin.computeAllTerms(self._model, self._data, q, v)

    @property
    def gravity(self) -> Vector:
        """(n,) torque that carries the arm where it was last evaluated [N m]."""
        return self.arrays[2]

    def tip(self) -> tuple[Vector, Vector]:
        """Position (3,) and rotation (3, 3) of the tool tip in the world, as last evaluated."""
        R = self._pose.rotation
        return self._pose.translation + R @ self._tip.translation, R @ self._tip.rotation


@dataclass(frozen=True, slots=True)
class TermSymbols:
    """The inputs that `ModelTerms.arrays` fill, and what follows from them at the tool tip.

    Attributes:
        inputs: CasADi vectors, in the order of `ModelTerms.arrays`.
        H: (n, n) joint inertia; only the upper triangle may be read.
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


def symbols(robot: RobotModel, v: ca.SX) -> TermSymbols:
    """Expressions of the tip's kinematics and the model terms, for joint velocities v (n,)."""
    n = robot.pin.nv
    H, bias, gravity = ca.SX.sym("H", n * n), ca.SX.sym("nle", n), ca.SX.sym("g", n)
    J_world = ca.SX.sym("J", 6 * n)
    joint_p, joint_R = ca.SX.sym("p", 3), ca.SX.sym("R", 9)
    joint_a = ca.SX.sym("a", 6)

    Rj = ca.reshape(joint_R, 3, 3)
    r = ca.DM(np.array(robot.tip.translation))
    p = joint_p + Rj @ r
    R = Rj @ ca.DM(np.array(robot.tip.rotation))

    # Pinocchio's world Jacobian gives the velocity of the body point at the world's origin.
    Jw = ca.reshape(J_world, 6, n)
    J = ca.vertcat(Jw[:3, :] - ca.skew(p) @ Jw[3:, :], Jw[3:, :])
    twist = J @ v

    # a_gf is the joint's spatial acceleration in its own axes, in a field that falls with g.
    g_world = ca.DM(np.array(robot.pin.gravity.linear))
    linear = joint_a[:3] + Rj.T @ g_world
    angular = joint_a[3:]
    drift = ca.vertcat(
        Rj @ (linear + ca.cross(angular, r)) + ca.cross(twist[3:], twist[:3]), Rj @ angular
    )
    return TermSymbols(
        inputs=(H, bias, gravity, J_world, joint_p, joint_R, joint_a),
        H=ca.reshape(H, n, n),
        bias=bias,
        gravity=gravity,
        p=p,
        R=R,
        J=J,
        drift=drift,
        twist=twist,
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
