"""The stiffness of a contact, estimated while it is pressed, and designed gains that follow it.

Along one axis a contact returns what a spring and a damper do,

    f = k x + d x' + c,

with the force f that the robot applies, the coordinate x of its tool, and c of a rest position that
nobody knows. Least squares that forget by lambda = exp(-T / memory) a period minimise

    sum lambda^(n-i) (f_i - k x_i - d x'_i - c)^2 / sigma^2
        + (k - k_0)^2 / s_k^2 + (d - d_0)^2 / s_d^2

(contact impedance by recursive least squares: Love and Book, 1995; Diolaiti, Melchiorri and
Stramigioli, 2005). k_0, d_0 are what the file declares, s_k the greater bound; on an object that
has been pressed before, k_0 is what was found there and s_k its standard deviation, a tenth of it
at least. The sums of the first part are recursive, S <- lambda S + (1, x, x', f)(1, x, x', f)^T,
and the second never forgets, so that what nothing excites has the covariance that it began with and
no more: nothing winds up (stabilised forgetting, Kulhavy and Zarrop, 1993).
c falls out with the means.

The sums stand still, and forget nothing, while the force does not change: they take a tick in which
f is outside of the dead zone, and as far from its own low-pass with the time constant `memory`.
What is found counts once its standard deviation is below a quarter of it. The design takes
another stiffness, the one that is followed, which goes to what was found by a bounded rate,

    |d/dt ln k_f| <= rate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.text.units import FORCE, STIFFNESS, TIME, scaled

#: What the sums are of: 1, x, x', f times each other, the upper triangle row by row.
_SUMS = 10
#: A standard deviation below this part of the stiffness makes it one that counts.
DECIDED = 0.25
#: Numbers that are fitted: stiffness, damping, and the force of no deflection.
UNKNOWNS = 3
#: Knots of a design in a decade of stiffness; between them its gains are lines of logarithms.
_KNOTS = 8
#: By which share of themselves two knots differ at least.
_APART = 1e-3
#: Slopes of two such lines that differ by less are one.
_ALIKE = 1e-6
#: Readings of a force that swings after which its stiffness is found, measured in random presses.
_READINGS = 12
#: What was found before is trusted to this part of it at most.
_TRUSTED = 0.1
#: d_0 is known no better than this part of a stiffness, in a second [s].
_LEAST_DAMPING = 1e-3
#: Of one axis in the memory of a stage, and how many numbers each is.
STATE: Mapping[str, int] = {
    **{"sums": _SUMS, "slow": 1, "prior": 2, "found": 1, "deviation": 1, "followed": 1}
}


@dataclass(frozen=True, slots=True)
class ContactStiffness:
    """The estimate along one axis.

    Attributes:
        low, high: bounds of the stiffness [N/m].
        declared: k_0 [N/m].
        damping: d_0 [N s/m].
        noise: sigma, the standard deviation of a reading [N].
        dead_zone: changes of the force that are no news [N].
        memory: time constant of forgetting [s].
        rate: of the stiffness that the design follows [1/s].
        period: of control T [s].
    """

    low: float
    high: float
    declared: float
    damping: float
    noise: float
    dead_zone: float
    memory: float
    rate: float
    period: float

    @property
    def undecided(self) -> float:
        """s_k: the standard deviation before anything was measured [N/m]."""
        return self.high

    @property
    def found_after(self) -> float:
        """How long a force that changes as loops make it has been read as the stiffness is found.

        Ticks by the dozen: with f = k x + d x' + c three readings decide what has no noise.
        """
        return _READINGS * self.period

    @property
    def settling(self) -> float:
        """The longest that the followed stiffness is on its way to one that was found [s].

        From bound to bound at the bounded rate, and the tick in which it is found.
        """
        return math.log(self.high / self.low) / self.rate + self.period

    @property
    def words(self) -> str:
        """What is estimated, of which readings."""
        low, high, first = (scaled(x, STIFFNESS, 3) for x in (self.low, self.high, self.declared))
        news = scaled(self.dead_zone, FORCE, 3)
        return (
            f"the contact's stiffness from {low} to {high}, begins with {first}; counts changes of "
            f"the force beyond {news}, forgets in {scaled(self.memory, TIME, 3)}"
        )

    def begun(self, found: ca.SX, deviation: ca.SX, followed: ca.SX) -> dict[str, ca.SX]:
        """The state of an axis whose contact begins.

        Args:
            found: the stiffness that was found there before, else the declared one [N/m].
            deviation: the standard deviation of that, else `undecided` [N/m].
            followed: by the design [N/m].
        """
        return {
            "sums": ca.SX.zeros(_SUMS),
            "slow": ca.SX(0),
            "prior": ca.vertcat(found, ca.fmax(deviation, _TRUSTED * found)),
            "found": found,
            "deviation": deviation,
            "followed": ca.log(followed),
        }

    def step(
        self,
        state: Mapping[str, ca.SX],
        force: ca.SX,
        position: ca.SX,
        velocity: ca.SX,
        *,
        first: ca.SX,
        fresh: ca.SX,
    ) -> dict[str, ca.SX]:
        """The state after a tick.

        Args:
            state: before it, as `STATE` has it.
            force: f, as measured [N].
            position: x as the force was taken [m].
            velocity: x' then [m/s].
            first: whether it is the first of the stage.
            fresh: whether the force is a new reading.
        """
        slow = ca.if_else(first, force, state["slow"])
        news = ca.logic_and(
            ca.logic_and(fresh, ca.fabs(force) > self.dead_zone),
            ca.fabs(force - slow) > self.dead_zone,
        )
        row = [ca.SX(1), position, velocity, force]
        products = [row[i] * row[j] for i in range(4) for j in range(i, 4)]
        kept = math.exp(-self.period / self.memory)
        sums = ca.if_else(news, kept * state["sums"] + ca.vertcat(*products), state["sums"])
        k, deviation = self._solved(sums, *ca.vertsplit(state["prior"]))
        decided = ca.logic_and(news, ca.logic_and(k > 0, deviation < DECIDED * k))
        found = ca.if_else(decided, ca.fmin(ca.fmax(k, self.low), self.high), state["found"])
        most = self.rate * self.period
        way = ca.log(found) - state["followed"]
        return {
            "sums": sums,
            "slow": slow + (1 - kept) * (force - slow),
            "prior": state["prior"],
            "found": found,
            "deviation": ca.if_else(decided, deviation, state["deviation"]),
            "followed": state["followed"] + ca.fmin(ca.fmax(way, -most), most),
        }

    def _solved(self, sums: ca.SX, k_0: ca.SX, s_k: ca.SX) -> tuple[ca.SX, ca.SX]:
        """k and its standard deviation [N/m].

        The noise is that of the sensor, or what the fit leaves if that is more: a contact that is
        no spring and damper is not decided.
        """
        n, x, v, f, xx, xv, xf, vv, vf, ff = (sums[i] for i in range(_SUMS))
        n = ca.fmax(n, 1.0)
        xx, xv, xf = xx - x * x / n, xv - x * v / n, xf - x * f / n
        vv, vf, ff = vv - v * v / n, vf - v * f / n, ff - f * f / n
        of_k = (self.noise / s_k) ** 2
        of_d = (self.noise / max(self.damping, _LEAST_DAMPING * self.declared)) ** 2
        xx, vv = xx + of_k, vv + of_d
        a, b = xf + of_k * k_0, vf + of_d * self.damping
        determinant = xx * vv - xv * xv
        k, d = (vv * a - xv * b) / determinant, (xx * b - xv * a) / determinant
        ff += of_k * k_0**2 + of_d * self.damping**2
        left = ca.fmax(ff - k * a - d * b, 0) / n
        return k, ca.sqrt(ca.fmax(left, self.noise**2) * vv / determinant)


@dataclass(frozen=True, slots=True)
class Schedule:
    """A designed gain that follows the stiffness: lines of ln gain over ln k.

    Attributes:
        knots: ln k, rising.
        values: ln gain there.
    """

    knots: tuple[float, ...]
    values: tuple[float, ...]

    @staticmethod
    def of(gains: Mapping[float, float]) -> Schedule | None:
        """Through the gains of some stiffnesses; None where they are one, or one of them is 0."""
        if min(gains.values()) <= 0 or len({*gains.values()}) < 2:
            return None
        at = [(math.log(k), math.log(gains[k])) for k in sorted(gains)]
        kept = [at[0]]
        for here, after in pairwise(at[1:]):
            before = kept[-1]
            slopes = [(b[1] - a[1]) / (b[0] - a[0]) for a, b in ((before, here), (here, after))]
            if abs(slopes[1] - slopes[0]) > _ALIKE:
                kept.append(here)
        knots, values = zip(*kept, at[-1], strict=True)
        return Schedule(knots, values)

    def value(self, stiffness: float) -> float:
        """The gain for a stiffness [N/m]."""
        return math.exp(float(np.interp(math.log(stiffness), self.knots, self.values)))

    def at(self, followed: ca.SX) -> ca.SX:
        """The same as an expression of ln k."""
        found, slope = ca.SX(self.values[0]), 0.0
        for i in range(len(self.knots) - 1):
            width = self.knots[i + 1] - self.knots[i]
            slope = (self.values[i + 1] - self.values[i]) / width
            found += slope * ca.fmin(ca.fmax(followed - self.knots[i], 0), width)
        return ca.exp(found)


def knots(low: float, high: float, also: Sequence[float] = ()) -> tuple[float, ...]:
    """The stiffnesses that a design is made for, both bounds among them [N/m].

    Args:
        low, high: the bounds.
        also: further ones; what lies beyond the bounds is left out.
    """
    count = max(2, math.ceil(_KNOTS * math.log10(high / low)) + 1)
    between = np.geomspace(low, high, count)[1:-1].tolist()
    found = [low, high]
    # Two that lie side by side would have a line between them whose slope is rounding.
    for k in (*(each for each in also if low < each < high), *between):
        if not any(math.isclose(k, other, rel_tol=_APART) for other in found):
            found.append(k)
    return tuple(sorted(found))


def schedules(
    design: Callable[[float], Mapping[str, float]], at: Sequence[float], names: Sequence[str]
) -> dict[str, Schedule]:
    """The gains that follow the stiffness, by name.

    Args:
        design: gains of an axis by name for a stiffness [N/m].
        at: the stiffnesses that it is made for [N/m].
        names: of gains that may follow.
    """
    made = {k: design(k) for k in at}
    found = {
        name: Schedule.of({k: gains[name] for k, gains in made.items()})
        for name in names
        if all(name in gains for gains in made.values())
    }
    return {name: each for name, each in found.items() if each is not None}
