"""Forward dynamics compliance control, as FZI's cartesian_controllers have it.

S. Scherzinger, A. Roennau, R. Dillmann, "Forward Dynamics Compliance Control (FDCC): a new approach
to cartesian compliance for robotic manipulators", IROS 2017; the CartesianComplianceController of
cartesian_controllers, branch ros2, read at commits 082b3811 (force and compliance) and 017b68d6
(motion). A virtual arm, whose mass is nearly all at the tip, falls under

    f = s PD(K (x_d - x) + F),   F the measured wrench plus the commanded one

    q <- q + h v,   v <- 0.9 (v + h H^-1 J^T f),   h = 20 ms whatever the control period is

so many iterations in a control period, from the measured joints but with the velocity that it had.
x of the first iteration is where it was in the end of the period before. The joints are commanded
q, or v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from referee.arm import Arm
from referee.reference import Reference, separation
from referee.session import Sample

Vector = NDArray[np.float64]
Six = tuple[float, float, float, float, float, float]

NAME = "forward dynamics compliance"
#: Virtual time of an iteration [s], and what it leaves of a velocity.
STEP, KEPT = 0.02, 0.9
#: Mass [kg] and inertia [kg m^2] at the tip, and the inertia of other links.
TIP, LINK_INERTIA = 1.0, 1e-6


@dataclass(frozen=True)
class ComplianceGains:
    """Parameters of the controller, by the package's names; six are of x y z rx ry rz.

    Attributes:
        stiffness: K [N/m, N m/rad].
        p, d: of the PD.
        error_scale: s.
        iterations: in a control period.
        link_mass: of each link of the virtual arm but the last [kg].
        free: K of stages without a set point of force, as it may be set while the controller runs;
            None for the same.
    """

    stiffness: Six
    p: Six
    d: Six
    error_scale: float = 1.0
    iterations: int = 1
    link_mass: float = 0.1
    free: Six | None = None

    def springs(self, sample: Sample) -> Six:
        """K of the stage that a sample is of."""
        return self.stiffness if self.free is None or sample.on_force.any() else self.free


#: The example of the package's README.
EXAMPLE = ComplianceGains(
    stiffness=(500.0, 500.0, 500.0, 20.0, 20.0, 20.0),
    p=(0.05, 0.05, 0.05, 1.5, 1.5, 1.5),
    d=(0.005, 0.005, 0.005, 0.0, 0.0, 0.0),
    error_scale=0.5,
)


class ForwardDynamics:
    """The controller on an arm that takes velocities, or positions.

    Attributes:
        given: what it was given, in words.
    """

    def __init__(
        self, arm: Arm, gains: ComplianceGains, period: float, *, positions: bool = False
    ) -> None:
        """Of an arm, with a control period [s]."""
        self._arm, self._gains, self._positions = arm, gains, positions
        self._reference = Reference(period)
        self._virtual = _virtual(arm, gains.link_mass)
        self._data = self._virtual.createData()
        self._p, self._d = np.array(gains.p), np.array(gains.d)
        self._v, self._before = np.zeros(arm.model.nv), np.zeros(6)
        self._pose: tuple[Vector, Vector] | None = None
        self.given = _described(gains)

    def command(self, sample: Sample) -> Vector:
        """(n,) velocities [rad/s, m/s] or positions [rad, m] of the joints."""
        if not sample.visit:
            return sample.q if self._positions else np.zeros_like(sample.q)
        self._reference.follow(sample)
        T, q = sample.frame, sample.q
        K = T @ np.diag(self._gains.springs(sample)) @ T.T
        force = T @ (sample.feed - sample.force)
        pose = sample.tip if self._pose is None else self._pose
        for _ in range(self._gains.iterations):
            error = K @ separation(self._reference.pose, pose) + force
            pushed = self._p * error + self._d * (error - self._before) / STEP
            self._before = error
            effort = self._arm.jacobian(q).T @ (self._gains.error_scale * pushed)
            acceleration = np.linalg.solve(self._inertia(q), effort)
            q = self._within(q + STEP * self._v)
            self._v = KEPT * (self._v + STEP * acceleration)
            pose = self._arm.tip_at(q)
        self._pose = pose
        return q if self._positions else self._v

    def _inertia(self, q: Vector) -> Vector:
        """(n, n) of the virtual arm."""
        H = pin.crba(self._virtual, self._data, q)
        return np.asarray(np.triu(H) + np.triu(H, 1).T)

    def _within(self, q: Vector) -> Vector:
        return np.clip(q, self._arm.robot.lower, self._arm.robot.upper)


def _virtual(arm: Arm, link_mass: float) -> pin.Model:
    """The arm's kinematics with links that weigh next to nothing, and a tip that weighs."""
    model = arm.model.copy()
    link = pin.Inertia(link_mass, np.zeros(3), LINK_INERTIA * np.eye(3))
    for i in range(1, model.njoints):
        model.inertias[i] = link
    tip = pin.Inertia(TIP, np.zeros(3), TIP * np.eye(3))
    model.inertias[arm.robot.tip_joint] += arm.robot.tip.act(tip)
    model.armature = np.zeros(model.nv)
    return model


def _described(gains: ComplianceGains) -> str:
    def six(values: tuple[float, ...]) -> str:
        return "(" + ", ".join(f"{value:.3g}" for value in values) + ")"

    free = "" if gains.free is None else f"; in free motion stiffness {six(gains.free)}"
    return (
        f"stiffness {six(gains.stiffness)}, p {six(gains.p)}, d {six(gains.d)}, "
        f"error_scale {gains.error_scale:.3g}, iterations {gains.iterations}, "
        f"link_mass {gains.link_mass:g}{free}"
    )
