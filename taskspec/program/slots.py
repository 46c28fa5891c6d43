"""Named slots in one flat vector: how a stage's memory, parameters and signals are laid out."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np
from numpy.typing import NDArray


def gain_slot(name: str, axis: str) -> str:
    """The name of the slot of one gain on one axis."""
    return f"gain.{name}.{axis}"


class Slots:
    """Collects named slots and hands out their symbols; frozen by `vector`."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._symbols: dict[str, ca.SX] = {}
        self.slots: dict[str, slice] = {}
        self.size = 0

    def add(self, name: str, length: int = 1) -> ca.SX:
        """A new slot of `length` numbers; its symbol is a column vector."""
        assert name not in self.slots, name
        symbol = ca.SX.sym(f"{self._name}.{name}", length)
        self._symbols[name] = symbol
        self.slots[name] = slice(self.size, self.size + length)
        self.size += length
        return symbol

    def once(self, name: str, length: int = 1) -> ca.SX:
        """The symbol of a slot, which is new at its first use."""
        return self._symbols[name] if name in self.slots else self.add(name, length)

    def symbol(self, name: str) -> ca.SX:
        """The symbol of a slot."""
        return self._symbols[name]

    def __contains__(self, name: str) -> bool:
        return name in self.slots

    def vector(self) -> ca.SX:
        """All slots as one column vector (size,)."""
        return ca.vertcat(ca.SX(0, 1), *self._symbols.values())

    def stack(self, values: Mapping[str, ca.SX]) -> ca.SX:
        """The vector with each slot given by an expression; all slots must be given."""
        return ca.vertcat(ca.SX(0, 1), *(values[name] for name in self.slots))

    def write(
        self, array: NDArray[np.float64], name: str, value: float | NDArray[np.float64]
    ) -> None:
        """Sets one slot of a numeric vector of this layout."""
        array[self.slots[name]] = value
