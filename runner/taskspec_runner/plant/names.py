"""Names of the world's elements in MuJoCo's model, and small helpers for building it."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.rotation import from_rpy
from taskspec.program.world.frames import Posed

#: Names of everything that is not the robot's begin with this.
PREFIX = "world/"
#: The body of a knob, below its mechanism's.
KNOB = "/knob"

#: A geom that neither touches nor weighs anything.
INERT = {"contype": 0, "conaffinity": 0, "mass": 0.0}


def quaternion(R: NDArray[np.float64]) -> list[float]:
    """(4,) w x y z of a rotation matrix (3, 3)."""
    found = np.zeros(4)
    mujoco.mju_mat2Quat(found, np.ascontiguousarray(R).ravel())
    return [float(value) for value in found]


def placed(posed: Posed) -> dict[str, list[float]]:
    """`pos` and `quat` of a posed thing, as MuJoCo's elements take them."""
    return {"pos": list(posed.xyz), "quat": quaternion(from_rpy(posed.rpy))}


def weightless(body: mujoco.MjsBody, mass: float, inertia: float) -> None:
    """Gives a body a mass [kg] at its origin and an inertia [kg m^2], and takes gravity off it."""
    body.explicitinertial = True
    body.mass, body.inertia = mass, [inertia] * 3
    body.ipos, body.iquat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    body.gravcomp = 1.0
