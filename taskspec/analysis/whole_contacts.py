"""Where a tool touches solids and cuts in a plain plant: looked for before each of its steps."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable
from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.analysis.coordinates import about_itself
from taskspec.analysis.point_contacts import Patch
from taskspec.native.engine import Engine, available
from taskspec.native.kernel import kernel_ir, kernel_source, vector
from taskspec.program.bound import Wiring
from taskspec.program.world import frames
from taskspec.program.world.touch import WholeTool
from taskspec.robot import RobotModel
from taskspec.shapes import Surface, overlap, patches
from taskspec.shapes.patches import PATCH, POINTS
from taskspec.shapes.solid import half_sizes, kind_and_sizes
from taskspec.spec import Task

Vector = NDArray[np.float64]

#: Patches that a tool has at most with a cut: four edges or sides, and its end on the ground.
_MOST = 5
#: Of a patch: normal, its point from the tip in the tool's axes, depth, lever, share.
_NUMBERS = 9


class ToolPatches:
    """The patches of a tool and a shape as a step begins: those that the simulator would make.

    Attributes:
        p: (3,) where the tip is in the shape's coordinates [m].
        axes: (9,) the tip's axes there, one after the other.
    """

    def __init__(self, tool: WholeTool, surface: Surface) -> None:
        self._tool = tool
        self.p, self.axes = np.zeros(3), np.eye(3).ravel()
        kind, sizes = kind_and_sizes(surface)
        self._shape, self._work = np.zeros(7), np.zeros(patches.WORK)
        self._shape[: 1 + len(sizes)] = kind, *sizes
        # Of the surface's own axes in the coordinates of what carries it.
        self._origin, self._rotation = np.array(surface.origin), np.array(surface.rotation)
        self._found = np.zeros((_MOST if surface.cut() is not None else 1, _NUMBERS))
        self._symbols: ca.SX | None = None

    def read(self, wiring: Wiring) -> None:
        """Has a function read what is found."""
        flat = self._found.reshape(-1)
        self._symbols = ca.reshape(wiring.reads("touch", flat), _NUMBERS, len(self._found)).T

    def look(self) -> None:
        """Looks where the tool touches now; what touches nothing has no share of the stiffness."""
        A = self._rotation
        R = A.T @ self.axes.reshape(3, 3).T
        p = A.T @ (self.p - self._origin)
        count = _find()(self._tool.numbers(p, R), self._shape, self._work)
        made = self._work[POINTS : POINTS + PATCH * count].reshape(count, PATCH)
        self._found[count:, 6:] = 0.0
        found = self._found[:count]
        found[:, :3], found[:, 3:6] = made[:, 3:6] @ A.T, (made[:, :3] - p) @ R
        found[:, 6], found[:, 7], found[:, 8] = made[:, 6], made[:, 8], made[:, 7]

    def patches(self) -> tuple[Patch, ...]:
        """What was found."""
        assert self._symbols is not None
        rows = [self._symbols[i, :].T for i in range(len(self._found))]
        return tuple(Patch(row[:3], row[3:6], row[6], row[7], row[8]) for row in rows)


def whole_contacts(task: Task, robot: RobotModel, loose: Iterable[str]) -> dict[str, ToolPatches]:
    """Of the shapes of a task that a tool touches whole, by name; planes have a closed form.

    A tool that is a ball touches cuts alone so, which it may touch on two sides at once.

    Args:
        task: of the true world.
        robot: for the tool.
        loose: the loose bodies.
    """
    bodies = {*loose, *(name for name, shape in task.shapes.items() if shape.on is not None)}
    tool, found = WholeTool(robot.tool), dict[str, ToolPatches]()
    for name, shape in task.shapes.items():
        surface = about_itself(shape) if name in bodies else frames.surface(shape)
        flat = robot.tool.flat and half_sizes(surface) is not None
        if flat or surface.cut() is not None:
            found[name] = ToolPatches(tool, surface)
    return found


@cache
def _find() -> Callable[[Vector, Vector, Vector], int]:
    """`patches.find` as machine code where there is any."""
    if not available():
        return lambda tool, shape, work: patches.find(vector(tool), vector(shape), vector(work))
    source = kernel_source(patches, overlap)
    engine = Engine(lambda: [kernel_ir(patches.find)], level=2, source=source)
    code = engine.function("find", ctypes.c_int64, *(ctypes.c_void_p,) * 3)
    return lambda tool, shape, work: int(
        code(tool.ctypes.data, shape.ctypes.data, work.ctypes.data)
    )
