"""How the axes of a stage come to rest, from the poles of its sampled loop."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from taskspec.analysis.loop import Mode
from taskspec.analysis.stage import Analysed
from taskspec.control.state import AXES
from taskspec.prediction.types import Settling

#: An axis takes part in a mode if it moves with at least this share of the energy of the axis that
#: moves most: axes with equal poles have modes in common, which may lie anywhere among them.
_TAKES_PART = 0.15
_NULL_SPACE = "null space"


def settling(seen: Analysed, modes: Sequence[Mode]) -> dict[str, Settling]:
    """The slowest mode in which each axis, each equation and the null space takes part.

    Args:
        seen: the stage. modes: its own, the least stable first.
    """
    found: dict[str, Settling] = {}
    for mode in modes:
        for axis in _moving(seen, mode):
            found.setdefault(axis, _of(mode))
    order = [*seen.stage.axes, *seen.stage.active, _NULL_SPACE]
    return {axis: found[axis] for axis in order if axis in found}


def _moving(seen: Analysed, mode: Mode) -> Iterator[str]:
    """The axes that take part in a mode, or what else it is a mode of."""
    most = seen.axis(mode)
    yield most
    if most not in seen.stage.axes:
        return
    J = np.kron(np.eye(2), seen.rotation.T) @ seen.context.start_jacobian
    rows = J[[AXES.index(a) for a in seen.stage.axes]]
    mobility = np.diag(rows @ np.linalg.solve(seen.context.start_inertia, rows.T))
    energy = np.abs(rows @ mode.shape) ** 2 / mobility
    for axis, part in zip(seen.stage.axes, energy, strict=True):
        if axis != most and part > _TAKES_PART * energy.max():
            yield axis


def _of(mode: Mode) -> Settling:
    rate = float(-mode.s.real)
    return Settling(1 / rate if rate > 0 else math.inf, mode.frequency, float(mode.damping_ratio))
