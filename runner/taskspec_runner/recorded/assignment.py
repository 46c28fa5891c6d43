"""Which column of a log is which signal: as a map says, else by the names that a run's log has."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.text.suggest import suggestion
from taskspec.text.units import NUMBER, TIME, Dimension, describe, fitting_text
from taskspec_runner.errors import InputError
from taskspec_runner.export.messages import field_of
from taskspec_runner.record.history import STAGE
from taskspec_runner.recorded.column_map import (
    LINE,
    PER_LINE,
    Columns,
    Offset,
    SignalColumn,
    TimeColumn,
    WrenchAxes,
)
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


class _Taken(NamedTuple):
    """A column that is taken for a signal; see `Assigned`."""

    name: str
    column: str
    unit: str
    sign: int = 1
    scale: float = 1.0
    frame: WrenchAxes | None = None


@dataclass(frozen=True, slots=True)
class Assigned:
    """A signal and the samples of it.

    Attributes:
        name: of the signal.
        column: of the log.
        unit: of the column, empty for plain numbers.
        sign, scale: by which it was multiplied.
        frame: axes of a force or moment; None for those of the stage's frame.
        offset: what was subtracted before the sign counts [SI].
        stamps: when they were recorded.
        values: (n,) as recorded, one for each of the times; NaN where there is none.
    """

    name: str
    column: str
    unit: str
    sign: int
    scale: float
    frame: WrenchAxes | None
    offset: float
    stamps: Stamps
    values: Vector

    @property
    def times(self) -> Vector:
        """(n,) [s]."""
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
        columns, found = self._columns, list[_Taken]()
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
                found.append(_Taken(name, own, self._stated(own, name), frame=self._axes(name)))
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
        joint = self._joint(name)
        if name not in self._columns.required and not self._matching(said.column, joint):
            return None
        return self._column(said.column, joint, "signals", name, "column")

    def _mapped(self, name: str, column: str, said: SignalColumn) -> _Taken:
        dimension = self._dimensions[name]
        scale = self._scale(said.scale, "signals", name, "scale")
        made = _Taken(name, column, "", said.sign, scale, said.frame)
        if said.frame is None:
            made = made._replace(frame=self._axes(name))
        elif not is_wrench(name):
            message = f"{name} has no axes of its own; 'frame' is of measured forces and moments"
            raise self._columns.wrong(message, "signals", name, "frame", key=True)
        if said.unit is None:
            return made._replace(unit=self._stated(column, name))
        unit = said.unit
        if unit.startswith(LINE):
            unit = self._line(unit.removeprefix(LINE), "signals", name, "unit")
        try:
            own = column_unit(unit).dimension
        except ValueError:
            message = f"the unit '{unit}' of {said.unit} is not known ({known_units()})"
            raise self._columns.wrong(message, "signals", name, "unit") from None
        if own != dimension:
            message = f"{name} is {describe(dimension)}, and {unit} is {describe(own)}"
            raise self._columns.wrong(message, "signals", name, "unit")
        return made._replace(unit=unit)

    def _scale(self, said: float | str, *path: str | int) -> float:
        """A factor; one that stands in a line above the columns is read from there."""
        if not isinstance(said, str):
            return said
        text = self._line(said.removeprefix(PER_LINE).removeprefix(LINE), *path)
        try:
            value = float(text)
            return 1 / value if said.startswith(PER_LINE) else value
        except (ValueError, ZeroDivisionError):
            message = f"'{text}' in the line that it is read from is no factor"
            raise self._columns.wrong(f"{self._source.path}: {message}", *path) from None

    def _line(self, name: str, *path: str | int) -> str:
        """What a line above the columns says."""
        lines = self._source.lines
        if name not in lines:
            hint = suggestion(name, lines, "lines") or "it begins with the names of its columns"
            message = f"{self._source.path} has no line '{name}' above its columns; {hint}"
            raise self._columns.wrong(message, *path)
        return lines[name]

    def _axes(self, name: str) -> WrenchAxes | None:
        """The axes that the map states for all forces and moments."""
        return self._columns.map.frame if is_wrench(name) else None

    def _joint(self, name: str) -> str:
        """What the robot calls the joint of a signal such as `joint.2.position`."""
        head, _, rest = name.partition(".")
        number = rest.partition(".")[0]
        known = head == "joint" and number.isdigit() and 0 < int(number) <= len(self._joints)
        return self._joints[int(number) - 1] if known else ""

    def _matching(self, wanted: str, joint: str = "") -> list[str]:
        """The columns of the log that a name may mean.

        With or without a unit behind it; with the index of an array, or the way to a field, in
        another spelling: `q[2]`, `q.2` and `q_2`, `/wrench.force.z` and `/wrench/force/z`.

        Args:
            wanted: the name, or several with | between them.
            joint: what the robot calls the joint that it is of.
        """
        known = self._source.units
        if wanted in known:
            return [wanted]
        for name in wanted.split(" | "):
            bare, _, behind = name.rpartition("[")
            if name in known:
                return [name]
            if bare.strip() in known and not behind.rstrip("]").isdigit():
                return [bare.strip()]
            pattern = _pattern(name, joint)
            found = [each for each in known if pattern.fullmatch(_spelled(each))]
            if found:
                return found
        return []

    def _column(self, name: str, joint: str, *path: str | int) -> str:
        """A column of the log by its name."""
        found = self._matching(name, joint)
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

    def _assigned(self, named: _Taken, values: Vector) -> Assigned:
        """A signal with its samples."""
        name, column = named.name, named.column
        infinite = np.isinf(values)
        if infinite.any():
            place = self._source.place(column, int(np.argmax(infinite)))
            raise InputError(f"{self._source.path}: '{column}' is not finite in {place}")
        if np.isnan(values).all() and name in self._columns.map.signals:
            raise InputError(f"{self._source.path}: column '{column}' has no value")
        stamps = self.stamps(column)
        made = Assigned(*named, 0.0, stamps, stamps.one_each(values))
        said = self._columns.map.signals.get(name)
        if said is not None and said.offset is not None:
            made = replace(made, offset=self._offset(made, said.offset))
        mirrored = self._mirrored and is_wrench(name)
        return replace(made, sign=-made.sign) if mirrored else made

    def _offset(self, signal: Assigned, offset: Offset) -> float:
        """What is to be subtracted from a signal before its sign counts [SI]."""
        name = signal.name
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
                message = f"{message}; write offset: {offset.value:g} {signal.unit}"
            raise self._columns.wrong(message, "signals", name, "offset")
        return float(in_si(np.array([offset.value]), offset.unit)[0])

    def numbers(self, names: Sequence[str]) -> list[Vector] | None:
        """(n,) values of columns as recorded, one for each time; None where the log lacks one."""
        found = [self._matching(name) for name in names]
        if any(len(each) != 1 for each in found):
            return None
        columns = [each[0] for each in found]
        values = self._source.numbers(columns)
        return [self.stamps(column).one_each(values[column]) for column in columns]

    def since(self) -> Assigned | None:
        """What a run's own log has of the time since a stage began; None where it has none."""
        column = next((c for c in self._own("t") if c in self._source.units), None)
        if column is None or not self._source.units[column]:
            return None
        named = _Taken("t", column, self._stated(column, "t"))
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
            columns = tuple(self._column(name, "", "time", "column") for name in said.column)
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
        read, scale = self._source.numbers([*columns]), self._scale(said.scale, "time", "scale")
        times: Vector | None = None
        for column, unit in zip(columns, units, strict=True):
            values = read[column]
            finite = np.isfinite(values)
            if not finite.all():
                place = self._source.place(column, int(np.argmin(finite)))
                raise InputError(f"{self._source.path}: there is no time in {place}")
            # The difference first: of a time since 1970 as it is, a double has too few digits.
            first = np.array(values[:1])
            since = in_si(values - first if first.any() else values, unit)
            since = since * scale if scale != 1 else since
            times = since if times is None else times + since
            self.origin += float(in_si(first, unit).sum()) * scale
        assert times is not None
        return times

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
            column, names = self._column(said.column, "", "stage", "column"), said.names
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
        if name in self._source.columns:
            yield self._source.columns[name]
        # A copy by another program may have lost what the file says of its columns.
        yield f"/signals.{field_of(name)}"
        head, _, rest = name.partition(".")
        number, _, of = rest.partition(".")
        if head == "joint" and of in _JOINTS:
            field = f"/joint_states.{_JOINTS[of]}"
            yield f"{field}[{self._joint(name)}]"
            # Their order is that of the sender; without names it has to be the robot's.
            if "/joint_states.name[0]" not in self._source.units:
                yield f"{field}[{int(number) - 1}]"


