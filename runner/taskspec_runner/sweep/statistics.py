"""What the rows of a sweep say together: how likely success is, and on what it depends."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec_runner.sweep.world_run import Row

Vector = NDArray[np.float64]

#: Of intervals that are told.
CONFIDENCE = 0.95
#: Parts that the values of a parameter are put into, at most, to see what goes with them.
_GROUPS = 8


@dataclass(frozen=True, slots=True)
class Rate:
    """How often something held.

    Attributes:
        good: times that it did.
        of: times that it was tried.
        sampled: it was tried in random worlds, so that it tells of all of them; not so of worlds
            that somebody chose.
        so_far: of the times that it held, those in which the run did not come to its end.
    """

    good: int
    of: int
    sampled: bool = True
    so_far: int = 0

    @property
    def share(self) -> float:
        """Of good ones; nan of none."""
        return self.good / self.of if self.of else math.nan

    def interval(self, confidence: float = CONFIDENCE) -> tuple[float, float]:
        """Wilson's interval of the probability.

        The probabilities p of which the share s of n tries is not farther away than z standard
        deviations: |s - p| <= z sqrt(p (1 - p) / n).
        """
        n, s = self.of, self.share
        if not n:
            return 0.0, 1.0
        z = NormalDist().inv_cdf(0.5 + confidence / 2)
        middle = (s + z * z / (2 * n)) / (1 + z * z / n)
        half = z / (1 + z * z / n) * math.sqrt(s * (1 - s) / n + z * z / (4 * n * n))
        low = 0.0 if self.good == 0 else max(0.0, middle - half)
        return low, 1.0 if self.good == n else min(1.0, middle + half)

    def as_data(self) -> dict[str, Any]:
        """For a summary; only what was sampled has an interval."""
        interval = self.interval() if self.sampled else None
        return {
            "good": self.good,
            "of": self.of,
            "share": self.share,
            "interval": interval,
            "so_far": self.so_far,
        }


@dataclass(frozen=True, slots=True)
class Influence:
    """How much a parameter has to do with the margin.

    Attributes:
        parameter: path and component.
        correlation: of ranks (Spearman), -1 to 1.
        explained: share of the variance of the margins' ranks that goes with the parameter, in
            whatever way: of two angles to either side the margin may fall on both.
        chance: probability of either as large where there is no influence.
    """

    parameter: str
    correlation: float
    explained: float
    chance: float

    @property
    def strength(self) -> float:
        """Share of the variance of ranks that is explained, by a line or in some other way."""
        return max(self.correlation**2, self.explained)

    @property
    def one_way(self) -> bool:
        """Whether it is mostly the more, the better, or the less."""
        return self.correlation**2 >= 0.5 * self.strength


def parameters(rows: Sequence[Row]) -> dict[str, Vector]:
    """(rows,) of every value that is not the same in all worlds."""
    found = {}
    for name in dict.fromkeys(n for row in rows for n in row if n.startswith(("world.", "robot."))):
        values = np.array([_number(row.get(name)) for row in rows])
        if np.isfinite(values).any() and np.nanmax(values) > np.nanmin(values):
            found[name] = values
    return found


def influences(rows: Sequence[Row]) -> list[Influence]:
    """Of every parameter, the most influential first."""
    margins = goodness(rows)
    found = []
    for name, values in parameters(rows).items():
        known = np.isfinite(values) & np.isfinite(margins)
        if np.count_nonzero(known) > 3:
            x, y = ranks(values[known]), ranks(margins[known])
            r = _correlation(x, y)
            explained, by_groups = _explained(x, y)
            # Of two tests, either may find something by chance.
            chance = min(1.0, 2 * min(_chance(r, len(x)), by_groups))
            found.append(Influence(name, r, explained, chance))
    return sorted(found, key=lambda each: -each.strength)


def goodness(rows: Sequence[Row]) -> Vector:
    """(rows,) the least margin of a world; of one that did not come to its end, less than any."""
    margins = np.array([_number(row.get("margin")) for row in rows])
    ended = np.array([row.get("status") == "done" for row in rows])
    least = np.nanmin(margins) if np.isfinite(margins).any() else 0.0
    return np.where(ended, margins, min(least, 0.0) - 1.0)


def ranks(values: Vector) -> Vector:
    """(n,) ranks from 1; equal values share the mean of theirs."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    ends = np.cumsum(counts)
    return np.asarray((ends - (counts - 1) / 2)[inverse])


def _correlation(a: Vector, b: Vector) -> float:
    a, b = a - a.mean(), b - b.mean()
    size = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / size if size else 0.0


def _chance(r: float, n: int) -> float:
    """Of a rank correlation as large without influence, by Fisher's transform."""
    z = abs(math.atanh(max(-1 + 1e-12, min(1 - 1e-12, r)))) * math.sqrt(max(n - 3, 1) / 1.06)
    return 2 * (1 - NormalDist().cdf(z))


