"""The signals of a stage as expressions, by the names that task files, guards and logs use."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import casadi as ca

from taskspec.control.reference import opposite
from taskspec.deferred_methods import dataclass
from taskspec.expression.tree import Name
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.context import Context
from taskspec.program.interval import Interval, IntervalAlgebra, point
from taskspec.program.slots import Slots
from taskspec.program.world import estimated_frames, kinematics
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.moving_base import BaseMotion, MovingBase
from taskspec.robot import RobotModel
from taskspec.robot.model_terms import TermSymbols
from taskspec.shapes import Surface
from taskspec.signals import VECTORS, Entry, MovingPose, Situation, find
from taskspec.spec import Task
from taskspec.spec.params import worths


class UnknownSignalError(LookupError):
    """A name that this stage cannot evaluate; the message says why."""


@dataclass(frozen=True, slots=True)
class SignalTable:
    """The signals of a stage by name.

    Attributes:
        situation: the arguments of their formulas; grows while the stage is put together.
        constants: params and pi by name.
        elsewhere: resolves `signal in FRAME`.
    """

    situation: Situation
    constants: Mapping[str, ca.SX]
    elsewhere: Callable[[str, str], ca.SX]

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes that exist in the stage's frame."""
        return self.situation.axes

    def get(self, name: str) -> ca.SX | None:
        """A signal by its full name, such as `force.z` or `gap`; None where it is not known."""
        return self.situation.signal(*name.split("."))

    def __getitem__(self, name: str) -> ca.SX:
        value = self.get(name)
        if value is None:
            raise UnknownSignalError(name)
        return value

    def lookup(self, name: Name) -> ca.SX:
        """A signal or a constant."""
        text = ".".join(name.path)
        if name.frame is not None:
            return self.elsewhere(text, name.frame)
        if text in self.constants:
            return self.constants[text]
        value = self.get(text)
        if value is None and name.path[0] in VECTORS and len(name.path) == 2:
            # A component of `norm(...)` that this stage does not have; alone, it has been reported.
            return ca.SX(0)
        return self[text] if value is None else value


def entry_of(task: Task, path: tuple[str, ...]) -> Entry | None:
    """The entry of the table that a name means in the task, None for params and constants."""
    return find(path, {name: thing.kind for name, thing in task.world.items()}, task.stages)


def natural(found: Entry) -> Interval:
    """The range of a signal by its nature."""
    return Interval(found.signal.low, found.signal.high)


def constant(context: Context, name: Name) -> Interval | None:
    """The values that a param or a constant can have, None of another name.

    One alone, but where a param may be set while a stage runs.
    """
    value, params = declared(context, name), context.loaded.task.params
    if value is None or str(name) not in params or not params[str(name)].live:
        return None if value is None else point(value)
    bounds = {each: Interval(p.low, p.high) for each, p in context.loaded.task.live.items()}
    return worths(params, IntervalAlgebra(), bounds.__getitem__)[str(name)]


def declared(context: Context, name: Name) -> float | None:
    """The value of a param or a constant that the file gives it, None of another name."""
    text, params = str(name), context.loaded.task.params
    if text == "pi":
        return math.pi
    return params[text].value if text in params else None


def applied(axis: Axis) -> str:
    """The signal of what the robot applies on an axis: `force.z`, `torque.rx`."""
    return f"{'torque' if axis.startswith('r') else 'force'}.{axis}"


@dataclass(frozen=True, slots=True)
class Placement:
    """The tool in a frame at this instant, relative to what carries the frame.

    Attributes:
        world: kinematics of the tip in the world.
        clock: since the run began [s].
        moving_base: what carries the frame, None where nothing does.
        terms: the tip.
        tool: the tool point.
        point: the control point.
        at: the frame.
    """

    world: TermSymbols
    clock: ca.SX
    moving_base: BaseMotion | None
    terms: TermSymbols
    tool: kinematics.ToolPoint
    point: kinematics.ControlPoint
    at: kinematics.FrameState

    def situation(self, axes: tuple[Axis, ...]) -> Situation:
        """The arguments of signals' formulas about the tool, on axes of the frame."""
        world, terms = self.world, self.terms
        return Situation(
            axes=axes,
            clock=self.clock,
            world=MovingPose(world.p, world.R, world.twist),
            tip=MovingPose(terms.p, terms.R, terms.twist),
            frame=self.at.R,
            twist=self.point.twist,
            applied=opposite(self.point.wrench),
        )


