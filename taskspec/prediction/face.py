"""A flat tool that does not lie flush: each point of its rim bears its share of the contact.

At rest the tool is displaced by e (6,) from its reference, where point i would be d_i deep. With
u_i = (n_i; l_i x n_i), the contact bears sum_i k_i max(0, d_i + u_i.e), and e minimises

    1/2 e^T K e - f_d.e + 1/2 sum_i k_i max(0, d_i - u_i.e)^2

over the axes that give way: those with a spring K, and those with a set point f_d instead of one.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.analysis.points import Touched
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec.laws.gains import BANDWIDTH
from taskspec.prediction.at_start import StageAtStart

Vector = NDArray[np.float64]

#: Points that are apart by less than this along the normal lie flush [m].
_FLUSH = 1e-6
#: Sets of points that bear until they stay the same; there are few points.
_ROUNDS = 60


@dataclass(frozen=True, slots=True)
class Face:
    """The rim of a flat tool over a contact, as a stage begins.

    Attributes:
        behind: (r,) how much farther from the surface each point is than the nearest [m].
        ways: (r, 6) rate at which each point comes nearer per rate of the stage's axes.
    """

    behind: Vector
    ways: Vector

    def bears(
        self, springs: Vector, loads: Vector, depth: float, stiffness: float
    ) -> tuple[Vector, float] | None:
        """What the robot applies at rest (6,) [N, N m], and how deep the deepest point is [m].

        None where the sets of bearing points go round in a circle.

        Args:
            springs: (6,) of the axes: infinite for those that give no way [N/m, N m/rad].
            loads: (6,) set points of axes without a spring [N, N m].
            depth: of the nearest point with the axes at their references [m].
            stiffness: of the contact [N/m].
        """
        each = stiffness / len(self.behind)
        soft = np.isfinite(springs)
        U, deep = self.ways[:, soft], depth - self.behind
        K, f = np.diag(springs[soft]), loads[soft]
        on = deep >= deep.max()
        for _ in range(_ROUNDS):
            A = K + each * U[on].T @ U[on]
            e = np.linalg.lstsq(A, f - each * U[on].T @ deep[on], rcond=None)[0]
            pushed = deep + U @ e
            now = pushed > 0
            if np.array_equal(now, on):
                depths = np.maximum(pushed, 0.0)
                return each * self.ways.T @ depths, float(depths.max())
            on = now if now.any() else pushed >= pushed.max()
        return None


def face(here: StageAtStart, contact: str) -> Face | None:
    """The rim of a stage's tool over a contact; None of a ball, and of a face that lies flush."""
    context = here.context
    tool, task = context.robot.tool, context.loaded.task
    if not tool.flat:
        return None
    surface = context.surfaces[contact]
    A, a = np.eye(3), np.zeros(3)
    if contact in context.moving_bases:
        A, a = context.moving_bases[contact].pose(0.0)
    gaps, ways = [], []
    touched = Touched(context, task, contact)
    for center, radius in zip(tool.centers, tool.radii, strict=True):
        lever = context.start_R @ center
        point = context.start_p + lever
        normal, _ = touched.normal_at(point, float(radius))
        arm = here.rotation.T @ (lever - here.stage.plan.lever)
        local = here.rotation.T @ normal
        ways.append(-np.concatenate([local, np.cross(arm, local)]))
        gaps.append(float(ca.evalf(surface.distance(ca.SX(ca.DM(A.T @ (point - a)))))) - radius)
    behind = np.array(gaps) - min(gaps)
    if behind.max() < _FLUSH:
        return None
    return Face(behind, np.array(ways))


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
