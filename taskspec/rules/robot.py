"""The robot as a task has it: values for its joints, and where its tool starts."""

from __future__ import annotations

import math
from collections.abc import Iterator

import casadi as ca
import numpy as np

from taskspec.control.state import ARM_LENGTH
from taskspec.program.bound import RowFunction
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.robot import RobotError, check_joints
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.rules import Finding, Phase, error, info, rule, warning
from taskspec.shapes.plate import CutPlate
from taskspec.signals.entries import TOUCHING
from taskspec.spec import FILE, KeyPath, below, key_of
from taskspec.text.units import FORCE, LENGTH, show

#: Cosine from which on a tool points away: 60 deg.
_AWAY = 0.5
#: Arms with so many axes move in a plane, and their tool cannot be turned out of it.
_PLANAR = 3
#: A joint that starts nearer to a limit soon stops the run [rad; of a slide, times 0.3 m].
_NEAR = math.radians(2.0)
#: Points along the sides of a tool.
_ALONG = 41
#: How a robot's file gives what it leaves out.
_LIMITS = {
    "torque": "effort in URDF's <limit>, actuatorfrcrange of MJCF's <joint>",
    "speed": "velocity in URDF's <limit>, velocity_limit in MJCF's <custom>",
}
#: Remarks about a robot's file that say more than how it is read.
_WARNED = frozenset({"TS441", "TS447", "TS448", "TS449"})
#: A link that weighs less has no mass in its file [kg].
_MASSLESS = 1e-6


@rule(
    "TS414",
    "values for joints that do not fit the robot",
    also=("TS411",),
    phase=Phase.TASK,
    bars=True,
)
def joint_values(task: TaskPlan) -> Iterator[Finding]:
    """Postures and dampings that do not fit the robot's joints."""
    robot, spec = task.context.robot, task.context.loaded.task
    if spec.robot.posture is not None:
        try:
            check_joints(robot, spec.robot.posture, "the posture", ("posture",))
        except RobotError as reason:
            place = below(FILE.robot, *reason.field)
            yield error(reason.code, reason.message, place, reason.hint)
    lists: list[tuple[KeyPath, tuple[float, ...]]] = [
        (FILE.robot.joint_damping, spec.robot.joint_damping),
        (FILE.robot.joint_friction, spec.robot.joint_friction),
    ]
    true = task.context.loaded.true_task.robot.encoder
    for encoder, place in ((spec.robot.encoder, FILE.robot.encoder), (true, FILE.truth)):
        if encoder is not None and (place == FILE.robot.encoder or true != spec.robot.encoder):
            lists.append((place, encoder.resolution))
    lists += [
        (FILE.stages[name].law.damping if stage.spec.law else FILE.law.damping, damping)
        for name, stage in task.stages.items()
        if (damping := stage.law.joint_damping) is not None
    ]
    n = robot.n
    for place, values in lists:
        if len(values) not in (1, n):
            yield error(
                "TS414",
                f"{len(values)} values for the {n} joints of {robot.name!r}",
                place,
                "one value for all joints, or one for each",
            )


@rule("TS305", "a start inside an object", phase=Phase.TASK)
def start_inside(task: TaskPlan) -> Iterator[Finding]:
    """Objects that the tool is inside of at the start."""
    context = task.context
    for name, to_end in context.touchable_gaps.items():
        gap = min(to_end, _gap_of_sides(task, name))
        force = -gap * context.compliances[name].stiffness
        if force > TOUCHING:
            yield warning(
                "TS305",
                f"the tool starts {show(-gap, 'mm')} inside {name!r}: the run begins with "
                f"{show(force, 'N', 3)} of contact",
                FILE.robot.start,
                "start above the surface, and approach it with a guarded stage",
            )


def _gap_of_sides(task: TaskPlan, name: str) -> float:
    """Distance [m] at the start from an object that the sides of a tool touch, too; else infinity.

    It is looked at in points along the sides, of which the deepest is a little less deep than what
    touches.
    """
    context = task.context
    surface, tool = context.surfaces[name], context.robot.tool
    if not isinstance(surface, CutPlate):
        return math.inf
    ends, radius = tool.solid.extremes()
    points = np.concatenate([ends * (1.0, 1.0, part) for part in np.linspace(-1, 1, _ALONG)])
    points[:, 2] += tool.middle
    placed = points @ context.start_R.T + context.start_p
    x = ca.SX.sym("x", 3)
    (gaps,) = RowFunction(ca.Function("gaps", [x], [surface.distance(x)]))(placed)
    return float(gaps.min()) - radius


