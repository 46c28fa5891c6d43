"""The function that compares the coordinates that constraints may decide, (4.80)."""

from __future__ import annotations

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.program.stages.commanded import Commanded

#: Coordinates are chosen again when an exchange would make their minor so many times as large. As
#: many times is an error of the reference along a normal larger in those that are kept.
WORN = 1.5


@dataclass(frozen=True, slots=True)
class Choice:
    """Choice of the coordinates that the constraints decide.

    Attributes:
        look: the tick's inputs -> J_phi on the candidates (m, c), weighted by how readily each
            yields, what the motion loops command (n,), and what of that keeps the constraints
            (n,): q'', or q' under a law that commands velocities.
        least: conditioning below which they are chosen again.
    """

    look: ca.Function
    least: float


def candidates(arguments: list[ca.SX], commanded: Commanded) -> Choice | None:
    """The choice of a stage under a law with multipliers; None where nothing constrains it."""
    control, chosen = commanded.case.constraints, commanded.chosen
    if control is None or chosen is None:
        return None
    wanted, kept = commanded.command.motion, commanded.command.joint_velocity
    if wanted is None or kept is None:
        wanted = commanded.case.joint_motion()
        kept = control.kept(wanted + control.held)
    weighted = chosen.J @ chosen.candidates @ ca.diag(ca.DM(chosen.weights))
    results = [ca.densify(result) for result in (weighted, wanted, kept)]
    return Choice(
        look=ca.Function("look", arguments, results),
        least=1 / WORN,
    )
