"""Which column of a log is which signal: as a map says, else by the names that a run's log has."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.text.suggest import suggestion
from taskspec.text.units import NUMBER, UNITS, Dimension, describe, fitting_text, parse_unit
from taskspec_runner.errors import InputError
from taskspec_runner.export.messages import field_of
from taskspec_runner.record.history import STAGE
from taskspec_runner.recorded.column_map import Columns, SignalColumn, TimeColumn
from taskspec_runner.recorded.sample_texts import SampleTexts
from taskspec_runner.recorded.source import LogSource

Vector = NDArray[np.float64]

#: Names of a column of time that need no map.
_TIMES = ("clock", "time")
#: What a run's log counts anew in each stage, or that follows from the other columns.
_COUNTED = ("clock", "t", STAGE)
#: Fields of the messages of joints, by the signal of a joint.
_JOINTS = {"position": "position", "velocity": "velocity", "torque": "effort"}


@dataclass(frozen=True, slots=True)
class Assigned:
    """A signal and the samples of it.

    Attributes:
        name: of the signal.
        column: of the log.
        unit: of the column, empty for plain numbers.
        sign: by which it was multiplied.
        times: (n,) [s].
        values: (n,) as recorded, in the unit; NaN where there is none.
    """

    name: str
    column: str
    unit: str
    sign: int
    times: Vector
    values: Vector

    def si(self, values: Vector) -> Vector:
        """Some of the values, with the sign of the signal [SI]."""
        return in_si(values, self.unit) * self.sign + 0.0

    def as_data(self) -> dict[str, object]:
        """What a manifest keeps of it."""
        return {"column": self.column, "unit": self.unit, "sign": self.sign}


class _Named(NamedTuple):
    """A signal, its column, the column's unit, and a sign."""

    name: str
    column: str
    unit: str
    sign: int


