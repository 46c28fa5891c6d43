"""Frames that are estimated: where the tip is when a stage ends, z against the force there.

While a stage is on they do not move. Later stages get them as parameters, written at entry.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction
from taskspec.program.slots import Slots
from taskspec.program.world.frames import FrameModel

Vector = NDArray[np.float64]

#: The force is averaged over this time before the stage's end [s], or over a shorter stage: long
#: enough to divide white noise by ten at 1 kHz, short enough to leave the impact out.
WINDOW = 0.1
#: Below this mean force [N] nothing is estimated of a surface.
LEAST_FORCE = 0.5
#: Sine of the angle to the normal below which a heading gives no x axis.
LEAST_SINE = 0.05
#: What the parameters begin with that hold estimated poses.
PREFIX = "estimated."
#: Numbers of an estimated pose: its rotation by columns, and its origin.
SIZE = 12
_WORLD_X = np.array([1.0, 0.0, 0.0])


class NotEstimatedError(ValueError):
    """A frame that what was measured does not define; the message is a clause that says why."""


def slot(frame: FrameModel) -> str:
    """The stage parameter that holds an estimated frame, or the one that `frame` is placed in."""
    return PREFIX + frame.estimated_in


def symbols(layout: Slots, frame: FrameModel) -> ca.SX:
    """(12,) rotation by columns and origin of the estimated frame; takes the parameter once."""
    name = slot(frame)
    return layout.symbol(name) if name in layout else layout.add(name, SIZE)


def placed(frame: FrameModel, pose: ca.SX) -> tuple[ca.SX, ca.SX]:
    """(3, 3), (3,) axes and origin in the world of a frame, from the (12,) of `symbols`."""
    R, origin = ca.reshape(pose[:9], 3, 3), pose[9:]
    local_R, local_origin = (ca.SX(ca.DM(part)) for part in frame.in_estimated)
    return R @ local_R, origin + R @ local_origin


def origin(frame: FrameModel, poses: Mapping[str, ca.SX]) -> ca.SX:
    """(3,) where a frame's origin is in the world, given the estimated poses (12,)."""
    if frame.kind != "estimated":
        return ca.SX(ca.DM(frame.origin))
    return placed(frame, poses[slot(frame)])[1]


def axes_of(normal: Vector, heading: Vector | None) -> Vector:
    """(3, 3) z along `normal` (3,), x along the part of `heading` (3,) across it.

    Raises:
        NotEstimatedError: the heading is along the normal.
    """
    z0, z1, z2 = _unit(normal.tolist())
    h0, h1, h2 = (1.0, 0.0, 0.0) if heading is None else _unit(heading.tolist())
    share = z0 * h0 + z1 * h1 + z2 * h2
    across = (h0 - z0 * share, h1 - z1 * share, h2 - z2 * share)
    if math.hypot(*across) < LEAST_SINE:
        raise NotEstimatedError(_HEADS_ALONG)
    x0, x1, x2 = _unit(across)
    y0, y1, y2 = z1 * x2 - z2 * x1, z2 * x0 - z0 * x2, z0 * x1 - z1 * x0
    return np.array([[x0, y0, z0], [x1, y1, z1], [x2, y2, z2]])


def _unit(vector: Iterable[float]) -> tuple[float, float, float]:
    x, y, z = vector
    size = math.hypot(x, y, z)
    return x / size, y / size, z / size


def measure(frame: FrameModel, force: Vector, tip: Vector) -> tuple[Vector, Vector]:
    """(3, 3), (3,) pose of an estimated frame.

    Args:
        frame: whose heading counts.
        tip: (3,) where the stage ended, world.
        force: (3,) mean by the environment on the tool, world: along the outward normal.

    Raises:
        NotEstimatedError: the force is too small, or the heading is along the normal.
    """
    size = math.hypot(*force.tolist())
    if size < LEAST_FORCE:
        raise NotEstimatedError(_too_little(frame.estimate, size))
    return axes_of(force, frame.heading), tip.copy()


_HEADS_ALONG = "its heading is along the normal that was measured"


def _too_little(stage: str | None, size: float) -> str:
    return (
        f"the mean force at the end of stage {stage!r} was {size:.2g} N, less than "
        f"{LEAST_FORCE:g} N"
    )


def with_nominal(
    frames: Mapping[str, FrameModel], normal: Vector, origin: Vector
) -> dict[str, FrameModel]:
    """The frames, those that are measured or tracked where the file would have them.

    Args:
        frames: all frames.
        normal: (3,) that is expected.
        origin: (3,) of the tip at the start.
    """
    found = dict(frames)
    for name, frame in frames.items():
        if frame.kind not in ("estimated", "tracking"):
            continue
        heading = frames[frame.estimated_in or name].heading
        tracking = frame.tracking
        if tracking is not None and tracking.of == "velocity":
            # Until anything moves; x along z is reported elsewhere.
            with suppress(NotEstimatedError):
                x, minus_y, z = axes_of(tracking.begun, tracking.across)[:, [2, 1, 0]].T
                R = np.column_stack([x, -minus_y, z])
                found[name] = replace(frame, rotation=R, origin=origin)
            continue
        try:
            R = axes_of(normal, heading)
        except NotEstimatedError:
            R = axes_of(normal, np.roll(_WORLD_X, 1 + int(np.argmax(np.abs(normal)))))
        local_R, local_origin = frame.in_estimated
        found[name] = replace(frame, rotation=R @ local_R, origin=origin + R @ local_origin)
    return found


#: What came of measuring a frame, and before anything did.
MEASURED, PRESSED_TOO_LITTLE, ALONG_NORMAL, UNVISITED = 1.0, 0.0, -1.0, -2.0


