"""A force where no force loop is: it displaces the reference of a spring."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.laws.coupled import stretched
from taskspec.laws.gains import pairs_of, value_of
from taskspec.modes.mode import (
    AxisMode,
    Blending,
    HandOver,
    OwnReference,
    ReferenceInputs,
    StageStart,
    move_speed,
)
from taskspec.motion import blend

if TYPE_CHECKING:
    from taskspec.geometry.axis import Axis


@dataclass(frozen=True, slots=True)
class OpenLoop(AxisMode):
    """A force under a law without a force loop: it displaces the reference of a spring."""

    name = "open-loop"

    def reference(self, at: ReferenceInputs) -> OwnReference:
        """r = r_0 + f (1/k_m + 1/k_e): a displacement that stands for a force is no motion.

        Of springs that are coupled, K_m^-1 f takes the place of f/k_m.
        """
        gains, force = at.plan.gains, at.forces[at.axis]
        k = at.plan.environment.stiffness_of(at.axis)
        contact = 1 / k if k > 0 else 0.0
        if pairs_of(gains, "stiffness"):
            displacement = stretched(gains, at.axis, at.forces) + force * contact
        else:
            displacement = force * (1 / value_of(gains, "stiffness", at.axis) + contact)
        return OwnReference(at.start + displacement, ca.SX(0), ca.SX(0))

    def blended(self, own: OwnReference, added: Blending) -> tuple[ca.SX, ca.SX, ca.SX]:
        """r with the blending, r' and r'' without: the damper does not follow the blending."""
        return own.value + added.value, own.rate, own.acceleration

    def hand_over(self, at: StageStart) -> HandOver:
        """The displacement that holds the last force passes into its own."""
        offset = at.start + at.pressed - at.own
        time = blend.blend_time(offset, move_speed(rotation=at.axis.is_rotation))
        return HandOver(offset, 0.0, time, 0.0)

    def constraint(self, axis: Axis, rate: str, *, turns: bool) -> str:  # noqa: ARG002
        """No motion: the force says it all."""
        return ""
