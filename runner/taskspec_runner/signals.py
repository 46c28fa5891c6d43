"""LoggedSignals of a run as arrays that know their unit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from taskspec.text.suggest import suggestion
from taskspec.text.units import to_si

Mask = NDArray[np.bool_]


class LoggedSignal(np.ndarray[tuple[int], np.dtype[np.float64]]):
    """(n,) one value a tick, NaN where there is none.

    A part of a signal is a signal; what is computed from it is a plain array, as its unit is not
    worked out.

    Attributes:
        name: in the log.
        unit: of the values, empty for a plain number.
    """

    name: str
    unit: str

    def __new__(cls, values: NDArray[np.float64], name: str, unit: str) -> Self:
        """Values with a name and a unit."""
        made = np.asarray(values, dtype=float).view(cls)
        made.name, made.unit = name, unit
        return made

    def __array_finalize__(self, source: object) -> None:
        self.name = getattr(source, "name", "")
        self.unit = getattr(source, "unit", "")

    def __array_wrap__(
        self, array: NDArray[Any], context: Any = None, return_scalar: bool = False
    ) -> Any:
        plain = np.asarray(array)
        return plain[()] if return_scalar else plain

    def to(self, unit: str) -> LoggedSignal:
        """The same in another unit, such as `mm`.

        Raises:
            ValueError: the unit is none, or one of another quantity.
        """
        own, wanted = to_si(1.0, self.unit), to_si(1.0, unit)
        if own.dimension != wanted.dimension:
            raise ValueError(f"{self.name} is in {self.unit or 'plain numbers'}, not in {unit}")
        return LoggedSignal(np.asarray(self) * (own.value / wanted.value), self.name, unit)


class LoggedSignals(Mapping[str, LoggedSignal]):
    """The signals of a run, or of a part of it, by their names in the log."""

    def __init__(
        self, columns: Mapping[str, NDArray[np.float64]], units: Mapping[str, str], rows: Mask
    ) -> None:
        self._columns, self._units, self._rows = columns, units, rows

    def __getitem__(self, name: str) -> LoggedSignal:
        if name not in self._columns:
            hint = suggestion(name, self._columns, "signals")
            raise KeyError(f"there is no signal '{name}'; {hint}".rstrip("; "))
        values = self._columns[name]
        part = values if self._rows.all() else values[self._rows]
        return LoggedSignal(part, name, self._units.get(name, ""))

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __repr__(self) -> str:
        return f"<{len(self)} signals of {int(self._rows.sum())} ticks>"