def measuring(frames: Sequence[FrameModel]) -> ca.Function:
    """What `measure` says of k frames, as one function.

    Takes the sum of the forces (3,) by the environment, world [N], of how many ticks it is (1,),
    and the tip (3,), world. Gives the frames' poses (12 k,), zeros for a frame that has none, what
    came of each (k,), and the mean force (1,) [N].
    """
    total, count, tip = ca.SX.sym("total", 3), ca.SX.sym("count"), ca.SX.sym("tip", 3)
    force = total / count
    size = ca.norm_2(force)
    z = force / size
    poses, found = [], []
    for frame in frames:
        heading = ca.SX(ca.DM(_WORLD_X if frame.heading is None else frame.heading))
        heading /= ca.norm_2(heading)
        across = heading - z * ca.dot(z, heading)
        sine = ca.norm_2(across)
        x = across / sine
        pose = ca.vertcat(x, ca.cross(z, x), z, tip)
        came = ca.if_else(sine < LEAST_SINE, ALONG_NORMAL, MEASURED)
        came = ca.if_else(size < LEAST_FORCE, PRESSED_TOO_LITTLE, came)
        poses.append(ca.if_else(came == MEASURED, pose, 0))
        found.append(came)
    results = [ca.densify(ca.vertcat(*part)) for part in (poses, found, [size])]
    return ca.Function("measuring", [total, count, tip], results)


class Estimates:
    """The estimated frames of a run, as they are gained.

    Attributes:
        recent: (window, 3) ring of the measured forces of the stage's last ticks, by the
            environment, world axes [N].
        collected: ticks of the stage; tick k is row k modulo the window.
        total: (3,) sum of these forces, the oldest first, as a stage has ended.
        count: (1,) of how many ticks that is; tip: (3,) where it ended, world.
        ends: measures the frames of a stage at its end, by its name.
        frames: the numbers of these frames, by the stage's name.
        poses: (12 frames,) frame by frame; found: (frames,) what came of each.
        names: of the stage parameters that hold the poses, frame by frame.
    """

    def __init__(self, frames: Iterable[FrameModel], period: float) -> None:
        """For the measured ones among `frames`; `period` is that of control [s]."""
        measured = sorted((f for f in frames if f.estimate), key=lambda f: f.estimate or "")
        self._frames = measured
        self.names = tuple(slot(f) for f in measured)
        self.recent: Vector = np.zeros((window(period), 3))
        self.collected = 0
        self.total, self.count, self.tip = np.zeros(3), np.zeros(1), np.zeros(3)
        self.poses, self.found = np.zeros(SIZE * len(measured)), np.full(len(measured), UNVISITED)
        self._sizes = np.zeros(len(measured))
        self.ends: dict[str, BoundFunction] = {}
        self.frames: dict[str, range] = {}
        given = (self.total, self.count, self.tip)
        for stage, group in itertools.groupby(range(len(measured)), lambda i: measured[i].estimate):
            assert stage is not None
            first, *rest = group
            end = first + 1 + len(rest)
            self.frames[stage] = range(first, end)
            found = [
                self.poses[SIZE * first : SIZE * end],
                self.found[first:end],
                self._sizes[first : first + 1],
            ]
            self.ends[stage] = BoundFunction(measuring(measured[first:end]), given, found)

    def begin(self) -> None:
        """Forgets the forces of the last stage."""
        self.collected = 0

    def collect(self, force: Vector) -> None:
        """Takes the measured force (3,) of a tick, by the environment, world axes."""
        self.recent[self.collected % len(self.recent)] = force
        self.collected += 1

    def end(self, stage: str, tip: Vector, *, summed: bool = False) -> None:
        """Measures the frames of a stage that has just ended with the tip at (3,).

        Args:
            stage: its name.
            tip: world.
            summed: whether `total` is the sum of now.
        """
        if stage not in self.ends:
            return
        if not summed:
            self._sum()
        self.count[0] = min(self.collected, len(self.recent))
        self.tip[:] = tip
        self.ends[stage].evaluate()

    def _sum(self) -> None:
        """Writes the sum of the forces in the window, the oldest first."""
        room, recent = len(self.recent), self.recent
        oldest = self.collected % room
        if self.collected <= room:
            recent = recent[: self.collected]
        elif oldest:
            recent = np.concatenate((recent[oldest:], recent[:oldest]))
        np.add.reduce(recent, out=self.total)

    def pose(self, name: str) -> Vector:
        """(12,) the pose that a stage parameter holds."""
        at = self.names.index(name)
        return self.poses[SIZE * at : SIZE * at + SIZE]

    def missing(self, parameters: Iterable[str]) -> str:
        """Why a stage with these poses cannot be entered, as a sentence; empty if it can.

        Args:
            parameters: that hold the poses.
        """
        for name in parameters:
            at = self.names.index(name)
            if self.found[at] == MEASURED:
                continue
            stage = self._frames[at].estimate
            size = self._sizes[self.frames[stage or ""].start]
            problem = {
                UNVISITED: f"stage {stage!r} has not been visited",
                PRESSED_TOO_LITTLE: _too_little(stage, size),
                ALONG_NORMAL: _HEADS_ALONG,
            }[float(self.found[at])]
            frame = name.removeprefix(PREFIX)
            return f"frame {frame!r} has not been estimated: {problem}"
        return ""


def window(period: float) -> int:
    """Ticks of which the force is averaged."""
    return max(1, math.floor(WINDOW / period + 0.5))


def estimates(frames: Mapping[str, FrameModel], period: float) -> Estimates | None:
    """The store of a run; None for a task that measures nothing."""
    measured = [f for f in frames.values() if f.estimate]
    return Estimates(measured, period) if measured else None
