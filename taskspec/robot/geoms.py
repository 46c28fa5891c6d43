"""The geom of a shape in MuJoCo's model: the one place where its data becomes one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from taskspec.deferred import mujoco
from taskspec.shapes import Geom

if TYPE_CHECKING:
    import numpy.typing as npt

_AXES = np.eye(3)


def add_geom(
    body: mujoco.MjsBody,
    geom: Geom,
    origin: Sequence[float] | npt.NDArray[np.float64],
    rotation: npt.NDArray[np.float64] = _AXES,
    **looks: Any,
) -> mujoco.MjsGeom:
    """Adds the geom of a shape to a body.

    Args:
        body: To add to.
        geom: What to add, in the shape's axes.
        origin: (3,) of the shape in the body [m].
        rotation: (3, 3), columns are the shape's axes in the body.
        looks: Name, colour and all else that MuJoCo's geom takes.
    """
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(rotation).ravel())
    return body.add_geom(
        type=getattr(mujoco.mjtGeom, f"mjGEOM_{geom.kind.upper()}"),
        size=list(geom.size),
        pos=(np.array(origin) + rotation @ np.array(geom.center)).tolist(),
        quat=quaternion.tolist(),
        **looks,
    )
