"""Goals of a redundant arm in the null space of its task.

Every goal gives a pull (n,) [rad, m]: how far the arm would be from a posture that pulls as hard.
`acceleration` makes of their sum what resolution sends through the dynamically consistent projector
I - J^bar J, behind which no pull disturbs the task.

That projector weights with H, and may turn a gradient g round: z^T H g and z^T g can differ in sign
for a null vector z. So the pulls of joint limits and manipulability are first laid into the null
space orthogonally (`along_null_space`), where the projector leaves them as they are.

Joints count in radians and the rows of J in metres: a slide's `ARM_LENGTH` is one radian, a row of
rotation is `ARM_LENGTH` metres a radian.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control import linear
from taskspec.control.state import ARM_LENGTH
from taskspec.geometry.axis import AXES, Axis

Vector = NDArray[np.float64]

#: The goals pull at this frequency [Hz], critically damped about a posture.
FREQUENCY = 2.0
#: A joint is drawn away from a limit within this part of its range,
LIMIT_SHARE = 0.2
#: but not farther away than this [rad].
LIMIT_WIDTH = 0.5
#: Pull [rad] of manipulability where ln w rises by 1/GAIN in one radian,
GAIN = 0.5
#: and the most that it gets to [rad].
MOST = 0.25
#: Singular values of J that are well below this do not count in w [m/rad],
LEAST = 1e-3
#: nor those below this among the directions that the task takes from the null space [m/rad].
NONE = 1e-6


def acceleration(pull: ca.SX, v: ca.SX) -> ca.SX:
    """q''_p (n,) of the summed pulls (n,) at joint velocities v (n,), damped once.

    q''_p = w^2 pull - 2 w q' with w = 2 pi `FREQUENCY`.
    """
    w = 2 * ca.pi * FREQUENCY
    return w**2 * pull - 2 * w * v


def velocity(pull: ca.SX) -> ca.SX:
    """q'_p (n,) of the summed pulls (n,), w pull with w = 2 pi `FREQUENCY`."""
    return 2 * ca.pi * FREQUENCY * pull


def posture(q: ca.SX, target: ca.SX) -> ca.SX:
    """Pull (n,) towards the posture `target` (n,)."""
    return target - q


def joint_limits(q: ca.SX, lower: Vector, upper: Vector, J_task: ca.SX, units: Vector) -> ca.SX:
    """Pull (n,) along the null space away from joint limits; zero where none is near.

    Args:
        q: (n,) joint positions.
        lower, upper: (n,) their limits [rad, m], infinite for none.
        J_task: (m, n) Jacobian of the task, scaled.
        units: (n,) of `joint_units`.
    """
    return units * along_null_space(repulsion(q, lower, upper, units) / units, J_task)


def repulsion(q: ca.SX, lower: Vector, upper: Vector, units: Vector) -> ca.SX:
    """Pull (n,) of each joint away from its limits, whatever the task.

    Joint i at distance d from a limit has the potential w^2 D^2 s^3 / 3 with s = max(0, 1 - d / D)
    and D its width, twice differentiable. The pull is D s^2: D at the limit, where the stiffness is
    2 w^2 and the damping ratio 0.7.
    """
    pull = []
    for i, D in enumerate(widths(lower, upper, units)):
        if D == 0:
            pull.append(ca.SX(0))
            continue
        low, high = (ca.fmax(0, 1 - d / D) for d in (q[i] - lower[i], upper[i] - q[i]))
        pull.append(D * (low**2 - high**2))
    return ca.vertcat(*pull)


def widths(lower: Vector, upper: Vector, units: Vector) -> Vector:
    """(n,) distance [rad, m] from a limit at which a joint begins to be drawn away from it.

    0 where it has no limits.
    """
    bounded = np.isfinite(lower) & np.isfinite(upper)
    share = LIMIT_SHARE * (np.where(bounded, upper, 0.0) - np.where(bounded, lower, 0.0))
    return np.asarray(np.minimum(share, LIMIT_WIDTH * units))


