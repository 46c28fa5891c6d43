"""`hold`: an axis that stays where it is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.expression.tree import Name
from taskspec.modes.force import Force
from taskspec.modes.key import Misuse, ModeKey
from taskspec.modes.mode import (
    AxisMode,
    HandOver,
    Known,
    OwnReference,
    ReferenceInputs,
    StageStart,
    from_start,
)
from taskspec.text.units import FORCE

if TYPE_CHECKING:
    from taskspec.geometry.axis import Axis


#: A set point that the stage before decides.
KEPT = Expression("the set point of the stage before", Name(("kept",)), FORCE)
_BESIDE = {
    "force": "it keeps the force of the stage before: keep one of the two",
    "torque": "it keeps the moment of the stage before: keep one of the two",
    "stiffness": "a soft axis is a motion axis: keep one of the two",
    "damping": "a soft axis is a motion axis: keep one of the two",
}


@dataclass(frozen=True, slots=True)
class Hold(AxisMode):
    """An axis that stays where the stage before left its reference; what axes do by default.

    Attributes:
        hold: `start` keeps the reference that is handed over; `world` the world's orientation;
            `force` the last set point of the stage before.
    """

    hold: str = "start"

    name = "hold"
    keys = (
        ModeKey(
            "hold",
            "Hold",
            words=("start", "world", "force"),
            description="start, world or force",
            meaning="start keeps the reference where it is; world keeps a rotation to the world; "
            "force keeps the last set point of the stage before.",
        ),
    )
    word: ClassVar[str] = "start"
    moves = False

    @classmethod
    def misuse(cls, data: Mapping[str, Any], *, rotation: bool) -> Misuse | None:
        """A translation cannot hold an orientation, and a force is held by itself."""
        beside = next((key for key in _BESIDE if key in data), None)
        if data.get("hold") == "force" and beside is not None:
            return Misuse(beside, f"a {beside} on an axis that holds its force", _BESIDE[beside])
        if data.get("hold") != "world" or rotation:
            return None
        hint = "a translation holds the reference: write 'hold'"
        return Misuse("hold", "'world' holds an orientation, not a place", hint)

    @property
    def set_point(self) -> Force | None:
        """The last command of the stage before, for an axis that holds its force."""
        return Force(KEPT, None, kept=True) if self.hold == "force" else None

    def reference(self, at: ReferenceInputs) -> OwnReference:
        """r = r_0, r' = r'' = 0."""
        return OwnReference(at.start, ca.SX(0), ca.SX(0))

    def hand_over(self, at: StageStart) -> HandOver:
        """It comes to rest where the rate that is handed over carries it."""
        return from_start(at)

    @property
    def world(self) -> bool:
        """Whether it holds an orientation against the world."""
        return self.hold == "world" and self.rotation

    @property
    def loop(self) -> tuple[object, ...]:
        """The frame against which it holds an orientation."""
        return ("world",) if self.hold == "world" else ()

    def constant_rate(self, known: Known) -> float | None:  # noqa: ARG002
        """0: a held axis has no rate [m/s, rad/s]."""
        return 0.0

    def constraint(self, axis: Axis, rate: str, *, turns: bool) -> str:
        """No rate, unless its frame takes it along."""
        if turns and axis.is_rotation and not self.world:
            return f"{axis} held, turns with the frame"
        return f"{rate} = 0{' in the world' if self.world else ''}"
