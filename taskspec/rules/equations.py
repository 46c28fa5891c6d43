"""Constraint equations at the start: regular, kept, independent of each other (4.80), (4.101)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.signals.entries import TOUCHING
from taskspec.spec import FILE, KeyPath, key_of
from taskspec.text.units import FORCE, LENGTH, show

#: Below this length a gradient, in its own units, is none.
_FLAT = 1e-9
#: Smallest singular value of unit normals, on joints' rates, that are told apart.
_DEPENDENT = 1e-3


@rule(
    {
        "TS311": "an equation without a gradient",
        "TS312": "a start off a constraint",
    },
    also=("TS117",),
    phase=Phase.TASK,
)
def equations_at_the_start(task: TaskPlan) -> Iterator[Finding]:
    """Equations that have no gradient at the start, or that the start does not keep."""
    context = task.context
    for name, at in context.start_equations.items():
        model = context.equations[name]
        place = FILE.world[name].equation
        what = "joints start" if model.joints else "tool starts"
        if not (np.isfinite(at.distance) and np.isfinite(at.normal).all()):
            yield error("TS117", f"this has no finite value where the {what}", place)
            continue
        if at.scale < _FLAT:
            yield error(
                "TS311",
                f"{name!r} has no gradient where the {what}, so no direction to push in",
                place,
                "start elsewhere, or state the same constraint by a regular equation",
            )
            continue
        broken = {"=": True, "<=": at.distance > 0, ">=": at.distance < 0}
        force = abs(at.distance) * context.compliances[name].stiffness
        if broken[model.constraint.relation] and force > TOUCHING:
            off = show(abs(at.distance), LENGTH.on(rotation=model.angular))
            effort = show(force, FORCE.on(rotation=model.angular), 3)
            yield warning(
                "TS312",
                f"the {what} {off} off {name!r}: the run begins with {effort} of it",
                FILE.robot.start,
                "start on the constraint",
            )


@rule("TS313", "constraints that depend on each other", phase=Phase.AXES)
def dependent_constraints(stage: StagePlan) -> Iterator[Finding]:
    """Constraints that say the same as others, or more than the arm has."""
    context = stage.context
    if not stage.law.control_law.multipliers:
        return
    J = np.kron(np.eye(2), stage.rotation.T) @ context.start_jacobian
    own = FILE.stages[stage.name]
    rows: list[tuple[str, KeyPath, NDArray[np.float64]]] = [
        (f"axis {a!r}", own.axes[a], J[a.row])
        for a, axis in stage.spec.axes.items()
        if a in stage.axes and axis.has_force
    ]
    for equation in stage.active:
        at = context.start_equations[equation]
        if at.scale < _FLAT:
            return  # The rule about the equation itself says so.
        place = own.constraints[equation] if equation in stage.spec.constraints else own
        rows.append((repr(equation), place, at.normal))
    kept: list[NDArray[np.float64]] = []
    for row, place, normal in rows:
        size = float(np.linalg.norm(normal))
        if size < _FLAT:
            yield error(
                "TS313",
                f"the arm cannot move along the normal of {row}, so no force can be set there",
                key_of(place),
                "leave it out",
            )
            return
        unit = normal / size
        if np.linalg.svd(np.array([*kept, unit]), compute_uv=False)[-1] < _DEPENDENT:
            before = ", ".join(text for text, *_ in rows[: len(kept)])
            yield error(
                "TS313",
                f"the constraint of {row} follows from those before it ({before}), so their forces "
                "cannot be distinguished",
                key_of(place),
                "leave one of them out",
            )
            return
        kept.append(unit)
