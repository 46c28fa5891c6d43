"""Where a flat tool touches boxes, cylinders and balls in a plain plant: looked for as it runs."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable
from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.analysis.coordinates import about_itself
from taskspec.analysis.point_contacts import Ground, Mover, Patch
from taskspec.native.engine import Engine, available
from taskspec.native.kernel import kernel_ir, kernel_source, vector
from taskspec.program.bound import Wiring
from taskspec.program.world import frames
from taskspec.program.world.touch import WholeTool, farthest, solid_numbers
from taskspec.robot import RobotModel
from taskspec.shapes import Surface, overlap
from taskspec.shapes.solid import half_sizes
from taskspec.spec import Task

Vector = NDArray[np.float64]

#: Farther off than a tool comes in a period it does not matter how far [m].
_NEAR = 5e-3


class SolidContact:
    """The deepest point of a tool in a solid, as a period of control begins.

    Attributes:
        p: (3,) where the tip is in the solid's coordinates [m].
        axes: (9,) the tip's axes there, one after the other.
    """

    def __init__(self, tool: WholeTool, surface: Surface) -> None:
        self._tool, self._solid = tool, solid_numbers(surface)
        self.p, self.axes = np.zeros(3), np.eye(3).ravel()
        # Normal, the tool's point in its own axes and in the solid's, depth, lever.
        self._numbers = np.zeros(11)
        self._work = np.zeros(overlap.WORK)
        self._symbol: ca.SX | None = None

    def read(self, wiring: Wiring) -> None:
        """Has a function read what is found."""
        self._symbol = wiring.reads("solid", self._numbers)

    def look(self) -> None:
        """Looks where the tool touches now."""
        R = self.axes.reshape(3, 3).T
        tool, found = self._tool.numbers(self.p, R), self._numbers
        depth = _overlap()(tool, self._solid, self._work)
        n = self._work[:3]
        at = farthest(tool, -n)[1]
        found[:3], found[6:9] = n, at[:3]
        found[3:6] = R.T @ (at[:3] - self.p)
        found[9], found[10] = depth, at[3]

    def patch(self, tip: Mover, ground: Ground) -> Patch:
        """What was found, of a tool that has moved on a little."""
        found = self._symbol
        assert found is not None
        place = ground.place(tip.p + tip.R @ found[3:6])
        depth = found[9] - ca.dot(found[:3], place - found[6:9])
        return Patch(found[:3], found[3:6], depth, found[10])


def solid_contacts(task: Task, robot: RobotModel, loose: Iterable[str]) -> dict[str, SolidContact]:
    """Of the boxes, cylinders and balls of a task, by name; none of a tool that is a ball.

    Args:
        task: of the true world.
        robot: for the tool.
        loose: the loose bodies.
    """
    if not robot.tool.flat:
        return {}
    bodies = {*loose, *(name for name, shape in task.shapes.items() if shape.on is not None)}
    found = {}
    for name, shape in task.shapes.items():
        surface = about_itself(shape) if name in bodies else frames.surface(shape)
        if half_sizes(surface) is not None:
            found[name] = SolidContact(WholeTool(robot.tool), surface)
    return found


@cache
def _overlap() -> Callable[[Vector, Vector, Vector], float]:
    """`overlap` as machine code where there is any."""
    if not available():
        return lambda tool, solid, work: overlap.overlap(
            vector(tool), vector(solid), _NEAR, vector(work)
        )
    source = kernel_source(overlap)
    engine = Engine(lambda: [kernel_ir(overlap.overlap)], level=2, source=source)
    memory = (ctypes.c_void_p,) * 2
    code = engine.function("overlap", ctypes.c_double, *memory, ctypes.c_double, ctypes.c_void_p)
    return lambda tool, solid, work: float(
        code(tool.ctypes.data, solid.ctypes.data, _NEAR, work.ctypes.data)
    )
