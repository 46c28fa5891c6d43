"""Signals that exist in the language but not in this stage, on this arm."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from taskspec.geometry.axis import ROTATIONS, Axis, as_axis
from taskspec.program.context import Context
from taskspec.program.known import known_value
from taskspec.program.signals import entry_of
from taskspec.signals import VECTORS
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.expression import Expression
from taskspec.text.expression.tree import Call, Name, Node, children

register({"TS224": "a signal that this stage cannot evaluate"})


def check_signals(context: Context, name: str, axes: tuple[Axis, ...], found: Diagnostics) -> None:
    """Reports signals in the expressions of stage `name` that it cannot evaluate."""
    stage = context.loaded.task.stages[name]
    expressions = [stage.until, stage.fail_if]
    references: list[Expression | None] = []
    for axis in stage.axes.values():
        references += [axis.velocity, axis.force, axis.torque, axis.position]
    for expression in [*expressions, *references]:
        if expression is None:
            continue
        if expression in references and not _finite_at_start(context, expression):
            found.error(
                "TS117",
                "this has no finite value at t = 0 s",
                expression.span,
                "mind what divides, and what stands under a root or in a logarithm",
            )
        for node, inside_norm in _names(expression.tree, False):
            hint = ""
            entry = entry_of(context.loaded.task, node.path)
            reason = no_such_signal(context, name, axes, node, inside_norm=inside_norm)
            if reason is None and expression in references and entry is not None:
                reason = entry.signal.reference or None
            if (
                reason is None
                and node.path[0] in context.mechanisms
                and node.path[0] != context.held
            ):
                reason = f"the robot does not hold {node.path[0]!r}, so it cannot know"
                hint = f"let it: robot: {{grasp: {node.path[0]}.handle}}"
            if reason is None and entry is not None:
                reason = entry.signal.unmeasured or None
            if reason is not None:
                found.error("TS224", f"{node}: {reason}", expression.where(node), hint)


def check_expectations(
    context: Context, axes_of: Mapping[str, tuple[Axis, ...]], found: Diagnostics
) -> None:
    """Reports expectations about axes that their stage does not have."""
    for expectation in context.loaded.task.expect:
        expression = expectation.expression
        for node, inside_norm in _names(expression.tree, False):
            stage = node.path[0]
            if stage not in axes_of or len(node.path) < 2:
                continue
            inner = Name(node.path[1:], node.frame)
            here = Name(inner.path)  # The verdict resolves other frames from the log.
            reason = no_such_signal(context, stage, axes_of[stage], here, inside_norm=inside_norm)
            if reason is not None:
                hint = ""
                if inner.path[0] == "error" and inner.path[-1] in axes_of[stage]:
                    kind = Axis(inner.path[-1]).effort
                    hint = f"judge what it controls: {stage}.{kind}.{inner.path[-1]}"
                found.error("TS224", f"{node}: {reason}", expression.where(node), hint)


def _finite_at_start(context: Context, expression: Expression) -> bool:
    """Whether a reference has a value when its stage begins, as far as the file tells."""
    value = known_value(context, expression, {"t": 0.0, "clock": 0.0})
    return value is None or math.isfinite(value)


def _not_elsewhere(context: Context, node: Name) -> str | None:
    """Why a signal has no meaning in another frame while the task runs, None if it has."""
    assert node.frame is not None
    frame, kind = context.frames[node.frame], node.path[0]
    surface = frame.surface
    if surface is not None and surface.parts:
        of = f"the {surface.parts} of a {surface.name}"
        return f"{of} are followed only by the stage's own frame"
    place = kind == "position" and frame.still and node.path[-1] not in ROTATIONS
    if (kind in VECTORS and VECTORS[kind].anywhere) or place:
        return None
    return "in another frame: force, torque, velocity, and positions in fixed frames"


def _names(node: Node, inside_norm: bool) -> Iterator[tuple[Name, bool]]:
    if isinstance(node, Name):
        yield node, inside_norm
    inside = inside_norm or (isinstance(node, Call) and node.function == "norm")
    for child in children(node):
        yield from _names(child, inside)


def no_such_signal(
    context: Context, stage_name: str, axes: tuple[Axis, ...], node: Name, *, inside_norm: bool
) -> str | None:
    """Why a stage has no such signal, None if it has it."""
    path = node.path
    if node.frame is not None:
        elsewhere = _not_elsewhere(context, node)
        if elsewhere is not None:
            return elsewhere
    stage = context.loaded.task.stages[stage_name]
    if path[0] == "gap" and len(path) == 1:
        if context.contact_of(context.frame_of(stage)) is None:
            return "there is no object in the world to have a gap to"
        return None
    if path[0] == "path_done" and stage.path is None:
        return f"stage {stage_name!r} has no path"
    if path[0] == "joint" and int(path[1]) > context.robot.pin.nv:
        return f"{context.robot.name!r} has {context.robot.pin.nv} joints"
    if path[0] not in VECTORS or len(path) != 2 or inside_norm:
        return None
    axis = as_axis(path[1])
    if axis is None:
        return None
    if node.frame is None and axis not in axes:
        return f"this arm has no axis {axis!r} in this frame; it has {', '.join(axes)}"
    declared = stage.axes.get(axis)
    facts = context.law_of(stage).control_law
    loop = facts.force_loop and not facts.shares
    if path[0] == "error" and loop and declared is not None and declared.has_force:
        return f"{axis!r} is force-controlled here and has no motion error"
    return None
