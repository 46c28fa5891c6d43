"""The column map: which column of a log is which signal, in which unit, sign and axes."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, ValidationError

from taskspec.deferred_methods import dataclass
from taskspec.expression.syntax import unknown_unit
from taskspec.regular_file import open_regular
from taskspec.spec.field_type import FieldType
from taskspec.spec.fields import RPY, XYZ
from taskspec.spec.model import REPORTED, Model, short_form
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.quantities import Constant
from taskspec.spec.words import Free, Switch, Word
from taskspec.text import nodes
from taskspec.text.characters import normal
from taskspec.text.data import Items, Map, Real, Text, Whole, to_data
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.render import render
from taskspec.text.source import Source, Span
from taskspec.text.suggest import suggestion
from taskspec.text.units import FREQUENCY, NUMBER, TIME, split_quantity, to_si
from taskspec.text.yaml import MAX_BYTES, read
from taskspec_runner.errors import InputError
from taskspec_runner.recorded.source import COMMA, POINT
from taskspec_runner.recorded.stamps import FIRST, LAST, MEAN
from taskspec_runner.recorded.units import column_unit

SCHEMA_FILE = "taskspec-columns-1.schema.json"
_READY = Path(__file__).parent / "maps"


#: Keys of a whole map that people write at a column.
_ELSEWHERE_IN_THE_MAP = {
    key: f"'{key}' stands at the top of the map, beside 'signals'"
    for key in ("repeated", "gap", "rate", "stage", "stages")
}
#: Groups of signals, and what people call them, with a signal of each.
_GROUPS = {
    group: signal
    for signal, groups in {
        "force.z": ("force", "forces", "wrench", "F"),
        "torque.rx": ("torque", "torques", "moment", "moments"),
        "position.z": ("position", "pose", "tcp", "xyz"),
        "position.rx": ("orientation", "rotation", "rpy"),
        "velocity.z": ("velocity", "twist"),
        "joint.1.position": ("joint", "joints", "q"),
    }.items()
    for group in groups
}
#: What stands before the name of a line above the columns, which has a unit or a factor.
LINE, PER_LINE = "line ", "1/line "
#: How several samples with the same stamp become one.
REPEATED = (LAST, FIRST, MEAN)


@dataclass(frozen=True)
class _Column(FieldType):
    """The name of a column, which may be a number where a log has no better one."""

    def read(self, value: object, context: ParseContext) -> str:
        if isinstance(value, Text | Whole) and value.node.value.strip():
            return value.node.value.strip()
        message = f"the name of a column is needed here, this is {kind_of(value)}"
        context.error("TS022", message, span_of(value), "put it in quotes")
        return ""

    def json(self) -> dict[str, Any]:
        return {"type": ["string", "integer"], "description": "The name of a column of the log"}


@dataclass(frozen=True)
class _Pair(FieldType):
    """The names of two columns."""

    def read(self, value: object, context: ParseContext) -> tuple[str, ...]:
        if isinstance(value, Items) and len(value) == 2:
            return tuple(_Column().read(each, context) for each in value)
        message = f"two columns are needed here, this is {kind_of(value)}"
        context.error("TS023", message, span_of(value), "such as [stamp.sec, stamp.nanosec]")
        return ()

    def json(self) -> dict[str, Any]:
        return {"type": "array", "items": _Column().json(), "minItems": 2, "maxItems": 2}


@dataclass(frozen=True)
class _TimeColumns(FieldType):
    """The name of a column of time, or of two: whole seconds, and nanoseconds beside them."""

    def read(self, value: object, context: ParseContext) -> tuple[str, ...]:
        if isinstance(value, Items):
            return _Pair().read(value, context)
        return (_Column().read(value, context),)

    def json(self) -> dict[str, Any]:
        described = "Seconds, and nanoseconds beside them"
        return {"anyOf": [_Column().json(), _Pair().json() | {"description": described}]}


@dataclass(frozen=True)
class _UnitName(FieldType):
    """A unit, such as `kN`, `lbf` or `deg/s`."""

    def read(self, value: object, context: ParseContext) -> str:
        text = value.node.value if isinstance(value, Text | Whole) else ""
        if text.startswith(LINE):
            return text
        try:
            column_unit(text)
        except ValueError:
            context.error("TS111", f"unknown unit '{text}'", span_of(value), _unit_hint(text))
        return text

    def json(self) -> dict[str, Any]:
        return {"type": "string", "description": "A unit, such as kN, lbf or deg/s"}


def _unit_hint(text: str) -> str:
    number, _, unit = text.strip().partition(" ")
    if re.fullmatch(r"[-+.\de]+", number) and unit:
        return f"a factor has a key of its own: unit: {unit}, scale: {number}"
    if text.lower() in ("count", "counts", "raw", "digit", "digits", "lsb"):
        return "name the unit that they are of, and what one of them is in it: unit: N, scale: 1e-6"
    return unknown_unit(text)


@dataclass(frozen=True)
class _Scale(FieldType):
    """A factor, or `1/line NAME`, `line NAME` for the number of a line above the columns."""

    def read(self, value: object, context: ParseContext) -> float | str:
        if isinstance(value, Text) and value.startswith((LINE, PER_LINE)):
            return str(value)
        found = Constant(NUMBER).read(value, context)
        if (
            found == 0
            and isinstance(value, Text | Whole | Real)
            and not context.diagnostics.has_errors
        ):
            context.error("TS118", "a scale of 0 leaves nothing", span_of(value))
        return found

    def json(self) -> dict[str, Any]:
        return {"type": ["number", "string"], "description": "A factor, such as 1e-6 or 1/7000"}


@dataclass(frozen=True, slots=True)
class Offset:
    """What is subtracted from a column.

    Attributes:
        value: a reading without a load, in `unit`; unless `first` says how to find it.
        unit: of the value, empty for a plain number.
        first: how long the mean of the log's first values is taken [s]; None for `value`.
    """

    value: float = 0.0
    unit: str = ""
    first: float | None = None


@dataclass(frozen=True)
class _Offset(FieldType):
    """A reading without a load, such as `20 N`; or `first 0.5 s`."""

    def read(self, value: object, context: ParseContext) -> Offset:
        if isinstance(value, Map) and [*value] == ["first"]:
            return Offset(first=float(Constant(TIME, above=0).read(value["first"], context)))
        text = value.node.value.strip() if isinstance(value, Text | Whole | Real) else ""
        head, _, rest = text.partition(" ")
        if head == "first":
            found = split_quantity(rest.strip())
            if found is not None and found[1]:
                time = to_si(*found)
                if time.dimension == TIME and time.value > 0:
                    return Offset(first=time.value)
            message = "'first' needs the time over which the mean is taken"
            context.error("TS112", message, span_of(value), "such as first 0.5 s")
            return Offset()
        match = re.fullmatch(r"([-+]?[\d.]+(?:e[-+]?\d+)?)\s*(.*)", text)
        try:
            unit = match[2] if match else ""
            if match and unit:
                column_unit(unit)
            if match:
                return Offset(float(match[1]), unit)
        except ValueError:
            context.error("TS111", f"unknown unit '{unit}'", span_of(value), _unit_hint(unit))
            return Offset()
        message = f"a reading without a load is needed here, this is {kind_of(value)}"
        context.error("TS022", message, span_of(value), "such as 20 N, or first 0.5 s")
        return Offset()

    def json(self) -> dict[str, Any]:
        described = "A reading without a load, such as 20 N; or first 0.5 s: the mean of these"
        return {"type": ["string", "number"], "description": described}


@dataclass(frozen=True)
class _Sign(FieldType):
    """1, or -1 for a column of the opposite sign."""

    def read(self, value: object, context: ParseContext) -> int:
        if isinstance(value, Whole) and value in (1, -1):
            return int(value)
        context.error("TS025", "a sign is 1 or -1", span_of(value))
        return 1

    def json(self) -> dict[str, Any]:
        return {"enum": [1, -1]}


@dataclass(frozen=True)
class _Names(FieldType):
    """What a column calls each stage."""

    def read(self, value: object, context: ParseContext) -> Mapping[str, str]:
        if not isinstance(value, Map):
            message = f"a mapping of the column's words to stages is needed, not {kind_of(value)}"
            context.error("TS022", message, span_of(value), "such as names: {1: approach}")
            return {}
        found = {}
        for word, stage in value.items():
            if isinstance(stage, Text):
                found[word] = str(stage)
            else:
                message = f"the name of a stage is needed here, this is {kind_of(stage)}"
                context.error("TS022", message, span_of(stage))
        return found

    def json(self) -> dict[str, Any]:
        return {"type": "object", "additionalProperties": {"type": "string"}}


#: Whose axes a wrench may be recorded in; `stage` are those of the frame of each stage.
AXES_OF = ("stage", "base", "tool", "flange", "sensor")


class WrenchAxes(Model):
    """The axes in which forces and moments were recorded, and the point of the moments.

    Attributes:
        of: whose axes: of the robot's base, the tool, the flange on which that is mounted, a sensor
            between the two, or the frame of each stage. Moments in axes of the flange or of a
            sensor are about its origin, all others about the tool's tip.
        rpy: how the recorded axes are turned against these [rad].
        xyz: where the origin of a sensor is from the flange, in the axes of the flange [m].
        tip: columns of x and y of the tool's tip in axes of a controller's base [m]. Where a log
            has them beside the joint positions, they show whether that base is turned by half a
            turn about z against the robot's, as those of some controllers are.
    """

    noun = "a frame of a wrench"
    example = "frame: base, or frame: {of: flange, rpy: [0, 0, 45 deg]}"
    short: ClassVar = {"enum": [*AXES_OF]}
    of: Annotated[Literal["stage", "base", "tool", "flange", "sensor"], Word(AXES_OF, "axes")] = (
        Field("stage", title="Whose axes")
    )
    rpy: RPY = Field((0.0, 0.0, 0.0), title="How the recorded axes are turned against these")
    xyz: XYZ = Field((0.0, 0.0, 0.0), title="Origin of the sensor in the axes of the flange")
    tip: Annotated[tuple[str, ...], _Pair()] | None = Field(
        None, title="Columns of the tip's x and y in axes of the controller's base"
    )

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """`base` is short for `{of: base}`."""
        return short_form(data, "of")

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """A sensor alone has a place, and a base a tip."""
        if "tip" in data and data.get("of") != "base":
            message = "'tip' shows how a controller's base is turned"
            context.error("TS026", message, data.node.key_span("tip"), "add of: base")
        if "xyz" in data and data.get("of") not in ("sensor", "flange"):
            message = "'xyz' is where a sensor is: moments in other axes are about the tool's tip"
            context.error("TS026", message, data.node.key_span("xyz"), "add of: sensor")


class SignalColumn(Model):
    """The column that holds a signal.

    Attributes:
        column: its name in the log, in which * stands for any text and {joint} for the name that
            the robot has for the joint of the signal; several with | between them, of which the
            first counts that the log has.
        unit: of its values; None for the one that the log states.
        sign: -1 for a column of the opposite sign.
        scale: factor from what is recorded to the unit: raw counts.
        offset: what is subtracted, after the scale and before the sign.
        frame: axes of a force or moment; None for those of the map.
    """

    noun = "a column"
    example = "force.z: {column: Fz, unit: N, sign: -1}"
    short: ClassVar = _Column().json()
    advice: ClassVar = _ELSEWHERE_IN_THE_MAP
    column: Annotated[str, _Column()] = Field(title="Name in the log")
    unit: Annotated[str, _UnitName()] | None = Field(None, title="Unit of its values")
    sign: Annotated[int, _Sign()] = Field(1, title="-1 for a column of the opposite sign")
    scale: Annotated[float | str, _Scale()] = Field(
        1.0, title="Factor", description="From what is recorded, such as counts, to the unit"
    )
    offset: Annotated[Offset, _Offset()] | None = Field(None, title="What is subtracted")
    frame: WrenchAxes | None = Field(None, title="Axes of a force or moment")

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """`Fz` is short for `{column: Fz}`."""
        return short_form(data, "column")


class TimeColumn(Model):
    """The column that holds the time.

    Attributes:
        column: its name, or those of seconds and nanoseconds; None for the time of the messages of
            an MCAP log. Of messages they are fields of each, such as `header.stamp.sec`.
        unit: of its values; None for the one that the log states.
        scale: factor from what is recorded to the unit, as of a counter.
        start: time of the log at which the task began, as the column counts [s]; None for its
            first sample.
    """

    noun = "a time"
    example = "time: {column: stamp, unit: ms}"
    short: ClassVar = _TimeColumns().json()
    advice: ClassVar = _ELSEWHERE_IN_THE_MAP
    column: Annotated[tuple[str, ...], _TimeColumns()] | None = Field(None, title="Name in the log")
    unit: Annotated[str, _UnitName()] | None = Field(None, title="Unit of its values")
    scale: Annotated[float | str, _Scale()] = Field(
        1.0, title="Factor", description="From what is recorded, such as a counter, to the unit"
    )
    start: Annotated[float, Constant(TIME)] | None = Field(None, title="When the task began")

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """`stamp` is short for `{column: stamp}`, and a list of two for both columns."""
        if not isinstance(data, Items):
            return short_form(data, "column")
        full = Map({"column": data})
        full.node = nodes.Mapping(data.node.span, flow=True)
        return full

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Two columns are seconds and nanoseconds."""
        if "unit" in data and isinstance(data.get("column"), Items):
            message = "two columns of a stamp are seconds and nanoseconds"
            context.error("TS026", message, data.node.key_span("unit"), "leave 'unit' out")


