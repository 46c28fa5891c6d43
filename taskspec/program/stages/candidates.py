"""The function that looks at the coordinates that constraints may decide, (4.80)."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.stages.commanded import Commanded

#: Coordinates are chosen again when an exchange would make their minor so many times as large. As
#: many times is an error of the reference along a normal felt by those that are kept.
WORN = 1.5


@dataclass(frozen=True, slots=True)
class Choice:
    """How the coordinates that the constraints decide are chosen.

    Attributes:
        look: the tick's inputs -> J_phi on the candidates (m, c), q'' that the motion loops ask
            for (n,), and q'' that keeps the constraints (n,).
        weights: (c,) how readily each candidate gives way.
        least: conditioning below which they are chosen again.
    """

    look: ca.Function
    weights: NDArray[np.float64]
    least: float


def candidates(arguments: list[ca.SX], commanded: Commanded) -> Choice | None:
    """The choice of a stage under a law with multipliers; None where nothing constrains it."""
    control, chosen = commanded.case.constraints, commanded.chosen
    if control is None or chosen is None:
        return None
    wanted = commanded.case.joint_motion()
    kept = control.kept(wanted + control.held)
    return Choice(
        look=ca.Function(
            "look", arguments, [ca.densify(e) for e in (chosen.J @ chosen.candidates, wanted, kept)]
        ),
        weights=chosen.weights,
        least=1 / WORN,
    )
