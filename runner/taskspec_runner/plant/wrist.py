"""What a force sensor between flange and tool feels: the contact, and the tool that hangs on it."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec_runner.plant.arm import SceneArm

Vector = NDArray[np.float64]

#: What is measured of how the tool's own body moves, by the names of the sensors.
_MOTION = {
    "wrist/linear": mujoco.mjtSensor.mjSENS_FRAMELINACC,
    "wrist/angular": mujoco.mjtSensor.mjSENS_FRAMEANGACC,
    "wrist/turning": mujoco.mjtSensor.mjSENS_FRAMEANGVEL,
}


def add_wrist(spec: mujoco.MjSpec, arm: SceneArm) -> None:
    """Adds sensors of how the tool's own body accelerates."""
    for name, kind in _MOTION.items():
        spec.add_sensor(
            name=arm.element(name),
            type=kind,
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            objname=arm.robot.tip_body,
        )


class Wrist:
    """Weight and inertia of the tool, added to what the environment exerts on it.

    Attributes:
        wrench: (6,) by all that is beyond the flange on the flange, moment about the tip, world
            axes [N, N m]. The tool's weight is in it also where a counterweight carries the arm:
            that hangs on the joints, not on the tool.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, arm: SceneArm) -> None:
        body = model.body(arm.robot.tip_body).id
        self.wrench = np.zeros(6)
        self._mass = float(model.body_mass[body])
        self._moments = np.array(model.body_inertia[body])
        self._axes = data.ximat[body].reshape(3, 3)
        self._lever = np.array(model.body_ipos[body])
        self._rotation = data.xmat[body].reshape(3, 3)
        addresses = [int(model.sensor(arm.element(name)).adr[0]) for name in _MOTION]
        self._motion = [data.sensordata[at : at + 3] for at in addresses]

    def read(self, contact: Vector) -> None:
        """Adds the tool's part to the contact wrench (6,) about the tip of the same step."""
        linear, angular, turning = self._motion
        # MuJoCo's acceleration of a frame has gravity in it: it is that of a body held still.
        force = -self._mass * linear
        axes, moments = self._axes, self._moments
        turned, spin = angular @ axes, turning @ axes
        moment = axes @ (-moments * turned - _cross(spin, moments * spin))
        self.wrench[:3] = contact[:3] + force
        self.wrench[3:] = contact[3:] + moment + _cross(self._rotation @ self._lever, force)


def _cross(a: Vector, b: Vector) -> Vector:
    """a x b of (3,) vectors, at a third of what NumPy's takes."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
