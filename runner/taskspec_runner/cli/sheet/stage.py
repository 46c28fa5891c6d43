"""What a task makes of itself once it is compiled, as data for `explain`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.explain import Natural, Selection, beside, natural, rest_values, selection
from taskspec.laws.law import gain_named
from taskspec.program.execution.transition import is_good
from taskspec.program.program import Program
from taskspec.program.stages.null_space import goals
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.world.stiffness import GRIP
from taskspec.robot.types import RobotModel
from taskspec.stability.gain_paths import turns
from taskspec.text.units import MASS, STIFFNESS, in_unit, number, scaled, show
from taskspec_runner.cli.sheet.at_rest import RestRow, rest_rows
from taskspec_runner.cli.sheet.axes import AxisRow, axis_row, equation_row, joint_rows
from taskspec_runner.cli.sheet.controller import controller_rows
from taskspec_runner.cli.sheet.limits import limit_rows
from taskspec_runner.cli.sheet.protection import protection_rows
from taskspec_runner.cli.sheet.selection import selection_rows
from taskspec_runner.cli.sheet.servo import servo_rows
from taskspec_runner.cli.sheet.terms import TermsSheet, terms_sheet
from taskspec_runner.cli.sheet.visits import StageTrial
from taskspec_runner.trial.trial import Trial

_LIMIT = "limit on "


@dataclass(frozen=True, slots=True)
class GainRow:
    """A gain on the axes that share its value and origin."""

    gain: str
    axes: tuple[str, ...]
    value: str
    origin: str


@dataclass(frozen=True, slots=True)
class StageSheet:
    """A stage: its law and frame, its axes, what it came to, its gains and its ends."""

    name: str
    law: str
    equations: str
    frame: str
    contact: str
    null_space: str
    kept: tuple[tuple[str, str], ...]
    beside: tuple[tuple[str, str], ...]
    selection: tuple[tuple[str, str], ...]
    axes: tuple[AxisRow, ...]
    trial: StageTrial | None
    at_rest: tuple[RestRow, ...]
    gains: tuple[GainRow, ...]
    ends: tuple[tuple[str, str], ...]
    tare: bool
    natural: tuple[Natural, ...]
    selected: Selection | None
    terms: TermsSheet | str | None = None


@dataclass(frozen=True, slots=True)
class FrameRow:
    """A frame, how it came about, and the stages that it is the task frame of."""

    name: str
    described: str
    stages: tuple[str, ...]


def robot_rows(program: Program) -> tuple[tuple[str, str], ...]:
    """The robot, its tool and where it starts."""
    context = program.context
    robot, tool = context.robot, context.loaded.task.robot.tool
    position = ", ".join(f"{round(1e3 * x, 3) + 0.0:g}" for x in context.start_p)
    sizes = [
        show(float(v), "mm")
        for v in (tool.radius, tool.thickness, *(tool.size or ()))
        if v is not None
    ]
    at = "" if tool.com is None else f" at [{', '.join(show(x, 'mm') for x in tool.com)}]"
    count = len(robot.joint_names)
    return (
        ("robot", f"{robot.name}, {count} joint{'s' * (count != 1)}: {robot.source}"),
        ("flange", f"{robot.flange}"),
        *_joints(robot),
        ("tool", f"{tool.shape} {' x '.join(sizes)}".rstrip() + f", {show(tool.mass, 'g')}{at}"),
        *_holds(context.loaded.task.robot.grasp),
        ("start", f"tool tip at [{position}] mm in the world"),
        *protection_rows(context.loaded.task.robot.protection, robot),
        *servo_rows(context.loaded.task.robot),
        *controller_rows(context),
        *(("note", note) for note in robot.notes),
    )


def _joints(robot: RobotModel) -> Iterator[tuple[str, str]]:
    """Each joint with its limits, and with the mass of the link that it carries."""
    for i, name in enumerate(robot.joint_names):
        turn = robot.hinges[i]
        angle, speed, moment = ("deg", "deg/s", "N*m") if turn else ("mm", "mm/s", "N")
        low, high = float(robot.lower[i]), float(robot.upper[i])
        span = "turns freely" if turn else "slides freely"
        if np.isfinite(high - low):
            span = f"{number(in_unit(low, angle))} to {show(high, angle)}"
        most = [
            show(float(limit), unit) if np.isfinite(limit) else f"no limit of {what}"
            for limit, unit, what in (
                (robot.velocity_limit[i], speed, "speed"),
                (robot.torque_limit[i], moment, "torque"),
            )
        ]
        mass = scaled(robot.carried_mass(i), MASS)
        yield f"joint {i + 1}", ", ".join((name, span, *most, f"carries {mass}"))
    for j in robot.coupling.followers:
        yield "follows", robot.coupling.relation(j)


def _holds(grasp: str | None) -> Iterator[tuple[str, str]]:
    if grasp is not None:
        grip = f"{scaled(GRIP.stiffness, STIFFNESS)} and {show(GRIP.angular_stiffness, 'N*m/rad')}"
        yield "holds", f"{grasp}, by a grip of {grip}"


def frame_rows(program: Program) -> tuple[FrameRow, ...]:
    """Every frame that the task can name."""
    return tuple(
        FrameRow(
            frame.name,
            frame.described,
            tuple(stage.name for stage in program.stages if stage.plan.frame.name == frame.name),
        )
        for name, frame in program.context.frames.items()
        if name == frame.name  # An equation's name leads to the frame that it is written in.
    )


def stage_sheet(
    program: Program,
    stage: CompiledStage,
    trial: Trial | None,
    came_to: StageTrial | None,
    *,
    terms: bool = False,
) -> StageSheet:
    """One stage, and what it came to in a trial of the program; None for both without one."""
    in_axes = stage.plan.joint_path is None
    selected = selection(stage.plan) if in_axes else None
    imposed = natural(stage.plan) if in_axes else ()
    return StageSheet(
        name=stage.name,
        law=stage.plan.law.kind,
        equations=_equations(stage),
        frame=stage.plan.frame.name,
        contact=_contact(program, stage),
        null_space=_null_space(program, stage),
        kept=tuple(limit_rows(program, stage)),
        beside=tuple(beside(stage.plan, {s.name: s.plan for s in program.stages})),
        selection=() if selected is None else selection_rows(selected),
        axes=(
            *(axis_row(program, stage, world) for world in imposed),
            *joint_rows(stage),
            *(equation_row(program, stage, name) for name in stage.plan.active),
        ),
        gains=tuple(_gains(program, stage)),
        ends=tuple(_ends(program, stage)),
        trial=came_to,
        at_rest=tuple(rest_rows(stage, rest_values(program, stage), trial)),
        tare=stage.plan.spec.tare,
        natural=imposed,
        selected=selected,
        terms=terms_sheet(program, stage, trial) if terms else None,
    )


def _equations(stage: CompiledStage) -> str:
    equations = stage.plan.law.control_law.equations
    return f"{equations}, in the form for a held mechanism" if stage.plan.consistent else equations


def _contact(program: Program, stage: CompiledStage) -> str:
    plan = stage.plan
    if plan.joint_path is not None:
        return "none that it controls: its joints are on a path"
    stiffness = scaled(plan.environment.stiffness, STIFFNESS)
    if plan.contacts.main is None and plan.contacts.held:
        return f"{plan.contacts.held}, held: nominal {stiffness} both ways"
    if plan.contacts.main is None and plan.active:
        return f"constraints {', '.join(plan.active)}"
    contacts = plan.contacts
    if contacts.main is None:
        return "none: the world has no surface" if not plan.context.surfaces else "none ahead"
    if len(contacts.touched) == 1:
        return _object(program, contacts.main)
    by = {c: [a for a in contacts.forces if contacts.by_axis[a] == c] for c in contacts.touched}
    return "; ".join(f"{', '.join(axes)}: {_object(program, c)}" for c, axes in by.items() if axes)


def _object(program: Program, name: str) -> str:
    """An object with the contact that it makes."""
    shape = program.context.loaded.task.shapes[name]
    stiffness = scaled(program.context.compliances[name].stiffness, STIFFNESS)
    rigid = " (rigid)" if shape.stiffness == "rigid" else ""
    friction = f", friction {shape.friction:.3g}" if shape.friction else ", frictionless"
    return f"{name}, nominal {stiffness}{rigid}{friction}"


def _null_space(program: Program, stage: CompiledStage) -> str:
    robot = program.context.robot
    if robot.n == len(stage.plan.axes) or stage.plan.joint_path is not None:
        return ""
    return (
        ", ".join(goals(stage.plan.law, robot, stage.plan.axes)) or "free: the law leaves it alone"
    )


def _gains(program: Program, stage: CompiledStage) -> Iterator[GainRow]:
    for name, by_axis in stage.plan.gains.items():
        groups: dict[tuple[str, str], list[str]] = {}
        for axis, gain in by_axis.items():
            text = gain_named(name).text(
                gain.value, angular=turns(program.context, axis), entry=axis
            )
            origin = gain.origin
            if gain.formula is not None:
                text, origin = f"{text} at the start", f"file: {gain.formula}"
            groups.setdefault((text, origin), []).append(axis)
        for (value, origin), axes in groups.items():
            yield GainRow(name, tuple(axes), value, origin)


def _ends(program: Program, stage: CompiledStage) -> Iterator[tuple[str, str]]:
    """What ends the stage and where it leads, in the order in which a tick decides."""
    spec, names = stage.plan.spec, [s.name for s in program.stages]
    number = names.index(stage.name)
    ways = spec.targets(names[number + 1] if number + 1 < len(names) else "end")
    failed = spec.on_fail or "fail"
    own = [
        e.text.removeprefix(_LIMIT) + (f" -> {e.then}" if e.then else "")
        for e in stage.events
        if e.text.startswith(_LIMIT)
    ]
    if own:
        yield "limits", ", ".join(own)
    targets = {"fail_if": failed, "within": failed}
    for event in stage.events:
        to = ways[event.branch] if is_good(event) else targets.get(event.kind)
        if to is not None:
            yield f"{event.kind} -> {to}", event.text.removeprefix("within ")
    if spec.repeat > 1:
        yield "repeat", f"done {spec.repeat} times in a row"
    if spec.attempts is not None:
        yield "attempts", f"entered {spec.attempts} times at most"
