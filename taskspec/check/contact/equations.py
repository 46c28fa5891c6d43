"""Constraint equations at the start: regular, kept, independent of each other (4.80), (4.101)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, Axis
from taskspec.program.context import Context
from taskspec.program.reference.constraints import active_equations
from taskspec.signals.entries import TOUCHING
from taskspec.spec import FILE, key_of
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.show import show
from taskspec.text.source import Span

register(
    {
        "TS311": "an equation without a gradient",
        "TS312": "a start off a constraint",
        "TS313": "constraints that depend on each other",
    }
)

#: Below this length a gradient, in its own units, is none.
_FLAT = 1e-9
#: Smallest singular value of unit normals, on joints' rates, that are told apart.
_DEPENDENT = 1e-3


def check_equations(context: Context, found: Diagnostics) -> None:
    """Reports equations that have no gradient at the start, or that the start does not keep."""
    loaded = context.loaded
    for name, at in context.start_equations.items():
        model = context.equations[name]
        place = loaded.span(FILE.world[name].equation)
        what = "joints start" if model.joints else "tool starts"
        if not (np.isfinite(at.distance) and np.isfinite(at.normal).all()):
            found.error("TS117", f"this has no finite value where the {what}", place)
            continue
        if at.scale < _FLAT:
            found.error(
                "TS311",
                f"{name!r} has no gradient where the {what}, so no direction to push in",
                place,
                "start elsewhere, or state the same constraint by a regular equation",
            )
            continue
        broken = {"=": True, "<=": at.distance > 0, ">=": at.distance < 0}
        force = abs(at.distance) * context.compliances[name].stiffness
        if broken[model.constraint.relation] and force > TOUCHING:
            unit = "deg" if model.joints else "mm"
            effort = show(force, "N*m" if model.joints else "N", 3)
            found.warning(
                "TS312",
                f"the {what} {show(abs(at.distance), unit)} off {name!r}: the run begins with "
                f"{effort} of it",
                loaded.span(FILE.robot.start),
                "start on the constraint",
            )


def check_constraints(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    rotation: NDArray[np.float64],
    found: Diagnostics,
) -> None:
    """Reports constraints of stage `name` that say the same as others, or more than the arm has.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        rotation: (3, 3) its frame at the start pose. found: where findings go.
    """
    loaded = context.loaded
    stage = loaded.task.stages[name]
    law = context.law_of(stage)
    if not law.control_law.multipliers:
        return
    J = np.kron(np.eye(2), rotation.T) @ context.start_jacobian
    rows: dict[str, NDArray[np.float64]] = {
        f"axis {a!r}": J[AXES.index(a)]
        for a, axis in stage.axes.items()
        if a in axes and axis.has_force
    }
    for equation in active_equations(law, stage, context.equations):
        at = context.start_equations[equation]
        if at.scale < _FLAT:
            return  # Told of the equation itself.
        rows[repr(equation)] = at.normal
    kept: list[NDArray[np.float64]] = []
    for row, normal in rows.items():
        size = float(np.linalg.norm(normal))
        if size < _FLAT:
            message = f"the arm cannot move along the normal of {row}, so no force can be set there"
            found.error("TS313", message, _place(context, name, row), "leave it out")
            return
        unit = normal / size
        if np.linalg.svd(np.array([*kept, unit]), compute_uv=False)[-1] < _DEPENDENT:
            before = ", ".join(list(rows)[: len(kept)])
            found.error(
                "TS313",
                f"the constraint of {row} follows from those before it ({before}), so their forces "
                "cannot be told apart",
                _place(context, name, row),
                "leave one of them out",
            )
            return
        kept.append(unit)


def _place(context: Context, stage: str, row: str) -> Span | None:
    """Where a stage states a constraint, or else where the world does."""
    name, span = row.removeprefix("axis ").strip("'"), context.loaded.span
    declared = context.loaded.task.stages[stage]
    if row.startswith("axis "):
        return span(key_of(FILE.stages[stage].axes[name]))
    if name in declared.constraints:
        return span(key_of(FILE.stages[stage].constraints[name]))
    return span(key_of(FILE.stages[stage]))
