"""What a law sees: the arm and the contact, resolved in the task frame's axes."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from taskspec.control import linear
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis

#: Characteristic length [m]: where distances and angles are compared, 1 rad counts as this
#: distance.
ARM_LENGTH = 0.3


@dataclass(frozen=True, slots=True)
class TaskState:
    """The arm at the control point, on the m axes of the task frame that the arm can move.

    Attributes:
        axes: names of the m rows.
        H_factor: (n, n) Cholesky factor of the joint inertia H.
        J: (m, n) Jacobian, rows in task-frame axes.
        drift: (m,) J' q', with the turning of the frame itself.
        velocity: (m,) J q' [m/s, rad/s].
        mobility: (m, m) J H^-1 J^T = Lambda^-1.
        f: (m,) measured wrench, exerted by the environment on the tool [N, N m].
    """

    axes: tuple[Axis, ...]
    H_factor: ca.SX
    J: ca.SX
    drift: ca.SX
    velocity: ca.SX
    mobility: ca.SX
    f: ca.SX

    def rows(self, names: Sequence[str]) -> list[int]:
        """Row numbers of the named axes."""
        return [self.axes.index(name) for name in names]


def task_state(
    *,
    axes: tuple[Axis, ...],
    H: ca.SX,
    J: ca.SX,
    drift: ca.SX,
    twist: ca.SX,
    wrench: ca.SX,
    R: ca.SX,
    R_rate: ca.SX,
) -> TaskState:
    """Resolves world quantities at the control point in a task frame that may itself turn.

    Args:
        axes: the rows to keep, in the order of the axes.
        H: (n, n) joint inertia.
        J: (6, n) Jacobian, drift: (6,) J' q', twist: (6,) J q', wrench: (6,) by the environment;
            all at the control point, in world axes.
        R: (3, 3) task frame in the world; R_rate: (3, 3) its time derivative.
    """
    rows = [AXES.index(a) for a in axes]
    both = ca.diagcat(R.T, R.T)
    turning = ca.diagcat(R_rate.T, R_rate.T)
    J_task = (both @ J)[rows, :]
    L = linear.cholesky(H)
    Y = linear.forward(L, J_task.T)
    return TaskState(
        axes=axes,
        H_factor=L,
        J=J_task,
        drift=(both @ drift + turning @ twist)[rows],
        velocity=(both @ twist)[rows],
        mobility=Y.T @ Y,
        f=(both @ wrench)[rows],
    )
