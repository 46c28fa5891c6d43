"""Forces that nothing in the world returns: artificial against natural constraints, by rank.

What the world can return at the tip is a space of wrenches W. A set point on an axis a is resisted
if some wrench of W does work along a, that is a^T W is not zero. Spaces of force and motion are
never compared with each other by angles, whose units differ.
"""

from __future__ import annotations

from itertools import product

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, Axis
from taskspec.program.context import Context
from taskspec.program.known import known_value
from taskspec.program.world.equations import EquationModel
from taskspec.spec import FILE, AxisEntry, Stage
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics, Severity
from taskspec.text.show import show
from taskspec.text.source import Span

register(
    {
        "TS320": "a force that nothing resists",
        "TS325": "an axis that nothing determines",
    }
)

Vector = NDArray[np.float64]

#: Smallest share of a direction that counts as resisted: an axis is no more exact than 1 deg.
_RESISTED = np.sin(np.deg2rad(1.0))
#: How far around the start the gradients of an equation are looked at [m].
_AROUND = 0.1
_TIMES = (0.0, 0.13, 0.37, 1.0, 2.9)
_ALL = np.eye(3)
_NONE = np.zeros((3, 0))


def check_resisting(
    context: Context, name: str, axes: tuple[Axis, ...], rotation: Vector, found: Diagnostics
) -> None:
    """Reports set points of stage `name` on axes along and about which nothing resists.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        rotation: (3, 3) its frame at the start pose. found: where findings go.
    """
    stage = context.loaded.task.stages[name]
    law = context.law_of(stage)
    if not law.control_law.force_loop:
        return
    gives_way = law.control_law.shares or law.solve == "qp"
    for axis, entry in stage.axes.items():
        wanted = _wanted(context, entry) if axis in axes else None
        if wanted is None:
            continue
        turns = axis.is_rotation
        key, unit = ("torque", "N*m") if turns else ("force", "N")
        place = context.loaded.span(FILE.stages[name].axes[axis][key])
        if _is_told(place, found):
            continue
        direction = rotation[:, AXES.index(axis) % 3]
        space = moments(context, stage) if turns else forces(context, stage, rotation)
        if np.linalg.norm(direction @ space) > _RESISTED:
            continue
        if wanted == 0.0:
            if not law.control_law.shares:
                _report_undetermined(context, axis, place, found)
            continue
        found.add(
            Severity.WARNING if gives_way else Severity.ERROR,
            "TS320",
            f"nothing resists {show(wanted, unit)} {'about' if turns else 'along'} {axis!r}: "
            f"{_reason(context, turns)}, and the tool {'turns' if turns else 'runs'} away",
            place,
            f"move or hold {axis!r} instead, or declare under 'world' what is to resist",
        )


def _report_undetermined(
    context: Context, axis: Axis, place: Span | None, found: Diagnostics
) -> None:
    """Tells of an axis without a motion, along which neither a force is asked for nor can be.

    That f = 0 there is natural already, so stating it is no constraint: what is left of the law is
    its damping.
    """
    turns = axis.is_rotation
    if turns and any(d.code == "TS228" for d in found.sorted()):
        return  # No rotation can be left to a torque there.
    found.info(
        "TS325",
        f"nothing determines {axis!r}: no {'moment' if turns else 'force'} is asked for, and "
        f"{_reason(context, turns)}; only damping keeps the tool there",
        place,
        f"hold it or move it, unless it is to {'turn' if turns else 'go'} freely",
    )


def _is_told(place: Span | None, found: Diagnostics) -> bool:
    """Whether a contradiction of lines or an open-loop force without a surface says it already."""
    told = (d for d in found.sorted() if d.code in ("TS303", "TS420"))
    return any(place in (d.span, *(note.span for note in d.notes)) for d in told)


def _wanted(context: Context, entry: AxisEntry) -> float | None:
    """A set point, not zero if it is ever another [N, N m]; None where signals decide it."""
    expression = entry.force if entry.torque is None else entry.torque
    if expression is None:
        return None
    values = [known_value(context, expression, {"t": t, "clock": t}) for t in _TIMES]
    if any(v is None or not np.isfinite(v) for v in values):
        return None
    return next((v for v in values if v), 0.0)


def forces(context: Context, stage: Stage, rotation: Vector) -> Vector:
    """(3, k) directions in which the world can return a force to the tip, world axes.

    A shape whose normal is not known everywhere counts as returning all, and so does what the
    robot holds: along the way that a mechanism leaves open its own dynamics resist.
    """
    task = context.loaded.task
    frame = context.frame_of(stage)
    if task.robot.grasp is not None or any(m.joints for m in context.equations.values()):
        return _ALL
    columns = [_NONE]
    for name, shape in task.shapes.items():
        moves = name in context.moving_bases and context.moving_bases[name].turns
        level = context.surfaces[name].level and not shape.free and not moves
        if shape.friction > 0 or not (level or name == frame.surface_name):
            return _ALL
        normal = rotation[:, 2] if name == frame.surface_name else context.start_normals[name]
        columns.append(normal[:, None])
    columns += [gradients(context, model) for model in context.equations.values()]
    return _basis(np.hstack(columns))


def moments(context: Context, stage: Stage) -> Vector:
    """(3, k) directions about which the world can return a moment to the control point.

    A ball touches in one point and an equation acts on one: neither bears a moment there. A free
    knob bears none about its own axis.
    """
    task = context.loaded.task
    frame = context.frame_of(stage)
    if frame.at_origin or any(m.joints for m in context.equations.values()):
        return _ALL
    if task.robot.grasp is not None:
        held = context.mechanisms.get(context.held)
        if held is None or not held.free:
            return _ALL
        axis = held.rotation[:, 2]
        return _basis(np.eye(3) - np.outer(axis, axis))
    return _ALL if task.shapes and context.robot.tool.flat else _NONE


def gradients(context: Context, model: EquationModel) -> Vector:
    """(3, k) unit gradients of an equation at the start and around it."""
    x = ca.SX.sym("x", 3)
    terms = model.terms(x, ca.SX.zeros(3), ca.SX(0))
    normal = ca.Function("normal", [x], [terms.normal])
    offsets = _AROUND * np.array([*product((-1.0, 0.3, 1.0), repeat=3)])
    found = [np.array(normal(context.start_p + d)).ravel() for d in (np.zeros(3), *offsets)]
    finite = [n for n in found if np.isfinite(n).all()]
    return np.array(finite).T if len(finite) == len(found) else _ALL


def _basis(columns: Vector) -> Vector:
    """An orthonormal basis (3, r) of the span of columns (3, k)."""
    if columns.shape[1] == 0:
        return _NONE
    U, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(U[:, sizes > _RESISTED * sizes[0]])


def _reason(context: Context, turns: bool) -> str:
    task = context.loaded.task
    objects = [*task.shapes, *task.equations]
    if turns and context.held:
        return f"the knob of {context.held!r} turns freely"
    if not objects:
        return "there is nothing in the world to push on"
    if turns:
        touching = "a ball touches in one point" if task.shapes else "an equation holds one point"
        return f"{touching} and bears no moment"
    listed = ", ".join(map(repr, objects))
    return f"without friction {listed} {'returns' if len(objects) == 1 else 'return'} none there"
