"""`follows: 2 * x`: an axis whose coordinate is an expression of those of other axes.

A leader is followed by its reference. One that has none to keep to, as a force decides where it
is, is followed by where it is measured.
"""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, ScopeKind
from taskspec.expression.tree import Name, walk
from taskspec.geometry.axis import Axis, as_axis
from taskspec.modes.key import ModeKey
from taskspec.modes.mode import (
    AxisMode,
    HandOver,
    OwnReference,
    ReferenceInputs,
    StageStart,
    to_coordinate,
)
from taskspec.text.units import LENGTH


@dataclass(frozen=True, slots=True)
class FollowsAxes(AxisMode):
    """An axis whose coordinate is a function f of the coordinates of other axes.

    Attributes:
        follows: f [m, rad].
    """

    follows: Expression

    name = "follows"
    keys = (
        ModeKey(
            "follows",
            "Mechanism, or expression of other axes",
            LENGTH,
            scope=ScopeKind.COUPLING,
            mechanism=True,
            meaning="A mechanism that the robot holds, or the coordinate as an expression of "
            "other axes, such as 2 * x.",
            examples=("door", "2 * x"),
        ),
    )
    placed = True
    bends = True

    def expressions(self) -> Iterator[tuple[Expression, bool]]:
        """f, of which rates are taken."""
        yield self.follows, True

    @property
    def leaders(self) -> tuple[Axis, ...]:
        """The axes that f uses, each once, in the order in which they stand there."""
        names = (str(node) for node in walk(self.follows.tree) if isinstance(node, Name))
        return tuple(dict.fromkeys(axis for name in names if (axis := as_axis(name)) is not None))

    def reference(self, at: ReferenceInputs) -> OwnReference:
        """r = f(q), r' = f_q q', r'' = f_q q'' + q'^T f_qq q', q the leaders' coordinates.

        The displacement that stands for a force which a leader releases is no motion of it.
        """
        leaders = [at.leader(axis) for axis in self.leaders]
        q, rate, acceleration = (ca.SX.sym(s, len(leaders)) for s in ("q", "rate", "acceleration"))
        named = zip(map(str, self.leaders), ca.vertsplit(q), strict=True)
        f = at.translate(self.follows, dict(named))
        f_rate = ca.jtimes(f, q, rate)
        bend = ca.jtimes(f_rate, q, rate) + ca.jtimes(f, q, acceleration)
        found = ca.substitute(
            ca.vertcat(f, f_rate, bend),
            ca.vertcat(q, rate, acceleration),
            ca.vertcat(
                *(leader.value - leader.released for leader in leaders),
                *(leader.rate for leader in leaders),
                *(leader.acceleration for leader in leaders),
            ),
        )
        return OwnReference(found[0], found[1], found[2])

    def hand_over(self, at: StageStart) -> HandOver:
        """Hand-over to what it follows, as to a coordinate of the frame."""
        return to_coordinate(at)

    @property
    def loop(self) -> tuple[object, ...]:
        """What it follows: a measured leader is part of the closed loop."""
        return (str(self.follows),)

    def constraint(self, axis: Axis, rate: str, *, turns: bool) -> str:  # noqa: ARG002
        """The artificial constraint in words: the coupling."""
        return f"{axis} = {self.follows}"
