"""What the header of a controller in C says: joints, units, frames and signs, stages and ends."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence

import numpy as np

from taskspec.program.execution.machine import Machine
from taskspec.program.execution.transition import exits
from taskspec.program.program import Program
from taskspec.spec import Robot, Task
from taskspec.spec.servo import PLURALS
from taskspec.text.units import (
    ANGULAR_ACCELERATION,
    FORCE,
    LENGTH,
    LINEAR_ACCELERATION,
    VELOCITY,
    in_si,
    si_unit,
)
from taskspec_runner.controller_c.commanded import CommandedQuantity

_WIDTH = 96


def header_facts(program: Program, machine: Machine) -> dict[str, str]:
    """The parts of the header that are comments, by their names in the template."""
    context = program.context
    task, robot = context.loaded.task, context.robot
    length = task.robot.tool.length
    away = "" if length is None else f", {length:g} m from it along its z"
    flange = f", flange {robot.flange!r}" if robot.flange else ""
    commanded = CommandedQuantity.of(program)
    return {
        "ROBOT": _comment(
            [
                f"Robot: {robot.name}{flange}. The tip is the tool's extreme point on its axis"
                f"{away}; z of its frame points out of the tool.",
                *_servo(task.robot),
            ]
        ),
        "JOINT_TABLE": _comment(_joints(program, machine), wrap=False),
        "KEPT": _comment([_kept(machine)]),
        "AT_END": _comment([f"From its end on, whatever it is, {commanded.at_end}"]),
        "AT_START": _comment([commanded.at_start], indent=4).strip(),
        "STAGE_TABLE": _comment(_stages(machine), wrap=False),
        "PARAM_TABLE": _comment(_params(task), wrap=False),
        "LIMITS": _comment(_limits(machine), wrap=False),
        "WRENCH": _comment(wrench_lines(program, machine), indent=4),
        "REACTION_NAMES": _comment(_reactions(program), indent=4),
        "COMMAND": commanded.name,
        "COMMANDS": commanded.plural,
        "QUANTITY": str(commanded.number),
        "MEANS": commanded.means,
    }


def _comment(lines: Iterable[str], *, indent: int = 1, wrap: bool = True) -> str:
    """Lines of a comment, each after ` * `; nothing in them ends it."""
    before = f"{' ' * indent}* " if indent == 1 else " " * (indent + 3)
    found = []
    for line in lines:
        # Names of joints are those of the robot's file.
        safe = line.replace("*/", "* /").replace("/*", "/ *").encode("ascii", "replace").decode()
        rows = textwrap.wrap(safe, _WIDTH - len(before)) if wrap else [safe]
        found += [f"{before}{row}".rstrip() for row in rows]
    return "\n".join(found)


def _servo(robot: Robot) -> list[str]:
    """The servo that the task is made for; nothing where torques are commanded."""
    if robot.takes_torques:
        return []
    numbers = ", ".join(f"{key} {text}" for key, text in robot.servo.written)
    return [f"It takes joint {PLURALS[robot.command]}, by a servo as the file has it: {numbers}."]


def _joints(program: Program, machine: Machine) -> list[str]:
    """The table of the joints."""
    context = program.context
    robot, drives = context.robot, context.drives
    commanded = CommandedQuantity.of(program)
    rates = np.min([runner.stage.plan.torque_rates for runner in machine.runners], axis=0)
    # Positions are limited by how fast they change.
    limited, dimension = ("torque", FORCE) if drives.torques else ("velocity", VELOCITY)
    head = ("", "name", "q", "v", commanded.name, "start", "range", f"{limited} limit")
    rows: list[tuple[str, ...]] = [(*head, "rate limit")]
    for i, name in enumerate(robot.joint_names):
        hinge = robot.hinges[i]
        own = (LENGTH, VELOCITY, commanded.dimension, dimension)
        *units, unit = [si_unit(d.on(rotation=hinge)) for d in own]
        low, high = robot.lower[i], robot.upper[i]
        rows.append(
            (
                *(f"{i}", name, *units, f"{round(context.start[i], 5) + 0.0:g}"),
                f"{low:g} .. {high:g}" if np.isfinite([low, high]).any() else "none",
                _limit(drives.most[i], unit),
                _limit(rates[i], f"{unit}/s" if drives.torques else _accelerated(hinge)),
            )
        )
    if not np.isfinite(rates).any():
        rows = [row[:-1] for row in rows]
    return _aligned(rows)


def _accelerated(hinge: bool) -> str:
    return si_unit(ANGULAR_ACCELERATION if hinge else LINEAR_ACCELERATION)


def _limit(value: float, unit: str) -> str:
    return f"{value:g} {unit}" if math.isfinite(value) else "none"


def _kept(machine: Machine) -> str:
    """How far commands are kept within the limits of the table, and their rates."""
    drives = machine.drives
    if drives.torques:
        said = "They are within the torque limits of the table at all times."
    elif drives.positions:
        said = "They change no faster than by the velocity limits of the table."
    else:
        said = "They are within the velocity limits of the table at all times."
    stages = [(runner.stage.name, runner.solver is not None) for runner in machine.runners]
    if not any(np.isfinite(runner.stage.plan.torque_rates).any() for runner in machine.runners):
        return said
    if not any(solves for _, solves in stages) and not drives.torques:
        return f"{said} The rates limit how fast it slows down at the end."
    others = ", ".join(name for name, solves in stages if not solves)
    but = f", but not in {others}: what keeps them is 'solve: qp'" if others else ""
    return f"{said} So are their rates{but}."


def _stages(machine: Machine) -> list[str]:
    """The stages by number, and the events that end them, beside limits that stop the task."""
    stages, lines = [runner.stage for runner in machine.runners], list[str]()
    for i, (stage, outs) in enumerate(zip(stages, exits(stages), strict=True)):
        lines.append(f"{i}: {stage.name}")
        for out in outs:
            if out.to:
                times = f", {out.repeat} times in a row" if out.repeat > 1 else ""
                lines.append(f"     {out.event.name}: {out.event.text} -> {out.to}{times}")
    return lines


def _limits(machine: Machine) -> list[str]:
    """The limits that stop the task in some stage, by their names; of joints the first and last."""
    outs = [out for outs in exits([runner.stage for runner in machine.runners]) for out in outs]
    found = dict[str, dict[str, None]]()
    for out in outs:
        if not out.to:
            found.setdefault(out.event.name, {})[out.event.text] = None
    lines = list[str]()
    for name, texts in found.items():
        first, *others = texts
        last = f" .. {others[-1]}" if others else ""
        lines.append(f"{name}: {first}{last}")
    return lines or ["none"]


def _params(task: Task) -> list[str]:
    """The table of the params that may be set."""
    if not task.live:
        return ["none"]
    rows = [("", "name", "value", "range", "rate limit")]
    for i, (name, param) in enumerate(task.live.items()):
        low, high = (in_si(x, param.dimension) for x in (param.low, param.high))
        rate = f"{in_si(param.rate, param.dimension)} per second" if param.rate else "none"
        rows.append((f"{i}", name, in_si(param.value, param.dimension), f"{low} .. {high}", rate))
    return _aligned(rows)


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]


def wrench_lines(program: Program, machine: Machine) -> list[str]:
    """Axes, point and sign of the wrench."""
    said = "By the environment on the tool: force x y z [N], then moment x y z about the tip [N m]."
    if machine.sensor is None:
        axes = (
            "Of the contact alone, in world axes: the host turns a sensor's reading, and takes "
            "the tool's weight and the sensor's zero from it."
        )
        return [said, axes]
    task = program.context.loaded.task
    weight = "no weight of the tool in it."
    if task.robot.sensor.at == "wrist":
        mass = program.context.robot.tool_body.mass
        weight = f"with the weight of the tool ({mass:g} kg) in it, which is taken off here."
    tares = [name for name, stage in task.stages.items() if stage.tare]
    zero = (
        f"Its zero is measured in {', '.join(tares)}."
        if tares
        else "Its zero is not measured here (no stage has 'tare'): the host takes it off."
    )
    return [said, f"A sensor's reading in the axes of the tip frame, {weight} {zero}"]


def _reactions(program: Program) -> list[str]:
    """The equations by number, with units and sign."""
    equations = program.context.equations
    gripped = program.context.loaded.task.gripped
    first = len(equations)
    gripper = [
        f"{first}: what each jaw of the gripper presses with [N], 0 with nothing in it",
        f"{first + 1}: how far what is gripped has slid since the jaws closed [m]",
    ]
    if not equations:
        return gripper if gripped else ["Not read: the task has no equations."]
    rows = [
        f"{i}: {name} [{'N m' if model.angular else 'N'}]: {model.constraint}"
        for i, (name, model) in enumerate(equations.items())
    ]
    sign = "What the robot applies along the unit gradient of left minus right of each equation."
    return [sign, *rows, *(gripper if gripped else ())]
