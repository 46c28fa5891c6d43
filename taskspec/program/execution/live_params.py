"""Params that may be set while a stage runs: how they go to what they are set to.

A kernel: Python's machine, machine code and exported C move them by this source.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.native.kernel import Record, Vector
from taskspec.spec.params import LiveParam
from taskspec.text.suggest import suggestion


class LiveTable(Record):
    """The params of a run that may be set, one entry of each vector for each.

    Attributes:
        n: how many there are.
        values, rates: what ticks read: the values of this tick [SI], and their derivatives by time.
        low, high: bounds [SI].
        most: how fast each goes, by the second [SI]; 0 where it jumps.
        targets: what each was last set to [SI].
        begins, began: the value that it had then [SI], and the run time [s].
    """

    n: int
    values: Vector
    rates: Vector
    low: Vector
    high: Vector
    most: Vector
    targets: Vector
    begins: Vector
    began: Vector


def move(c: LiveTable, clock: float) -> None:
    """Has the params be what they are at run time `clock` [s].

    That follows from when each was set, so a tick that is made twice finds the same values. On
    its way v = v_0 ± most (clock - began), and its rate is ± most; at its target it is at rest.
    """
    values, rates, targets, begins, began = c.values, c.rates, c.targets, c.begins, c.began
    most = c.most
    for i in range(c.n):
        way = targets[i] - begins[i]
        done = most[i] * (clock - began[i])
        if most[i] == 0.0 or abs(way) <= done:
            values[i] = targets[i]
            rates[i] = 0.0
        elif way > 0.0:
            values[i] = begins[i] + done
            rates[i] = most[i]
        else:
            values[i] = begins[i] - done
            rates[i] = -most[i]


def request(c: LiveTable, i: int, value: float, clock: float) -> float:
    """Sets param `i` from the tick after the one at run time `clock` [s] on.

    The value that it goes to: the nearest one within its bounds. One that it goes to already
    changes nothing, so whoever sets it before every tick sets it once.
    """
    targets, begins, began = c.targets, c.begins, c.began
    wanted = min(max(value, c.low[i]), c.high[i])
    if wanted != targets[i]:
        begins[i] = c.values[i]
        began[i] = clock
        targets[i] = wanted
    return wanted


def declare(c: LiveTable, i: int, value: float) -> float:
    """Has a run that has not begun begin with another value of param `i`; else as `request`."""
    values, targets, begins = c.values, c.targets, c.begins
    wanted = min(max(value, c.low[i]), c.high[i])
    values[i] = wanted
    begins[i] = wanted
    targets[i] = wanted
    return wanted


class LiveParams:
    """The params of a run that may be set between ticks.

    Attributes:
        table: what ticks read and write.
    """

    def __init__(
        self, params: Mapping[str, LiveParam], now: NDArray[np.float64], first: int
    ) -> None:
        """Begins with the declared values.

        Args:
            params: by name, in the order of their slots.
            now: the input of a tick that has their values from `first` on, then their rates.
            first: where.
        """
        self._places = {name: i for i, name in enumerate(params)}
        self._now, n = now, len(params)
        each = params.values()
        declared = np.array([p.value for p in each], dtype=np.float64)
        self.table = LiveTable(
            n=n,
            values=now[first : first + n],
            rates=now[first + n : first + 2 * n],
            low=np.array([p.low for p in each], dtype=np.float64),
            high=np.array([p.high for p in each], dtype=np.float64),
            most=np.array([p.rate for p in each], dtype=np.float64),
            targets=declared.copy(),
            begins=declared.copy(),
            began=np.zeros(n),
        )

    def renew(self) -> None:
        """Has them be as they are declared, in a run that begins; `now` is as it is at a start."""
        table = self.table
        for array in (table.targets, table.begins):
            np.asarray(array)[:] = table.values
        np.asarray(table.began)[:] = 0.0

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(self._places)

    @property
    def names(self) -> tuple[str, ...]:
        """Their names, in the order of their slots."""
        return tuple(self._places)

    def __getitem__(self, name: str) -> float:
        """The value of a param in the last tick [SI].

        Raises:
            KeyError: there is none of that name that may be set.
        """
        return self.table.values[self._place(name)]

    def target(self, name: str) -> float:
        """What a param was last set to [SI]; a KeyError as above."""
        return self.table.targets[self._place(name)]

    def set(self, name: str, value: float) -> float:
        """Sets a param from the next tick on, at its rate where it has one.

        Args:
            name: of the param.
            value: that it is to have [SI].

        Returns:
            What it goes to: the nearest value within its bounds.

        Raises:
            KeyError: there is none of that name that may be set.
            ValueError: the value is not a number.
        """
        return request(self.table, *self._number(name, value), float(self._now[1]))

    def start(self, name: str, value: float) -> float:
        """Has a run that has not begun begin with another value; else as `set`."""
        return declare(self.table, *self._number(name, value))

    def move(self, clock: float) -> None:
        """Has them be what they are at run time `clock` [s]."""
        move(self.table, clock)

    def _number(self, name: str, value: float) -> tuple[int, float]:
        i = self._place(name)
        if math.isnan(value):
            raise ValueError(f"'{name}' cannot be set to what is not a number")
        return i, float(value)

    def _place(self, name: str) -> int:
        if name not in self._places:
            known = suggestion(name, self._places, "it has") if self._places else "it has none"
            raise KeyError(f"the task has no live param '{name}'; {known}")
        return self._places[name]