def manipulability(J: ca.SX, axes: Sequence[Axis], J_task: ca.SX, units: Vector) -> ca.SX:
    """Pull (n,) along the null space in which w = sqrt(det(J J^T)) rises.

    With g = P grad ln w the pull is GAIN^2 g, bent so that it stays below MOST.

    Args:
        J: (6, n) Jacobian of the tip, world axes.
        axes: its rows that the arm can move.
        J_task: (m, n) Jacobian of the task, scaled.
        units: (n,) of `joint_units`.
    """
    pull = GAIN**2 * along_null_space(units * log_gradient(J, axes, units), J_task)
    return units * pull / ca.sqrt(1 + ca.sumsqr(pull) / MOST**2)


def log_gradient(J: ca.SX, axes: Sequence[Axis], units: Vector) -> ca.SX:
    """Gradient (n,) [1/rad, 1/m] of ln w, w^2 = det(J_s J_s^T + LEAST^2 I), J_s = S J U.

    S scales the rows and U the joints. d/dq_j ln w = tr(J_s^T A^-1 S (dJ/dq_j) U), A the matrix
    whose determinant it is. The columns (v_i; w_i) of a serial arm's J move with

        dv_i/dq_j = w_min(i,j) x v_max(i,j),    dw_i/dq_j = w_j x w_i for j < i, else 0:

    a joint before i carries the rest of the arm round with it; one behind i moves the tip on the
    lever arm of i. Slides have w = 0 and need no formula of their own. With F = S A^-1 J_s U, of
    columns (a_i; b_i), the trace is the sum of all elements of F times those of dJ/dq_j, or

        w_j . sum_{i >= j} (v_i x a_i + w_i x b_i) + v_j . sum_{i < j} a_i x w_i.

    Args:
        J: (6, n) world axes, joints in their order from the base.
        axes: rows that count.
        units: (n,) of `joint_units`.
    """
    rows = [AXES.index(a) for a in axes]
    n = J.shape[1]
    scaled = scale(J[rows, :], axes, units)
    weighted = linear.solve(_factor(scaled, LEAST), scaled)
    F = ca.SX.zeros(6, n)
    F[rows, :] = scale(weighted, axes, units)
    columns = [(J[:3, i], J[3:, i], F[:3, i], F[3:, i]) for i in range(n)]
    behind = list(accumulate(ca.cross(v, a) + ca.cross(w, b) for v, w, a, b in reversed(columns)))
    before = list(accumulate((ca.cross(a, w) for _, w, a, _ in columns), initial=ca.SX.zeros(3)))
    gradient = [
        ca.dot(w, behind[n - 1 - j]) + ca.dot(v, before[j])
        for j, (v, w, _, _) in enumerate(columns)
    ]
    return ca.vertcat(*gradient)


def along_null_space(g: ca.SX, J: ca.SX) -> ca.SX:
    """P g (n,) with P = I - J^T (J J^T + NONE^2 I)^-1 J, for J (m, n) and g scaled."""
    return g - J.T @ linear.solve(_factor(J, NONE), J @ g)


def scale(J: ca.SX, axes: Sequence[Axis], units: Vector) -> ca.SX:
    """J (m, n) with its rows `axes` in metres and its joints in radians [m/rad]."""
    rows = [ARM_LENGTH if a.is_rotation else 1.0 for a in axes]
    return ca.diag(ca.DM(rows)) @ J @ ca.diag(ca.DM(units))


def joint_units(turns: Sequence[bool]) -> Vector:
    """(n,) what counts as one radian of each joint: 1 rad of a hinge, `ARM_LENGTH` of a slide."""
    return np.array([1.0 if hinge else ARM_LENGTH for hinge in turns])


def _factor(J: ca.SX, least: float) -> ca.SX:
    return linear.cholesky(J @ J.T + least**2 * ca.SX.eye(J.shape[0]))
