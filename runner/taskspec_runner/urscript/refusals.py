"""Why a task does not map to a program of a Universal Robots arm."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, PAIRS, TRANSLATIONS, Axis
from taskspec.modes import (
    FollowsAxes,
    FreeAxis,
    Hold,
    Move,
    OnPath,
    OpenLoop,
    Position,
    Velocity,
)
from taskspec.modes.hold import KEPT
from taskspec.motion.joint_path import JointPath
from taskspec.motion.paths import Waypoints
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.world.frames import FrameModel
from taskspec.spec import FILE, KeyPath
from taskspec_runner.errors import InputError

#: Modes of axes that a program has.
_MODES = (Hold, FreeAxis, Move, Velocity, Position, OnPath, OpenLoop, FollowsAxes)
#: Built-in arms whose joints are those of a Universal Robots arm.
UNIVERSAL_ROBOTS = ("ur5e",)
_FRAMES = {
    "tool": "turns with the tool, and force_mode keeps its frame until it is called again",
    "estimated": "is estimated from measured forces while the task runs",
    "turning": "turns with the handle of a mechanism",
}


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a task does not map, and the place in the file that it is about."""

    place: KeyPath
    text: str


class NotMappedError(InputError):
    """A task has no program for a Universal Robots arm.

    Attributes:
        reasons: a line each, with its place.
    """

    def __init__(self, reasons: tuple[str, ...]) -> None:
        super().__init__("\n".join(["this task has no URScript:", *reasons]))
        self.reasons = reasons


def reasons(plan: TaskPlan) -> list[Reason]:
    """All reasons that a plan shows, in the order of the file; none of a task that maps."""
    found = dict.fromkeys((*_of_robot(plan), *_of_gripper(plan), *_of_world(plan), *_of_law(plan)))
    for stage in plan.stages.values():
        found |= dict.fromkeys(_of_stage(plan, stage))
    return list(found)


def _of_robot(plan: TaskPlan) -> Iterator[Reason]:
    context, robot = plan.context, plan.context.loaded.task.robot
    if set(context.robot.axes) != {*AXES}:
        yield Reason(FILE.robot.model, "the arm is planar: its tool has less than six axes")
    if robot.grasp is not None:
        if context.held:
            text = f"the robot holds the mechanism {context.held!r}, and goes by its coordinate"
        else:
            text = f"the robot starts with {robot.grasp!r} in its gripper: a program grips it first"
        yield Reason(FILE.robot.grasp, text)


def _of_gripper(plan: TaskPlan) -> Iterator[Reason]:
    for name, stage in plan.context.loaded.task.stages.items():
        if stage.grip is not None:
            text = "URScript has no gripper of its own: each maker's has commands of its own"
            yield Reason(FILE.stages[name].grip, text)
            return


def _of_world(plan: TaskPlan) -> Iterator[Reason]:
    task = plan.context.loaded.task
    for name in task.equations:
        text = "an equation constrains the motion: force_mode has no constraints but its six axes"
        yield Reason(FILE.world[name], text)
    for name in task.bushings:
        text = f"{name!r} is a bushing on the tool: its frame and forces are those of a model"
        yield Reason(FILE.world[name], text)


def _of_law(plan: TaskPlan) -> Iterator[Reason]:
    task = plan.context.loaded.task
    laws = [(FILE.law, task.law)]
    laws += [(FILE.stages[n].law, s.law) for n, s in task.stages.items() if s.law is not None]
    for place, law in laws:
        for key in ("sliding", "disturbance_observer"):
            if getattr(law, key) is not None:
                yield Reason(place[key], f"'{key}' works on torques, and servoj takes positions")
        if law.estimate is not None:
            yield Reason(
                place.estimate, "gains of the law follow an estimate: those of force_mode are fixed"
            )
        if law.varying:
            yield Reason(place, "gains of the law vary: those of force_mode and servoj are fixed")
        elif any(on in PAIRS for entries in law.by_entry.values() for on in entries):
            yield Reason(place, "gains of the law couple axes: force_mode has none that do")


