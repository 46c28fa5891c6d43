"""`force`, `torque`: an axis that presses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, ScopeKind
from taskspec.modes.key import ModeKey
from taskspec.text.units import FORCE, TIME, show

#: A force set point rises from the measured force in this time [s] (docs/language/axes.md).
DEFAULT_RAMP = 0.2


@dataclass(frozen=True, slots=True)
class Force:
    """The force set point of an axis, beside or in place of a motion.

    Attributes:
        wanted: what the robot is to apply to the environment [N, N m].
        ramp: in which it is reached [s]; None for the default.
        kept: it is what the stage before commanded last; `wanted` is that as far as the file
            determines it.
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
            ramped=True,
            only="along",
            description="What the robot applies to the environment",
            examples=("-15 N", "-press"),
        ),
        ModeKey(
            "torque",
            "Moment",
            FORCE,
            scope=ScopeKind.REFERENCE,
            ramped=True,
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
        """The artificial constraint in words: its set point.

        Args:
            force: its symbol.
        """
        ramp = "" if str(self.wanted) == "0" else f", reached in {show(self.rise, TIME)}"
        return f"{force} = {self.wanted}{ramp}"

    def defaults(self) -> Iterator[tuple[str, str]]:
        """Its ramp, where a file leaves that out."""
        if self.ramp is None:
            yield "ramp", show(self.rise, TIME)
