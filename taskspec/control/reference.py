"""The references of a law at one instant, on the axes of its task state."""

from __future__ import annotations

from typing import TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass

Wrench = TypeVar("Wrench", ca.SX, NDArray[np.float64])


@dataclass(frozen=True, slots=True)
class Reference:
    """Motion and force references on the m task axes.

    Attributes:
        error: (m,) e = x_d - x [m, rad].
        velocity: (m,) x'_d in frame axes [m/s, rad/s], with the frame's own turning.
        acceleration: (m,) d/dt of `velocity` as components [m/s^2, rad/s^2].
        force: (m,) f_d in the theory's sign, by the environment on the tool [N, N m].
        force_integral: (m,) integral of f_d - f in the theory's sign [N s, N m s].
        released: (m,) what the last stage held on axes without a set point now, as it fades out, in
            the theory's sign [N, N m].
    """

    error: ca.SX
    velocity: ca.SX
    acceleration: ca.SX
    force: ca.SX
    force_integral: ca.SX
    released: ca.SX


def opposite(wrench: Wrench) -> Wrench:
    """The one change of sign between theory and file, of expressions and of arrays.

    The theory's f is what the environment exerts on the tool; task files, logs and guards speak of
    what the robot applies to the environment (docs/language/axes.md).
    """
    return -wrench
