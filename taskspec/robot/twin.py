"""Pinocchio's model of an arm, evaluated in the coordinates in which the arm moves."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.robot.coupling import JointCoupling
from taskspec.robot.poses import columns, mirrored

Array = NDArray[np.float64]


class Twin:
    """An arm's kinematics and dynamics, with memory of its own.

    Attributes:
        model: Pinocchio's, of all joints.
        joint, placement: the joint that carries the tip, and the tip's pose in it.
        coupling: which joints follow others.
        data: of the last evaluation.
    """

    def __init__(
        self, model: pin.Model, joint: int, placement: pin.SE3, coupling: JointCoupling
    ) -> None:
        """Takes a model that has a frame `tip`."""
        self.model, self.joint, self.placement, self.coupling = model, joint, placement, coupling
        self.data = model.createData()
        self._tip = model.getFrameId("tip")

    @property
    def n(self) -> int:
        """Coordinates of the arm."""
        return self.coupling.n

    def place(self, q: Array) -> pin.Data:
        """Where the joints are, at coordinates q (n,)."""
        pin.forwardKinematics(self.model, self.data, self.coupling.joints(q))
        return self.data

    def tip(self, q: Array) -> pin.SE3:
        """The tip's pose in the world, at coordinates q (n,)."""
        return self.place(q).oMi[self.joint] * self.placement

    def jacobian(self, q: Array) -> Array:
        """(6, n) of the tip in world axes, linear above angular, by Pinocchio's frame."""
        J: Array = pin.computeFrameJacobian(
            self.model, self.data, self.coupling.joints(q), self._tip, pin.LOCAL_WORLD_ALIGNED
        )
        return self.coupling.by_coordinates(columns(J))

    def resolved_jacobian(self, q: Array) -> Array:
        """(6, n) the same, turned into world axes from those of the tip.

        It differs from `jacobian` by rounding: what is made of either keeps its last digits.
        """
        pin.computeJointJacobians(self.model, self.data, self.coupling.joints(q))
        local = self.placement.toActionMatrixInverse() @ columns(
            pin.getJointJacobian(self.model, self.data, self.joint, pin.LOCAL)
        )
        R = self.data.oMi[self.joint].rotation @ self.placement.rotation
        return self.coupling.by_coordinates(np.vstack((R @ local[:3], R @ local[3:])))

    def inertia(self, q: Array) -> Array:
        """(n, n) H [kg m^2, kg]."""
        H = mirrored(pin.crba(self.model, self.data, self.coupling.joints(q)))
        return self.coupling.by_coordinates(self.coupling.on_coordinates(H))

    def gravity(self, q: Array) -> Array:
        """(n,) torque that carries the arm [N m, N]."""
        g = pin.computeGeneralizedGravity(self.model, self.data, self.coupling.joints(q))
        return self.coupling.on_coordinates(np.array(g))

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """(n,) u = H q'' + C q' + g, that moves the arm so [N m, N]."""
        whole = self.coupling
        u = pin.rnea(self.model, self.data, whole.joints(q), whole.rates(v), whole.rates(a))
        return whole.on_coordinates(np.array(u))

    def coriolis(self, q: Array, v: Array) -> Array:
        """(n, n) C of C q' at velocities v (n,), by Christoffel symbols [N m s/rad, N s/m]."""
        whole = self.coupling
        C = pin.computeCoriolisMatrix(self.model, self.data, whole.joints(q), whole.rates(v))
        return whole.by_coordinates(whole.on_coordinates(np.array(C)))

    def jacobian_rate(self, q: Array, v: Array) -> Array:
        """(6, n) J' of the tip in world axes at velocities v (n,), linear above angular [1/s]."""
        whole = self.coupling
        pin.computeJointJacobiansTimeVariation(
            self.model, self.data, whole.joints(q), whole.rates(v)
        )
        J_dot: Array = pin.getFrameJacobianTimeVariation(
            self.model, self.data, self._tip, pin.LOCAL_WORLD_ALIGNED
        )
        return whole.by_coordinates(columns(J_dot))
