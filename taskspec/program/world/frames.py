"""Nominal frames: where the file says they are, resolved to the world, the tool or a surface."""

from __future__ import annotations

from dataclasses import field
from functools import lru_cache
from threading import get_ident
from typing import Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry import rotation
from taskspec.program.bound import evaluated
from taskspec.program.world.mechanisms import MechanismModel, mechanism_models
from taskspec.shapes import SHAPES, Surface
from taskspec.spec import Frame, Shape, Task

Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DirectionTracking:
    """The tracking of the measured force, or of the motion, by a frame.

    Attributes:
        of: `force`, against which its z is kept, or `velocity`, along which its x is.
        filter: cutoff [Hz].
        floor: the filtered force [N] or velocity [m/s] up to which it keeps its direction.
        turn: its greatest rate [rad/s].
        across: (3,) world direction that is laid across the tracked one: as x where z is
            tracked, as z where x is.
        begun: (3,) x before anything has moved, world axes; of a tracked velocity.
    """

    of: str
    filter: float
    floor: float
    turn: float
    across: Matrix = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    begun: Matrix = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))


@dataclass(frozen=True, slots=True)
class FrameModel:
    """A task frame.

    Attributes:
        name: as in the file.
        kind: fixed (in the world, or on an object that moves by itself), tool (carried by the
            tool), following (a surface), estimated (where a stage touched), turning (with a handle
            that goes around an axis), tracking (the measured force, or the motion).
        rotation, origin: (3, 3), (3,) pose in the world as declared, for kind tool in the tool,
            for kind turning in the axes of the handle; of an estimated frame, where it is expected.
        owner: the object that it is fixed on, through its parents.
        surface: of a following frame; heading: (3,) world direction of its x, or None.
        estimate: the stage that measures it; empty for a frame that is placed in such a one.
        estimated_in: of an estimated frame: the measured frame that it is or is placed in.
        in_estimated: (3, 3), (3,) its pose in that one.
        mechanism: of a turning frame, whose handle it turns with.
        tracking: how it follows the measured force or the motion; its rotation is what is expected.
        at_origin: the control point is the frame's origin, carried rigidly by the tool.
        described: how it came about, for `explain`.
    """

    name: str
    kind: str
    rotation: Matrix
    origin: Matrix
    surface: Surface | None = None
    surface_name: str = ""
    owner: str = ""
    heading: Matrix | None = None
    estimate: str = ""
    estimated_in: str = ""
    in_estimated: tuple[Matrix, Matrix] = field(default_factory=lambda: (np.eye(3), np.zeros(3)))
    mechanism: MechanismModel | None = None
    tracking: DirectionTracking | None = None
    at_origin: bool = False
    described: str = ""

    @property
    def still(self) -> bool:
        """Whether it stays where it is on what carries it while a stage is on."""
        return self.kind in ("fixed", "estimated")

    @property
    def by_tool_point(self) -> bool:
        """Whether it goes by the tool's reference point, and turns about that."""
        return self.kind in ("following", "tracking")

    @property
    def base_name(self) -> str:
        """The object that carries it along where that moves by itself."""
        return self.surface_name or self.owner


class Posed(Protocol):
    """Anything with a position [m] and roll, pitch, yaw [rad]."""

    @property
    def xyz(self) -> tuple[float, float, float]: ...  # noqa: D102

    @property
    def rpy(self) -> tuple[float, float, float]: ...  # noqa: D102


def pose(of: Posed) -> tuple[Matrix, Matrix]:
    """(3, 3) rotation and (3,) origin [m] of a posed thing in its parent."""
    return rotation.from_rpy(of.rpy), np.array(of.xyz, dtype=float)


def surface(shape: Shape) -> Surface:
    """The geometry of a declared shape, in the world."""
    R, origin = pose(shape)
    return SHAPES[shape.shape].placed(origin, R, shape.sizes)


def normal_at(shape: Shape, point: Matrix) -> tuple[Matrix, Matrix, float]:
    """Outward normal (3,), its change (3, 3) [1/m] and distance [m] of a world point (3,).

    Of a plate with a cut they are those of the plate.
    """
    R, origin = pose(shape)
    function = _normal(shape.shape, tuple(shape.sizes.items()), get_ident())
    normal, change, distance = evaluated(function, R.T @ (point - origin))
    return R @ normal, R @ change.reshape(3, 3, order="F") @ R.T, float(distance[0])


@lru_cache(maxsize=64)
def _normal(kind: str, sizes: tuple[tuple[str, float], ...], _thread: int) -> ca.Function:
    """What `normal_at` evaluates, of a point in the shape's own axes."""
    surface = SHAPES[kind].placed(np.zeros(3), np.eye(3), dict(sizes)).uncut()
    x = ca.SX.sym("x", 3)
    gradient = surface.gradient(x)
    return ca.Function("normal", [x], [gradient, ca.jacobian(gradient, x), surface.distance(x)])


