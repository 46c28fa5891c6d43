"""The selection matrices of a stage in words, for `explain`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.explain import Selection
from taskspec.text.units import number

#: A component below this is not shown.
_SHOWN = 1e-6


def selection_rows(selection: Selection) -> tuple[tuple[str, str], ...]:
    """The matrices, on a line each."""
    found = [("S_f", _matrix(selection.force)), ("S_v", _matrix(selection.motion))]
    if selection.soft:
        found.append(("neither", f"{' '.join(selection.soft)}: springs of their own"))
    return tuple(found)


def _matrix(M: NDArray[np.float64]) -> str:
    """A basis along axes as the diagonal of its projector, another one column by column."""
    there = np.abs(M) > _SHOWN
    if np.all(np.count_nonzero(there, axis=0) == 1):
        chosen = np.count_nonzero(there, axis=1)
        return f"diag({' '.join(map(str, chosen))})"
    columns = (" ".join(number(float(v) + 0.0, 3) for v in np.round(c, 6)) for c in M.T)
    return ", ".join(f"({column})^T" for column in columns)
