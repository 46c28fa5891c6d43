"""The admittance rule of ROS 2's controllers (package admittance_controller of ros2_controllers).

Read at commits 033cc03d (admittance_rule_impl.hpp), 015decf2 (admittance_controller.cpp) and
01936294 (its parameters); kinematics by kinematics_interface_kdl. With x the tip's measured pose
against the one of the reference joints q_r, and F the measured wrench plus the commanded one,

    F~  <-  c F + (1 - c) F~                                  a sample
    x'' = M^-1 (S F~ - D x' - K x),   D = 2 zeta sqrt(M K)    x' that of the joints' own v below
    v'  = (J^T J + alpha)^-1 J^T x'' - d v                    semi-implicit Euler: v, then q
    q'  = v

and the joints are commanded q_r + q, or q_r' + v. S selects the axes whose force counts: others
keep spring and damper. K and D are of the control frame's axes, M is of the base's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from referee.arm import Arm
from referee.reference import Reference, separation
from referee.session import Sample

Vector = NDArray[np.float64]
Six = tuple[float, float, float, float, float, float]

NAME = "ROS 2 admittance"


@dataclass(frozen=True)
class AdmittanceGains:
    """Parameters of the rule, by the package's names; six are of x y z rx ry rz.

    Attributes:
        mass: M [kg, kg m^2].
        damping_ratio: zeta.
        stiffness: K [N/m, N m/rad].
        selected_axes: S.
        joint_damping: d [1/s].
        filter_coefficient: c.
        alpha: of the inverse.
        free: those of stages without a set point of force, as parameters may be set while the
            controller runs; None for the same.
    """

    mass: Six
    damping_ratio: Six
    stiffness: Six
    selected_axes: tuple[bool, bool, bool, bool, bool, bool] = (True,) * 6
    joint_damping: float = 5.0
    filter_coefficient: float = 0.05
    alpha: float = 0.01
    free: AdmittanceGains | None = None

    @property
    def damping(self) -> Vector:
        """(6,) D [N s/m, N m s/rad]."""
        return 2.0 * np.array(self.damping_ratio) * np.sqrt(np.multiply(self.mass, self.stiffness))

    def at(self, sample: Sample) -> AdmittanceGains:
        """Those of the stage that a sample is of."""
        return self if self.free is None or sample.on_force.any() else self.free


#: The package's example, test/test_params.yaml, as it is beside filter_coefficient.
EXAMPLE = AdmittanceGains(
    mass=(5.5, 6.6, 7.7, 8.8, 9.9, 10.1),
    damping_ratio=(2.828427,) * 6,
    stiffness=(214.1, 214.2, 214.3, 214.4, 214.5, 214.6),
    filter_coefficient=0.005,
    alpha=0.0005,
)


class RosAdmittance:
    """The rule on an arm that takes velocities, or positions.

    Attributes:
        given: what it was given, in words.
    """

    def __init__(
        self, arm: Arm, gains: AdmittanceGains, period: float, *, positions: bool = False
    ) -> None:
        """Of an arm, with a control period [s]."""
        self._arm, self._gains, self._period, self._positions = arm, gains, period, positions
        self._reference = Reference(period)
        self._wrench = self._rate = np.zeros(6)
        self._off, self._v = np.zeros(arm.model.nv), np.zeros(arm.model.nv)
        self._rest: Vector | None = None
        self.given = _described(gains)

    def command(self, sample: Sample) -> Vector:
        """(n,) velocities [rad/s, m/s] or positions [rad, m] of the joints."""
        if not sample.visit:
            return sample.q if self._positions else np.zeros_like(sample.q)
        gains, T, J = self._gains.at(sample), sample.frame, sample.jacobian
        rest, moved = self._reference_joints(sample)
        force = T @ (sample.feed - sample.force)
        self._wrench = self._wrench + gains.filter_coefficient * (force - self._wrench)
        off = separation(sample.tip, self._reference.pose)
        pull = np.array(gains.selected_axes, dtype=float) * (T.T @ self._wrench)
        pull -= gains.damping * (T.T @ self._rate) + np.array(gains.stiffness) * (T.T @ off)
        acceleration = _damped_inverse(J, gains.alpha) @ (T @ pull / np.array(gains.mass))
        acceleration -= gains.joint_damping * self._v
        self._v = self._v + self._period * acceleration
        self._off = self._off + self._period * self._v
        self._rate = J @ self._v
        return rest + self._off if self._positions else moved + self._v

    def _reference_joints(self, sample: Sample) -> tuple[Vector, Vector]:
        """(n,) positions and velocities that bring the tip to its reference.

        The controller takes joints: somebody before it has solved for them.
        """
        self._reference.follow(sample)
        q = sample.q if self._rest is None else self._rest
        J, off = self._arm.jacobian(q), separation(self._reference.pose, self._arm.tip_at(q))
        wanted = np.column_stack([off, self._reference.twist])
        step, rate = (J.T @ np.linalg.solve(J @ J.T, wanted)).T
        self._rest = q + step
        return self._rest, rate


def _damped_inverse(J: Vector, alpha: float) -> Vector:
    return np.linalg.solve(J.T @ J + alpha * np.eye(J.shape[1]), J.T)


def _described(gains: AdmittanceGains) -> str:
    def six(values: tuple[float, ...]) -> str:
        return "(" + ", ".join(f"{value:.3g}" for value in values) + ")"

    names = ("x", "y", "z", "rx", "ry", "rz")
    axes = " ".join(name for name, on in zip(names, gains.selected_axes, strict=True) if on)
    free = "" if gains.free is None else f"; in free motion stiffness {six(gains.free.stiffness)}"
    return (
        f"mass {six(gains.mass)}, damping_ratio {six(gains.damping_ratio)}, "
        f"stiffness {six(gains.stiffness)}, selected_axes {axes}, "
        f"joint_damping {gains.joint_damping:g}, "
        f"filter_coefficient {gains.filter_coefficient:.3g}, alpha {gains.alpha:g}{free}"
    )
