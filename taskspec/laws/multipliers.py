"""Holonomic constraints of a stage and their multipliers, as hybrid laws command them (4.3.2).

Both laws are u = H (T E_2^T v_2 + Gamma) + C q' + g - J_phi^T (what they make of the multipliers).
The rows of J_phi are unit normals, so that multipliers are newtons (N m on joints).
"""

from __future__ import annotations

import casadi as ca

from taskspec.control import constrained, linear
from taskspec.control.command import Command
from taskspec.deferred_methods import dataclass
from taskspec.laws.gains import Gains


@dataclass(frozen=True, slots=True)
class Multipliers:
    """A stage's m constraints and their multipliers, by the environment on the robot [N, N m].

    Attributes:
        names: force axes, then equations.
        J: (m, n) J_phi with unit normals.
        gamma: (m,) what J q'' has to cancel.
        directions: (n, m) T E_1^T.
        closing: (m,) J q' + r_t, zero on an ideal constraint [m/s, rad/s].
        desired: (m,) lambda_d.
        measured: (m,) lambda.
        integral: (m,) of lambda_d - lambda.
        held: (n,) what keeps q'' continuous after another choice of coordinates, as it fades.
    """

    names: tuple[str, ...]
    J: ca.SX
    gamma: ca.SX
    directions: ca.SX
    closing: ca.SX
    desired: ca.SX
    measured: ca.SX
    integral: ca.SX
    held: ca.SX

    def diagonal(self, gains: Gains, name: str) -> ca.DM | ca.SX:
        """(m,) one gain on all constraints."""
        return linear.column([gains[name][constraint].value for constraint in self.names])

    @property
    def on_first(self) -> ca.SX:
        """E_1 T^T J_phi^T (m, m): multipliers as forces on the coordinates of q_1."""
        return (self.J @ self.directions).T

    def from_first(self, forces: ca.SX) -> ca.SX:
        """(m,) the multipliers of forces on the coordinates of q_1.

        With (4.94), T^-T E_1^T is J_phi^T times the inverse of E_1 T^T J_phi^T.
        """
        return linear.small_solve(self.on_first, forces)

    def kept(self, wanted: ca.SX) -> ca.SX:
        """q'' (n,) nearest to `wanted` that keeps the constraints, T E_2^T E_2 q'' + Gamma."""
        return self.nearest(wanted, self.gamma)

    def nearest(self, wanted: ca.SX, rest: ca.SX) -> ca.SX:
        """x (n,) with J x + rest = 0, rest (m,), that differs from `wanted` along q_1 alone."""
        return constrained.eliminate(self.J, rest, self.directions, wanted)

    def command(
        self, wanted: ca.SX, reaction: ca.SX, damping: ca.DM | ca.SX, released: ca.SX
    ) -> Command:
        """The command of both laws.

        Args:
            wanted: (n,) q'' that the motion loops command, q''_d + K_D e' + K_P e.
            reaction: (n,) J_phi^T of what the law makes of the multipliers.
            damping: (m,) along the normals [N s/m]; it does nothing on an ideal constraint.
            released: (m,) wrench on the task axes that the last stage held, as it fades.
        """
        return Command(
            wrench=released,
            joint_acceleration=self.kept(wanted),
            joint=-reaction - self._damped(damping),
        )

    def _damped(self, damping: ca.DM | ca.SX) -> ca.SX:
        """J_phi^T of damping times `closing` (n,).

        Where a gradient is constant, so is its product with the gain: rounding is that of one
        factor, whether the gain is a number or a parameter.
        """
        found = ca.SX.zeros(self.J.shape[1])
        for j in range(self.J.shape[0]):
            for i in range(self.J.shape[1]):
                along, closing = self.J[j, i], self.closing[j]
                if along.is_constant():
                    found[i] += along * damping[j] * closing
                else:
                    found[i] += along * (damping[j] * closing)
        return found