@rule(
    {
        "TS417": "a start at the limit of a joint",
        "TS418": "motors that cannot hold the arm where it starts",
        "TS419": "a link without mass",
    },
    phase=Phase.TASK,
)
def arm_at_start(task: TaskPlan) -> Iterator[Finding]:
    """Joints that start at their limits or cannot bear the arm, and links that weigh nothing."""
    context = task.context
    robot, q = context.robot, context.start
    place = FILE.robot if context.loaded.task.robot.start is None else FILE.robot.start
    room = np.minimum(q - robot.lower, robot.upper - q)
    bears = np.abs(context.start_gravity) / robot.torque_limit
    weakest = int(np.argmax(bears))
    if bears[weakest] > 1.0:
        unit = FORCE.on(rotation=turns_at(robot, weakest))
        holds = show(abs(float(context.start_gravity[weakest])), unit, 3)
        most = show(float(robot.torque_limit[weakest]), unit, 3)
        yield error(
            "TS418",
            f"joint {weakest + 1} ({robot.joint_names[weakest]}) has to bear {holds} to hold the "
            f"arm where it starts, and its motor has {most}: the arm falls",
            key_of(place),
            "start with the arm less stretched, or take a lighter tool; an arm "
            "whose weight springs or counterweights carry has `balanced: true`",
        )
    for i, name in enumerate(robot.joint_names):
        unit = LENGTH.on(rotation=turns_at(robot, i))
        near = _NEAR if turns_at(robot, i) else _NEAR * ARM_LENGTH
        if room[i] < near:
            yield warning(
                "TS417",
                f"joint {i + 1} ({name}) starts {show(max(float(room[i]), 0.0), unit, 2)} from its "
                "limit, where the run stops",
                key_of(place),
                "start with that joint turned back: another rpy, or other joints",
            )
    numbers = {j: f" {i + 1}" for i, j in enumerate(robot.coupling.free)}
    for j, (name, link) in enumerate(zip(robot.coupling.names, robot.carried_links, strict=True)):
        if robot.pin.inertias[j + 1].mass < _MASSLESS:
            yield warning(
                "TS419",
                f"joint{numbers.get(j, '')} ({name}) carries a link without mass, '{link}': what "
                "it weighs, and what its inertia resists, is left out of the arm",
                key_of(FILE.robot.model),
                "give the link its <inertial>, or the tool a mass",
            )


@rule(
    {
        "TS440": "joints of a gripper at the end of the arm",
        "TS441": "a flange whose z does not point out of the arm",
        "TS442": "a joint without a limit of torque or speed",
        "TS446": "joints that follow others",
        "TS447": "something in a robot's file that is not modelled",
        "TS448": "an inertia that no body has",
        "TS449": "a joint that its file locks",
    },
    phase=Phase.TASK,
)
def robot_file(task: TaskPlan) -> Iterator[Finding]:
    """What the robot's file leaves open, or means otherwise than it looks."""
    robot = task.context.robot
    for remark in robot.remarks:
        place = below(FILE.robot, *remark.field)
        say = warning if remark.code in _WARNED or remark.field == ("flange",) else info
        yield say(remark.code, remark.message, place, remark.hint)
    lacking = {
        "torque": np.isinf(robot.torque_limit),
        "speed": np.isinf(robot.velocity_limit),
    }
    n, open_ended = len(robot.joint_names), {}
    for what, without in lacking.items():
        names = [name for name, each in zip(robot.joint_names, without, strict=True) if each]
        if names:
            open_ended[what] = "any joint" if len(names) == n else ", ".join(names)
    if open_ended:
        which = " nor for ".join(f"the {what} of {whose}" for what, whose in open_ended.items())
        yield info(
            "TS442",
            f"the robot's file gives no limit for {which}",
            FILE.robot.model,
            "give the real ones: " + "; ".join(_LIMITS[what] for what in open_ended),
        )


@rule("TS326", "a tool that points away from its surface", phase=Phase.AXES)
def pointing_away(stage: StagePlan) -> Iterator[Finding]:
    """A tool that starts pointing away from the surface which a stage is about.

    A force of the stage, or a motion until something is felt, would have to go through the tool's
    stem. A ball that touches with its side is no such tool.
    """
    context, contact = stage.context, stage.contacts.main
    touches = stage.spec.until is not None or any(e.has_force for e in stage.spec.axes.values())
    if contact is None or not touches or context.loaded.task.robot.grasp is not None:
        return
    if len(context.robot.axes) <= _PLANAR or context.start_gaps[contact] < 0:
        return
    along = float(context.start_R[:, 2] @ context.start_normals[contact])
    if along > _AWAY:
        yield warning(
            "TS326",
            f"the tool starts pointing away from {contact!r}, at "
            f"{show(math.pi - math.acos(min(along, 1.0)), 'deg', 3)} to its inward normal",
            FILE.robot.start,
            "z of the tip points out of the tool: straight down is rpy: [180 deg, 0, 0]",
            unless=("TS326",),
        )
