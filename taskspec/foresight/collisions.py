"""What the links of an arm run into on the nominal trajectory of a stage."""

from __future__ import annotations

import itertools
import math
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.foresight.kept_out import KeptOut
from taskspec.program.bound import RowFunction
from taskspec.program.context import Context
from taskspec.program.passage import Instant
from taskspec.program.plan import StagePlan
from taskspec.shapes import BoundedSurface

Vector = NDArray[np.float64]

TOOL_END = "the tool"
#: Between two configurations that are looked at no joint turns farther [rad, m].
_STEP = 0.02
#: A longer way of the joints is looked at in so many steps, beside the instants of its passage.
_MOST = 400
#: Less than this inside is what a passage's instants leave open [m].
_LEAST = 1e-3


@dataclass(frozen=True, slots=True)
class Collision:
    """Where something of the arm first meets an object.

    Attributes:
        time: since the stage began [s].
        part: a link of the robot's file, or `TOOL_END`.
        object: its name.
        depth: how far inside it comes in the stage [m].
    """

    time: float
    part: str
    object: str
    depth: float


class Surroundings:
    """The objects of a task that stand where they are, and what of the arm may run into them.

    Objects that move by themselves, are loose or ride on a mechanism are not among them. One
    without an end stands for a table or a wall of some size: links that are in it as the run
    starts, such as those that carry the arm through the height of its table, are beside it.

    Attributes:
        names: of the objects that are looked at.
        left_out: those that are not, and why.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        shapes = context.loaded.task.shapes
        self.left_out = {
            name: "rides on a mechanism" if shape.on is not None else "is loose" if shape.gives_way
            else "moves"
            for name, shape in shapes.items()
            if name in context.moving_bases or shape.gives_way
        }  # fmt: skip
        self.names = tuple(name for name in shapes if name not in self.left_out)

    @cached_property
    def _beside(self) -> NDArray[np.bool_]:
        """(links + 1, objects) what is in an endless object as the run starts."""
        links = self._context.robot.links
        points = self._points(self._context.start)[: len(links.radii)]
        inside = self._distances(points)[0] < links.radii[:, np.newaxis]
        found: NDArray[np.bool_] = np.zeros((len(links.names) + 1, len(self.names)), dtype=bool)
        np.logical_or.at(found, links.link, inside)
        surfaces = [self._context.surfaces[name] for name in self.names]
        return found & [not isinstance(each, BoundedSurface) for each in surfaces]

    @cached_property
    def _distances(self) -> RowFunction:
        x = ca.SX.sym("x", 3)
        found = [self._context.surfaces[name].distance(x) for name in self.names]
        return RowFunction(ca.Function("distances", [x], [ca.vertcat(*found)]))

    @cached_property
    def _kept_out(self) -> KeptOut:
        surfaces = [self._context.surfaces[name] for name in self.names]
        return KeptOut(surfaces, self._context.robot.tool.radii)

    @staticmethod
    def knows(stage: StagePlan) -> bool:
        """Whether the way of a stage is known, so that it is looked at."""
        passage = stage.nominal.passage if stage.followed else None
        return passage is not None and bool(_along(passage.instants)[0])

    def first(self, stage: StagePlan) -> Collision | None:
        """The first collision in a stage; None without one, or where its way is not known.

        To be asked stage by stage in their order: what the tool's end is pressed on goes on being
        pressed on in the stage after.
        """
        passage = stage.nominal.passage if stage.followed else None
        links, tool = stage.context.robot.links, stage.context.robot.tool
        if not self.names or not len(links.radii):
            return None
        times, configurations = _along(passage.instants) if passage is not None else ([], [])
        if not times:
            self._kept_out.forget()
            return None
        points = np.stack([self._points(q) for q in configurations])
        radii = np.concatenate([links.radii, tool.radii])
        gaps = self._gaps(points, radii)
        part = np.concatenate([links.link, np.full(len(tool.radii), len(links.names))])
        if stage.joint_path is None:
            # Its touch is what other rules look at; what it presses on keeps the arm from following
            # a reference that leads inside. A link goes back by a share of what the tool's end is
            # kept back by, so it is inside for certain where it is without and with all of it.
            end = len(links.radii)
            kept = self._kept_out.follow(points[:, end:], gaps[:, end:])
            gaps, part = gaps[:, :end], links.link
            if kept.any() and (gaps < 0).any():
                moved = self._gaps(points[:, :end] + kept[:, np.newaxis], links.radii)
                gaps = np.maximum(gaps, moved)
        else:
            self._kept_out.forget()
        gaps = np.where(self._beside[part], np.inf, gaps)
        meets = (gaps < -_LEAST).any(axis=(1, 2))
        if not meets.any():
            return None
        first = int(np.argmax(meets))
        ball, thing = np.unravel_index(int(np.argmin(gaps[first])), gaps[first].shape)
        deepest = -float(gaps[:, part == part[ball], thing].min())
        name = (*links.names, TOOL_END)[int(part[ball])]
        return Collision(times[first], name, self.names[int(thing)], deepest)

    def _gaps(self, points: Vector, radii: Vector) -> Vector:
        """(k, b, objects) gaps of balls with centres (k, b, 3) [m] and radii (b,) [m]."""
        found = self._distances(points.reshape(-1, 3))[0]
        return found.reshape(*points.shape[:2], -1) - radii[:, np.newaxis]

    def _points(self, q: Vector) -> Vector:
        """(k, 3) the centres of the links' balls and of those of the tool's end [m]."""
        robot = self._context.robot
        points, data = robot.links.at(robot.pin, q)
        at = data.oMi[robot.tip_joint] * robot.tip
        return np.concatenate([points, robot.tool.centers @ at.rotation.T + at.translation])


def _along(instants: tuple[Instant, ...]) -> tuple[list[float], list[Vector]]:
    """Times [s] and configurations (n,) of a passage, close to each other; none without an end."""
    ways = [float(np.abs(b.q - a.q).max()) for a, b in itertools.pairwise(instants)]
    whole = sum(ways)
    if not np.isfinite(whole):
        return [], []
    step = max(_STEP, whole / _MOST)
    times, configurations = [instants[0].time], [instants[0].q]
    for (a, b), way in zip(itertools.pairwise(instants), ways, strict=True):
        count = max(1, math.ceil(way / step))
        for share in (np.arange(1, count + 1) / count).tolist():
            times.append(a.time + share * (b.time - a.time))
            configurations.append(a.q + share * (b.q - a.q))
    return times, configurations