def _of_stage(plan: TaskPlan, stage: StagePlan) -> Iterator[Reason]:
    place, frame = FILE.stages[stage.name], stage.frame
    if stage.joint_path is not None:
        yield from _of_joint_path(plan, stage)
        return
    if (text := _of_frame(plan, frame)) is not None:
        own = stage.spec.frame is not None
        declared = (
            FILE.frames[frame.name] if frame.name in plan.context.loaded.task.frames else None
        )
        used = place.frame if own else FILE.frame
        yield Reason(used if declared is None else declared, text)
        return
    if {*stage.plans} != {*AXES}:
        return  # The arm is planar, which is said.
    for axis, entry in stage.plans.items():
        if not isinstance(entry.mode, _MODES):
            text = f"{axis} goes by a mechanism, which the program knows nothing of"
            yield Reason(place.axes[axis], text)
        point = entry.axis.set_point
        if point is not None and point.wanted is KEPT:
            text = "the force of the stage before is kept, and the file does not determine it"
            yield Reason(place.axes[axis], text)
    yield from _of_springs(stage)
    if stage.path is not None and isinstance(stage.path.form, Waypoints):
        text = "the path leads to points of the frame from wherever the stage begins: make it 'to'"
        yield Reason(place.path, text)


def _of_frame(plan: TaskPlan, frame: FrameModel) -> str | None:
    """Why a frame does not map."""
    moving = plan.context.base_of(frame)
    if moving is not None:
        return f"the frame is carried by {frame.base_name!r}, which moves by itself"
    if frame.at_origin:
        return f"the control point is the origin of frame {frame.name!r}, not the TCP"
    if frame.kind == "tracking":
        assert frame.tracking is not None
        return f"frame {frame.name!r} tracks the measured {frame.tracking.of}"
    if frame.kind == "following":
        assert frame.surface is not None
        if not frame.surface.flat:
            kind = frame.surface.name
            return f"frame {frame.name!r} follows a curved surface ({kind}), force_mode's is fixed"
        return None
    return f"frame {frame.name!r} {_FRAMES[frame.kind]}" if frame.kind in _FRAMES else None


def _of_springs(stage: StagePlan) -> Iterator[Reason]:
    """A motion that presses by the spring of its law."""
    if stage.spec.until is not None:
        return
    springs = not stage.law.control_law.force_loop
    for axis, entry in stage.plans.items():
        if not springs and not entry.axis.is_soft:
            continue
        if axis in TRANSLATIONS and entry.yields and _leads_into(stage, axis):
            into = stage.contacts.of(axis)
            text = (
                f"the spring of the {stage.law.kind} law presses on {into!r}: a stiff arm would be "
                "driven into it; give the axis a 'force'"
            )
            yield Reason(FILE.stages[stage.name].axes[axis], text)


def _leads_into(stage: StagePlan, axis: Axis) -> bool:
    """Whether a motion along the normal of an object goes towards it, as far as the file tells."""
    entry = stage.plans[axis]
    if entry.set_point or isinstance(entry.mode, Hold):
        return False
    rate = entry.mode.settled_rate(stage.known) if isinstance(entry.mode, Velocity) else None
    towards = entry.mode.move if isinstance(entry.mode, Move) else rate
    return towards is None or towards * stage.contacts.facing(axis) < 0


def _of_joint_path(plan: TaskPlan, stage: StagePlan) -> Iterator[Reason]:
    place = FILE.stages[stage.name].path
    model = plan.context.loaded.task.robot.model
    if model not in UNIVERSAL_ROBOTS:
        yield Reason(place, f"joint positions of {model!r} are not those of a Universal Robots arm")
    elif not isinstance(stage.joint_path, JointPath) or stage.joint_path.speed is None:
        yield Reason(place, "of joints the program goes to positions at a speed, not by time")
