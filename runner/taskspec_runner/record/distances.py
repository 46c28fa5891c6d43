"""The true distances of the tool from all objects of the world, at every logged tick."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.world import frames, kinematics
from taskspec.program.world.equations import equation_models
from taskspec.program.world.moving_base import moving_bases
from taskspec.robot import RobotModel
from taskspec.spec import Shape, Task

Vector = NDArray[np.float64]


class Distances:
    """Distance of the tool from every shape [m] and from every equation [m, rad], by name.

    A shape that moves is where the clock has it, a loose body where the log has it. From an
    equation it is r / |r_x|, to first order the distance from the constraint.
    """

    def __init__(self, robot: RobotModel, task: Task) -> None:
        n = robot.pin.nv
        p, R, clock = ca.SX.sym("p", 3), ca.SX.sym("R", 9), ca.SX.sym("clock")
        q = ca.SX.sym("q", n)
        bodies = [name for name, shape in task.shapes.items() if shape.free]
        poses = ca.SX.sym("poses", 7 * len(bodies))
        axes = ca.reshape(R, 3, 3)
        bases = moving_bases(task)
        found: dict[str, ca.SX] = {}
        for name, shape in task.shapes.items():
            place, turned = p, axes
            if shape.free:
                start = 7 * bodies.index(name)
                place, turned = _seen_from_body(shape, poses[start : start + 7], p, axes)
            elif shape.motion is not None:
                now = bases[name].at(clock)
                place, turned = now.place(p), now.A.T @ axes
            found[name] = kinematics.gap(robot, frames.surface(shape), place, turned)
        for name, model in equation_models(task).items():
            x = q if model.joints else p
            found[name] = model.terms(x, ca.SX.zeros(x.shape[0]), clock).distance
        self.names = tuple(found)
        distances = ca.vertcat(ca.SX(0, 1), *found.values())
        inputs = {"tip": p, "tip_rotation": R, "clock": clock, "q": q, "loose": poses}
        # Handing over what no distance depends on would take most of the time.
        used = {name: x for name, x in inputs.items() if ca.depends_on(distances, x)}
        self._inputs = tuple(used)
        self._function = ca.Function("distances", list(used.values()), [distances])

    def __call__(self, field: Callable[[str], Vector]) -> Mapping[str, Vector]:
        """Distances (ticks,) by object, from the bus's fields by name, (size, ticks) each."""
        if not self.names:
            return {}
        values = np.array(self._function(*(field(name) for name in self._inputs)))
        return dict(zip(self.names, values, strict=True))


def _seen_from_body(shape: Shape, pose: ca.SX, p: ca.SX, R: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The tool's pose if the loose body were where it is declared."""
    w, x, y, z = (pose[i] for i in range(3, 7))
    moved = ca.blockcat(
        [
            [1 - 2 * (y**2 + z**2), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x**2 + z**2), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x**2 + y**2)],
        ]
    )
    declared, origin = (ca.DM(value) for value in frames.pose(shape))
    back = declared @ moved.T
    return origin + back @ (p - pose[:3]), back @ R
