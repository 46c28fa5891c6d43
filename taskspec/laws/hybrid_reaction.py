"""Hybrid control under holonomic constraints (section 4.3.2): motion and reaction torque apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.control.command import Command
from taskspec.laws.gains import (
    BANDWIDTH,
    DAMPING_RATIO,
    FORCE_DAMPING,
    FORCE_PROPORTIONAL,
    K_D,
    K_P,
)
from taskspec.laws.hybrid import on_mechanism
from taskspec.laws.law import ControlLaw, register

if TYPE_CHECKING:
    from taskspec.laws.case import Case


@register
class HybridReaction(ControlLaw):
    """P on the reaction torque, (4.118)-(4.122).

    - J_phi^T lambda_d - T^-T E_1^T K_F E_1 T^T J_phi^T (lambda_d - lambda)

    Without a constraint the motion loops are alone. What the last stage held on what is now a
    motion axis is added to the wrench while it is released.
    """

    kind = "hybrid-reaction"
    title = "P control of the reaction torque"
    equations = "(4.118)-(4.122)"
    gains = (BANDWIDTH, DAMPING_RATIO, FORCE_PROPORTIONAL, FORCE_DAMPING)
    derived = (K_P, K_D)
    mechanism_form = True
    force_loop = True
    follows = ("force.damping",)
    multipliers = True
    selects = True
    axis_springs = False
    dual = "hybrid-velocity"

    def command(self, case: Case) -> Command:
        """(4.121) with K_F diagonal on the coordinates of q_1."""
        if case.free is not None:
            return on_mechanism(case)
        wanted, released = case.joint_motion(), case.applied(case.reference.released)
        on = case.constraints
        if on is None:
            return Command(wrench=released, joint_acceleration=wanted)
        proportional = on.diagonal(case.gains, "force.proportional")
        damping = on.diagonal(case.gains, "force.damping")
        error = on.desired - on.measured
        correction = on.from_first(proportional * (on.on_first @ error))
        reaction = on.J.T @ (on.desired + correction)
        return on.command(wanted + on.held, reaction, damping, released)
