"""The column map: which column of a log is which signal, in which unit, and with which sign."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field, ValidationError

from taskspec.deferred_methods import dataclass
from taskspec.expression.syntax import unknown_unit
from taskspec.spec.field_type import FieldType
from taskspec.spec.model import REPORTED, Model, short_form
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.quantities import Constant
from taskspec.text import nodes
from taskspec.text.characters import normal
from taskspec.text.data import Items, Map, Text, Whole, to_data
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.render import render
from taskspec.text.source import Source, Span
from taskspec.text.units import FREQUENCY, TIME, parse_unit
from taskspec.text.yaml import MAX_BYTES, read
from taskspec_runner.errors import InputError
from taskspec_runner.record.whole import open_regular

SCHEMA_FILE = "taskspec-columns-1.schema.json"


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
class _UnitName(FieldType):
    """A unit, such as `kN` or `deg/s`."""

    def read(self, value: object, context: ParseContext) -> str:
        text = value.node.value if isinstance(value, Text | Whole) else ""
        try:
            parse_unit(text)
        except ValueError:
            context.error("TS111", f"unknown unit '{text}'", span_of(value), unknown_unit(text))
        return text

    def json(self) -> dict[str, Any]:
        return {"type": "string", "description": "A unit, such as kN or deg/s"}


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


class SignalColumn(Model):
    """The column that holds a signal.

    Attributes:
        column: its name in the log.
        unit: of its values; None for the one that the log states.
        sign: -1 for a column of the opposite sign.
    """

    noun = "a column"
    example = "force.z: {column: Fz, unit: N, sign: -1}"
    short: ClassVar = _Column().json()
    column: Annotated[str, _Column()] = Field(title="Name in the log")
    unit: Annotated[str, _UnitName()] | None = Field(None, title="Unit of its values")
    sign: Annotated[int, _Sign()] = Field(1, title="-1 for a column of the opposite sign")

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """`Fz` is short for `{column: Fz}`."""
        return short_form(data, "column")


class TimeColumn(Model):
    """The column that holds the time.

    Attributes:
        column: its name; None for the time of the messages of an MCAP log.
        unit: of its values; None for the one that the log states.
        start: time of the log at which the task began, as the column counts [s]; None for its
            first sample.
    """

    noun = "a time"
    example = "time: {column: stamp, unit: ms}"
    short: ClassVar = _Column().json()
    column: Annotated[str, _Column()] | None = Field(None, title="Name in the log")
    unit: Annotated[str, _UnitName()] | None = Field(None, title="Unit of its values")
    start: Annotated[float, Constant(TIME)] | None = Field(None, title="When the task began")

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """`stamp` is short for `{column: stamp}`."""
        return short_form(data, "column")


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
        time: the column that holds the time.
        signals: signal to its column.
        stage: the column that names stages.
        stages: when each of them began, in place of such a column.
        gap: the longest time between two samples that is bridged [s]; None for ten ticks.
        rate: samples a second that the log is to have [Hz]; None for any.
    """

    noun = "a column map"
    time: TimeColumn | None = Field(None, title="The column that holds the time")
    signals: dict[str, SignalColumn] = Field({}, title="Signal to its column")
    stage: StageColumn | None = Field(None, title="The column that names stages")
    stages: list[StageTime] | None = Field(None, title="When each stage began")
    gap: Annotated[float, Constant(TIME, above=0)] | None = Field(
        None, title="Longest time between two samples that is bridged"
    )
    rate: Annotated[float, Constant(FREQUENCY, above=0)] | None = Field(
        None, title="Samples a second"
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
    """

    def __init__(self, map_: ColumnMap, name: str = "", root: nodes.Node | None = None) -> None:
        self.map, self.name, self._root = map_, name, root

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


def read_columns(path: Path | None) -> Columns:
    """The map of a file.

    Raises:
        InputError: it cannot be read or is wrong; the message names file, line and column.
    """
    if path is None:
        return Columns(ColumnMap())
    try:
        with open_regular(path) as file:
            content = file.read(MAX_BYTES + 1)
        text = normal(content.decode("utf-8"))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        place = f"byte {error.start}"
        raise InputError(f"cannot read {path}: it is not UTF-8 ({place})") from error
    name = str(path)
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
    return Columns(made, name, root)


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
    from taskspec.spec.schema import tidy

    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": "urn:taskspec:schema:columns:1",
        "title": "A column map of taskspec, for logs that were recorded elsewhere",
    }
    made = tidy(ColumnMap.model_json_schema())
    return json.dumps(head | {k: v for k, v in made.items() if k not in head}, indent=2) + "\n"
