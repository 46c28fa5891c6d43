"""One identified value, with its interval."""

from __future__ import annotations

from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.text.units import Dimension, si_unit


@dataclass(frozen=True, slots=True)
class Estimate:
    """One value that logs decide.

    Attributes:
        path: as `vary` and `truth` name it, such as `world.table.stiffness`.
        index: of its component, from 0; None for a single number.
        along: how it is meant where it is not the component of the file itself, such as
            `along its z`; then it is a displacement from where the file has the object.
        value, low, high: [SI]; the interval has the level of the identification.
        deviation: standard deviation [SI].
        declared: what the file has [SI], or what stands for it.
        dimension: of the value.
        exact: whether the interval says nothing of how far worlds may differ: arithmetic makes
            more of it than noise does, or all delays in it read alike.
    """

    path: str
    index: int | None
    along: str
    value: float
    low: float
    high: float
    deviation: float
    declared: float
    dimension: Dimension
    exact: bool = False

    @property
    def name(self) -> str:
        """Of the component, such as `world.table.xyz.2`."""
        name = self.path if self.index is None or self.along else f"{self.path}.{self.index}"
        return f"{name} {self.along}".rstrip()

    @property
    def unit(self) -> str:
        """The SI unit."""
        return si_unit(self.dimension)

    @property
    def settled(self) -> float:
        """The value for a file [SI]: 0 where that is what it has, and cannot be told from it."""
        nothing = self.declared == 0 and self.low <= 0 <= self.high and not self.along
        return 0.0 if nothing else self.value

    @property
    def declared_inside(self) -> bool:
        """Whether the file's value is in the interval."""
        return self.low <= self.declared <= self.high

    def as_data(self) -> dict[str, Any]:
        """For `--format json`, in SI."""
        return {
            "path": self.path, "index": self.index, "name": self.name, "value": self.value,
            "low": self.low, "high": self.high, "deviation": self.deviation,
            "declared": self.declared, "unit": self.unit, "declared_inside": self.declared_inside,
        }  # fmt: skip
