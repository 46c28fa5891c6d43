"""The inputs of a law."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import field

import casadi as ca

from taskspec.control import linear
from taskspec.control.reference import Reference, opposite
from taskspec.control.resolution import full_acceleration, resolved
from taskspec.control.state import TaskState
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.laws import coupled
from taskspec.laws.gains import Gains, diagonal, pairs_of
from taskspec.laws.multipliers import Multipliers
from taskspec.laws.uncertainty import Uncertainty


@dataclass(frozen=True, slots=True)
class JointReference:
    """The references of a path of joints at one instant.

    Attributes:
        position: (n,) q_d [rad, m].
        error: (n,) q_d - q [rad, m].
        velocity, acceleration: (n,) q'_d, q''_d.
    """

    position: ca.SX
    error: ca.SX
    velocity: ca.SX
    acceleration: ca.SX


@dataclass(frozen=True, slots=True)
class FreeDirections:
    """Twists of the control point that a held mechanism leaves free, on the task axes.

    Attributes:
        driven: (m, d) those that motion axes drive.
        others: (m, o) the rest.
        rate: a [1/s] of the damper; see `laws.mechanism_form`.
    """

    driven: ca.SX
    others: ca.SX
    rate: float


def _nothing(name: str, length: int = 1) -> ca.SX:  # noqa: ARG001
    raise LookupError(name)


@dataclass(frozen=True, slots=True)
class Case:
    """A stage as its law sees it: state, references and gains on the task axes.

    Forces are in the theory's sign: what the environment exerts on the tool.

    Attributes:
        state: the arm at the control point.
        reference: of motion and force, on the same axes.
        gains: by name and axis.
        joint_velocity: (n,) q' [rad/s, m/s].
        force: names of the axes under a force loop.
        soft: names of the motion axes with a spring or damper of their own.
        normal: names of the motion axes along a contact's normal.
        posture: (n,) acceleration that a redundant arm has in its null space, else None.
        constraints: of a stage under a law with multipliers; None where it has none.
        free: directions of the mechanism that it holds, where the law takes the form for that;
            else None.
        joints: reference of a path of joints; None where the axes of the tool are controlled.
        period: of control [s].
        carried: (m,) velocity that the axes have by what carries their frame; None for none.
        left: (m,) velocities that the joints were commanded last, and whether limits had taken
            from them; None where no program keeps limits.
        bias: (n,) C q' + g [N m].
        uncertainty: bounds of what the model lacks, for a sliding term.
        remembered: what the tick before kept in the slot of a name, one number or so many, 0 as
            the stage begins; what is kept now is the command's `memory`.
    """

    state: TaskState
    reference: Reference
    gains: Gains
    joint_velocity: ca.SX
    force: tuple[Axis, ...] = ()
    soft: tuple[Axis, ...] = ()
    normal: tuple[Axis, ...] = ()
    posture: ca.SX | None = None
    constraints: Multipliers | None = None
    free: FreeDirections | None = None
    joints: JointReference | None = None
    period: float = 0.0
    carried: ca.SX | None = None
    left: tuple[ca.SX, ca.SX] | None = None
    bias: ca.SX | None = None
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    remembered: Callable[..., ca.SX] = _nothing

    def gain(self, name: str, axis: Axis) -> float:
        """One gain on one axis [SI]."""
        return self.gains[name][axis].value

    def kept(self, axis: Axis, rate: ca.SX) -> ca.SX:
        """A velocity against the reference that is remembered: what limits have left of it."""
        if self.left is None:
            return rate
        i, (commanded, limited) = self.state.axes.index(axis), self.left
        moved = commanded[i] - self.reference.velocity[i]
        least, most = ca.fmin(rate, 0), ca.fmax(rate, 0)
        return ca.if_else(limited, ca.fmin(ca.fmax(moved, least), most), rate)

    def diagonal(self, name: str) -> ca.DM | ca.SX:
        """(m,) one gain on all axes, zero where an axis has none."""
        return linear.column(diagonal(self.gains, name, self.state.axes))

    def diagonals(self, *names: str) -> list[ca.DM | ca.SX]:
        """(m,) of each of some gains."""
        return [self.diagonal(name) for name in names]

    def times(self, name: str, vector: ca.SX, uncancelled: Sequence[Axis] = ()) -> ca.SX:
        """(m,) one gain, a matrix where it couples axes, times a vector (m,).

        Args:
            name: of the gain.
            vector: on the axes.
            uncancelled: axes on which the gain is 1, whatever it is there.
        """
        if not pairs_of(self.gains, name):
            diagonal = self.diagonal(name)
            if uncancelled:
                diagonal[self.state.rows(uncancelled)] = 1.0
            return diagonal * vector
        matrix = self.matrix(name)
        for row in self.state.rows(uncancelled):
            matrix[row, row] = 1.0
        return matrix @ vector

    def by_mass(self, vector: ca.SX) -> ca.SX:
        """(m,) H_m^-1 times a vector (m,)."""
        if not pairs_of(self.gains, "mass"):
            return vector / self.diagonal("mass")
        return linear.solve(linear.cholesky(self.matrix("mass")), vector)

    def matrix(self, name: str) -> ca.SX:
        """(m, m) one gain, zero where it has no entry."""
        return coupled.matrix(self.gains, name, self.state.axes)

    def of_joints(self, name: str) -> ca.DM | ca.SX:
        """(n,) one gain on all joints."""
        return linear.column([gain.value for gain in self.gains[name].values()])

    @staticmethod
    def column(values: Iterable[ca.SX]) -> ca.SX:
        """Numbers one below the other."""
        return ca.vertcat(ca.SX(0, 1), *values)

    @staticmethod
    def applied(wrench: ca.SX) -> ca.SX:
        """A force in the sign of what the robot applies."""
        return opposite(wrench)

    def joint_rates(self) -> ca.SX:
        """q' (n,) that the motion loops command of an arm that takes velocities.

        On a path of joints that is q'_d + w (q_d - q), joint by joint.
        """
        if self.joints is not None:
            return self.joints.velocity + self.of_joints("K_V") * self.joints.error
        velocity = self.reference.velocity + self.diagonal("K_V") * self.reference.error
        return resolved(self.by_the_arm(velocity), self.state, self.posture)

    def by_the_arm(self, velocity: ca.SX) -> ca.SX:
        """The part of a velocity (m,) of the axes that joints have to make."""
        return velocity if self.carried is None else velocity - self.carried

    def joint_motion(self) -> ca.SX:
        """q'' (n,) that the motion loops command, whatever constrains the arm.

        On a path of joints that is q''_d + K_D (q'_d - q') + K_P (q_d - q), joint by joint.
        """
        if self.joints is not None:
            at, K_P, K_D = self.joints, self.of_joints("K_P"), self.of_joints("K_D")
            return at.acceleration + K_D * (at.velocity - self.joint_velocity) + K_P * at.error
        reference, state = self.reference, self.state
        acceleration = (
            reference.acceleration
            + self.diagonal("K_D") * (reference.velocity - state.velocity)
            + self.diagonal("K_P") * reference.error
        )
        return full_acceleration(acceleration, state, self.posture)
