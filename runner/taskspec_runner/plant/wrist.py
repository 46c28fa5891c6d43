"""The wrist sensor's truth: what the tool exerts on the flange."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

_NAMES = ("wrist/force", "wrist/torque")


def add(spec: mujoco.MjSpec, tip_body: str) -> None:
    """Adds a force and a torque sensor at the tip of the tool."""
    spec.body(tip_body).add_site(name="wrist", pos=[0.0, 0.0, 0.0])
    types = (mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE)
    for name, kind in zip(_NAMES, types, strict=True):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="wrist")


class Wrist:
    """Reads the sensors of a scene; wrenches are about the tip in world axes."""

    def __init__(self, model: mujoco.MjModel, tip_body: str) -> None:
        self._where = [int(model.sensor(name).adr[0]) for name in _NAMES]
        body = model.body(tip_body)
        self._mass, self._lever = float(body.mass[0]), np.array(body.ipos)
        self._gravity = np.array(model.opt.gravity)

    def at_rest(self, rotation: Vector, contact: Vector, out: Vector) -> None:
        """Fills `out` (6,) as long as nothing moves: contact and weight."""
        force = self._mass * self._gravity
        out[:3] = contact[:3] + force
        out[3:] = contact[3:] + np.cross(rotation.reshape(3, 3) @ self._lever, force)

    def read(self, data: mujoco.MjData, rotation: Vector, out: Vector) -> None:
        """Fills `out` (6,) from the last step. MuJoCo gives what the flange exerts on the tool."""
        R = rotation.reshape(3, 3)
        for i, at in enumerate(self._where):
            out[3 * i : 3 * i + 3] = -R @ data.sensordata[at : at + 3]
