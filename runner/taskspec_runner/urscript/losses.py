"""What is lost of a task in a program of a Universal Robots arm."""

from __future__ import annotations

import math
from collections.abc import Iterator

from taskspec.expression import Expression
from taskspec.expression.tree import Held, Name, walk
from taskspec.modes import FollowsAxes, Move, OnPath, Position
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.spec import FILE, KeyPath, Law, LoadedTask, Sensor
from taskspec.spec.servo import PLURALS
from taskspec.text.units import FREQUENCY, fitting, show
from taskspec_runner.urscript.refusals import UNIVERSAL_ROBOTS
from taskspec_runner.urscript.script import Loss

#: Control period of the robot [s], and the share of it that rounding may take.
STEP, _ROUNDING = 0.002, 1e-9
#: Float input registers that RTDE clients write, one for each live param.
REGISTERS = range(24, 48)
#: What of a sensor is the plant's, and the controller's own on a robot.
_OF_SENSOR = ("rate", "delay", "filter")


def located(loaded: LoadedTask, place: KeyPath, text: str) -> Loss:
    """A sentence at a place of the file."""
    span = loaded.span(place)
    return Loss(span.source or loaded.source.name, span.line, span.column, text)


def of_task(plan: TaskPlan) -> list[Loss]:
    """What is lost of a task as a whole."""
    loaded = plan.context.loaded
    return [located(loaded, place, text) for place, text in _of_task(plan)]


def of_stage(stage: StagePlan) -> list[Loss]:
    """What is lost of a stage, but for its path."""
    loaded = stage.context.loaded
    return [located(loaded, place, text) for place, text in _of_stage(stage)]


def _of_task(plan: TaskPlan) -> Iterator[tuple[KeyPath, str]]:
    task = plan.context.loaded.task
    robot = task.robot
    if robot.model not in UNIVERSAL_ROBOTS:
        yield (
            FILE.robot.model,
            f"joint positions, posture and limits of {robot.model!r} are not those of a Universal "
            "Robots arm: the motion of the tool alone is exported",
        )
    else:
        text = "ends by limits of joints and near singular postures: the robot stops by its own"
        yield FILE.robot.model, text
    if not robot.takes_torques:
        text = f"the joint {PLURALS[robot.command]} and their servo: the robot's own follow servoj"
        yield FILE.robot.command, f"{text} and force_mode"
    for name, param in list(task.live.items())[len(REGISTERS) :]:
        unit = next(iter(fitting(param.dimension)), "")
        yield (
            FILE.params[name],
            f"the param {name} stays at {show(param.value, unit)}: the {len(REGISTERS)} float "
            "registers that RTDE clients write are those of other params",
        )
    own = [key for key in _OF_SENSOR if getattr(robot.sensor, key) != getattr(Sensor(), key)]
    if own:
        keys = " and ".join(own)
        yield (
            FILE.robot.sensor,
            f"{keys} of the sensor: get_tcp_force is filtered by the controller",
        )
    if robot.protection is not None:
        text = "bounds of the protection: the robot's safety configuration has its own"
        yield FILE.robot.protection, text
    if task.control.rate != 1 / STEP:
        rates = show(task.control.rate, FREQUENCY), show(1 / STEP, FREQUENCY)
        yield (
            FILE.control.rate,
            f"the controller's rate of {rates[0]}: the program runs at {rates[1]}",
        )
    if not task.control.velocity.measured:
        text = "how joint velocities are estimated: the robot's controller has its own"
        yield FILE.control.velocity, text
    if task.control.friction is not None:
        text = "the compensation of friction in the joints: the robot's controller has its own"
        yield FILE.control.friction, text
    yield from _of_law(FILE.law, task.law)
    if task.limits.torque_rate is not None:
        yield FILE.limits.torque_rate, "the limit on the rate of joint torques"
    if task.limits.deviation is not None:
        yield FILE.limits.deviation, _DEVIATION
    yield FILE.stages, "references are not handed over: a stage starts from where the tool is then"


_DEVIATION = "the limit on deviation: force_mode has it on its stiff axes, other stages have none"


