"""Fields that hold words: one of a few, a name given elsewhere, free text; and counts."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.expression.spelling import PARTS, VALUE_WORDS
from taskspec.spec.field_type import FieldType
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.text.codes import register
from taskspec.text.data import Items, Map, Real, Text, TruthValue, Whole
from taskspec.text.suggest import suggestion
from taskspec.text.units import alternatives

register({"TS025": "not one of the words that fit"})

ENDS = ("end", "fail")
"""Where a run may go instead of to a stage."""

_MEANT = {"yes": "true", "on": "true", "no": "false", "off": "false"}


@dataclass(frozen=True)
class Word(FieldType):
    """One of a few words.

    Attributes:
        words: the choice.
        what: what they are, in the singular.
        reserved: words of the language that are not supported yet.
        code: of the diagnostic for any other word.
        others: words that would have led to another model, for the hint.
    """

    words: tuple[str, ...]
    what: str
    reserved: tuple[str, ...] = ()
    code: str = "TS025"
    others: tuple[str, ...] = ()

    def read(self, value: object, context: ParseContext) -> str:
        """The word."""
        if not isinstance(value, Text):
            message = f"a word is needed here, this is {kind_of(value)}"
            context.error(
                "TS022", message, span_of(value), f"{self.what}s: {', '.join(self.words)}"
            )
            return self.words[0]
        word = str(value)
        if word in self.words:
            return word
        if word in self.reserved:
            context.unsupported(word, span_of(value))
            return self.words[0]
        known = self.words + self.others + self.reserved
        hint = suggestion(word, known, f"{self.what}s")
        if (meant := VALUE_WORDS.get(word.lower())) in known:
            hint = f"did you mean '{meant}'?"
        if self.what == "shape" and word.lower() in PARTS:
            hint = PARTS[word.lower()]
        context.error(self.code, f"unknown {self.what} '{word}'", span_of(value), hint)
        return self.words[0]

    def json(self) -> dict[str, Any]:
        """Lists the words."""
        return {"enum": list(self.words)}


@dataclass(frozen=True)
class Words(FieldType):
    """One of a few words, or a list of some of them.

    Attributes:
        word: what each of them can be.
    """

    word: Word

    def read(self, value: object, context: ParseContext) -> tuple[str, ...]:
        """The words in the order of the file."""
        entries = value if isinstance(value, Items) else [value]
        if isinstance(value, Items) and not value and not value.node.broken:
            context.error("TS023", "this list is empty", span_of(value))
        found: dict[str, None] = {}
        for entry in entries:
            before = len(context.diagnostics)
            word = self.word.read(entry, context)
            if len(context.diagnostics) > before:
                continue
            if word in found:
                context.error("TS023", f"'{word}' stands in this list twice", span_of(entry))
            found[word] = None
        return tuple(found)

    def json(self) -> dict[str, Any]:
        """Describes both forms."""
        items = self.word.json()
        listed = {"type": "array", "minItems": 1, "uniqueItems": True, "items": items}
        return {"anyOf": [items, listed]}


@dataclass(frozen=True)
class NameReference(FieldType):
    """The name of something that the file defines elsewhere.

    Attributes:
        names: all names that would do.
        what: what they are, in the singular.
        code: of the diagnostic for an unknown name.
        plural: what all of them are; `what` and an s if left out.
        unfit: what to say of any other name, with `{}` for it.
        instead: what to do about a name that exists but does not fit; empty for no advice.
        always: those of the names that every file has, for editors.
    """

    names: Callable[[ParseContext], dict[str, None]]
    what: str
    code: str
    plural: str = ""
    unfit: str = ""
    instead: Callable[[str, ParseContext], str] = lambda _name, _context: ""
    always: tuple[str, ...] = ()

    @property
    def _one(self) -> str:
        return f"{'an' if self.what[0] in 'aeio' else 'a'} {self.what}"

    def read(self, value: object, context: ParseContext) -> str:
        """The name."""
        if not isinstance(value, Text):
            message = f"the name of {self._one} is needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value))
        elif value not in (names := self.names(context)):
            hint = self.instead(value, context) or suggestion(
                value, names, self.plural or f"{self.what}s"
            )
            hint = hint or f"the file has no {self.plural or f'{self.what}s'}"
            message = self.unfit.format(value) or f"unknown {self.what} '{value}'"
            context.error(self.code, message, span_of(value), hint)
        return str(value)

    def json(self) -> dict[str, Any]:
        """Describes the name."""
        others = f", or {alternatives(self.always)}" if self.always else ""
        found: dict[str, Any] = {"description": f"The name of {self._one}{others}"}
        name = {"type": "string"}
        return found | ({"anyOf": [{"enum": list(self.always)}, name]} if self.always else name)


@dataclass(frozen=True)
class Free(FieldType):
    """Any text.

    Attributes:
        form: in words, what it has to be.
        matches: whether it is of that form.
        pattern: the form for editors.
        filled: it may not be empty.
    """

    form: str = ""
    matches: Callable[[str], bool] | None = None
    pattern: str = ""
    filled: bool = False

    def read(self, value: object, context: ParseContext) -> str:
        """The text."""
        if not isinstance(value, Text):
            message = f"a text is needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), "put it in quotes")
            return ""
        if self.filled and not value.strip():
            context.error("TS022", "this text is empty", span_of(value))
        if self.matches is not None and not self.matches(value):
            near = re.sub(r"[^a-z0-9]+", "-", value.lower()).strip("-")
            hint = f"write '{near}'" if near != value and self.matches(near) else ""
            context.error("TS125", f"'{value}' is not {self.form}", span_of(value), hint)
        return str(value)

    def json(self) -> dict[str, Any]:
        """Describes the text."""
        return {"type": "string"} | ({"pattern": self.pattern} if self.pattern else {})


@dataclass(frozen=True)
class Texts(FieldType):
    """Names, each with a text, a number or a truth value, taken as it is written.

    Attributes:
        what: one of them, with its article.
        example: of all.
    """

    what: str
    example: str

    def read(self, value: object, context: ParseContext) -> dict[str, str]:
        """The texts by name."""
        if not isinstance(value, Map):
            message = f"names with their values are needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), f"such as {self.example}")
            return {}
        found = {}
        for name, each in value.items():
            if isinstance(each, Map | Items):
                message = f"{self.what} is a text or a number, this is {kind_of(each)}"
                context.error("TS022", message, span_of(each), f"such as {self.example}")
            elif isinstance(each, Text | Whole | Real | TruthValue):
                found[name] = each.node.value
        return found

    def json(self) -> dict[str, Any]:
        """Describes the mapping."""
        return {
            "type": "object",
            "additionalProperties": {"type": ["string", "number", "boolean"]},
        }


@dataclass(frozen=True)
class Count(FieldType):
    """A whole number of at least one."""

    def read(self, value: object, context: ParseContext) -> int:
        """The number."""
        if not isinstance(value, Whole):
            message = f"a whole number is needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), "such as 3, without a unit")
            return 1
        if value < 1:
            context.error("TS118", "this has to be at least 1", span_of(value), "such as 3")
        return int(value)

    def json(self) -> dict[str, Any]:
        """Describes the number."""
        return {"type": "integer", "minimum": 1}


@dataclass(frozen=True)
class Switch(FieldType):
    """`true` or `false`."""

    def read(self, value: object, context: ParseContext) -> bool:
        """The truth value."""
        if isinstance(value, TruthValue):
            return value.value
        message = f"true or false is needed here, this is {kind_of(value)}"
        hint = f"write '{_MEANT[value]}'" if isinstance(value, Text) and value in _MEANT else ""
        context.error("TS022", message, span_of(value), hint)
        return False

    def json(self) -> dict[str, Any]:
        """Describes the switch."""
        return {"type": "boolean"}
