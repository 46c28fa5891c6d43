"""Mechanisms of a plain plant: one coordinate each, with friction, stops, detent and what rides."""

from __future__ import annotations

import casadi as ca
import numpy as np

from taskspec.analysis.point_contacts import Ground, Mover
from taskspec.deferred_methods import dataclass
from taskspec.geometry.rotation import exp
from taskspec.program.world import frames
from taskspec.program.world.mechanisms import MechanismModel, mechanism_models
from taskspec.program.world.stiffness import mobility_of
from taskspec.shapes import SHAPES, Surface
from taskspec.spec import Mechanism, Shape, Task

#: Dry friction of a mechanism takes away this share of a slip in one step, a stop turns a motion
#: back within so many steps, overdamped: as the simulator has them.
_SETTLING, _STOP_STEPS, _STOP_DAMPING = 0.5, 3.0, 2.0
_IMPEDANCE = 0.99


@dataclass(frozen=True, slots=True)
class Coordinate:
    """The coordinate of a mechanism, whose state (2,) is where it is and its rate.

    Attributes:
        declared: the mechanism as the file has it.
        model: its geometry.
        row: its place among the plant's coordinates.
    """

    declared: Mechanism
    model: MechanismModel
    row: int

    def weigh(self, H: ca.SX, on: ca.SX, state: ca.SX, h: float) -> None:
        """Adds inertia and damping to H (c, c), and forces to (c,), for a step of h [s]."""
        i, damping = self.row, self.declared.damping
        H[i, i] = self.declared.coordinate_inertia + h * damping
        on[i] = -damping * state[1] + self._detent(state[0])

    def held_back(self, a: ca.SX, state: ca.SX, column: ca.SX, h: float) -> ca.SX:
        """Accelerations (c,) under its dry friction and its stops, of those without.

        Args:
            a: (c,) without them.
            state: its own.
            column: (c,) of the inverse inertia.
            h: a step [s].
        """
        i = self.row
        a = a + column * self._rubs(state, a[i], column[i], h)
        return a + column * self._stops(state, a[i], column[i], h)

    def moved(self, state: ca.SX, a: ca.SX, h: float) -> ca.SX:
        """(2,) its state a step of h [s] later, with accelerations (c,)."""
        rate = state[1] + h * a[self.row]
        return ca.vertcat(state[0] + h * rate, rate)

    def at(self, s: ca.SX, point: np.ndarray) -> tuple[ca.SX, ca.SX]:
        """(3,) where a world point at coordinate 0 is at s, and (3, 3) how far that has turned."""
        axis = ca.DM(self.model.rotation[:, 2])
        if not self.model.angular:
            return ca.DM(point) + s * axis, ca.SX.eye(3)
        turned, origin = exp(s * axis), ca.DM(self.model.origin)
        return origin + turned @ (ca.DM(point) - origin) + self.model.lead * s * axis, turned

    def ways(self, point: ca.SX) -> tuple[ca.SX, ca.SX]:
        """(3,), (3,) how a world point that goes with it moves and turns per its rate."""
        axis = ca.DM(self.model.rotation[:, 2])
        if not self.model.angular:
            return ca.SX(axis), ca.SX.zeros(3)
        lever = point - ca.DM(self.model.origin)
        return ca.cross(axis, lever) + self.model.lead * axis, ca.SX(axis)

    def mover(self, state: ca.SX, shape: Shape, c: int) -> Mover:
        """A shape that rides on it, of c coordinates."""
        R, origin = frames.pose(shape)
        p, turned = self.at(state[0], origin)
        way = ca.vertcat(*self.ways(p))
        J = ca.SX(6, c)
        if c:
            J[:, self.row] = way
        return Mover(p, turned @ ca.DM(R), way * state[1], J, mobility_of(shape))

    def ground(self, state: ca.SX, shape: Shape) -> Ground:
        """The surface of a shape that rides on it, where that is."""
        return Ground(about_itself(shape), body=self.mover(state, shape, 0))

    def _detent(self, place: ca.SX) -> ca.SX:
        detent = self.declared.detent
        if detent is None:
            return ca.SX(0)
        away = (place - detent.at) / detent.width
        return ca.if_else(ca.fabs(away) < 1, detent.force * ca.sin(np.pi * away), 0)

    def _rubs(self, state: ca.SX, a: ca.SX, mobility: ca.SX, h: float) -> ca.SX:
        """Dry friction [N m, N]."""
        c = self.declared.friction
        if c == 0:
            return ca.SX(0)
        wanted = (-_SETTLING / h * state[1] - a) / mobility
        return ca.fmin(ca.fmax(wanted, -c), c)

    def _stops(self, state: ca.SX, a: ca.SX, mobility: ca.SX, h: float) -> ca.SX:
        """What its stops exert [N m, N]."""
        if self.declared.stop is None:
            return ca.SX(0)
        low, high = self.declared.stop
        time, d = _STOP_STEPS * h, _IMPEDANCE
        b, k = 2 / (d * time), 1 / (d * time * _STOP_DAMPING) ** 2
        total = ca.SX(0)
        for sign, end in ((1.0, low), (-1.0, high)):
            if not np.isfinite(end):
                continue
            room = sign * (state[0] - end)
            wanted = -b * sign * state[1] - k * room
            push = ca.fmax(d * (wanted - sign * a) / mobility, 0)
            total += ca.if_else(room < 0, sign * push, 0)
        return total


def about_itself(shape: Shape) -> Surface:
    """The surface of a shape in its own axes."""
    return SHAPES[shape.shape](np.zeros(3), np.eye(3), **shape.sizes)


def coordinates(task: Task, held: str, first: int) -> dict[str, Coordinate]:
    """The mechanisms that a plain plant has: what is held first, then what carries shapes.

    Args:
        task: of the world.
        held: the mechanism that is held; empty for none.
        first: row of the first of them.
    """
    carry = {shape.on: None for shape in task.shapes.values() if shape.on is not None}
    names = [name for name in {held: None, **carry} if name]
    models, declared = mechanism_models(task), task.mechanisms
    return {
        name: Coordinate(declared[name], models[name], first + i) for i, name in enumerate(names)
    }
