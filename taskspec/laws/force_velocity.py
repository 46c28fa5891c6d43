"""Force control over a velocity interface: proportional-integral, beside a motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from taskspec.control.command import Command
from taskspec.laws import design
from taskspec.laws.gains import (
    BANDWIDTH,
    FORCE_DAMPING,
    FORCE_INTEGRAL,
    FORCE_PROPORTIONAL,
    K_V,
    AxisDesign,
    Gain,
)
from taskspec.laws.law import ControlLaw, register

if TYPE_CHECKING:
    from taskspec.laws.case import Case


@register
class ForceVelocity(ControlLaw):
    """One loop for each axis, which commands its velocity.

    Motion axes:  x' = x'_d + w e, w = 2 pi bandwidth.
    Force axes:   x' = x'_d + (p (f_d - f) + i int (f_d - f) dt) / d, as the robot applies forces.

    A velocity integrates the force on a spring by itself, so that i only takes off what a surface
    that moves, or a servo that gives way, leaves.
    """

    kind = "force-velocity"
    title = "force control by velocity"
    equations = "x' = (p (f_d - f) + i int (f_d - f) dt) / d"
    gains = (BANDWIDTH, FORCE_PROPORTIONAL, FORCE_INTEGRAL, FORCE_DAMPING)
    derived = (K_V,)
    commands = "velocity"
    dual = "hybrid"
    following: ClassVar[Mapping[str, Mapping[str, float]]] = {
        "force.damping": {"force.integral": -1}
    }
    force_loop = True
    follows = ("force.damping", "force.integral")
    selects = True
    axis_springs = False

    def design(self, axis: AxisDesign) -> dict[str, Gain]:
        """p, i and d of a force axis; the bandwidth of others."""
        return design.velocities(self, axis)

    def command(self, case: Case) -> Command:
        """The velocity of each axis."""
        state, reference = case.state, case.reference
        velocity = reference.velocity + case.diagonal("K_V") * reference.error
        for axis in case.force:
            i = state.axes.index(axis)
            error = case.applied(reference.force[i] - state.f[i])
            push = case.gain("force.proportional", axis) * error
            if "force.integral" in case.gains:
                integral = case.applied(reference.force_integral[i])
                push += case.gain("force.integral", axis) * integral
            velocity[i] = reference.velocity[i] + push / case.gain("force.damping", axis)
        return Command(wrench=0 * state.f, velocity=velocity)
