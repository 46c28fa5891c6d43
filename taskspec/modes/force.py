"""`force`, `torque`: an axis that presses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.laws.gains import value_of
from taskspec.modes.key import ModeKey
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
from taskspec.text.expression import Expression, ScopeKind
from taskspec.text.units import FORCE, TIME, show

if TYPE_CHECKING:
    from taskspec.geometry.axis import Axis

#: A force set point rises from the measured force in this time [s] (docs/language.md).
DEFAULT_RAMP = 0.2


@dataclass(frozen=True, slots=True)
class Force:
    """The force set point of an axis, beside or in place of a motion.

    Attributes:
        wanted: what the robot is to apply to the environment [N, N m].
        ramp: in which it is reached [s]; None for the default.
        kept: it is what the stage before commanded last; `wanted` is that as far as the file tells.
        keys: in a file: that of translations, that of rotations, and their companion.
    """

    wanted: Expression
    ramp: float | None
    kept: bool = False

    keys: ClassVar[tuple[ModeKey, ...]] = (
        ModeKey(
            "force",
            "Force",
            FORCE,
            scope=ScopeKind.REFERENCE,
            only="along",
            description="What the robot applies to the environment",
            examples=("-15 N", "-press"),
        ),
        ModeKey(
            "torque",
            "Moment",
            FORCE,
            scope=ScopeKind.REFERENCE,
            only="about",
            description="What the robot applies to the environment",
            examples=("-2 N*m", 0),
        ),
        ModeKey(
            "ramp",
            "Time in which the force is reached",
            TIME,
            least=0,
            companion="it is the time in which a force or torque is reached",
            meaning="Time in which the set point is reached from the measured value; "
            "0.2 s by default.",
            examples=("0.3 s",),
        ),
    )

    @property
    def rise(self) -> float:
        """Time in which it is reached, given or not [s]."""
        return DEFAULT_RAMP if self.ramp is None else self.ramp

    def constraint(self, force: str) -> str:
        """What it asks for.

        Args:
            force: its symbol.
        """
        ramp = "" if str(self.wanted) == "0" else f", reached in {show(self.rise, TIME)}"
        return f"{force} = {self.wanted}{ramp}"

    def defaults(self) -> Iterator[tuple[str, str]]:
        """Its ramp, where a file leaves that out."""
        if self.ramp is None:
            yield "ramp", show(self.rise, TIME)


@dataclass(frozen=True, slots=True)
class OpenLoop(AxisMode):
    """A force under a law without a force loop: it displaces the reference of a spring."""

    name = "open-loop"

    def reference(self, at: ReferenceInputs) -> OwnReference:
        """r = r_0 + f (1/k_m + 1/k_e): a displacement that stands for a force asks no motion."""
        own = 1 / value_of(at.plan.gains, "stiffness", at.axis)
        k = at.plan.stiffness_of(at.axis)
        contact = 1 / k if k > 0 and not at.axis.is_rotation else 0.0
        displacement = at.forces[at.axis] * (own + contact)
        return OwnReference(at.start + displacement, ca.SX(0), ca.SX(0))

    def blended(self, own: OwnReference, added: Blending) -> tuple[ca.SX, ca.SX, ca.SX]:
        """The damper is asked for no motion while it is blended either."""
        return own.value + added.value, own.rate, own.acceleration

    def hand_over(self, at: StageStart) -> HandOver:
        """The displacement that holds the last force passes into its own."""
        offset = at.start + at.pressed - at.own
        time = blend.blend_time(offset, move_speed(rotation=at.axis.is_rotation))
        return HandOver(offset, 0.0, time, 0.0)

    def constraint(self, axis: Axis, rate: str, *, turns: bool) -> str:  # noqa: ARG002
        """No motion: the force says it all."""
        return ""
