"""`templates`: stages with params, and the stages that use them.

A stage that uses a template becomes, in the tree of the file, the stage that the template is with
the values of its params: everything behind the tree sees plain stages. Each part keeps its place,
in the template or in what the stage gives, and knows what led there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.expression import ExpressionError, parse
from taskspec.spec.field_type import FieldType
from taskspec.spec.names import why_not
from taskspec.spec.parse_context import ParseContext, kind_of
from taskspec.text import nodes
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.nodes import Mapping as MappingNode
from taskspec.text.nodes import Node, Scalar, Sequence
from taskspec.text.source import Span
from taskspec.text.spliced import reached, spliced
from taskspec.text.suggest import suggestion
from taskspec.text.yaml import MAX_EVENTS

register({"TS131": "an unknown template", "TS132": "a template that cannot be used"})

SECTION, USE, WITH, PARAMS = "templates", "use", "with", "params"
#: Keys of a stage that are gone when its template stands in its place.
_OWN = (USE, WITH)
#: Keys whose value is the name of a file: a word in it is no param.
_FILES = ("file",)


class Templates(FieldType):
    """Stages with params; they are read where they are used."""

    def read(self, value: object, context: ParseContext) -> Mapping[str, object]:
        """What is written."""
        if not isinstance(value, dict):
            context.error("TS022", f"'{SECTION}' is a mapping of names, this is {kind_of(value)}",
                          context.data.node.key_span(SECTION),
                          "write 'name: ' before each template")  # fmt: skip
            return {}
        return value

    def json(self) -> dict[str, Any]:
        """Describes a mapping of stages; a param may stand for any of their values."""
        names = {"type": "array", "items": {"type": "string"}}
        params = {
            "anyOf": [names, {"type": "object"}],
            "title": "Params of the template",
            "description": "Names, or a mapping of names to what they are by default",
        }
        each = {"type": "object", "properties": {PARAMS: params}}
        return {"type": "object", "additionalProperties": each}


@dataclass(frozen=True, slots=True)
class _Template:
    """A template of a file: its name, where that stands, its body, and its params."""

    name: str
    key: Scalar
    body: MappingNode
    params: Mapping[str, tuple[Scalar, Node | None]]


def expand(root: MappingNode, found: Diagnostics) -> None:
    """Puts templates in the place of the stages that use them.

    Args:
        root: the tree of a file, which is changed in place.
        found: where findings go.
    """
    section, stages = root.get(SECTION), root.get("stages")
    templates = _read(section, found) if isinstance(section, MappingNode) else {}
    use = _Uses(templates, found)
    for name, (key, stage) in stages.entries.items() if isinstance(stages, MappingNode) else ():
        if isinstance(stage, MappingNode):
            new = use.stage(name, stage)
            if new is not stage:
                assert isinstance(stages, MappingNode)
                stages.entries[name] = (key, new)
    use.warn_unused()


def _read(section: MappingNode, found: Diagnostics) -> dict[str, _Template | None]:
    """The templates by name; None for one that is wrong in itself."""
    templates: dict[str, _Template | None] = {}
    for name, (key, body) in section.entries.items():
        templates[name] = None
        if (reason := why_not(name, SECTION)) is not None:
            found.error("TS125", f"'{name}' cannot be the name of a template", key.span, reason)
        elif not isinstance(body, MappingNode):
            found.error("TS022", f"a template is a stage with params, this is {_kind(body)}",
                        nodes.pointer(body), f"{name}: {{params: {{level: 12 N}}, "
                        "axes: {z: {force: -level}}, time: 2 s}")  # fmt: skip
        elif USE in body.entries:
            found.error("TS132", f"the template '{name}' uses another one", body.key_span(USE),
                        "a template is written out; stages use templates")  # fmt: skip
        else:
            params = _params(name, body, found)
            templates[name] = None if params is None else _Template(name, key, body, params)
    return templates


def _params(
    name: str, body: MappingNode, found: Diagnostics
) -> dict[str, tuple[Scalar, Node | None]] | None:
    """The params of a template, each with where it is named and what it is by default."""
    given = body.get(PARAMS)
    pairs: Iterable[tuple[Node, Node | None]] = ()
    if isinstance(given, MappingNode):
        pairs = given.entries.values()
    elif isinstance(given, Sequence):
        pairs = ((item, None) for item in given.items)
    elif given is not None:
        message = f"'{PARAMS}' of a template are names, or a mapping of them, this is a text"
        found.error("TS022", message, nodes.pointer(given), f"{PARAMS}: {{level: 12 N}}")
        return None
    params: dict[str, tuple[Scalar, Node | None]] = {}
    for key, value in pairs:
        if not isinstance(key, Scalar):
            found.error("TS022", f"the name of a param is a word, this is {_kind(key)}",
                        nodes.pointer(key), f"{PARAMS}: [level, speed]")  # fmt: skip
            return None
        if (reason := why_not(key.value, PARAMS)) is not None:
            message = f"'{key.value}' cannot be the name of a param"
            found.error("TS125", message, key.span, reason)
            return None
        if key.value in params:
            found.error("TS126", f"'{key.value}' names two params of '{name}'", key.span,
                        "keep one of the two")  # fmt: skip
            return None
        if value is not None and isinstance(value, Scalar) and value.empty:
            hint = f"give it a default, or list names alone: {PARAMS}: [{key.value}]"
            found.error("TS011", f"the key '{key.value}' has no value", key.span, hint)
            return None
        params[key.value] = (key, value)
    return params


class _Uses:
    """Makes stages of templates, and takes note of what is used."""

    def __init__(self, templates: Mapping[str, _Template | None], found: Diagnostics) -> None:
        self._templates, self._found = templates, found
        self._used: dict[str, set[str]] = {}
        self._parts, self._unclear = 0, False

    def stage(self, name: str, stage: MappingNode) -> MappingNode:
        """The stage as it is without its template; the same one if it uses none."""
        used = stage.get(USE)
        if used is None:
            if WITH in stage.entries:
                self._unclear = True
                self._error(
                    "TS026",
                    "'with' without 'use'",
                    stage.key_span(WITH),
                    "'use' names the template that the values are for",
                )
                del stage.entries[WITH]
            return stage
        own = {key: entry for key, entry in stage.entries.items() if key not in _OWN}
        plain = MappingNode(stage.span, stage.flow, own, stage.broken)
        template = self._named(used)
        texts = None if template is None else self._values(template, stage, used.span)
        if template is None or texts is None:
            self._unclear = plain.broken = True
            return plain
        note = (f"used by the stage '{name}'", used.span)
        copied = _Copy(texts, note, self._used.setdefault(template.name, set()), self._found)
        body = copied.node(_without_params(template.body), "")
        assert isinstance(body, MappingNode)
        self._parts += copied.parts
        if not all(copied.readable.values()):
            plain.broken = True
            return plain
        if self._parts > MAX_EVENTS:
            message = f"templates come to more than {MAX_EVENTS} parts"
            self._error("TS009", message, used.span, "use them in fewer stages")
            return plain
        plain.entries = {**body.entries, **own}
        plain.broken = plain.broken or body.broken
        return plain

    def warn_unused(self) -> None:
        """Reports templates and params of them that nothing uses, of the file itself."""
        if self._unclear:
            return  # A stage that could not be made may be the one that uses them.
        for template in self._templates.values():
            if template is None or template.key.span.source:
                continue
            if template.name not in self._used:
                self._found.warning("TS130", f"nothing uses the template '{template.name}'",
                                    template.key.span, f"name it in a stage: {{use: "
                                    f"{template.name}}}, or leave it out")  # fmt: skip
                continue
            for param, (key, _) in template.params.items():
                if param not in self._used[template.name]:
                    message = f"nothing in the template '{template.name}' uses its param '{param}'"
                    self._found.warning("TS130", message, key.span, "use it by its bare name where "
                                        "a value stands, or leave it out")  # fmt: skip

    def _named(self, used: Node) -> _Template | None:
        if not isinstance(used, Scalar):
            self._error("TS022", f"'use' is the name of a template, this is {_kind(used)}",
                        nodes.pointer(used), "use: press, with: {level: 12 N}")  # fmt: skip
            return None
        if used.value not in self._templates:
            hint = suggestion(used.value, self._templates, "templates") or (
                f"the file has none; write it under '{SECTION}'"
            )
            self._error("TS131", f"unknown template '{used.value}'", nodes.pointer(used), hint)
            return None
        self._used.setdefault(used.value, set())
        return self._templates[used.value]

    def _values(
        self, template: _Template, stage: MappingNode, used: Span
    ) -> dict[str, Node] | None:
        """What stands for each param; None after reporting what is wrong."""
        given = stage.get(WITH)
        texts = {p: value for p, (_, value) in template.params.items() if value is not None}
        if given is not None and not isinstance(given, MappingNode):
            self._error("TS022", f"'with' is a mapping of params, this is {_kind(given)}",
                        nodes.pointer(given), "with: {level: 12 N}")  # fmt: skip
            return None
        sound = True
        for param, (key, value) in given.entries.items() if given is not None else ():
            if param in template.params:
                texts[param] = value
                sound = sound and not nodes.is_empty(value)
                continue
            message = f"the template '{template.name}' has no param '{param}'"
            hint = suggestion(param, template.params, "its params") or (
                f"it has none; name it there under '{PARAMS}'"
            )
            self._found.error("TS020", message, key.span, hint,
                              (("the template", template.key.span),))  # fmt: skip
            sound = False
        broken = given is not None and given.broken
        for param in template.params.keys() - texts.keys():
            sound = False
            if not broken:
                self._found.error(
                    "TS021",
                    f"the template '{template.name}' needs a value of '{param}'",
                    used,
                    f"with: {{{param}: ..}}",
                    (("a param without a default", template.params[param][0].span),),
                )
        for param, value in texts.items():
            if nodes.is_empty(value):
                entry = None if given is None else given.entries.get(param)
                place = used if entry is None else entry[0].span
                self._error("TS011", f"the key '{param}' has no value", place,
                            "give it a value or leave it out")  # fmt: skip
        return texts if sound else None

    def _error(self, code: str, message: str, span: Span | None, hint: str) -> None:
        self._found.error(code, message, span, hint)


class _Copy:
    """Copies the body of a template for one use."""

    def __init__(
        self,
        texts: Mapping[str, Node],
        note: tuple[str, Span],
        used: set[str],
        found: Diagnostics,
    ) -> None:
        self._texts, self._note, self._used, self._found = texts, note, used, found
        self.readable: dict[str, bool] = {}
        self._scalars = {name: text for name, text in texts.items() if isinstance(text, Scalar)}
        self.parts = 0

    def node(self, node: Node, key: str) -> Node:
        """A copy with params replaced; `key` is what it hangs on."""
        self.parts += 1
        if isinstance(node, Scalar):
            return self._scalar(node, key)
        span = node.span.reached(*self._note)
        if isinstance(node, Sequence):
            return Sequence(span, node.flow, [self.node(i, key) for i in node.items], node.broken)
        entries = {
            name: (self._placed(each, *self._note), self.node(value, name))
            for name, (each, value) in node.entries.items()
        }
        return MappingNode(span, node.flow, entries, node.broken)

    def _scalar(self, node: Scalar, key: str) -> Node:
        here = self._placed(node, *self._note)
        if node.value in self._texts:
            self._used.add(node.value)
            return self._given(self._texts[node.value], here.span)
        if key in _FILES:
            return here
        if not all([self._reads(name) for name in self._scalars if nodes.has_word(node, name)]):
            return here
        found = spliced(here, self._scalars, self._used)
        for name in self._texts.keys() - self._scalars.keys():
            if nodes.has_word(node, name):
                self._used.add(name)
                self.readable[name] = False
                value = self._texts[name]
                message = f"'{name}' is {_kind(value)} here, which cannot stand in an expression"
                hint = "let the param be the whole value, or give it a quantity or a word"
                self._found.error("TS132", message, here.span, hint,
                                  ((f"'{name}' is given here", nodes.pointer(value)),))  # fmt: skip
        return found

    def _reads(self, name: str) -> bool:
        """Whether what stands for a param can be read alone; if not, that is reported."""
        text = self._scalars[name]
        if text.value not in self.readable:
            self.readable[text.value] = True
            try:
                parse(text.value, "logic")
            except ExpressionError as error:
                self.readable[text.value] = False
                for each in error.problems:
                    place = text.origin.at(each.start, each.end)
                    self._found.error(each.code, each.message, place, each.hint)
        self._used.add(name)
        return self.readable[text.value]

    def _given(self, value: Node, place: Span) -> Node:
        """What a stage gives, where a param is the whole of a value."""
        self.parts += 1
        note = ("used by the template here", Span(place.line, place.column, place.end_line,
                                                 place.end_column, place.source))  # fmt: skip
        if isinstance(value, Scalar):
            return self._placed(value, *note)
        span = value.span.reached(*note)
        if isinstance(value, Sequence):
            items = [self._given(item, place) for item in value.items]
            return Sequence(span, value.flow, items, value.broken)
        entries = {
            name: (self._placed(each, *note), self._given(below, place))
            for name, (each, below) in value.entries.items()
        }
        return MappingNode(span, value.flow, entries, value.broken)

    def _placed(self, node: Scalar, words: str, place: Span) -> Scalar:
        return Scalar(node.value, node.plain, reached(node.origin, words, place), node.comment)


def _without_params(body: MappingNode) -> MappingNode:
    rest = {key: entry for key, entry in body.entries.items() if key != PARAMS}
    return MappingNode(body.span, body.flow, rest, body.broken)


def _kind(node: Node) -> str:
    if isinstance(node, Scalar):
        return "a text"
    return "a list" if isinstance(node, Sequence) else "a mapping"
