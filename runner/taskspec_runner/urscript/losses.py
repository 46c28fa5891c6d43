"""What is lost of a task in a program of a Universal Robots arm."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.expression import Expression
from taskspec.expression.tree import Held, Name, walk
from taskspec.modes import FollowsAxes, FreeAxis, Hold, Position
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.spec import FILE, KeyPath, Law, LoadedTask, Sensor
from taskspec.text.units import FREQUENCY, TIME, show
from taskspec_runner.urscript.refusals import UNIVERSAL_ROBOTS
from taskspec_runner.urscript.script import Loss

#: Control period of the robot [s], and the share of it that rounding may take.
STEP, _ROUNDING = 0.002, 1e-9
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
    own = [key for key in _OF_SENSOR if getattr(robot.sensor, key) != getattr(Sensor(), key)]
    if own:
        keys = " and ".join(own)
        yield FILE.robot.sensor, f"{keys} of the sensor: get_tcp_force is filtered by the controller"
    if robot.protection is not None:
        text = "bounds of the protection: the robot's safety configuration has its own"
        yield FILE.robot.protection, text
    if task.control.rate != 1 / STEP:
        rates = show(task.control.rate, FREQUENCY), show(1 / STEP, FREQUENCY)
        yield FILE.control.rate, f"the controller's rate of {rates[0]}: the program runs at {rates[1]}"
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
    if law.null_space != Law().null_space:
        yield place, "goals in the null space: a Universal Robots arm has none"


def _of_stage(stage: StagePlan) -> Iterator[tuple[KeyPath, str]]:
    place, spec, law = FILE.stages[stage.name], stage.spec, stage.law
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
    if stage.joint_path is not None:
        return
    kind, facts = law.kind, law.control_law
    pressing = [a for a, p in stage.plans.items() if p.set_point and not isinstance(p.mode, FreeAxis)]
    if pressing:
        axes = ", ".join(pressing)
        text = f"the force loop of the {kind} law on {axes}: gains, integral and damping are \
force_mode's own"
        yield place.axes[pressing[0]], text
        if facts.shares:
            yield place.axes[pressing[0]], f"the position that the {kind} law holds beside on {axes}"
    if not facts.force_loop:
        text = f"the springs of the {kind} law: the arm is stiff where force_mode does not yield"
        yield place, text
    for axis, plan in stage.plans.items():
        if plan.axis.is_soft:
            yield place.axes[axis], f"stiffness and damping of {axis}: the axis is stiff"
        late = isinstance(plan.mode, Position) and axis not in stage.from_rest
        if late or isinstance(plan.mode, FollowsAxes):
            yield place.axes[axis], f"the phase of {axis}: it starts from rest, 0.1 s late"
    moving = [a for a, p in stage.plans.items() if p.mode.moves and not isinstance(p.mode, Hold)]
    if set(moving) - set(pressing) and stage.frame.kind == "following":
        owner = stage.frame.surface_name
        if stage.frame.surface is not None and not stage.frame.surface.level:
            yield place, f"the edges of {owner!r}: nobody notices that the tool leaves its face"


def _of_condition(place: KeyPath, condition: Expression) -> Iterator[tuple[KeyPath, str]]:
    for node in walk(condition.tree):
        if isinstance(node, Name) and str(node) == "touching":
            yield place, "contact is a force of 0.5 N, less than a sensor's drift: raise TOUCHING"
        if not isinstance(node, Held):
            continue
        steps = node.amount.value_si / STEP
        if steps < 2 or abs(steps - round(steps)) > _ROUNDING:
            wanted = show(node.amount.value_si, TIME)
            text = f"{wanted} is not a whole number of at least two periods of {show(STEP, TIME)}"
            yield place, text