class Assignment:
    """The columns of a log by the signals of a task."""

    def __init__(
        self, source: LogSource, columns: Columns, dimensions: Mapping[str, Dimension]
    ) -> None:
        """Takes a log and its map.

        Args:
            source: the log.
            columns: the map.
            dimensions: of every signal that a log of the task may have.
        """
        self._source, self._columns, self._dimensions = source, columns, dimensions
        self._times: Vector | None = None

    def signals(self) -> list[Assigned]:
        """Every signal that the log has.

        Raises:
            InputError: a column is missing, its unit is unknown or does not fit, or its values are
                no numbers.
        """
        columns, found = self._columns, list[_Named]()
        for name, said in columns.map.signals.items():
            if name not in self._dimensions or name in _COUNTED:
                hint = suggestion(name, self._dimensions, "signals")
                message = f"the task has no signal '{name}'; {hint}".rstrip("; ")
                raise columns.wrong(message, "signals", name, key=True)
            found.append(self._mapped(name, said))
        named = set(columns.map.signals)
        for name in self._dimensions:
            column = next((c for c in self._own(name) if c in self._source.units), None)
            if column is not None and name not in named and name not in _COUNTED:
                found.append(_Named(name, column, self._stated(column, name), 1))
        if not found:
            hint = self._names()
            raise InputError(
                f"{self._source.path}: no column is that of a signal; name them in a column map "
                f"(--columns). Its columns: {hint}"
            )
        values = self._source.numbers(list(dict.fromkeys(each.column for each in found)))
        return [self._assigned(each, values[each.column]) for each in found]

    def _mapped(self, name: str, said: SignalColumn) -> _Named:
        column = self._column(said.column, "signals", name, "column")
        dimension = self._dimensions[name]
        if said.unit is None:
            return _Named(name, column, self._stated(column, name), said.sign)
        own = parse_unit(said.unit).dimension
        if own != dimension:
            message = f"{name} is {describe(dimension)}, and {said.unit} is {describe(own)}"
            raise self._columns.wrong(message, "signals", name, "unit")
        return _Named(name, column, said.unit, said.sign)

    def _column(self, name: str, *path: str | int) -> str:
        """A column of the log by its name, with or without the unit behind it."""
        if name in self._source.units:
            return name
        bare = name.rpartition("[")[0].strip() or name
        if bare in self._source.units:
            return bare
        hint = suggestion(name, self._source.units, "columns") or f"columns: {self._names()}"
        raise self._columns.wrong(f"{self._source.path} has no column '{name}'; {hint}", *path)

    def _names(self) -> str:
        names = [*self._source.units]
        more = f" and {len(names) - 20} more" if len(names) > 20 else ""
        return ", ".join(names[:20]) + more

    def _stated(self, column: str, name: str) -> str:
        """The unit that the log states of a column."""
        unit, dimension = self._source.units[column], self._dimensions[name]
        remedy = f"say it in the map: {name}: {{column: {column}, unit: ...}}"
        if not unit:
            if dimension == NUMBER:
                return ""
            raise InputError(
                f"{self._source.path}: column '{column}' states no unit, and {name} is "
                f"{describe(dimension)}; {remedy} ({fitting_text(dimension)})"
            )
        try:
            own = parse_unit(unit).dimension
        except ValueError:
            raise InputError(
                f"{self._source.path}: the unit '{unit}' of column '{column}' is not known; "
                f"{remedy} ({' '.join(UNITS)})"
            ) from None
        if own != dimension:
            raise InputError(
                f"{self._source.path}: column '{column}' is in {unit}, which is {describe(own)}, "
                f"and {name} is {describe(dimension)}"
            )
        return unit

    def _assigned(self, named: _Named, values: Vector) -> Assigned:
        name, column, unit, sign = named
        infinite = np.isinf(values)
        if infinite.any():
            place = self._source.place(column, int(np.argmax(infinite)))
            raise InputError(f"{self._source.path}: '{column}' is not finite in {place}")
        if np.isnan(values).all() and name in self._columns.map.signals:
            raise InputError(f"{self._source.path}: column '{column}' has no value")
        return Assigned(name, column, unit, sign, self.times(column), values)

    def since(self) -> Assigned | None:
        """What a run's own log has of the time since a stage began; None where it has none."""
        column = next((c for c in self._own("t") if c in self._source.units), None)
        if column is None or not self._source.units[column]:
            return None
        named = _Named("t", column, self._stated(column, "t"), 1)
        return self._assigned(named, self._source.numbers([column])[column])

    def times(self, column: str) -> Vector:
        """(n,) times of the samples of a column, not yet from the start of the task on [s].

        Raises:
            InputError: the log has no column of time.
        """
        said = self._columns.map.time or TimeColumn()
        own = self._source.times(column)
        if own is not None:
            if said.column is not None:
                message = "an MCAP log has the time of its messages; leave 'column' out"
                raise self._columns.wrong(message, "time")
            return own
        if self._times is None:
            self._times = self._read_times(said)
        return self._times

    def _read_times(self, said: TimeColumn) -> Vector:
        if said.column is not None:
            column = self._column(said.column, "time", "column")
        else:
            column = next((c for c in _TIMES if c in self._source.units), "")
        if not column:
            raise InputError(
                f"{self._source.path}: no column is called {' or '.join(_TIMES)}; name the one of "
                f"the time in a column map (time: {{column: ..., unit: ...}}). Its columns: "
                f"{self._names()}"
            )
        unit = said.unit or self._stated(column, "clock")
        if parse_unit(unit).dimension != self._dimensions["clock"]:
            message = f"a time is needed here, and {unit} is {describe(parse_unit(unit).dimension)}"
            raise self._columns.wrong(message, "time", "unit")
        times = in_si(self._source.numbers([column])[column], unit)
        finite = np.isfinite(times)
        if not finite.all():
            place = self._source.place(column, int(np.argmin(finite)))
            raise InputError(f"{self._source.path}: there is no time in {place}")
        return times

    def place(self, column: str, row: int) -> str:
        """Where a sample stands, in words."""
        return self._source.place(column, row)

    def stages(self) -> tuple[str, Vector, SampleTexts] | None:
        """The column that names stages, its times [s] and the stage of each sample; None without.

        Raises:
            InputError: the map names a column that is missing.
        """
        said = self._columns.map.stage
        if said is not None:
            column, names = self._column(said.column, "stage", "column"), said.names
        elif self._columns.map.stages is None:
            column = next((c for c in (STAGE, "/signals.stage") if c in self._source.units), "")
            names = {}
        else:
            return None
        if not column:
            return None
        words = self._source.words(column)
        renamed = tuple(names.get(word, word) for word in words.names)
        return column, self.times(column), SampleTexts(renamed, words.codes)

    def _own(self, name: str) -> Iterator[str]:
        """What the project's own exports call a signal."""
        yield name
        yield f"/signals.{field_of(name)}"
        head, _, rest = name.partition(".")
        number, _, of = rest.partition(".")
        if head == "joint" and of in _JOINTS:
            yield f"/joint_states.{_JOINTS[of]}[{int(number) - 1}]"


def in_si(values: Vector, unit: str) -> Vector:
    """Values of a unit in SI; exact where the unit is a whole part of it, as 1 mm is of 1 m."""
    if not unit:
        return values
    scale = parse_unit(unit).scale
    inverse = round(1 / scale) if scale < 1 else 0
    if inverse and math.isclose(inverse * scale, 1.0, rel_tol=1e-15):
        return values / inverse
    return values * scale if scale != 1 else values