class StageColumn(Model):
    """The column that names the stage of each sample.

    Attributes:
        column: its name in the log.
        names: its words to the stages of the task; a word that is missing is the stage itself.
    """

    noun = "a column of stages"
    example = "stage: {column: phase, names: {1: approach, 2: press}}"
    short: ClassVar = _Column().json()
    column: Annotated[str, _Column()] = Field(title="Name in the log")
    names: Annotated[Mapping[str, str], _Names()] = Field({}, title="Its words for stages")

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """`phase` is short for `{column: phase}`."""
        return short_form(data, "column")


class StageTime(Model):
    """When a stage began.

    Attributes:
        stage: its name.
        at: time since the log begins [s].
    """

    noun = "the beginning of a stage"
    example = "- {stage: press, at: 1.2 s}"
    stage: Annotated[str, _Column()] = Field(title="Name of the stage")
    at: Annotated[float, Constant(TIME, least=0.0)] = Field(title="When it began")


class ColumnMap(Model):
    """Which column of a log is which signal.

    Attributes:
        about: what logs it is for.
        source: where their names, signs and axes are documented.
        assumes: the sign, the axes and what else it takes for granted.
        include: a ready map, to which this one adds.
        time: the column that holds the time.
        signals: signal to its column.
        frame: axes of forces and moments of which no column says its own; None for the frame of
            each stage.
        stage: the column that names stages.
        stages: when each of them began, in place of such a column.
        gap: the longest time between two samples that is bridged [s]; None for ten ticks.
        rate: samples a second that the log is to have [Hz]; None for any.
        repeated: which of several samples with one stamp counts; None for an error.
        header: line of a CSV file with the names of the columns; None to find it.
        decimal: what stands before the decimals of its numbers; None to find it.
        optional: whether signals are left out whose columns a log does not have.
    """

    noun = "a column map"
    advice: ClassVar = {
        "sign": "a sign belongs to a column: signals: {force.z: {column: Fz, sign: -1}}",
        "scale": "a scale belongs to a column: signals: {force.z: {column: Fz, scale: 1e-6}}",
        "offset": "an offset belongs to a column: "
        "signals: {force.z: {column: Fz, offset: first 0.5 s}}",
        "start": "a start belongs to the time: time: {column: stamp, start: 2.5 s}",
    }

    @classmethod
    def advice_on(cls, key: str, data: Map) -> str:
        """Signals and their groups stand under `signals`."""
        group = key.partition(".")[0]
        if group in _GROUPS:
            column = f"{_GROUPS[group]}: {{column: .., unit: ..}}"
            return f"signals stand one by one under 'signals': {column}"
        return super().advice_on(key, data)

    about: Annotated[str, Free()] = Field("", title="What logs it is for")
    source: Annotated[str, Free()] = Field("", title="Where their columns are documented")
    assumes: Annotated[str, Free()] = Field("", title="The sign and axes that it assumes")
    include: Annotated[str, Free(filled=True)] | None = Field(
        None, title="Ready map", description="One of taskspec judge --columns list, to add to"
    )
    time: TimeColumn | None = Field(None, title="The column that holds the time")
    signals: dict[str, SignalColumn] = Field({}, title="Signal to its column")
    frame: WrenchAxes | None = Field(None, title="Axes of forces and moments")
    stage: StageColumn | None = Field(None, title="The column that names stages")
    stages: list[StageTime] | None = Field(None, title="When each stage began")
    gap: Annotated[float, Constant(TIME, above=0)] | None = Field(
        None, title="Longest time between two samples that is bridged"
    )
    rate: Annotated[float, Constant(FREQUENCY, above=0)] | None = Field(
        None, title="Samples a second"
    )
    repeated: Annotated[Literal["last", "first", "mean"], Word(REPEATED, "choice")] | None = Field(
        None, title="Which of several samples with the same stamp counts"
    )
    header: Annotated[float, Constant(NUMBER, least=1)] | None = Field(
        None, title="Line of a CSV file with the names of the columns"
    )
    decimal: Annotated[Literal["point", "comma"], Word((POINT, COMMA), "mark")] | None = Field(
        None, title="What stands before the decimals in a CSV file"
    )
    optional: Annotated[bool, Switch()] = Field(
        False, title="Whether signals without a column in the log are left out"
    )

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Stages are found by one method."""
        if "stage" in data and "stages" in data:
            message = "'stages' beside 'stage': both say where stages begin"
            context.error("TS026", message, data.node.key_span("stages"), "leave one of them out")
        starts = data.get("stages")
        if isinstance(starts, Items) and not starts:
            context.error("TS023", "this list is empty", span_of(starts))


class Columns:
    """A column map and the text that it came from; of no file, what a log states by itself.

    Attributes:
        map: the map.
        name: of its file, empty without one.
        required: signals whose columns a log has to have.
    """

    def __init__(self, map_: ColumnMap, name: str = "", root: nodes.Node | None = None) -> None:
        self.map, self.name, self._root = map_, name, root
        self.required = frozenset(() if map_.optional else map_.signals)

    def wrong(self, message: str, *path: str | int, key: bool = False) -> InputError:
        """An error at a place of the file.

        Args:
            message: what is wrong.
            path: of keys.
            key: whether the key itself is wrong, and not its value.
        """
        if self._root is None:
            return InputError(message)
        return InputError(f"{_place(self.name, nodes.place(self._root, path, key=key))}: {message}")

    def including(self, ready: Columns) -> Columns:
        """This map with what it does not say itself taken from a ready one."""
        own, known = self.map, ready.map
        said = {key: getattr(own, key) for key in own.model_fields_set}
        # A signal that the file names has to be there, also where those of the ready map need not.
        said["signals"] = {**known.signals, **own.signals}
        self.map = known.model_copy(update=said)
        self.required = frozenset(own.signals) if known.optional else frozenset(said["signals"])
        return self


def read_columns(path: Path | None) -> Columns:
    """The map of a file, or a ready one by its name.

    Raises:
        InputError: it cannot be read or is wrong; the message names file, line and column.
    """
    if path is None:
        return Columns(ColumnMap())
    ready = ready_maps()
    if str(path) in ready and not path.exists():
        return _read(ready[str(path)], str(path))
    if not path.exists() and not path.suffix:
        hint = suggestion(str(path), ready, "ready maps")
        raise InputError(f"there is no column map {path}, neither a file nor a ready one; {hint}")
    return _read(path, str(path))


def ready_maps() -> dict[str, Path]:
    """The files of the column maps that come along, by their names."""
    return {path.stem: path for path in sorted(_READY.glob("*.yaml"))}


def _read(path: Path, name: str) -> Columns:
    try:
        with open_regular(path) as file:
            content = file.read(MAX_BYTES + 1)
        text = normal(content.decode("utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        place = f"byte {error.start}"
        raise InputError(f"cannot read {path}: it is not UTF-8 ({place})") from error
    found = Diagnostics(name)
    root = read(Source(name, text), found, inner=True)
    made = None
    if isinstance(root, nodes.Mapping):
        data = to_data(root, found)
        assert isinstance(data, Map)
        context = ParseContext(found, data)
        try:
            made = ColumnMap.model_validate(data, context=context)
        except ValidationError as error:
            for detail in error.errors(include_url=False, include_context=False):
                if detail["type"] != REPORTED:
                    _translate(detail["type"], detail["msg"], detail["loc"], root, context)
    elif not found.has_errors:
        raise InputError(f"{name}:1:1: a column map is a mapping, such as signals: {{force.z: Fz}}")
    if made is None or found.has_errors:
        said = render(found.sorted(), {name: Source(name, text)})
        raise InputError(f"the column map is wrong\n{said}")
    columns = Columns(made, name, root)
    if made.include is None:
        return columns
    ready = ready_maps()
    if made.include not in ready:
        hint = suggestion(made.include, ready, "ready maps")
        raise columns.wrong(f"there is no ready map '{made.include}'; {hint}", "include")
    return columns.including(_read(ready[made.include], made.include))


def _translate(
    kind: str,
    message: str,
    loc: tuple[str | int, ...],
    root: nodes.Mapping,
    context: ParseContext,
) -> None:
    if kind == "missing":
        _, depth = nodes.find(root, loc[:-1])
        hint = {"column": "such as column: Fz", "at": "such as at: 1.2 s"}.get(str(loc[-1]), "")
        where = f"'{loc[-2]}'" if len(loc) > 1 and isinstance(loc[-2], str) else "this entry"
        context.error(
            "TS021", f"{where} needs the key '{loc[-1]}'", nodes.place(root, loc[:depth]), hint
        )
        return
    words = {
        "dict_type": ("this is a mapping of names", "write 'name: ' before each entry"),
        "list_type": ("this is a list", "such as [{stage: press, at: 1.2 s}]"),
    }
    said, hint = words.get(kind, (f"this does not fit: {message}", ""))
    context.error("TS022", said, nodes.place(root, loc), hint)


def _place(name: str, span: Span) -> str:
    return f"{name}:{span.line}:{span.column}"


def schema_text() -> str:
    """The JSON Schema of column maps, as the text of its file."""
    from taskspec.schema import tidy

    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "urn:taskspec:schema:columns:1",
        "title": "A column map of taskspec, for logs that were recorded elsewhere",
    }
    made = tidy(ColumnMap.model_json_schema())
    return json.dumps(head | {k: v for k, v in made.items() if k not in head}, indent=2) + "\n"
