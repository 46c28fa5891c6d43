"""Task frames: whether they have axes as the run begins, and are known where they are used."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np

from taskspec.expression import Expression
from taskspec.expression.tree import Name, walk
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.axes import MOSTLY, SkewedAxisError
from taskspec.program.flow import followers, reached
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.prepare import chart_at, pose_of_base, tool_center
from taskspec.program.world.estimated_frames import LEAST_SINE
from taskspec.program.world.frames import DirectionTracking, FrameModel, normal_at
from taskspec.program.world.tracked_frames import fastest_filter, fastest_turn, passes
from taskspec.rules import Finding, Phase, Place, error, rule, warning
from taskspec.shapes import SHAPES
from taskspec.spec import FILE, KeyPath, Stage
from taskspec.spec.frame import TRACKED
from taskspec.text.units import (
    ANGULAR_VELOCITY,
    FORCE,
    FREQUENCY,
    VELOCITY,
    describe,
    noun,
    show,
)

#: A heading is in a surface if it has no greater share of the normal than this leaves.
_IN_SURFACE = 1 - 1e-3


@rule(
    "TS232",
    "a rotation held against the world on an object that turns",
    also=("TS231",),
    phase=Phase.FRAME,
)
def turning_frames(stage: StagePlan) -> Iterator[Finding]:
    """What a stage asks of a frame that turns with an object or a handle and cannot be."""
    context, frame, base = stage.context, stage.frame, stage.moving_base
    held = [a for a, entry in stage.spec.axes.items() if entry.mode.world]
    if base is not None and base.turns and held:
        yield error(
            "TS232",
            f"{base.name!r} turns, and {held[0]!r} of a frame on it cannot hold the world's "
            "orientation",
            FILE.stages[stage.name].axes[held[0]],
            "take a frame that does not turn with the object, or write 'hold'",
            stops=True,
        )
        return
    if frame.mechanism is None:
        return
    yield from _against_a_knob(stage, held)
    if context.held not in ("", frame.mechanism.name):
        yield error(
            "TS231",
            f"frame {frame.name!r} turns with the handle of {frame.mechanism.name!r}, and the "
            f"robot holds that of {context.held!r}",
            _frame_of(stage),
            f"take {context.held}.handle",
            stops=True,
        )
    elif float(ca.evalf(frame.mechanism.margin(ca.SX(context.start_p)))) < 0:
        yield error(
            "TS231",
            f"the tool starts at the axis of {frame.mechanism.name!r}, where frame "
            f"{frame.name!r} has no axes",
            FILE.robot.start,
            f"start at the handle: robot.grasp: {frame.mechanism.name}.handle",
            stops=True,
        )


def _against_a_knob(stage: StagePlan, held: list[Axis]) -> Iterator[Finding]:
    """Rotations held against the world about the axis of a handle with a fixed knob."""
    frame = stage.frame
    mechanism = frame.mechanism
    assert mechanism is not None
    if mechanism.free or mechanism.name != stage.context.held:
        return
    for axis in held:
        if abs(frame.rotation[2, axis.column]) > MOSTLY:
            yield warning(
                "TS232",
                f"the knob of {mechanism.name!r} is fixed, so the tool turns with it, and {axis!r} "
                "holds against that",
                FILE.stages[stage.name].axes[axis],
                f"write {axis}: {{follows: {mechanism.name}}}, or knob: free",
            )


@rule("TS248", "a frame that does not go with its loose body", phase=Phase.FRAME)
def loose_frames(stage: StagePlan) -> Iterator[Finding]:
    """A frame on a loose body, or on one that turns with a mechanism: it stays where declared."""
    task, frame = stage.context.loaded.task, stage.frame
    owner = frame.surface_name or frame.owner
    shape = task.shapes.get(owner or "")
    if shape is None or owner == task.robot.grasp:
        return
    if shape.carrier is not None and shape.carrier.angular:
        handle = f"take {shape.on}.handle, whose axes go around with the tool"
        if not stage.context.mechanisms[shape.on or ""].swings:
            handle = (
                f"give {shape.on!r} a handle off its axis, and take its frame {shape.on}.handle"
            )
        yield warning(
            "TS248",
            f"{owner!r} turns with {shape.on!r}, and nothing tells the robot how far: frame "
            f"{frame.name!r} stays where it is declared",
            _frame_of(stage),
            handle,
            unless=("TS248",),
        )
    if not shape.free:
        return
    yield warning(
        "TS248",
        f"{owner!r} is loose, and nothing tells the robot where it goes: frame {frame.name!r} "
        "stays where it is declared",
        _frame_of(stage),
        "follow what stands still, or hold the body: robot.grasp",
        unless=("TS248",),
    )


@rule("TS225", "a following frame without an x axis at the start", phase=Phase.FRAME)
def following_frames(stage: StagePlan) -> Iterator[Finding]:
    """A frame that follows a surface and has no axes at the start pose."""
    context, frame = stage.context, stage.frame
    if frame.kind != "following":
        return
    assert frame.surface is not None
    A, a = pose_of_base(context, frame)
    center = A.T @ (tool_center(context) - a)
    chart = chart_at(frame.surface, center)
    normal = np.array(ca.evalf(chart.normal(ca.SX(center)))).ravel()
    heading = np.array(ca.evalf(chart.reference_direction(frame.heading))).ravel()
    share = abs(normal @ heading) / np.linalg.norm(heading)
    margin = float(ca.evalf(chart.margin(ca.SX(center), frame.heading)))
    if not np.isfinite(normal).all() or (share < _IN_SURFACE and margin < 0):
        yield error(
            "TS225",
            f"the tool does not start over the part of {frame.surface_name!r} that frame "
            f"{frame.name!r} follows",
            FILE.robot.start,
            "start " + ", ".join(s.start_over for s in SHAPES.values() if s.start_over),
            stops=True,
        )
    elif not share < _IN_SURFACE:
        given = frame.heading is not None
        yield error(
            "TS225",
            f"frame {frame.name!r} has no x axis where the tool starts: its heading is along the "
            "normal there",
            FILE.frames[frame.name]["heading" if given else "surface"],
            "give a heading that lies in the surface, such as heading: [0, 1, 0]",
            stops=True,
        )


@rule("TS221", "a frame that is askew to the plane of a planar arm", phase=Phase.FRAME)
def skewed_frames(stage: StagePlan) -> Iterator[Finding]:
    """A frame with axes that the arm can move only in part."""
    try:
        _ = stage.axes
    except SkewedAxisError as reason:
        message, hint = f"in frame {stage.frame.name!r} {reason}", "align the frame with that plane"
        yield error("TS221", message, _frame_of(stage), hint, stops=True)


@rule(
    {
        "TS245": "a measured frame that is used before it is measured",
        "TS246": "a measured frame that may be used before it is measured",
    },
    phase=Phase.TASK,
)
def frames_without_estimate(task: TaskPlan) -> Iterator[Finding]:
    """Stages that use a measured frame before it has been measured."""
    context, task_spec = task.context, task.context.loaded.task
    first = {next(iter(task_spec.stages))}
    once = ("TS245",)  # The file's frame is that of several stages.
    for name, stage in task.stages.items():
        for frame, place in _estimated_frames(stage):
            estimate = context.frames[frame.estimated_in].estimate
            if name not in reached(task_spec, followers(task_spec, estimate)):
                yield error(
                    "TS245",
                    f"stage {name!r} uses frame {frame.name!r}, which is measured at the end of "
                    f"{estimate!r}; that stage never comes before it",
                    place,
                    "use the frame in a stage that follows, or let it be measured by an earlier "
                    "one",
                    unless=once,
                )
            elif name in reached(task_spec, first, without=estimate) and name != estimate:
                yield warning(
                    "TS246",
                    f"stage {name!r} can be entered without stage {estimate!r} before it, which "
                    f"measures frame {frame.name!r}: the run stops there",
                    place,
                    f"lead every way to {name!r} through {estimate!r}",
                    unless=once,
                )


@rule({}, also=("TS225",), phase=Phase.TASK)
def estimated_headings(task: TaskPlan) -> Iterator[Finding]:
    """Measured frames whose heading is along the normal that is to be measured."""
    context = task.context
    if not context.start_gaps:
        return
    nearest = min(context.start_gaps, key=lambda o: context.start_gaps[o])
    normal = context.start_normals[nearest]
    for name, frame in context.frames.items():
        tracking = frame.tracking
        if tracking is not None and tracking.of == "velocity":
            if np.linalg.norm(np.cross(tracking.begun, tracking.across)) < LEAST_SINE:
                yield error(
                    "TS225",
                    f"frame {name!r} has no z axis: its normal is along its heading",
                    FILE.frames[name],
                    "give a heading along which the tool sets out, or a normal across it",
                )
            continue
        if not frame.estimate and tracking is None:
            continue
        heading = np.array([1.0, 0.0, 0.0]) if frame.heading is None else frame.heading
        if np.linalg.norm(np.cross(normal, heading)) < LEAST_SINE * np.linalg.norm(heading):
            yield error(
                "TS225",
                f"frame {name!r} has no x axis: its heading is along the normal of {nearest!r}",
                FILE.frames[name],
                "give a heading that lies in the surface, such as heading: [0, 1, 0]",
            )


@rule({}, also=("TS112",), phase=Phase.TASK)
def tracked_floors(task: TaskPlan) -> Iterator[Finding]:
    """Frames that track one thing down to a floor of the other."""
    for name, frame in task.context.loaded.task.frames.items():
        measures = frame.floor.dimension if frame.floor is not None else None
        needed = TRACKED.get(frame.track or "", measures)
        if measures is not None and needed is not None and measures != needed:
            yield error(
                "TS112",
                f"{noun(needed)} is needed here, this is {describe(measures)}",
                FILE.frames[name].floor,
                f"the frame tracks a {frame.track}",
            )


@rule("TS251", "a frame whose filter is none at the control rate", phase=Phase.TASK)
def unfiltered_frames(task: TaskPlan) -> Iterator[Finding]:
    """Frames that track what changes from tick to tick as if they had no filter."""
    period = task.context.period
    rate, most = (show(f, FREQUENCY, 3) for f in (1 / period, fastest_filter(period)))
    for name, frame in task.context.frames.items():
        tracking = frame.tracking
        if tracking is not None and tracking.filter >= fastest_filter(period):
            given, left = show(tracking.filter, FREQUENCY), passes(tracking.filter, period)
            yield warning(
                "TS251",
                f"frame {name!r} filters nothing: at {rate} a filter of {given} passes "
                f"{100 * left:.0f} % of a change from tick to tick; a cutoff is below {most}",
                FILE.frames[name].filter,
                "lower it, or the noise of the sensor turns the frame",
            )


@rule({}, also=("TS249",), phase=Phase.RUN)
def unturned_frames(task: TaskPlan) -> Iterator[Finding]:
    """Frames that track the force, of whose stages none presses."""
    stages = task.stages.values()
    for name, frame in task.context.frames.items():
        if frame.tracking is None or frame.tracking.of != "force":
            continue
        there = [stage for stage in stages if stage.frame.name == name]
        if there and not any(_presses(stage) for stage in there):
            yield warning(
                "TS249",
                f"frame {name!r} tracks the contact force, and no stage in it presses: only what "
                "a motion runs into turns it",
                FILE.frames[name].track,
                "press along z in it, such as z: {force: -10 N}",
            )


def _presses(stage: StagePlan) -> bool:
    """Whether a stage has something to press with: a force, a spring, or a grasp that pulls back.

    A force that depends on time or signals counts. A spring is an axis whose law closes no force
    loop, a soft one, and one whose place is given along the normal of what it meets; a velocity
    there is an approach.
    """
    constrained = stage.spec.constraints.values()
    if stage.contacts.gripped or any(
        stage.known(each) != 0 for point in constrained for each in point.expressions
    ):
        return True
    if any(stage.set_points.of(axis) != 0 for axis in stage.contacts.forces):
        return True
    if stage.joint_path is not None:
        return False
    plans = [plan for axis, plan in stage.plans.items() if not axis.is_rotation]
    if any(p.soft or not (stage.law.control_law.force_loop or p.mode.lets_go) for p in plans):
        return True
    return any(p.yields and p.mode.moves and not p.mode.settled_rate(stage.known) for p in plans)


@rule(
    {
        "TS249": "a frame that tracks what its stage does not do",
        "TS250": "a frame that turns too slowly for the surface that it tracks",
    },
    phase=Phase.MOTION,
)
def tracking_frames(stage: StagePlan) -> Iterator[Finding]:
    """Stages that press or move so that the frame which tracks that goes astray."""
    tracking, frame = stage.frame.tracking, stage.frame
    if tracking is None:
        return
    if tracking.of == "velocity":
        yield from _tracked_motion(stage, tracking)
        return
    pressed = {a: stage.set_points.of(a) for a in stage.contacts.forces}
    astray = [a for a in pressed if a is not Axis.Z and pressed[a]]
    if astray and not pressed.get(Axis.Z):
        yield warning(
            "TS249",
            f"frame {frame.name!r} tracks the measured force, and stage {stage.name!r} "
            f"presses along {astray[0]} alone: z turns to where {astray[0]} was",
            FILE.stages[stage.name].axes[astray[0]],
            "press along z",
        )
    depth = pressed.get(Axis.Z)
    if depth is not None and 0 < abs(depth) <= tracking.floor:
        yield warning(
            "TS249",
            f"stage {stage.name!r} presses with {show(abs(depth), FORCE)}, and frame "
            f"{frame.name!r} keeps its direction up to {show(tracking.floor, FORCE)}",
            FILE.stages[stage.name].axes[Axis.Z],
            f"press harder, or lower the floor of {frame.name!r}",
        )
    if depth:
        yield from _left_behind(stage, tracking, Axis.Z)


def _tracked_motion(stage: StagePlan, tracking: DirectionTracking) -> Iterator[Finding]:
    """Stages that move so that the frame which tracks the motion goes astray."""
    frame, axes = stage.frame, stage.spec.axes
    moving = [a for a in AXES[:3] if a in axes and axes[a].mode.moves]
    rate = axes[Axis.X].mode.settled_rate(stage.known) if Axis.X in moving else None
    if moving and Axis.X not in moving:
        yield warning(
            "TS249",
            f"frame {frame.name!r} tracks the motion, and stage {stage.name!r} moves along "
            f"{moving[0]} alone: x turns to where {moving[0]} was, and on and on",
            FILE.stages[stage.name].axes[moving[0]],
            "move along x",
        )
    elif rate is not None and rate < 0:
        yield warning(
            "TS249",
            f"stage {stage.name!r} moves against x, and frame {frame.name!r} turns x along the "
            "motion: the tool goes to and fro",
            FILE.stages[stage.name].axes[Axis.X],
            f"move along x, and give {frame.name!r} the heading in which that leads",
        )
    elif rate is not None and 0 < rate <= tracking.floor:
        yield warning(
            "TS249",
            f"stage {stage.name!r} moves at {show(rate, VELOCITY)}, and frame {frame.name!r} "
            f"keeps its direction up to {show(tracking.floor, VELOCITY)}",
            FILE.stages[stage.name].axes[Axis.X],
            f"go faster, or lower the floor of {frame.name!r}",
        )
    for axis in stage.contacts.forces:
        if axis in stage.contacts.by_axis and rate:
            yield from _left_behind(stage, tracking, axis)


def _left_behind(stage: StagePlan, tracking: DirectionTracking, pressed: Axis) -> Iterator[Finding]:
    """Whether the surface that the file declares turns faster than the frame can."""
    name, context = stage.contacts.by_axis.get(pressed), stage.context
    shape = context.loaded.task.shapes.get(name or "")
    if shape is None or shape.motion is not None:
        return
    rates = [
        stage.spec.axes[a].mode.settled_rate(stage.known) or 0.0 if a in stage.spec.axes else 0.0
        for a in (Axis.X, Axis.Y)
    ]
    way = stage.rotation[:, :2] @ np.array(rates)
    center = tool_center(context)
    normal, _, distance = normal_at(shape, center)
    radius = 0.0 if context.robot.tool.flat else float(context.robot.tool.radii[0])
    _, bend, _ = normal_at(shape, center + (radius - distance) * normal)
    turning = bend @ way
    rate = float(np.linalg.norm(turning))
    if not np.isfinite(rate) or rate == 0.0:
        return
    place, frame = FILE.stages[stage.name], stage.frame.name
    if rate > tracking.turn:
        yield warning(
            "TS250",
            f"at this speed the normal of {name!r} turns at {show(rate, ANGULAR_VELOCITY)}, "
            f"and frame {frame!r} at {show(tracking.turn, ANGULAR_VELOCITY)} at most: it is "
            "left behind",
            place,
            f"go slower, or raise 'turn' of {frame!r}",
        )
        return
    tilts = tracking.of == "force" and turning @ way > 0
    friction = shape.friction if tilts else 0.0
    most = fastest_turn(tracking.filter, friction)
    if rate >= most:
        yield warning(
            "TS250",
            f"at this speed the normal of {name!r} turns at {show(rate, ANGULAR_VELOCITY)}; "
            f"from {show(most, ANGULAR_VELOCITY)} on the loop of frame {frame!r}, filtered at "
            f"{show(tracking.filter, FREQUENCY)}, is unstable",
            place,
            f"go slower, or raise 'filter' of {frame!r}",
        )


def _frame_of(stage: StagePlan) -> KeyPath:
    """The path of the frame that a stage has, its own or the file's."""
    return FILE.stages[stage.name].frame if stage.spec.frame else FILE.frame


def _estimated_frames(stage: StagePlan) -> Iterator[tuple[FrameModel, Place | None]]:
    """The measured frames that a stage needs, and where it says so."""
    if stage.frame.estimated_in:
        yield stage.frame, _frame_of(stage)
    for expression in _expressions(stage.spec):
        for node in walk(expression.tree):
            if isinstance(node, Name) and node.frame is not None:
                frame = stage.context.frames[node.frame]
                if frame.estimated_in:
                    yield frame, expression.where(node)


def _expressions(stage: Stage) -> Iterator[Expression]:
    candidates: list[Expression | None] = [stage.until, stage.fail_if]
    candidates += [way.when for way in stage.next]
    for axis in stage.axes.values():
        candidates += [expression for expression, _ in axis.expressions()]
    if stage.path is not None:
        candidates.append(stage.path.slowed)
    for expression in candidates:
        if expression is not None:
            yield expression