def place(
    robot: RobotModel,
    frame: FrameModel,
    base: MovingBase | None,
    terms: TermSymbols,
    wrench: ca.SX,
    clock: ca.SX,
    offset: ca.SX | None,
    face: ca.SX | None,
) -> Placement:
    """The tool in a frame.

    Args:
        robot: for the tool.
        frame: whichever.
        base: the object that carries it, if one does.
        terms: kinematics of the tip in the world.
        wrench: (6,) on it, world axes [N, N m].
        clock: since the run began [s].
        offset: (3,) of the control point in tip axes, or None.
        face: parameters of the frame, as `kinematics.frame_state` has them.
    """
    now = None if base is None else base.at(clock)
    # Relative to what carries the frame, in its coordinates; to the world's where nothing does.
    relative = terms if now is None else now.relative(terms)
    there = wrench if now is None else now.wrench(wrench)
    tool = kinematics.tool_point(robot, relative)
    point = kinematics.control_point(relative, there, offset)
    at = kinematics.frame_state(frame, relative, tool, face)
    return Placement(terms, clock, now, relative, tool, point, at)


@dataclass(frozen=True, slots=True)
class SignalsElsewhere:
    """Resolves a signal in another frame than the stage's, at the stage's control point."""

    robot: RobotModel
    frames: Mapping[str, FrameModel]
    terms: TermSymbols
    wrench: ca.SX
    offset: ca.SX | None
    moving_bases: Mapping[str, MovingBase]
    clock: ca.SX
    parameters: Slots

    def __call__(self, signal: str, frame_name: str) -> ca.SX:
        """The component `signal` in the axes of frame `frame_name`."""
        frame = self.frames[frame_name]
        surface = frame.surface
        if frame.tracking is not None:
            raise UnknownSignalError(
                f"{signal} in {frame_name}: a frame that tracks is nowhere but in its own stages"
            )
        if surface is not None and surface.parts:
            raise UnknownSignalError(
                f"{signal} in {frame_name}: the {surface.parts} of a {surface.name} are followed "
                "only by the stage's own frame"
            )
        face = (
            estimated_frames.symbols(self.parameters, frame) if frame.kind == "estimated" else None
        )
        base = self.moving_bases.get(frame.base_name)
        placed = place(
            self.robot, frame, base, self.terms, self.wrench, self.clock, self.offset, face
        )
        situation = placed.situation(AXES)
        if frame.still:
            local = placed.at.R.T @ (placed.point.p - placed.at.origin)
            situation.position = {axis: local[i] for i, axis in enumerate(AXES[:3])}
        kind, _, axis = signal.partition(".")
        value = situation.signal(kind, axis)
        if value is None:
            raise UnknownSignalError(f"{signal} in {frame_name}")
        return value


def gaps(
    robot: RobotModel,
    surfaces: Mapping[str, Surface],
    p: ca.SX,
    R: ca.SX,
    moving_bases: Mapping[str, MovingBase] | None = None,
    clock: ca.SX | None = None,
) -> dict[str, ca.SX]:
    """Signed distance [m] of the tool's shape from every object, by object name.

    Args:
        robot: for the tool.
        surfaces: as declared.
        p, R: (3,), (3, 3) pose of the tip.
        moving_bases: of the objects that move; None has all of them where they are declared.
        clock: [s].
    """
    found = {}
    for name, surface in surfaces.items():
        if moving_bases is not None and name in moving_bases:
            assert clock is not None
            now = moving_bases[name].at(clock)
            found[name] = kinematics.gap(robot, surface, now.place(p), now.A.T @ R)
        else:
            found[name] = kinematics.gap(robot, surface, p, R)
    return found


def normal(
    surface: Surface, point: ca.SX, moving_bases: Mapping[str, MovingBase], name: str, clock: ca.SX
) -> ca.SX:
    """Outward normal (3,) of object `name` at a point (3,), world."""
    if name not in moving_bases:
        return surface.gradient(point)
    now = moving_bases[name].at(clock)
    return now.A @ surface.gradient(now.place(point))
