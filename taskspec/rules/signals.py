"""Signals that exist in the language but not in this stage, on this arm."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.expression import Expression
from taskspec.expression.tree import Call, Name, Node, children
from taskspec.geometry.axis import ROTATIONS, Axis, as_axis
from taskspec.laws.law import LAWS
from taskspec.program.context import Context
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.signals import entry_of
from taskspec.rules import Finding, Phase, error, rule
from taskspec.signals import ENERGY, PAYLOAD, VECTORS, Index
from taskspec.signals.table import REFERENCE


@rule("TS224", "a signal that this stage cannot evaluate", phase=Phase.AXES)
def missing_signals(stage: StagePlan) -> Iterator[Finding]:
    """Signals in the expressions of a stage that it cannot evaluate."""
    for condition in (stage.spec.until, stage.spec.fail_if, *(w.when for w in stage.spec.next)):
        if condition is not None:
            yield from _missing(stage, condition, reference=False)
    for axis in stage.spec.axes.values():
        for reference, _ in axis.expressions():
            yield from _missing(stage, reference, reference=True)
    if stage.spec.path is not None and stage.spec.path.slowed is not None:
        yield from _missing(stage, stage.spec.path.slowed, reference=True)
    for entries in stage.law.by_entry.values():
        for gain in entries.values():
            if isinstance(gain, Expression):
                yield from _missing(stage, gain, reference=True)


def _missing(stage: StagePlan, expression: Expression, *, reference: bool) -> Iterator[Finding]:
    context = stage.context
    for node, inside_norm in _names(expression.tree, False):
        entry = entry_of(context.loaded.task, node.path)
        gain = entry is not None and entry.signal.index is Index.GAIN
        reason = None if gain else no_such_signal(stage, node, inside_norm=inside_norm)
        hint = given_by(stage, node) if reason is not None else ""
        if reason is None and reference and entry is not None:
            reason = entry.signal.reference or None
        if reason is None and node.path[0] in context.mechanisms and node.path[0] != context.held:
            reason = f"the robot does not hold {node.path[0]!r}, so it cannot know"
            hint = _instead(context, node)
        if reason is None and entry is not None:
            reason = entry.signal.unmeasured or _of_a_drive(context, node)
            hint = _INSTEAD_OF_A_DRIVE if reason and not entry.signal.unmeasured else hint
        if reason is not None:
            # A law is that of several stages, and one gain that of several axes.
            yield error(
                "TS224", f"{node}: {reason}", expression.where(node), hint, unless=("TS224",)
            )


_INSTEAD_OF_A_DRIVE = (
    "go by what is measured, such as force.z, norm(torque) or joint.1.velocity; 'expect' may use it"
)


def _of_a_drive(context: Context, node: Name) -> str | None:
    """Why a controller does not know the torque of a joint, None if it commands it."""
    robot = context.loaded.task.robot
    if robot.takes_torques or node.path[0] != "joint" or node.path[2] != "torque":
        return None
    return f"this robot takes {robot.commands}, and what its drives exert is not measured"


def _instead(context: Context, node: Name) -> str:
    """What to write where a mechanism that the robot does not hold is asked where it is."""
    name = node.path[0]
    if any(shape.on == name for shape in context.loaded.task.shapes.values()):
        return f"go by what is measured, a force, a position or a time; 'expect' may use {node}"
    return f"let it: robot: {{grasp: {name}.handle}}"


@rule({}, also=("TS224",), phase=Phase.RUN)
def missing_expected_signals(task: TaskPlan) -> Iterator[Finding]:
    """Expectations about axes that their stage does not have."""
    for expectation in task.context.loaded.task.expect:
        expression = expectation.expression
        for node, inside_norm in _names(expression.tree, False):
            stage = task.framed.get(node.path[0])
            if stage is None or len(node.path) < 2:
                continue
            inner = Name(node.path[1:], node.frame)
            here = Name(inner.path)  # The verdict resolves other frames from the log.
            reason = no_such_signal(stage, here, inside_norm=inside_norm)
            if reason is not None:
                hint = given_by(stage, inner)
                if inner.path[0] == "error" and inner.path[-1] in stage.axes:
                    kind = Axis(inner.path[-1]).effort
                    hint = f"judge what it controls: {stage.name}.{kind}.{inner.path[-1]}"
                yield error("TS224", f"{node}: {reason}", expression.where(node), hint)


def given_by(stage: StagePlan, node: Name) -> str:
    """What gives a stage a signal that it lacks; empty where no key of a file does."""
    entry = entry_of(stage.context.loaded.task, node.path)
    if entry is None or not entry.signal.given or _tank_pays(stage, ".".join(node.path)):
        return ""
    return f"it comes of {entry.signal.given}"


def no_such_signal(stage: StagePlan, node: Name, *, inside_norm: bool) -> str | None:
    """Why a stage has no such signal, None if it has it."""
    path = node.path
    if path[-1] == REFERENCE:
        of = Name(path[:-1], node.frame)
        missing = _no_references if inside_norm else _no_reference
        return no_such_signal(stage, of, inside_norm=inside_norm) or missing(stage, of.path)
    if node.frame is not None:
        elsewhere = _not_elsewhere(stage.context, node)
        if elsewhere is not None:
            return elsewhere
    if len(path) == 1:
        return _no_single(stage, path[0])
    families = (Index.GAIN, Index.GRIP, Index.TANK, Index.ESTIMATE)
    if path[0] in families or ".".join(path) in {*ENERGY, *PAYLOAD}:
        return _not_of_law(stage, path)
    if path[0] == "joint":
        return _no_joint(stage, path)
    if path[0] in stage.context.equations and path[1] == "residual":
        given = path[0] in stage.spec.generalised
        return None if given else f"stage {stage.name!r} gives {path[0]!r} no joint torques"
    if path[0] not in VECTORS or len(path) != 2 or inside_norm:
        return None
    axis = as_axis(path[1])
    if axis is None:
        return None
    if node.frame is None and axis not in stage.axes:
        return f"this arm has no axis {axis!r} in this frame; it has {', '.join(stage.axes)}"
    declared = stage.spec.axes.get(axis)
    facts = stage.law.control_law
    loop = facts.force_loop and not facts.shares
    if path[0] == "error" and loop and declared is not None and declared.has_force:
        return f"{axis!r} is force-controlled here and has no motion error"
    return None


def _no_reference(stage: StagePlan, path: tuple[str, ...]) -> str | None:
    """Why a signal that a stage has is referred to nothing there, None if it is."""
    if path[0] == "joint" or path[1] == "gap":
        given = stage.joint_path is not None
        return None if given else f"no path of joints is followed in stage {stage.name!r}"
    if path[0] in stage.context.equations:
        given = path[0] in stage.spec.constraints
        return None if given else f"stage {stage.name!r} has no set point of {path[0]!r}"
    axis = Axis(path[1])
    plan = stage.plans.get(axis)
    if path[0] == axis.effort:
        given = plan is not None and bool(plan.set_point)
        return None if given else f"{axis!r} has no set point of a {axis.effort} here"
    given = plan is not None and plan.motion
    return None if given else f"{axis!r} follows no motion here"


def _no_references(stage: StagePlan, path: tuple[str, ...]) -> str | None:
    """The same of a component of a norm, which leaves out what has none: said once if all have."""
    vector = VECTORS.get(path[0])
    if vector is None:
        return _no_reference(stage, path)
    reasons = [_no_reference(stage, (path[0], axis)) for axis in vector.bare]
    if not all(reasons) or path[1] != vector.bare[0]:
        return None
    what = f"set point of a {path[0]}" if path[0] == vector.bare[0].effort else "motion"
    return f"no axis has a {what} here"


def _no_single(stage: StagePlan, name: str) -> str | None:
    """Why a stage has no signal of a single word, None if it has it."""
    if name == "path_done" and stage.spec.path is None:
        return f"stage {stage.name!r} has no path"
    return _no_gap(stage) if name == "gap" else None


def _no_joint(stage: StagePlan, path: tuple[str, ...]) -> str | None:
    """Why a stage has no such signal of a joint, None if it has it."""
    robot = stage.context.robot
    if int(path[1]) > robot.n:
        return f"{robot.name!r} has {robot.n} joints"
    if path[2] == "disturbance" and stage.law.disturbance_observer is None:
        return f"the law of stage {stage.name!r} has no disturbance observer"
    return None


def _not_of_law(stage: StagePlan, path: tuple[str, ...]) -> str | None:
    """Why the law of a stage has no such gain, energy or payload, None if it has."""
    task = stage.context.loaded.task
    if path[0] == Index.GRIP:
        return None if task.gripped or path[0] in task.world else "no stage grips anything"
    if ".".join(path) in PAYLOAD:
        none = task.adapt is None
        return "no law adapts to a payload" if none else None
    if ".".join(path) in ENERGY:
        return _no_energy(stage, ".".join(path))
    if path[0] == Index.TANK:
        given = stage.law.tank is not None and stage.joint_path is None
        return None if given else f"the law of stage {stage.name!r} has no energy tank"
    if path[0] == Index.ESTIMATE:
        return _no_estimate(stage, Axis(path[-1]))
    name, on = ".".join(path[1:-1]), path[-1]
    varies = (name, on) in stage.varying
    return None if varies else f"the {name} of stage {stage.name!r} does not vary on {on!r}"


def _no_estimate(stage: StagePlan, axis: Axis) -> str | None:
    """Why the law of a stage estimates no stiffness along an axis, None if it does."""
    if stage.law.estimate is None or stage.joint_path is not None:
        return f"the law of stage {stage.name!r} estimates no stiffness"
    plan = stage.plans.get(axis)
    given = plan is not None and plan.force
    return None if given else f"{axis!r} has no force in stage {stage.name!r}, so none is estimated"


#: What a law with a tank has no single power or function of.
_PAID_FOR = (
    *("energy.lyapunov", "power.reference", "power.force", "power.integral", "power.gains"),
)


def _tank_pays(stage: StagePlan, name: str) -> bool:
    """Whether the tank of a stage's law has taken the place of an energy."""
    return name in ENERGY and stage.law.tank is not None


def _no_energy(stage: StagePlan, name: str) -> str | None:
    """Why a stage has no energy of its law, None if it has."""
    law = stage.law.control_law
    if not law.storage or stage.joint_path is not None:
        having = ", ".join(kind for kind, each in LAWS.items() if each.storage)
        return f"{stage.law.kind!r} states no energy that it stores; laws that do: {having}"
    if _tank_pays(stage, name) and name in _PAID_FOR:
        return "the tank of its law pays for that: judge 'tank.power', or 'energy.stored'"
    if name == "energy.lyapunov" and law.force_loop:
        return f"{stage.law.kind!r} has a force loop, whose Lyapunov function is local (4.62)"
    if name == "energy.lyapunov" and stage.law.varying:
        return "gains vary here, and put energy in: no such function falls"
    return None


def _no_gap(stage: StagePlan) -> str | None:
    """Why `gap` is the distance from no object, None if it is."""
    if stage.contacts.main is None:
        return "there is no object in the world to have a gap to"
    if stage.contacts.of_gap is None:
        names = " or ".join(f"{contact}.gap" for contact in stage.contacts.of_forces)
        return f"the forces of this stage press on several objects: write {names}"
    return None


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