def is_wrench(name: str) -> bool:
    """Whether a signal is a part of a force or moment that was measured."""
    head, _, rest = name.partition(".")
    return head in _WRENCH and rest.partition(".")[2] in ("", "measured")


def _pattern(name: str, joint: str) -> re.Pattern[str]:
    """What the columns are spelled like that a name with * and {joint} means.

    Robots' files and drivers differ in how they spell a joint: `wrist1`, `ur5e_wrist_1_joint`.
    """
    words = re.findall(r"[a-z]+|\d+", joint.lower().removesuffix("_joint"))
    spelled = rf"(?:[A-Za-z0-9]+_)?{'_?'.join(words)}(?:_joint)?" if words else r"(?!)"
    parts = re.split(r"(\*|\{joint\})", _spelled(name.replace("[{joint}]", ".{joint}")))
    known = {"*": ".*", "{joint}": spelled}
    return re.compile("".join(known.get(part, re.escape(part)) for part in parts), re.DOTALL)


def _spelled(name: str) -> str:
    """A name in one spelling of indices and of ways to a field: `/q[2]` and `q_2` are `q.2`."""
    plain = re.sub(r"\[(\w+)\]", r".\1", name.strip()).replace("/", ".")
    return re.sub(r"_(\d+)\Z", r".\1", plain).strip(".")
