"""Where the tool touches an object: with its spheres, or with its whole surface."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from taskspec.program.context import Context
from taskspec.program.world import frames
from taskspec.program.world.touch import Touch, whole_tool
from taskspec.spec import Task

Matrix = NDArray[np.float64]


class Touched:
    """The surface of an object where the tool touches it.

    Args:
        context: for the object's pose where it moves.
        task: whose object is the true one.
        name: of the object.
    """

    def __init__(self, context: Context, task: Task, name: str) -> None:
        self._shape = task.shapes[name]
        self._surface = frames.surface(self._shape)
        self._tool = whole_tool(context.robot.tool, self._surface)
        self._A, self._a = np.eye(3), np.zeros(3)
        if name in context.moving_bases:
            self._A, self._a = context.moving_bases[name].pose(0.0)

    @property
    def whole(self) -> bool:
        """Whether the tool touches it with its whole surface."""
        return self._tool is not None

    def patch(self, p: Matrix, R: Matrix) -> Touch:
        """How the whole tool meets it, at a pose (3,), (3, 3) of the tip, world axes."""
        assert self._tool is not None
        place, axes = self._A.T @ (p - self._a), self._A.T @ R
        return self._tool.touch(self._surface, place, axes).turned(self._A)

    def laid(self, p: Matrix, R: Matrix, turns: Matrix) -> Touch:
        """The same, where a face, an edge or a side that nearly lies flat does.

        Args:
            p, R: the pose.
            turns: (3, k) unit axes, across each other, about which the tool gives way.
        """
        assert self._tool is not None
        A = self._A
        place, axes = A.T @ (p - self._a), A.T @ R
        return self._tool.laid(self._surface, place, axes, A.T @ turns).turned(A)

    def normal_at(self, center: Matrix, radius: float) -> tuple[Matrix, Matrix]:
        """Outward normal (3,) at a sphere that touches, and its change (3, 3) [1/m]."""
        A = self._A
        local = A.T @ (center - self._a)
        normal, _, distance = frames.normal_at(self._shape, local)
        # The normal's change is that of the tool brought to the surface.
        touching = local - (distance - radius) * normal
        normal, bend, _ = frames.normal_at(self._shape, touching)
        return A @ normal, A @ bend @ A.T

    def off(self, center: Matrix, radius: float) -> tuple[Matrix, float, bool]:
        """Outward normal (3,) at a sphere, how far off that is [m], whether normals turn."""
        A = self._A
        local = A.T @ (center - self._a)
        normal, bend, distance = frames.normal_at(self._shape, local)
        return A @ normal, distance - radius, bool(bend.any())


def touching(context: Context, task: Task, names: Iterable[str]) -> Matrix | None:
    """(3,) where the tip is when the tool touches each of some objects, world axes [m].

    None where all of them are flat: their normals are the same however far off the tool is. On a
    curved one a frame that follows it, and the force that it returns, turn by 1/rho per metre with
    the distance rho from its centre: both have to be looked at from the same place.
    """
    tool, normals, gaps, turns = context.robot.tool, [], [], False
    for name in names:
        touched = Touched(context, task, name)
        if touched.whole:
            patch = touched.patch(context.start_p, context.start_R)
            normal, gap = patch.normal, -patch.depth
            bent = touched.off(context.start_p, 0.0)[2]
        else:
            spheres = zip(tool.centers, tool.radii, strict=True)
            here = [
                touched.off(context.start_p + context.start_R @ c, float(r)) for c, r in spheres
            ]
            normal, gap, bent = min(here, key=lambda each: each[1])
        normals.append(normal)
        gaps.append(gap)
        turns = turns or bent
    if not turns:
        return None
    way = np.linalg.lstsq(np.array(normals), -np.array(gaps), rcond=None)[0]
    return np.asarray(context.start_p + way)


def skew(v: Matrix) -> Matrix:
    """S(v) (3, 3) with S(v) w = v x w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
