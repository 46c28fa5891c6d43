"""A flat tool that does not lie flush: where springs and contact have it come to rest.

At rest the tool is displaced by e (6,) from its reference, where it is D(0) deep; with its whole
surface it is D(e) deep then, and the contact's energy is k D^2/2. e minimises

    1/2 e^T K e - f_d.e + 1/2 k max(0, D(e))^2

over the axes that give way: those with a spring K, and those with a set point f_d instead of one.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec.laws.gains import BANDWIDTH
from taskspec.prediction.at_start import StageAtStart
from taskspec.stability.points import Touched, skew

Vector = NDArray[np.float64]

#: A tool that leans by less than this lies flush: it rests on the middle of its face [rad].
_FLUSH = 1e-5
#: Steps of Newton's method, and halvings of each.
_STEPS, _HALVINGS = 100, 40
#: Of the energy's size, what a step has to gain.
_GAIN = 1e-14


@dataclass(frozen=True, slots=True)
class Face:
    """A flat tool over a contact, as a stage begins.

    Attributes:
        touched: the object.
        p, R: (3,), (3, 3) pose of the tip.
        rotation: (3, 3) of the stage's axes.
        lever: (3,) from the tip to the control point, world axes [m].
    """

    touched: Touched
    p: Vector
    R: Vector
    rotation: Vector
    lever: Vector

    def bears(
        self, springs: Vector, loads: Vector, depth: float, stiffness: float
    ) -> tuple[Vector, float] | None:
        """What the robot applies at rest (6,) [N, N m], and how deep the tool is [m].

        None where the search for it does not end.

        Args:
            springs: (6,) of the axes: infinite for those that give no way [N/m, N m/rad].
            loads: (6,) set points of axes without a spring [N, N m].
            depth: of the tool with the axes at their references [m].
            stiffness: of the contact [N/m].
        """
        soft = np.flatnonzero(np.isfinite(springs))
        K, f = np.diag(springs[soft]), loads[soft]
        begun = self._at(np.zeros(6))[0]

        def energy(e: Vector) -> tuple[float, Vector, Vector, float]:
            whole = np.zeros(6)
            whole[soft] = e
            found, way, bend = self._at(whole)
            deep = max(found - begun + depth, 0.0)
            value = 0.5 * e @ K @ e - f @ e + 0.5 * stiffness * deep**2
            slope = K @ e - f + stiffness * deep * way[soft]
            curve = bend[np.ix_(soft, soft)]
            inside = float(deep > 0)
            H = K + stiffness * (inside * np.outer(way[soft], way[soft]) + deep * curve)
            return float(value), slope, H, deep

        e = np.zeros(len(soft))
        value, slope, H, deep = energy(e)
        for _ in range(_STEPS):
            sizes, V = np.linalg.eigh(0.5 * (H + H.T))
            # Ways that neither a spring nor the contact holds are not taken.
            held = np.abs(sizes) > 1e-9 * max(float(np.abs(sizes).max(initial=0.0)), 1e-12)
            step = -V[:, held] @ ((V.T @ slope)[held] / np.abs(sizes[held]))
            gain = -float(slope @ step)
            if gain <= _GAIN * max(abs(value), 1e-9):
                whole = np.zeros(6)
                whole[soft] = e
                return stiffness * deep * self._at(whole)[1], deep
            for half in range(_HALVINGS):
                tried = energy(e + 0.5**half * step)
                if tried[0] < value:
                    e = e + 0.5**half * step
                    value, slope, H, deep = tried
                    break
            else:
                whole = np.zeros(6)
                whole[soft] = e
                return stiffness * deep * self._at(whole)[1], deep
        return None

    def _at(self, e: Vector) -> tuple[float, Vector, Vector]:
        """Depth, its rate (6,) and second derivative (6, 6) at a displacement of the axes."""
        w = self.rotation @ e[3:]
        turn = pin.exp3(w)
        lever = turn @ self.lever
        p = self.p + self.lever + self.rotation @ e[:3] - lever
        patch = self.touched.patch(p, turn @ self.R)
        # A rate of e as a twist of the tip.
        T = np.zeros((6, 6))
        T[:3, :3] = self.rotation
        T[3:, 3:] = pin.Jexp3(-w) @ self.rotation
        T[:3, 3:] = skew(lever) @ T[3:, 3:]
        return patch.depth, T.T @ patch.way, T.T @ patch.bending() @ T


def face(here: StageAtStart, contact: str) -> Face | None:
    """A stage's flat tool over a contact; None of a ball, and of a face that lies flush."""
    context = here.context
    tool, task = context.robot.tool, context.loaded.task
    if not tool.flat:
        return None
    touched = Touched(context, task, contact)
    if not touched.whole:
        return None
    patch = touched.patch(context.start_p, context.start_R)
    if np.linalg.norm(np.cross(context.start_R[:, 2], patch.normal)) < _FLUSH:
        return None
    plan = here.stage.plan
    return Face(touched, context.start_p, context.start_R, here.rotation, plan.kinematics.lever)


def springs_and_loads(here: StageAtStart, forces: dict[int, float]) -> tuple[Vector, Vector]:
    """(6,) springs of a stage's axes, infinite where they are stiff, and (6,) its set points.

    Args:
        here: the stage.
        forces: set point by row of the axes under force control [N, N m].
    """
    plan = here.stage.plan
    springs, loads = np.full(6, np.inf), np.zeros(6)
    given = plan.gains.get("stiffness", {})
    stiff = BANDWIDTH.name in plan.gains
    for axis in plan.axes:
        row = AXES.index(axis)
        if row in forces:
            springs[row], loads[row] = 0.0, forces[row]
        elif axis in given and not (stiff and not plan.plans[axis].soft):
            springs[row] = given[axis].value
    return springs, loads
