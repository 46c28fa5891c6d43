"""What a law's own springs press with: impedance, PD and stiffness control, soft axes.

At rest K_m (x_d - x) is what the robot applies, (4.25)-(4.27), (4.33). A contact of stiffness k
along the unit normal a bears f with the reference a way s behind its surface:

    s = f (1/k + w^T K_m^-1 w),    w = (a; r x a), r from the control point to where they touch.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.gains import BANDWIDTH, value_of
from taskspec.prediction.at_start import StageAtStart
from taskspec.prediction.reach import along, moment_arms
from taskspec.prediction.worlds import ContactWorld
from taskspec.program.known_value import known_value

Vector = NDArray[np.float64]


def yield_of(here: StageAtStart, normal: Vector) -> float | None:
    """w^T K_m^-1 w [m/N] of the axes with a spring along a normal (3,); None where there is none.

    Axes that have a bandwidth instead of a spring are stiff beside those with one.
    """
    springs = here.stage.plan.gains.get("stiffness", {})
    stiff = BANDWIDTH.name in here.stage.plan.gains
    w = moment_arms(here, normal)
    found = 0.0
    for axis in here.stage.plan.axes:
        share = float(w[AXES.index(axis)]) ** 2
        if share < 1e-12 or (stiff and axis not in springs):
            continue
        if axis not in springs or springs[axis].value <= 0:
            return None
        found += share / springs[axis].value
    return found if found > 0 else None


def behind(here: StageAtStart, normals: Vector) -> tuple[Axis, float] | None:
    """The axis whose reference goes behind the surface, and how far [m].

    None where no such axis is planned to, or the place of its reference is not known.

    Args:
        here: the stage.
        normals: (3, 1) of its contact, outward, in the stage's axes.
    """
    for axis, plan in here.stage.plan.plans.items():
        if along(normals, axis) is None or plan.force:
            continue
        away = float(normals[AXES.index(axis), 0])
        if plan.open_loop:
            force = plan.axis.set_point
            wanted = None if force is None else known_value(here.context, force.wanted)
            own = value_of(here.stage.plan.gains, "stiffness", axis)
            if wanted is None or own <= 0:
                return None
            k = here.stage.plan.environment.stiffness_of(axis)
            return axis, -wanted * (1 / own + 1 / k) / away
        reference = _reference(here, normals[:, 0])
        return None if reference is None else (axis, -reference)
    return None


def _reference(here: StageAtStart, normal: Vector) -> float | None:
    """Gap [m] of the reference as the planned motion of a stage ends."""
    if here.gap is None or here.course is None:
        return None
    moved = here.course.moved(here.course.duration)
    way = np.array([moved.get(a, 0.0) for a in AXES[:3]])
    reference = here.gap + float(normal @ way)
    return reference if np.isfinite(reference) else None


def push(depth: float, own: float, world: ContactWorld) -> float:
    """What a contact bears [N] with the reference `depth` [m] behind its nominal surface.

    Args:
        depth: [m].
        own: yielding of the law's springs [m/N].
        world: where the surface is.
    """
    return max(depth - world.farther, 0.0) / (1 / world.stiffness + own)
