"""Statistics of features, by which who learns from them scales them."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

#: By the names that LeRobot gives them.
QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}

#: Values that a channel of a picture has.
_LEVELS = 256

Statistics = dict[str, list[Any]]


def statistics(values: NDArray[Any]) -> Statistics:
    """Least, greatest, mean, standard deviation, count and quantiles of each component.

    Those of a window are over all of its samples. LeRobot takes for the quantiles of several
    episodes the means of theirs; these are of all the frames.

    Args:
        values: (n,), (n, d) or (n, window, d).
    """
    flat = values.reshape(len(values), -1) if values.ndim < 3 else values
    flat = flat.reshape(-1, flat.shape[-1]).astype(np.float64)
    quantiles = np.quantile(flat, [*QUANTILES.values()], axis=0)
    return {
        "min": flat.min(axis=0).tolist(),
        "max": flat.max(axis=0).tolist(),
        "mean": flat.mean(axis=0).tolist(),
        "std": flat.std(axis=0).tolist(),
        "count": [len(values)],
        **dict(zip(QUANTILES, quantiles.tolist(), strict=True)),
    }


class Colours:
    """How often pictures have which colours, from which their statistics follow exactly."""

    def __init__(self) -> None:
        self.pictures = 0
        self._counts = np.zeros((3, _LEVELS), dtype=np.int64)

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Takes a picture (height, width, 3)."""
        self.pictures += 1
        for counts, channel in zip(self._counts, np.moveaxis(picture, 2, 0), strict=True):
            counts += np.bincount(channel.ravel(), minlength=_LEVELS)

    def __iadd__(self, other: Colours) -> Self:
        self.pictures += other.pictures
        self._counts += other._counts
        return self

    def statistics(self) -> Statistics:
        """What `statistics` has, of each channel from 0 to 1 over all pixels."""
        levels = np.arange(_LEVELS) / (_LEVELS - 1)
        found = [_weighted(levels, counts) for counts in self._counts]
        # As of pictures (channel, height, width).
        joined: Statistics = {key: [[[one[key]]] for one in found] for key in found[0]}
        return joined | {"count": [self.pictures]}


def _weighted(levels: NDArray[np.float64], counts: NDArray[np.int64]) -> dict[str, float]:
    there, total = levels[counts > 0], counts.sum()
    mean = float(levels @ counts / total)
    up_to = np.cumsum(counts)
    quantiles = {
        name: float(levels[np.searchsorted(up_to, share * (total - 1), side="right")])
        for name, share in QUANTILES.items()
    }
    std = float(np.sqrt((levels - mean) ** 2 @ counts / total))
    return {"min": float(there[0]), "max": float(there[-1]), "mean": mean, "std": std, **quantiles}
