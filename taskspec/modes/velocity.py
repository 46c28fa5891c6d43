"""`velocity`: an axis whose rate is an expression."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Iterator
from functools import reduce
from typing import TYPE_CHECKING

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
    from_start,
)
from taskspec.motion import blend
from taskspec.text.units import VELOCITY

if TYPE_CHECKING:
    import casadi as ca

    from taskspec.geometry.axis import Axis

#: Times at which a velocity that has risen is the same [s]; no period divides both distances.
_LATE = (17.0, 41.3, 73.9)


@dataclass(frozen=True, slots=True)
class Velocity(AxisMode):
    """An axis whose rate is an expression, which may use measured signals.

    Attributes:
        velocity: [m/s, rad/s].
    """

    velocity: Expression

    name = "velocity"
    keys = (
        ModeKey(
            "velocity",
            "Velocity",
            VELOCITY,
            about="Rate of turn",
            scope=ScopeKind.REFERENCE,
            ramped=True,
            meaning="How fast the reference goes; may use measured signals.",
        ),
    )
    travels = True
    goes_on = True

    def expressions(self) -> Iterator[tuple[Expression, bool]]:
        """The expression of its rate."""
        yield self.velocity, False

    def reference(self, at: ReferenceInputs) -> OwnReference:
        """r = r_0 + int v dt, which is memorised; r' = v; r'' the part of v' that time decides.

        v is what the file gives, risen from nothing, so it is never larger than that. A step of
        the integral is v h + v' h^2/2 over a period h.
        """
        shape = blend.ramp_shape(at.clock.t / blend.BLEND_TIME)
        speeds = [speed * shape for speed in at.clock.apart(at.translate(self.velocity))]
        gains = [at.clock.rate(speed) for speed in speeds]
        slot = f"travelled.{at.axis}"
        travelled = at.memory.add(slot)
        step = _sum(
            speed * at.period + gain * (at.period**2 / 2)
            for speed, gain in zip(speeds, gains, strict=True)
        )
        reference = at.start + travelled
        return OwnReference(reference, _sum(speeds), _sum(gains), {slot: travelled + step})

    def hand_over(self, at: StageStart) -> HandOver:
        """Its rate is taken up from the one that is handed over."""
        return from_start(at)

    def constant_rate(self, known: Known) -> float | None:
        """v, where it depends on parameters alone."""
        return known(self.velocity, None)

    def settled_rate(self, known: Known) -> float | None:
        """v, or what it rises to and keeps."""
        found = {known(self.velocity, {"t": t}) for t in _LATE}
        return found.pop() if len(found) == 1 else None

    def heading(self, known: Known) -> float | None:
        """v, where it is known and not zero."""
        return known(self.velocity, None) or None

    def displacement(self, known: Known, start: float) -> Displacement | None:  # noqa: ARG002
        """A constant rate v times the time, which rises from rest; None where v is not constant."""
        speed = known(self.velocity, None)
        return None if speed is None else lambda time: speed * blend.from_rest(time)

    def constraint(self, axis: Axis, rate: str, *, turns: bool) -> str:  # noqa: ARG002
        """The artificial constraint in words: the rate."""
        return f"{rate} = {self.velocity}"


def _sum(parts: Iterable[ca.SX]) -> ca.SX:
    return reduce(operator.add, parts)