def _explained(x: Vector, y: Vector) -> tuple[float, float]:
    """Share of the variance of ranks y that groups of like x explain, and the chance of as much.

    The groups are of like size; the share is without what chance alone explains. The test is that
    of Kruskal and Wallis: (n - 1) times the share of k groups is about chi-squared with k - 1
    degrees of freedom, which the cube root of Wilson and Hilferty makes a normal number.
    """
    n = len(x)
    wanted = min(max(2, round(n ** (1 / 3))), _GROUPS)
    # Equal values have equal ranks, and come into the same group.
    _, group, sizes = np.unique(
        np.floor((x - 0.5) / n * wanted), return_inverse=True, return_counts=True
    )
    k, whole = len(sizes), float(((y - y.mean()) ** 2).sum())
    if k < 2 or k >= n or not whole:
        return 0.0, 1.0
    means = np.bincount(group, weights=y) / sizes
    share = float((sizes * (means - y.mean()) ** 2).sum()) / whole
    free = k - 1
    cube = ((n - 1) * share / free) ** (1 / 3)
    z = (cube - (1 - 2 / (9 * free))) / math.sqrt(2 / (9 * free))
    return max(0.0, 1 - (1 - share) * (n - 1) / (n - k)), 1 - NormalDist().cdf(z)


@dataclass(frozen=True, slots=True)
class Split:
    """A condition on a parameter.

    Attributes:
        parameter: path and component.
        above: it is greater than the value; else at most it.
        value: [SI].
    """

    parameter: str
    above: bool
    value: float


@dataclass(frozen=True, slots=True)
class Region:
    """Where worlds fail.

    Attributes:
        splits: that all hold there.
        failed: worlds that fail there.
        of: worlds that are there.
    """

    splits: tuple[Split, ...]
    failed: int
    of: int


_DEPTH = 3
#: A part of the worlds that a rule tells of has at least so many of them, and so great a share.
_LEAST, _LEAST_SHARE = 5, 0.02
#: A region is told of where so great a share of its worlds fails.
_FAILS = 0.5


def regions(rows: Sequence[Row]) -> list[Region]:
    """Where worlds fail, by a shallow tree: each split makes the two sides as unlike as it can.

    It is grown greedily by the decrease of Gini's impurity, p (1 - p) of the share p that fails.
    """
    known = parameters(rows)
    failed = np.array([not row["success"] for row in rows])
    if not known or not failed.any() or failed.all():
        return []
    leaves = list(_leaves(known, failed, np.ones(len(rows), bool), (), _DEPTH))
    found = [leaf for leaf in leaves if leaf.splits and leaf.failed / leaf.of >= _FAILS]
    return sorted(found, key=lambda leaf: -leaf.failed)


def _leaves(
    known: Mapping[str, Vector],
    failed: NDArray[np.bool_],
    here: NDArray[np.bool_],
    splits: tuple[Split, ...],
    depth: int,
) -> Any:
    count, bad = int(here.sum()), int(failed[here].sum())
    best = _best(known, failed, here) if depth and 0 < bad < count else None
    if best is None:
        yield Region(_merged(splits), bad, count)
        return
    name, value = best
    for above in (True, False):
        side = here & ((known[name] > value) == above)
        yield from _leaves(known, failed, side, (*splits, Split(name, above, value)), depth - 1)


def _best(
    known: Mapping[str, Vector], failed: NDArray[np.bool_], here: NDArray[np.bool_]
) -> tuple[str, float] | None:
    """The parameter and the value at which a part is split best; None where nothing is gained."""
    count = int(here.sum())
    least = max(_LEAST, math.ceil(_LEAST_SHARE * len(here)))
    whole = _impurity(float(failed[here].sum()), count) * count
    found: tuple[float, str, float] | None = None
    for name, values in known.items():
        order = np.argsort(values[here], kind="stable")
        x, bad = values[here][order], np.cumsum(failed[here][order])
        n = np.arange(1, count + 1)
        left = bad * (1 - bad / n)
        right = (bad[-1] - bad) * (1 - (bad[-1] - bad) / np.maximum(count - n, 1))
        gain = whole - left - right
        allowed = (n >= least) & (count - n >= least)
        allowed[:-1] &= x[1:] > x[:-1]
        allowed[-1] = False
        if allowed.any():
            at = int(np.argmax(np.where(allowed, gain, -np.inf)))
            if found is None or gain[at] > found[0] + 1e-12:
                found = (float(gain[at]), name, float((x[at] + x[at + 1]) / 2))
    # Less than this is what the best of many splits of chance gains.
    if found is None or found[0] < 0.02 * len(here) * _impurity(float(failed.sum()), len(here)):
        return None
    return found[1], found[2]


def _impurity(bad: float, count: int) -> float:
    share = bad / count
    return share * (1 - share)


def _merged(splits: tuple[Split, ...]) -> tuple[Split, ...]:
    """The splits of a leaf, of each parameter and side the narrowest."""
    kept: dict[tuple[str, bool], Split] = {}
    for each in splits:
        key = (each.parameter, each.above)
        old = kept.get(key)
        tighter = old is None or (each.value > old.value) == each.above
        if tighter:
            kept[key] = each
    return tuple(kept.values())


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else math.nan
