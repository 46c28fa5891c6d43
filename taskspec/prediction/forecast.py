"""Signals of a stage against time, as far as they can be told, and when a guard holds with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import field

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.foresight.ranges import Ranges
from taskspec.geometry.axis import Axis
from taskspec.motion.blend import BLEND_TIME, from_rest
from taskspec.prediction.at_start import StageAtStart
from taskspec.prediction.types import Impact
from taskspec.program.interval import ANY, Interval, IntervalAlgebra, point
from taskspec.signals.entries import TOUCHING
from taskspec.text.expression import Expression, evaluate
from taskspec.text.expression.tree import Held, Name, Reduce, walk

#: A velocity is blended in over `BLEND_TIME`: the way lags by what it covers in half of that [s].
LAG = BLEND_TIME / 2
#: Instants at which a guard is looked at before the first at which it holds is narrowed down.
_LOOKS = 400
_NARROWINGS = 24

#: A signal [SI] against the time since its stage began [s].
Signal = Callable[[float], Interval]


@dataclass(frozen=True, slots=True)
class Forecast:
    """Signals of a stage by full name; what is not among them can have any value."""

    here: StageAtStart
    signals: Mapping[str, Signal] = field(default_factory=dict)

    def first(self, guard: Expression, horizon: float) -> float | None:
        """When a guard first holds for certain [s], its dwell included; None where that is open.

        Args:
            guard: of the stage.
            horizon: how far to look [s].
        """
        tree = guard.tree
        node, dwell = (tree.x, tree.amount.value_si) if isinstance(tree, Held) else (tree, 0.0)
        if any(isinstance(part, Held | Reduce) for part in walk(node)):
            return None
        algebra = IntervalAlgebra()

        def holds(t: float) -> bool:
            known = {signal: at(t) for signal, at in self.signals.items()}
            ranges = Ranges(self.here.stage.plan, known)
            return evaluate(node, algebra, lambda n: _value(ranges, n)).always

        times = np.linspace(0.0, horizon, _LOOKS)
        late = next((i for i, t in enumerate(times) if holds(float(t))), None)
        if late is None:
            return None
        early, t = float(times[max(late - 1, 0)]), float(times[late])
        for _ in range(_NARROWINGS):
            middle = (early + t) / 2
            early, t = (early, middle) if holds(middle) else (middle, t)
        return t + dwell


def _value(ranges: Ranges, name: Name) -> Interval:
    return ANY if name.frame is not None else ranges(name)


def moved(rate: float, t: float) -> float:
    """The way of an axis at a constant rate t seconds after its stage began at rest."""
    way: float = rate * from_rest(t)
    return way


def coming(rates: Mapping[Axis, float], start: Mapping[Axis, float] | None) -> dict[str, Signal]:
    """Positions of axes that go at constant rates [m/s, rad/s], held ones among them.

    Args:
        rates: by axis.
        start: coordinates as the stage begins; of rotations they are zero.
    """
    found: dict[str, Signal] = {}
    for axis, rate in rates.items():
        if axis.is_rotation:
            found[f"position.{axis}"] = _linear(0.0, rate)
        elif start is not None:
            found[f"position.{axis}"] = _linear(start[axis], rate)
    return found


def _linear(start: float, rate: float) -> Signal:
    return lambda t: point(start + moved(rate, t))


def touching(here: StageAtStart, met: Impact, own: float) -> dict[str, Signal]:
    """Forces and gap of a stage on its way to its surface and into it.

    Once there, a mass on a spring: the force rises as a sine to its peak, and at least as fast as
    the contact and the spring behind the axis let the reference press.

    Args:
        here: the stage, whose gap is known.
        met: the impact.
        own: stiffness behind the axis [N/m]; infinite for a stiff one.
    """
    assert here.gap is not None
    arrives = arrival(here, met, own)
    frequency = math.sqrt(met.stiffness / met.mass)
    slope = met.speed / (1 / met.stiffness + 1 / own)
    normal = here.rotation.T @ here.context.start_normals[met.contact]

    def pushes(t: float) -> float:
        since = t - arrives
        if since <= 0:
            return 0.0
        phase = min(frequency * since, math.pi / 2)
        return max(met.speed * math.sqrt(met.mass * met.stiffness) * math.sin(phase), slope * since)

    def along(share: float) -> Signal:
        return lambda t: point(-share * pushes(t))

    found = {f"force.{a}": along(float(normal[i])) for i, a in enumerate("xyz")}
    found |= {f"torque.{a}": lambda _: ANY for a in ("rx", "ry", "rz")}
    found["touching"] = lambda t: point(float(pushes(t) > TOUCHING))
    found["gap"] = found[f"{met.contact}.gap"] = lambda t: point(
        max(-met.speed * (t - arrives), -pushes(t) / met.stiffness)
    )
    return found


def arrival(here: StageAtStart, met: Impact, own: float) -> float:
    """When a stage comes to its surface [s].

    Args:
        here: the stage.
        met: the impact.
        own: stiffness behind the axis [N/m].
    """
    gap = max((here.gap or 0.0) - here.nearing * LAG, 0.0)
    drags = (met.drag or 0.0) / own
    time = gap / met.speed + LAG + drags
    return time if time > BLEND_TIME else math.sqrt(2 * gap * BLEND_TIME / met.speed) + drags