def resolve(task: Task) -> dict[str, FrameModel]:
    """Every frame that the task can name. The file's frames are known to exist and not to loop."""
    frames = {
        "world": FrameModel("world", "fixed", np.eye(3), np.zeros(3), described="the world"),
        "tool": FrameModel(
            "tool", "tool", np.eye(3), np.zeros(3), described="turns with the tool, z out of it"
        ),
    }
    for name, shape in task.shapes.items():
        R, origin = pose(shape)
        described = f"fixed on {shape.shape}"
        if shape.motion is not None:
            described = f"moves with {shape.shape}"
        elif shape.on is not None:
            described = f"where the {shape.shape} is with {shape.on} at coordinate 0"
        elif shape.free:
            described = f"where the {shape.shape} lies as the run begins"
        frames[name] = FrameModel(name, "fixed", R, origin, owner=name, described=described)
    for model in mechanism_models(task).values():
        frames |= _of_mechanism(model)
    for name, bushing in task.bushings.items():
        R, origin = pose(bushing)
        described = "the tip's axes at rest, with the origin where it is at rest"
        frames[name] = FrameModel(name, "fixed", R, origin, owner=name, described=described)
    # An equation's frame is the one in which its coordinates count.
    frames |= {name: frames["world"] for name, e in task.equations.items() if e.frame is None}
    pending = dict(task.frames)
    while pending:
        for name, frame in list(pending.items()):
            parent = frame.parent or "world"
            if frame.surface is None and parent not in frames:
                continue
            del pending[name]
            frames[name] = _declared(task, name, frames)
    frames |= {name: frames[e.frame] for name, e in task.equations.items() if e.frame is not None}
    return frames


def _of_mechanism(model: MechanismModel) -> dict[str, FrameModel]:
    """The frames of a mechanism's own axes and of its handle."""
    name, handle = model.name, f"{model.name}.handle"
    own = FrameModel(
        name,
        "fixed",
        model.rotation,
        model.origin,
        owner=name,
        described=f"axes of the {model.kind} as declared; they do not turn with it",
    )
    if not model.swings:
        at = FrameModel(
            handle,
            "fixed",
            model.rotation,
            model.grip,
            owner=name,
            described=f"fixed at the handle of {name} where that is at coordinate 0",
        )
        return {name: own, handle: at}
    turning = FrameModel(
        handle,
        "turning",
        np.eye(3),
        np.zeros(3),
        owner=name,
        mechanism=model,
        described=f"turns with the tool about the axis of {name}: x radial, y tangential, z the "
        "axis",
    )
    return {name: own, handle: turning}


def _declared(task: Task, name: str, frames: dict[str, FrameModel]) -> FrameModel:
    frame = task.frames[name]
    if frame.surface is not None:
        shape = surface(task.shapes[frame.surface])
        heading = None if frame.heading is None else np.array(frame.heading, dtype=float)
        along = "its own x" if frame.heading is None else f"heading {list(frame.heading)}"
        return FrameModel(
            name,
            "following",
            np.eye(3),
            np.zeros(3),
            surface=shape,
            surface_name=frame.surface,
            heading=heading,
            described=f"follows the tool over {frame.surface}, z outward normal, x along {along}",
        )
    if frame.track is not None:
        return _tracking(name, frame)
    if frame.estimate is not None:
        heading = None if frame.heading is None else np.array(frame.heading, dtype=float)
        along = "the world's x" if frame.heading is None else f"heading {list(frame.heading)}"
        return FrameModel(
            name,
            "estimated",
            np.eye(3),
            np.zeros(3),
            heading=heading,
            estimate=frame.estimate,
            estimated_in=name,
            described=f"measured at the end of {frame.estimate}, z against the measured force, "
            f"x along {along}",
        )
    parent = frames[frame.parent or "world"]
    R, origin = pose(frame)
    outer_R, outer_origin = parent.in_estimated
    return FrameModel(
        name,
        parent.kind,
        parent.rotation @ R,
        parent.origin + parent.rotation @ origin,
        owner=parent.owner,
        estimated_in=parent.estimated_in,
        in_estimated=(outer_R @ R, outer_origin + outer_R @ origin),
        mechanism=parent.mechanism,
        at_origin=frame.point == "origin",
        described=f"{'placed' if parent.mechanism else 'fixed'} in {parent.name}"
        + (", control point at its origin" if frame.point == "origin" else ""),
    )


def _tracking(name: str, frame: Frame) -> FrameModel:
    """A frame that tracks the force or the motion."""
    heading = _unit(frame.heading, 0)
    along = "the world's x" if frame.heading is None else f"heading {list(frame.heading)}"
    if frame.track == "force":
        floor = 1.0 if frame.floor is None else float(frame.floor)
        tracking = DirectionTracking("force", frame.filter, floor, frame.turn, across=heading)
        described = (
            f"z against the measured force, filtered at {frame.filter:g} Hz, from {floor:g} N on, "
            f"x along {along}"
        )
    else:
        floor = 2e-3 if frame.floor is None else float(frame.floor)
        normal = _unit(frame.normal, 2)
        tracking = DirectionTracking(
            "velocity", frame.filter, floor, frame.turn, across=normal, begun=heading
        )
        up = "the world's z" if frame.normal is None else f"normal {list(frame.normal)}"
        described = (
            f"x along the motion, filtered at {frame.filter:g} Hz, from {1e3 * floor:g} mm/s on, "
            f"at first along {along}, z along {up}"
        )
    return FrameModel(
        name,
        "tracking",
        np.eye(3),
        np.zeros(3),
        heading=None if frame.heading is None else heading,
        tracking=tracking,
        described=described,
    )


def _unit(direction: tuple[float, float, float] | None, axis: int) -> Matrix:
    """(3,) a declared direction as a unit vector; without one, an axis of the world."""
    if direction is None:
        return np.asarray(np.eye(3)[axis])
    given = np.array(direction, dtype=float)
    return np.asarray(given / np.linalg.norm(given))
