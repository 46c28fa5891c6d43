"""Links of the arm that run into objects: in the simulator only the tool's end touches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import RowFunction
from taskspec.program.context import Context
from taskspec.program.world.frames import surface
from taskspec.rules.finding import Finding, warning
from taskspec.rules.places import motion_of
from taskspec.shapes import BoundedSurface
from taskspec.text.units import show
from taskspec_runner.trial.moment import Moment
from taskspec_runner.trial.trial import Trial

Vector = NDArray[np.float64]

#: Between two configurations that are looked up no joint turns farther [rad, m].
_TURNED = 0.02
#: A link that is less far inside an object stands on it, as where an arm is mounted [m].
_INSIDE = 1e-3


class Surroundings:
    """The objects of a task that stand where they are, and the links that may run into them.

    Objects that move by themselves, are loose or ride on a mechanism are not among them. One
    without an end stands for a table or a wall of some size: links that are in it as the run
    starts, such as those that carry the arm through the height of its table, are beside it.

    Attributes:
        names: of these objects.
        left_out: the others, and why.
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

    def first(self, configurations: Vector) -> Iterator[tuple[int, str, str, float]]:
        """Of each object the row of (k, n) joint positions in which a link is first inside it.

        Yields:
            The row, the link, the object, and how far inside the link comes in all of them [m].
        """
        links = self._context.robot.links
        if not self.names or not len(links.radii):
            return
        twin = self._context.robot.twin()
        points = np.stack([links.at(twin, q) for q in configurations])
        found = self._distances(points.reshape(-1, 3))[0]
        gaps = found.reshape(*points.shape[:2], -1) - links.radii[:, np.newaxis]
        gaps = np.where(self._beside[links.link], np.inf, gaps)
        for i, name in enumerate(self.names):
            inside = (gaps[..., i] < -_INSIDE).any(axis=1)
            if not inside.any():
                continue
            row = int(np.argmax(inside))
            link = int(links.link[int(np.argmin(gaps[row, :, i]))])
            deepest = -float(gaps[:, links.link == link, i].min())
            yield row, links.names[link], name, deepest

    @cached_property
    def _beside(self) -> NDArray[np.bool_]:
        """(links, objects) what is in an endless object as the run starts."""
        robot = self._context.robot
        links = robot.links
        points = links.at(robot.twin(), self._context.start)
        inside = self._distances(points)[0] < links.radii[:, np.newaxis]
        found: NDArray[np.bool_] = np.zeros((len(links.names), len(self.names)), dtype=bool)
        np.logical_or.at(found, links.link, inside)
        surfaces = [self._context.surfaces[name] for name in self.names]
        return found & [not isinstance(each, BoundedSurface) for each in surfaces]

    @cached_property
    def _distances(self) -> RowFunction:
        x = ca.SX.sym("x", 3)
        found = [self._context.surfaces[name].distance(x) for name in self.names]
        return RowFunction(ca.Function("distances", [x], [ca.vertcat(*found)]))


def collisions(trial: Trial) -> Iterator[Finding]:
    """Where a link is first in each object, which is where the world of the trial has it."""
    context = trial.program.context
    shapes = trial.world.task.shapes.items()
    context = replace(context, surfaces={name: surface(shape) for name, shape in shapes})
    columns = [f"joint.{i + 1}.position" for i in range(context.robot.n)]
    if not len(trial.history):
        return
    q = np.stack([trial.history.columns[name] for name in columns], axis=1)
    rows = _apart(q)
    for at, link, thing, depth in Surroundings(context).first(q[rows]):
        row = int(rows[at])
        visit = next(v for v in trial.history.visits() if v.first <= row <= v.last)
        moment = Moment(trial, visit, row)
        what = "the tool's stem" if link == context.robot.tip_body else f"link {link!r}"
        yield warning(
            "TS428",
            f"in the trial, in stage {visit.stage!r} {moment.when}, {what} runs into "
            f"{thing!r}, and comes {show(depth, 'mm', 2)} into it: in a run only the tool's end "
            "touches, a robot does with all of itself",
            motion_of(moment.stage),
            "lead the arm round it, start in another posture, or move the object",
        )


def _apart(q: Vector) -> NDArray[np.int64]:
    """Rows of (k, n) joint positions, between any two of which no joint turns by `_TURNED`."""
    turned = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q, axis=0)).max(axis=1))])
    steps = np.floor(np.nan_to_num(turned) / _TURNED)
    return np.unique(np.searchsorted(steps, np.unique(steps)))
