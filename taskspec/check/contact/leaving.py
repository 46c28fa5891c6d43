"""Planned motions against natural constraints: into a surface, off an equation, (4.101)."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.foresight.course import moving_axes
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.gains import on_axis
from taskspec.motion.path import PathShape
from taskspec.program.axes import MOSTLY
from taskspec.program.context import Context
from taskspec.program.reference.constraints import active_equations
from taskspec.program.trajectory import Nominal
from taskspec.program.world.equations import EquationModel
from taskspec.signals.entries import TOUCHING
from taskspec.spec import FILE, AxisEntry, Stage, key_of
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.expression.tree import Name, walk
from taskspec.text.show import show
from taskspec.text.source import Span

register(
    {
        "TS321": "a motion into a surface",
        "TS323": "a motion that leaves a constraint",
        "TS324": "a motion to where a constraint has no gradient",
    }
)

Vector = NDArray[np.float64]

#: A planned motion may leave an equation by this much [m]: tables of points are taken as polygons.
_OFF = 1e-3
#: Share of a gradient along axes that give way, from which the constraint decides about them.
_DECIDED = 0.1
#: Below this length, against that at the start, a gradient is none.
_FLAT = 1e-3


def check_leaving(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    path: PathShape | None,
    walked: Nominal,
    found: Diagnostics,
) -> None:
    """Reports planned motions of stage `name` that natural constraints do not allow.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame. path: its path.
        walked: where the tool is, after this stage's places. found: where findings go.
    """
    stage = context.loaded.task.stages[name]
    way = walked.way()
    if not way or stage.until is not None:
        return
    if context.law_of(stage).control_law.selects:
        _check_surface(context, name, axes, walked, way, found)
        _check_equations(context, name, axes, path, walked, way, found)


def _check_surface(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    walked: Nominal,
    way: list[tuple[float, Vector]],
    found: Diagnostics,
) -> None:
    """Reports a motion axis that leads into the nominal contact, and how hard it presses."""
    stage = context.loaded.task.stages[name]
    frame, law = context.frame_of(stage), context.law_of(stage)
    contact = context.contact_of(frame)
    if contact is None or walked.gap is None or walked.start is None or frame.at_origin:
        return
    normal = context.start_normals[contact]
    along = {a: abs(float(walked.rotation[:, AXES.index(a)] @ normal)) for a in axes if a[0] != "r"}
    axis = max(along, key=lambda a: along[a])
    entry = stage.axes.get(axis)
    if along[axis] < MOSTLY or any(e.has_force for e in stage.axes.values()):
        return
    depth = max(-walked.gap - float(normal @ (p - walked.start)) for _, p in way)
    if depth <= max(0.0, -walked.gap) or (entry is not None and entry.stiffness is not None):
        return
    felt = context.felt_stiffness(frame, axes, walked.rotation)
    plant = context.plants(axes, walked.rotation, felt)[axis]
    gains = law.design({axis: _motion(stage, axis)}, {axis: plant})
    own = law.control_law.spring(on_axis(gains, axis), plant.h)
    k = context.compliances[contact].stiffness
    force = depth * own * k / (own + k)
    if force > TOUCHING:
        found.warning(
            "TS321",
            f"stage {name!r} moves {show(depth, 'mm', 3)} into {contact!r}: the motion does not "
            f"give way there, and presses with about {show(force, 'N', 2)}",
            _place(context, name, stage),
            f"shorten the way, give {axis!r} a force, or move until one is felt",
        )


def _check_equations(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    path: PathShape | None,
    walked: Nominal,
    way: list[tuple[float, Vector]],
    found: Diagnostics,
) -> None:
    """Reports where the planned way leaves an equation that holds, or where that has no gradient.

    What a law with multipliers leaves to the constraints gives way: axes that the stage does not
    name. An equation along whose gradient they can move is kept whatever the others do.
    """
    stage = context.loaded.task.stages[name]
    law = context.law_of(stage)
    multipliers = law.control_law.multipliers
    active = active_equations(law, stage, context.equations) if multipliers else ()
    free = [
        walked.rotation[:, AXES.index(a)]
        for a in axes
        if a[0] != "r"
        and multipliers
        and a not in stage.axes
        and (path is None or a not in path.axes)
    ]
    for equation, model in context.equations.items():
        if model.joints or _moves(model):
            continue
        x = ca.SX.sym("x", 3)
        terms = model.terms(x, ca.SX.zeros(3), ca.SX(0))
        at = ca.Function("at", [x], [terms.distance, terms.normal, terms.scale])
        least = _FLAT * context.start_equations[equation].scale
        both = model.constraint.relation == "=" or equation in active
        for time, p in way:
            distance, normal, scale = (np.array(v).ravel() for v in at(p))
            if not np.isfinite(distance[0]) or scale[0] < least:
                found.warning(
                    "TS324",
                    f"stage {name!r} leads at t = {show(time, 's', 3)} to where {equation!r} has "
                    "no gradient, so no direction to push in",
                    _place(context, name, stage),
                    "keep away from there, or state the same constraint by a regular equation",
                )
                break
            off = float(distance[0])
            wrong = {"<=": off > 0, ">=": off < 0}.get(model.constraint.relation, True)
            decided = any(abs(float(normal @ direction)) > _DECIDED for direction in free)
            if abs(off) <= _OFF or not (both or wrong) or decided:
                continue
            if time > 0.0:  # A stage that begins off it does not leave it.
                found.warning(
                    "TS323",
                    f"stage {name!r} leaves {equation!r}: at t = {show(time, 's', 3)} it would be "
                    f"{show(abs(off), 'mm', 3)} {'off' if both else 'beyond'} it",
                    _place(context, name, stage),
                    "plan a motion that keeps the equation, phi(q_d(t)) = 0 (4.101)",
                )
                break


def _moves(model: EquationModel) -> bool:
    """Whether an equation changes with time."""
    nodes = walk(model.constraint.residual.tree)
    return any(isinstance(n, Name) and n.path == ("clock",) for n in nodes)


def _motion(stage: Stage, axis: Axis) -> AxisEntry:
    return stage.axes.get(axis) or AxisEntry()


def _place(context: Context, name: str, stage: Stage) -> Span | None:
    """Where a stage says how it moves."""
    span = context.loaded.span
    if stage.path is not None:
        return span(key_of(FILE.stages[name].path))
    axis = next(iter(moving_axes(stage)), None)
    return span(key_of(FILE.stages[name].axes[axis] if axis else FILE.stages[name]))
