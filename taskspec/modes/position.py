"""`position`: an axis whose coordinate is an expression."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, ScopeKind
from taskspec.modes.key import ModeKey
from taskspec.modes.mode import (
    AxisMode,
    Displacement,
    HandOver,
    Known,
    OwnReference,
    ReferenceInputs,
    StageStart,
    to_coordinate,
)
from taskspec.text.units import LENGTH

if TYPE_CHECKING:
    from taskspec.geometry.axis import Axis


@dataclass(frozen=True, slots=True)
class Position(AxisMode):
    """An axis whose coordinate in the frame is planned as an expression of time.

    Attributes:
        position: [m, rad].
    """

    position: Expression

    name = "position"
    keys = (
        ModeKey(
            "position",
            "Position",
            LENGTH,
            about="Angle",
            scope=ScopeKind.PLANNED,
            meaning="Where the reference is, as an expression of t, clock and params.",
        ),
    )
    placed = True
    bends = True

    def expressions(self) -> Iterator[tuple[Expression, bool]]:
        """The coordinate, of which rates are taken."""
        yield self.position, True

    @property
    def own_time(self) -> bool:
        """Whether it is of `t` and not of the run's `clock`."""
        return self.position.uses("t") and not self.position.uses("clock")

    def reference(self, at: ReferenceInputs) -> OwnReference:
        """r, differentiated by time; its own time, where the stage leaves it that."""
        value = at.translate(self.position)
        if at.axis in at.plan.from_rest:
            value = ca.substitute(value, at.clock.t, at.from_rest)
        return at.in_time(value)

    def hand_over(self, at: StageStart) -> HandOver:
        """Hand-over to the coordinate of the expression."""
        return to_coordinate(at)

    def displacement(self, known: Known, start: float) -> Displacement | None:
        """r(t) - r_0, where the expression depends on time alone."""
        begins = known(self.position, {"t": 0.0})
        if begins is None or not math.isfinite(begins):
            return None

        def moved(time: float) -> float:
            value = known(self.position, {"t": time})
            return math.nan if value is None else value - start

        return moved

    def constraint(self, axis: Axis, rate: str, *, turns: bool) -> str:  # noqa: ARG002
        """The artificial constraint in words: the coordinate."""
        return f"{axis} = {self.position}"
