"""Values given beside the file, such as by `--set`."""

from __future__ import annotations

from collections.abc import Mapping

from taskspec.spec.alias import SAME
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.nodes import Mapping as MappingNode
from taskspec.text.nodes import Node, Scalar, Sequence
from taskspec.text.origin import Origin
from taskspec.text.source import OVERRIDES, Source, Span
from taskspec.text.suggest import suggestion
from taskspec.text.yaml import read

register({"TS027": "an override of something that the task does not have"})

NAMED_BY_FILES = ("params", "world", "frames", "templates", "stages", "expect")
"""Sections whose keys the file invents: an override changes what is there, it adds nothing."""

_BY_PATH = ("vary", "truth")
"""Sections whose keys are paths."""

WITH_ALIASES = ("world", "robot", "stages")
"""Sections in which a value may be written by several keys, of which the override's is kept."""

SHORT_FORMS = {"law": "kind", "within": "time"}
"""What the short form of a key stands for, so that another part of it can be set."""


class Overrides:
    """Changes of a file's tree.

    Attributes:
        source: the text in which the changes are shown.
    """

    def __init__(
        self, overrides: Mapping[str, str], keys: tuple[str, ...], found: Diagnostics
    ) -> None:
        """Reads the values.

        Args:
            overrides: dotted path, or the bare name of a param, to YAML text.
            keys: the keys that a task may have.
            found: where findings go.
        """
        pairs = [(_one_line(path), _one_line(text)) for path, text in overrides.items()]
        self.source = Source(OVERRIDES, "\n".join(f"{path}={text}" for path, text in pairs))
        self._keys, self._found = keys, found
        self._values: list[tuple[Scalar, Node]] = []
        for number, (path, text) in enumerate(pairs, 1):
            value = _value(text, number, len(path) + 1, found)
            span = Span(number, 1, number, max(len(path), 1) + 1, OVERRIDES)
            if value is not None:
                self._values.append((Scalar(path, True, Origin(span, path, path)), value))

    def apply(self, root: MappingNode, *, templates: bool) -> None:
        """Changes a tree in place.

        Args:
            root: the tree.
            templates: whether templates, and what stages give them, are changed, or all else.
        """
        for key, value in self._values:
            steps = steps_of(root, key.value, value, self._keys)
            if _of_templates(steps) is templates:
                _put(root, key, steps, value, self._keys, self._found)


def _of_templates(steps: list[str]) -> bool:
    return steps[0] == "templates" or (steps[0] == "stages" and steps[2:3] in (["use"], ["with"]))


def _one_line(text: str) -> str:
    return " ".join(text.split())


def steps_of(root: MappingNode, path: str, value: Node | None, keys: tuple[str, ...]) -> list[str]:
    """The keys that lead to what an override names.

    Args:
        root: the tree of a task.
        path: of the override, or the bare name of a param.
        value: of the override.
        keys: the keys that a task may have.
    """
    steps = path.split(".")
    params = root.get("params")
    if isinstance(params, MappingNode) and steps[0] not in keys:
        live = isinstance(params.get(steps[0]), MappingNode)
        steps = ["params", *steps] if live or len(steps) == 1 else steps
    if isinstance(params, MappingNode) and steps[0] == "params" and len(steps) == 2:
        live = isinstance(params.get(steps[1]), MappingNode)
        # A lone quantity is where a live param begins.
        return [*steps, "value"] if live and isinstance(value, Scalar) else steps
    if steps[0] in _BY_PATH and len(steps) > 2:
        return [steps[0], ".".join(steps[1:])]
    return steps


def _value(text: str, line: int, shift: int, found: Diagnostics) -> Node | None:
    """Reads one value; what is wrong with it is shown in the line that the override has."""
    inner = Diagnostics(OVERRIDES)
    node = read(Source(OVERRIDES, text), inner, inner=True)
    for d in inner.sorted():
        span = _moved(d.span, line, shift) if d.span else Span(line, 1, line, shift, OVERRIDES)
        found.error(d.code, d.message, span, d.hint)
    if node is not None:
        _shift(node, line, shift)
    elif not len(inner):
        span = Span(line, 1, line, shift + 1, OVERRIDES)
        found.error("TS011", "an override without a value", span, "write it after '='")
    return node


def _moved(span: Span, line: int, shift: int) -> Span:
    return Span(line, span.column + shift, line, span.end_column + shift, OVERRIDES)


def _shift(node: Node, line: int, shift: int) -> None:
    if isinstance(node, Scalar):
        o = node.origin
        node.origin = Origin(_moved(o.span, line, shift), o.value, o.raw, o.skip)
        return
    node.span = _moved(node.span, line, shift)
    below = node.items if isinstance(node, Sequence) else [
        part for entry in node.entries.values() for part in entry]  # fmt: skip
    for part in below:
        _shift(part, line, shift)


def _put(
    root: MappingNode,
    key: Scalar,
    steps: list[str],
    value: Node,
    keys: tuple[str, ...],
    found: Diagnostics,
) -> None:
    node: Node = root
    owner = root
    for depth, step in enumerate(steps):
        last = depth == len(steps) - 1
        if depth and isinstance(node, Scalar) and steps[depth - 1] in SHORT_FORMS:
            node = _full(owner, steps[depth - 1], node)
        if isinstance(node, Sequence):
            if not (step.isdigit() and int(step) < len(node.items)):
                _unknown(key, step, [str(i) for i in range(len(node.items))], found)
                return
            if last:
                node.items[int(step)] = value
                return
            node = node.items[int(step)]
            continue
        if not isinstance(node, MappingNode):
            _unknown(key, step, [], found)
            return
        fixed = depth == 1 and steps[0] in NAMED_BY_FILES
        if step not in node.entries and (fixed or (depth == 0 and step not in keys)):
            known = list(node.entries) if fixed else list(keys)
            _unknown(key, step, known, found)
            return
        if last:
            if steps[0] in WITH_ALIASES:
                for other in SAME.get(step, ()):
                    node.entries.pop(other, None)
            old = node.entries.get(step)
            node.entries[step] = (old[0] if old else key, value)
            return
        below = node.get(step)
        if below is None:
            below = MappingNode(key.span, flow=True)
            node.entries[step] = (key, below)
        owner, node = node, below


def _full(owner: MappingNode, key: str, node: Scalar) -> MappingNode:
    """Writes `law: hybrid` as `law: {kind: hybrid}` so that a gain can be set."""
    full = MappingNode(node.span, flow=True, entries={SHORT_FORMS[key]: (node, node)})
    owner.entries[key] = (owner.entries[key][0], full)
    return full


def _unknown(key: Scalar, step: str, known: list[str], found: Diagnostics) -> None:
    start = len(key.value) - len(step) if key.value.endswith(step) else key.value.find(step)
    span = key.origin.at(max(start, 0), max(start, 0) + len(step))
    hint = suggestion(step, known, "known here")
    found.error("TS027", f"the task has no '{step}' to override", span, hint)
