"""Which column of a log is which signal: as a map says, else by the names that a run's log has."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.text.suggest import suggestion
from taskspec.text.units import NUMBER, TIME, Dimension, describe, fitting_text
from taskspec_runner.errors import InputError
from taskspec_runner.export.messages import field_of
from taskspec_runner.record.history import STAGE
from taskspec_runner.recorded.column_map import Columns, SignalColumn, TimeColumn, WrenchAxes
from taskspec_runner.recorded.sample_texts import SampleTexts
from taskspec_runner.recorded.source import LogSource
from taskspec_runner.recorded.stamps import Stamps
from taskspec_runner.recorded.units import column_unit, in_si, known_units

Vector = NDArray[np.float64]

#: Names of columns of time that need no map: one, or seconds and nanoseconds.
_TIMES = (
    ("clock",),
    ("time",),
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("header.stamp.secs", "header.stamp.nsecs"),
)
#: What a run's log counts anew in each stage, or that follows from the other columns.
_COUNTED = ("clock", "t", STAGE)
#: Fields of the messages of joints, by the signal of a joint.
_JOINTS = {"position": "position", "velocity": "velocity", "torque": "effort"}
#: Signals that have axes, as forces do, and change their sign with whoever bears them.
_WRENCH = ("force", "torque")


@dataclass(frozen=True, slots=True)
class Assigned:
    """A signal and the samples of it.

    Attributes:
        name: of the signal.
        column: of the log.
        unit: of the column, empty for plain numbers.
        sign, scale: by which it was multiplied.
        offset: what was subtracted before the sign counts [SI].
        frame: axes of a force or moment; None for those of the stage's frame.
        stamps: when they were recorded.
        values: (n,) as recorded, one for each of the times; NaN where there is none.
    """

    name: str
    column: str
    unit: str
    sign: int = 1
    scale: float = 1.0
    offset: float = 0.0
    frame: WrenchAxes | None = None
    stamps: Stamps | None = None
    values: Vector | None = None

    @property
    def times(self) -> Vector:
        """(n,) [s]."""
        assert self.stamps is not None
        return self.stamps.times

    def si(self, values: Vector) -> Vector:
        """Some of the values as the signal has them: scale, offset, then sign [SI]."""
        found = in_si(values if self.scale == 1 else values * self.scale, self.unit)
        return (found - self.offset if self.offset else found) * self.sign + 0.0

    def as_data(self) -> dict[str, object]:
        """What a manifest keeps of it."""
        data: dict[str, object] = {"column": self.column, "unit": self.unit, "sign": self.sign}
        if self.scale != 1:
            data["scale"] = self.scale
        if self.offset:
            data["offset"] = self.offset
        if self.frame is not None:
            data["frame"] = self.frame.model_dump(exclude_defaults=True) | {"of": self.frame.of}
        return data


class Assignment:
    """The columns of a log by the signals of a task.

    Attributes:
        origin: the first time of a table, as its column counts [s]; times count from there.
    """

    def __init__(
        self,
        source: LogSource,
        columns: Columns,
        dimensions: Mapping[str, Dimension],
        joints: Sequence[str] = (),
        *,
        mirrored: bool = False,
    ) -> None:
        """Takes a log and its map.

        Args:
            source: the log.
            columns: the map.
            dimensions: of every signal that a log of the task may have.
            joints: names that the robot has for its joints.
            mirrored: whether forces and moments are taken with the opposite sign.
        """
        self._source, self._columns, self._dimensions = source, columns, dimensions
        self._joints, self._mirrored = joints, mirrored
        self._stamps: dict[int, Stamps] = {}
        self._times: Vector | None = None
        self.origin = 0.0

    def signals(self) -> list[Assigned]:
        """Every signal that the log has.

        Raises:
            InputError: a column is missing, its unit is unknown or does not fit, or its values are
                no numbers.
        """
        columns, found = self._columns, list[Assigned]()
        for name, said in columns.map.signals.items():
            if name not in self._dimensions or name in _COUNTED:
                if name not in columns.required:
                    continue
                hint = suggestion(name, self._dimensions, "signals")
                message = f"the task has no signal '{name}'; {hint}".rstrip("; ")
                raise columns.wrong(message, "signals", name, key=True)
            column = self._mapped_column(name, said)
            if column is not None:
                found.append(self._mapped(name, column, said))
        named = {each.name for each in found} | columns.required
        for name in self._dimensions:
            own = next((c for c in self._own(name) if c in self._source.units), None)
            if own is not None and name not in named and name not in _COUNTED:
                found.append(Assigned(name, own, self._stated(own, name), frame=self._axes(name)))
        if not found:
            what = "no column is that of a signal"
            if columns.map.signals:
                what = f"it has none of the columns of the map {columns.name}"
            raise InputError(
                f"{self._source.path}: {what}; name them in a column map (--columns). Its columns: "
                f"{self._names()}"
            )
        values = self._source.numbers(list(dict.fromkeys(each.column for each in found)))
        return [self._assigned(each, values[each.column]) for each in found]

    def _mapped_column(self, name: str, said: SignalColumn) -> str | None:
        """The column of a signal; None where the log has none and need not have it."""
        wanted = said.column.replace("{joint}", self._joint(name))
        if name not in self._columns.required and not self._matching(wanted):
            return None
        return self._column(wanted, "signals", name, "column")

    def _mapped(self, name: str, column: str, said: SignalColumn) -> Assigned:
        dimension = self._dimensions[name]
        made = Assigned(name, column, "", said.sign, said.scale, frame=said.frame)
        if said.frame is None:
            made = replace(made, frame=self._axes(name))
        elif name.partition(".")[0] not in _WRENCH:
            message = f"{name} has no axes of its own; 'frame' is of forces and moments"
            raise self._columns.wrong(message, "signals", name, "frame", key=True)
        if said.unit is None:
            return replace(made, unit=self._stated(column, name))
        own = column_unit(said.unit).dimension
        if own != dimension:
            message = f"{name} is {describe(dimension)}, and {said.unit} is {describe(own)}"
            raise self._columns.wrong(message, "signals", name, "unit")
        return replace(made, unit=said.unit)

    def _axes(self, name: str) -> WrenchAxes | None:
        """The axes that the map states for all forces and moments."""
        return self._columns.map.frame if name.partition(".")[0] in _WRENCH else None

    def _joint(self, name: str) -> str:
        """What the robot calls the joint of a signal such as `joint.2.position`."""
        head, _, rest = name.partition(".")
        number = rest.partition(".")[0]
        known = head == "joint" and number.isdigit() and 0 < int(number) <= len(self._joints)
        return self._joints[int(number) - 1] if known else ""

    def _matching(self, name: str) -> list[str]:
        """The columns of the log that a name may mean.

        With or without a unit behind it; with the index of an array, or the way to a field, in
        another spelling: `q[2]`, `q.2` and `q_2`, `/wrench.force.z` and `/wrench/force/z`.
        """
        known = self._source.units
        if name in known:
            return [name]
        bare = name.rpartition("[")[0].strip()
        if bare in known and not name.rpartition("[")[2].rstrip("]").isdigit():
            return [bare]
        parts = (re.escape(part) for part in _spelled(name).split("*"))
        pattern = re.compile(".*".join(parts), re.DOTALL)
        return [each for each in known if pattern.fullmatch(_spelled(each))]

    def _column(self, name: str, *path: str | int) -> str:
        """A column of the log by its name."""
        found = self._matching(name)
        if len(found) == 1:
            return found[0]
        if found:
            message = f"'{name}' may be {' or '.join(found[:6])}; name one of them"
            raise self._columns.wrong(f"{self._source.path}: {message}", *path)
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
        if name == "clock":
            remedy = f"say it in the map: time: {{column: {column}, unit: ...}}"
        if not unit:
            if dimension == NUMBER:
                return ""
            raise InputError(
                f"{self._source.path}: column '{column}' states no unit, and {name} is "
                f"{describe(dimension)}; {remedy} ({fitting_text(dimension)})"
            )
        try:
            own = column_unit(unit).dimension
        except ValueError:
            raise InputError(
                f"{self._source.path}: the unit '{unit}' of column '{column}' is not known; "
                f"{remedy} ({known_units()})"
            ) from None
        if own != dimension:
            raise InputError(
                f"{self._source.path}: column '{column}' is in {unit}, which is {describe(own)}, "
                f"and {name} is {describe(dimension)}"
            )
        return unit

    def _assigned(self, named: Assigned, values: Vector) -> Assigned:
        """A signal with its samples."""
        name, column = named.name, named.column
        infinite = np.isinf(values)
        if infinite.any():
            place = self._source.place(column, int(np.argmax(infinite)))
            raise InputError(f"{self._source.path}: '{column}' is not finite in {place}")
        if np.isnan(values).all() and name in self._columns.map.signals:
            raise InputError(f"{self._source.path}: column '{column}' has no value")
        stamps = self.stamps(column)
        made = replace(named, stamps=stamps, values=stamps.one_each(values))
        said = self._columns.map.signals.get(name)
        if said is not None and said.offset is not None:
            made = replace(made, offset=self._offset(made, said))
        mirrored = self._mirrored and name.partition(".")[0] in _WRENCH
        return replace(made, sign=-made.sign) if mirrored else made

    def _offset(self, signal: Assigned, said: SignalColumn) -> float:
        """What is to be subtracted from a signal before its sign counts [SI]."""
        offset, name = said.offset, signal.name
        assert offset is not None and signal.values is not None
        if offset.first is not None:
            count = int(np.searchsorted(signal.times, signal.times[0] + offset.first, "right"))
            rest = np.array(signal.values[:count])
            rest = rest[~np.isnan(rest)]
            if not len(rest):
                message = f"column '{signal.column}' has no value in its first {offset.first:g} s"
                raise self._columns.wrong(message, "signals", name, "offset")
            return float(in_si(np.array([rest.mean() * signal.scale]), signal.unit)[0])
        own = column_unit(offset.unit).dimension if offset.unit else NUMBER
        dimension = self._dimensions[name]
        if own != dimension and not (offset.value == 0 and not offset.unit):
            message = f"{name} is {describe(dimension)}, and its offset is {describe(own)}"
            if own == NUMBER:
                message = f"{message}; write offset: {offset.value:g} {said.unit or signal.unit}"
            raise self._columns.wrong(message, "signals", name, "offset")
        return float(in_si(np.array([offset.value]), offset.unit)[0])

    def since(self) -> Assigned | None:
        """What a run's own log has of the time since a stage began; None where it has none."""
        column = next((c for c in self._own("t") if c in self._source.units), None)
        if column is None or not self._source.units[column]:
            return None
        named = Assigned("t", column, self._stated(column, "t"))
        return self._assigned(named, self._source.numbers([column])[column])

    def stamps(self, column: str) -> Stamps:
        """When the samples of a column were recorded, since the log began.

        Raises:
            InputError: the log has no column of time, or its times do not rise.
        """
        said = self._columns.map.time or TimeColumn()
        times = self._source.times(column, said.column or ())
        what = str(self._source.path)
        if times is None:
            if self._times is None:
                self._times = self._read_times(said)
            times = self._times
        else:
            what = f"{what}, {column}"
            if said.unit is not None:
                message = "the messages of an MCAP log have stamps of ns; leave 'unit' out"
                raise self._columns.wrong(message, "time", "unit")
        if id(times) not in self._stamps:
            repeated = self._columns.map.repeated
            made = Stamps(times, lambda row: self._source.place(column, row), what, repeated)
            self._stamps[id(times)] = made
        return self._stamps[id(times)]

    def _read_times(self, said: TimeColumn) -> Vector:
        """(n,) times of the rows of a table, since the first one [s]."""
        columns: tuple[str, ...]
        if said.column is not None:
            columns = tuple(self._column(name, "time", "column") for name in said.column)
        else:
            known = (names for names in _TIMES if all(n in self._source.units for n in names))
            columns = next(known, ())
        if not columns:
            raise InputError(
                f"{self._source.path}: no column is called clock or time; name the one of "
                f"the time in a column map (time: {{column: ..., unit: ...}}). Its columns: "
                f"{self._names()}"
            )
        if len(columns) == 2:
            units = ["s", "ns"]
        else:
            units = [said.unit or self._stated(columns[0], "clock")]
            own = column_unit(units[0]).dimension
            if own != TIME:
                message = f"a time is needed here, and {units[0]} is {describe(own)}"
                raise self._columns.wrong(message, "time", "unit")
        read = self._source.numbers([*columns])
        times: Vector | float = 0.0
        for column, unit in zip(columns, units, strict=True):
            values = read[column]
            finite = np.isfinite(values)
            if not finite.all():
                place = self._source.place(column, int(np.argmin(finite)))
                raise InputError(f"{self._source.path}: there is no time in {place}")
            # The difference first: of a time since 1970 as it is, a double has too few digits.
            first = np.array([values[0]]) if len(values) else np.zeros(1)
            times = in_si(values - first, unit) + times
            self.origin += float(in_si(first, unit)[0])
        return np.asanyarray(times)

    def place(self, column: str, row: int) -> str:
        """Where a sample stands, in words; of several with one stamp the first."""
        return self.stamps(column).place(row)

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
        words, stamps = self._source.words(column), self.stamps(column)
        renamed = tuple(names.get(word, word) for word in words.names)
        codes = np.asanyarray(stamps.chosen(words.codes), dtype=np.int64)
        return column, stamps.times, SampleTexts(renamed, codes)

    def _own(self, name: str) -> Iterator[str]:
        """What the project's own exports call a signal."""
        yield name
        yield f"/signals.{field_of(name)}"
        head, _, rest = name.partition(".")
        number, _, of = rest.partition(".")
        if head == "joint" and of in _JOINTS:
            yield f"/joint_states.{_JOINTS[of]}[{self._joint(name)}]"


def _spelled(name: str) -> str:
    """A name in one spelling of indices and of ways to a field: `/q[2]` and `q_2` are `q.2`."""
    plain = re.sub(r"\[(\w+)\]", r".\1", name.strip()).replace("/", ".")
    return re.sub(r"_(\d+)\Z", r".\1", plain).strip(".")
