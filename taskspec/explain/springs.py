"""What a law's own springs press with: impedance, PD and stiffness control, soft axes.

At rest K_m (x_d - x) is what the robot applies, (4.25)-(4.27), (4.33). A contact of stiffness k
along the unit normal a bears f with the reference at a depth s behind its surface:

    s = f (1/k + w^T K_m^-1 w),    w = (a; r x a), r from the control point to where they touch.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.explain.bearing import along, bearing, gap_at_start, moment_arms
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.coupled import stretched, yielding_stiffness
from taskspec.laws.gains import BANDWIDTH, pairs_of
from taskspec.program.plan import StagePlan

Vector = NDArray[np.float64]

#: A component of a lever whose square is below this does not load its spring.
_UNLOADED = 1e-12


@dataclass(frozen=True, slots=True)
class SpringContact:
    """A contact that springs of a law press on.

    Attributes:
        name: of the object.
        axis: whose reference is behind its surface.
        normal: (3,) outward, in the stage's axes.
        depth: of the reference behind the surface [m].
        compliance: w^T K_m^-1 w [m/N].
    """

    name: str
    axis: Axis
    normal: Vector
    depth: float
    compliance: float

    def force(self, stiffness: float) -> float:
        """What the robot applies on the axis at rest [N], on a contact of a stiffness [N/m]."""
        return -float(self.normal[self.axis.row]) * self.depth / (1 / stiffness + self.compliance)


def spring_contact(plan: StagePlan) -> SpringContact | None:
    """The contact of a stage that springs press on; None where there is none, or it is unknown."""
    on = bearing(plan)
    if plan.contacts.main not in on.names or plan.frame.at_origin or plan.falls:
        return None
    normal = on.normals[:, on.names.index(plan.contacts.main)]
    found, compliance = _behind(plan, normal), _compliance(plan, normal)
    if found is None or compliance is None or found[1] <= 0:
        return None
    return SpringContact(plan.contacts.main, found[0], normal, found[1], compliance)


def _compliance(plan: StagePlan, normal: Vector) -> float | None:
    """w^T K_m^-1 w [m/N] of the axes with a spring along a normal (3,); None where there is none.

    None as well where a stiffness varies. Axes that have a bandwidth instead of a spring are stiff
    beside those with one.
    """
    springs = plan.gains.get("stiffness", {})
    if any(gain.formula is not None for gain in springs.values()):
        return None
    stiff = BANDWIDTH.name in plan.gains
    w = moment_arms(plan, normal)
    if pairs_of(plan.gains, "stiffness"):
        loads = {axis: float(w[axis.row]) for axis in plan.axes}
        borne = {axis: load for axis, load in loads.items() if load**2 >= _UNLOADED}
        if any(axis not in springs or springs[axis].value <= 0 for axis in borne):
            return None
        return float(sum(w * stretched(plan.gains, a, borne) for a, w in borne.items()))
    found = 0.0
    for axis in plan.axes:
        share = float(w[axis.row]) ** 2
        if share < _UNLOADED or (stiff and axis not in springs):
            continue
        if axis not in springs or springs[axis].value <= 0:
            return None
        found += share / springs[axis].value
    return found if found > 0 else None


def _behind(plan: StagePlan, normal: Vector) -> tuple[Axis, float] | None:
    """The axis whose reference goes behind the surface, and how far [m].

    None where no such axis is planned to, or the place of its reference is not known.

    Args:
        plan: of the stage.
        normal: (3,) of its contact, outward, in the stage's axes.
    """
    for axis, one in plan.plans.items():
        if along(normal[:, None], axis) is None or one.force:
            continue
        if one.open_loop:
            force = one.axis.set_point
            wanted = None if force is None else plan.known(force.wanted)
            own = yielding_stiffness(plan.gains, axis)
            if wanted is None or own <= 0:
                return None
            depth = (
                -wanted
                * (1 / own + 1 / plan.environment.stiffness_of(axis))
                / float(normal[axis.row])
            )
            return axis, depth
        reference = _reference(plan, normal)
        return None if reference is None else (axis, -reference)
    return None


def _reference(plan: StagePlan, normal: Vector) -> float | None:
    """Gap [m] of the reference as the planned motion of a stage ends."""
    gap, course = gap_at_start(plan), plan.nominal.course
    if gap is None or course is None:
        return None
    moved = course.moved(course.duration)
    reference = gap + float(normal @ [moved.get(a, 0.0) for a in AXES[:3]])
    return reference if np.isfinite(reference) else None
