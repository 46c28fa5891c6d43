"""Inertias that no body has, and what is used in their place.

Of a body whose density is positive everywhere all principal moments of inertia are, and the largest
is at most the sum of the other two (Traversaro et al. 2016, Identification of fully physical
consistent inertial parameters).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taskspec.deferred import mujoco
from taskspec.deferred_methods import dataclass
from taskspec.robot.errors import RobotError
from taskspec.robot.poses import symmetric
from taskspec.robot.types import FileRemark

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

#: Moments below this are those of a point [kg·m²].
_NONE = 1e-12
#: Share of the largest moment that rounding in a file may be.
_ROUNDED = 1e-3


@dataclass(frozen=True, slots=True)
class Unphysical:
    """A link whose inertia no body has.

    Attributes:
        link: Its name.
        moments: (3,) principal moments of inertia as its file has them, ascending [kg·m²].
        used: Of each axis what is used instead [kg·m²].
    """

    link: str
    moments: tuple[float, ...]
    used: float

    @property
    def remark(self) -> FileRemark:
        """What is wrong, and what is used instead."""
        given = ", ".join(f"{moment:g}" for moment in reversed(self.moments))
        if self.moments[0] < 0:
            why = "and no body has a negative one"
            used = "the mean of the three with negative ones taken as zero"
        else:
            why = "and of no body is the largest more than the sum of the other two"
            used = "their mean"
        return FileRemark(
            "TS448",
            f"link '{self.link}' has principal moments of inertia {given} kg*m^2, {why}: "
            f"{self.used:.4g} kg*m^2, {used}, is used about every axis",
            "correct the link's <inertial>: moments are about its centre of mass, in kg*m^2, along "
            "the axes of its origin",
            ("model",),
        )


def make_physical(spec: mujoco.MjSpec) -> tuple[list[Unphysical], list[str]]:
    """Replaces the inertias of a specification that no body has.

    Returns:
        Links whose inertias are others now, and one sentence on each that was rounded.

    Raises:
        RobotError: TS405 for a negative mass.
    """
    found, rounded = list[Unphysical](), list[str]()
    if spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        return found, rounded
    for body in spec.bodies:
        if not body.explicitinertial:
            continue
        if body.mass < 0:
            raise RobotError("TS405", f"link '{body.name}' has a negative mass, {body.mass:g} kg")
        tensor = _tensor(body)
        moments, axes = np.linalg.eigh(tensor)
        low, middle, high = (float(moment) for moment in moments)
        size = max(abs(low), high)
        if size < _NONE or (low >= 0 and high <= low + middle):
            continue
        if low >= -_ROUNDED * size and high - low - middle <= _ROUNDED * size:
            low, middle = max(low, 0.0), max(middle, 0.0)
            # By a hair less, so that it stays below the sum in whatever order that is formed.
            most = min(high, (low + middle) * (1 - 1e-12))
            _give(body, axes @ np.diag([low, middle, most]) @ axes.T)
            rounded.append(
                f"the moments of inertia of '{body.name}' are rounded by {high - most:.2g} kg·m², "
                "so that none exceeds the sum of the others"
            )
            continue
        used = float(np.mean(np.maximum(moments, 0.0)))
        _give(body, used * np.eye(3))
        found.append(Unphysical(body.name, (low, middle, high), used))
    return found, rounded


def _tensor(body: mujoco.MjsBody) -> Array:
    """(3, 3) inertia about the centre of mass, in the frame that the specification has for it."""
    whole = body.fullinertia.tolist()
    return symmetric(body.inertia.tolist() if np.isnan(whole[0]) else whole)


def _give(body: mujoco.MjsBody, tensor: Array) -> None:
    """Has a body another inertia (3, 3) in that frame."""
    if np.isnan(body.fullinertia[0]):
        body.inertia = np.diag(tensor)
    else:
        body.fullinertia = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