def _of_law(place: KeyPath, law: Law) -> Iterator[tuple[KeyPath, str]]:
    if law.solve == "qp":
        text = "the quadratic program: nothing keeps limits, reaching one stops the program"
        yield place, text
    if law.adapt is not None:
        text = "the adaptation to a payload: set_target_payload has what the file says of the tool"
        yield place, text
    if law.null_space != Law().null_space:
        yield place, "goals in the null space: a Universal Robots arm has none"
    if law.tank is not None:
        yield place.tank, "the energy tank: nothing pays for what is not passive"


def _of_stage(stage: StagePlan) -> Iterator[tuple[KeyPath, str]]:
    place, spec = FILE.stages[stage.name], stage.spec
    if spec.law is not None and stage.joint_path is None:
        yield from _of_law(place.law, spec.law)
    for key, condition in (("until", spec.until), ("fail_if", spec.fail_if)):
        if condition is not None:
            yield from _of_condition(place[key], condition)
    if spec.tare:
        text = "the mean over the stage: zero_ftsensor takes what is measured at its end"
        yield place.tare, text
    if stage.limits.deviation is not None and spec.limits is not None:
        yield place.limits, _DEVIATION
    if stage.joint_path is None:
        yield from _of_forces(stage)
        yield from _of_motion(stage)


def _of_forces(stage: StagePlan) -> Iterator[tuple[KeyPath, str]]:
    """Gains, of forces and of springs."""
    place, kind, facts = FILE.stages[stage.name], stage.law.kind, stage.law.control_law
    pressing = [a for a, plan in stage.plans.items() if plan.axis.set_point]
    if pressing:
        axes, first = ", ".join(pressing), place.axes[pressing[0]]
        if facts.force_loop:
            text = f"the force loop of the {kind} law on {axes}: force_mode has gains of its own"
        else:
            text = f"the open-loop force of the {kind} law on {axes}: force_mode closes a loop"
        yield first, text
        if facts.shares:
            yield first, f"the position that the {kind} law holds beside the force on {axes}"
    if not facts.force_loop:
        text = f"the springs of the {kind} law: the arm is stiff where force_mode does not yield"
        yield place, text
    for axis, plan in stage.plans.items():
        if plan.axis.is_soft:
            yield place.axes[axis], f"stiffness and damping of {axis}: the axis is stiff"


_WAITED = "which the end of a move waits for"


def _of_motion(stage: StagePlan) -> Iterator[tuple[KeyPath, str]]:
    """MotionLines, and what they go over."""
    place, frame = FILE.stages[stage.name], stage.frame
    for axis, plan in stage.plans.items():
        if isinstance(plan.mode, Position) and axis not in stage.from_rest:
            yield place.axes[axis], f"the phase of {axis}: it starts from rest, 0.1 s late"
    tracked = [
        axis
        for axis, plan in stage.plans.items()
        if isinstance(plan.mode, Move | Position | OnPath | FollowsAxes) and not plan.set_point
    ]
    if not tracked:
        return
    first = place.axes[tracked[0]] if tracked[0] in stage.spec.axes else place.path
    text = f"{', '.join(tracked)}: servoj follows late, by about SERVO_LOOKAHEAD, {_WAITED}"
    yield first, text
    if frame.surface is not None and not frame.surface.level:
        text = f"the edges of {frame.surface_name!r}: nobody notices that the tool leaves its face"
        yield place, text


def _of_condition(place: KeyPath, condition: Expression) -> Iterator[tuple[KeyPath, str]]:
    for node in walk(condition.tree):
        if isinstance(node, Name) and str(node) == "touching":
            yield place, "contact is a force of 0.5 N, less than a sensor's drift: raise TOUCHING"
        if not isinstance(node, Held):
            continue
        wanted = node.amount.value_si
        counted = STEP * math.ceil(wanted / STEP - _ROUNDING)
        if counted - wanted > _ROUNDING:
            text = f"{1e3 * wanted:g} ms are counted in periods of {1e3 * STEP:g} ms"
            yield place, f"{text}: {1e3 * counted:g} ms"
