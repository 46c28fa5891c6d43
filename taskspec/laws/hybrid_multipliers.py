"""Hybrid control under holonomic constraints (section 4.3.2): motion and multipliers apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.control.command import Command
from taskspec.laws.gains import (
    BANDWIDTH,
    DAMPING_RATIO,
    FORCE_DAMPING,
    FORCE_INTEGRAL,
    FORCE_PROPORTIONAL,
    K_D,
    K_P,
)
from taskspec.laws.hybrid import on_mechanism
from taskspec.laws.law import ControlLaw, register

if TYPE_CHECKING:
    from taskspec.laws.case import Case


@register
class HybridMultipliers(ControlLaw):
    """PI on the multipliers, (4.104)-(4.106) and (4.117).

    lambda_c = lambda_d + K_lambda (lambda_d - lambda) + K_I int (lambda_d - lambda) dt

    Without a constraint the motion loops are alone. What the last stage held on what is now a
    motion axis is added to the wrench while it is released.
    """

    kind = "hybrid-multipliers"
    title = "PI control of constraint multipliers"
    equations = "(4.104)-(4.106), (4.117)"
    gains = (BANDWIDTH, DAMPING_RATIO, FORCE_PROPORTIONAL, FORCE_INTEGRAL, FORCE_DAMPING)
    derived = (K_P, K_D)
    mechanism_form = True
    force_loop = True
    follows = ("force.damping", "force.integral")
    multipliers = True
    selects = True
    axis_springs = False
    dual = "hybrid-velocity"

    def command(self, case: Case) -> Command:
        """(4.106) with K_lambda [1] and K_I [1/s] diagonal."""
        if case.free is not None:
            return on_mechanism(case)
        wanted, released = case.joint_motion(), case.applied(case.reference.released)
        on = case.constraints
        if on is None:
            return Command(wrench=released, joint_acceleration=wanted)
        proportional = on.diagonal(case.gains, "force.proportional")
        integral = on.diagonal(case.gains, "force.integral")
        damping = on.diagonal(case.gains, "force.damping")
        error = on.desired - on.measured
        command = on.desired + proportional * error + integral * on.integral
        return on.command(wanted + on.held, on.J.T @ command, damping, released)
