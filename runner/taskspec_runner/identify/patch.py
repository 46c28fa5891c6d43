"""A task file with other values; its comments and its layout stay."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import yaml

from taskspec_runner.errors import InputError

#: Other words for an orientation, which it takes the place of.
_INSTEAD = {"rpy": ("normal", "axis")}


def patched(text: str, values: Mapping[Sequence[str], str]) -> str:
    """A text with values put at keys; what is not there yet is added.

    Args:
        text: of a task file.
        values: text of each value by the keys that lead to it.

    Raises:
        InputError: a key leads through something that has no keys.
    """
    for path, value in values.items():
        text = _put(text, tuple(path), value)
    return text


def _put(text: str, path: tuple[str, ...], value: str) -> str:
    root = yaml.compose(text, Loader=yaml.SafeLoader)
    if not isinstance(root, yaml.MappingNode):
        raise InputError("the file is no mapping, so nothing can be put into it")
    owner, depth = root, 0
    while depth < len(path):
        entry = _entry(owner, path[depth])
        if entry is None:
            return _added(text, root, owner, path[depth:], value)
        key, below = entry
        if depth == len(path) - 1:
            name = path[depth] if key.value != path[depth] else None
            return _replaced(text, key, below, value, name)
        if not isinstance(below, yaml.MappingNode):
            kept = _short(text, below)
            if kept is None:
                raise InputError(f"'{'.'.join(path[: depth + 1])}' has no keys, so '{path[-1]}' has "
                                 "no place there; give the values by --set")  # fmt: skip
            return _put(_replaced(text, key, below, kept, None), path, value)
        owner, depth = below, depth + 1
    return text


def _entry(owner: yaml.MappingNode, name: str) -> tuple[yaml.Node, yaml.Node] | None:
    for key, below in owner.value:
        if key.value in (name, *_INSTEAD.get(name, ())):
            return key, below
    return None


def _short(text: str, node: yaml.Node) -> str | None:
    """What an empty value becomes where keys are put below it; None where it says something."""
    return "{}" if isinstance(node, yaml.ScalarNode) and not text[_start(node) : _end(node)] else None


def _replaced(
    text: str, key: yaml.Node, old: yaml.Node, value: str, name: str | None
) -> str:
    """A text with another value at a key, and another name of the key."""
    start, end = _start(old), _end(old)
    if not isinstance(old, yaml.ScalarNode) and not old.flow_style:
        # A list below its key goes up into the line of that.
        start = text.index(":", key.end_mark.index) + 1
        value = f" {value}"
    text = text[:start] + value + text[end:]
    if name is not None:
        text = text[: key.start_mark.index] + name + text[key.end_mark.index :]
    return text


def _added(
    text: str, root: yaml.MappingNode, owner: yaml.MappingNode, path: Sequence[str], value: str
) -> str:
    """A text with a new key in a mapping."""
    for name in reversed(path[1:]):
        value = f"{{{name}: {value}}}"
    line = f"{path[0]}: {value}"
    if owner.flow_style:
        end = owner.end_mark.index - 1
        if not owner.value:
            return text[:end] + line + text[end:]
        last = _end(owner.value[-1][1])
        return text[:last] + f", {line}" + text[last:]
    if not owner.value:
        return text + ("" if text.endswith("\n") or not text else "\n") + line + "\n"
    column = owner.value[0][0].start_mark.column
    # Behind the line in which the last entry ends, with the comment in it.
    at = text.find("\n", _end(owner.value[-1][1]))
    if at < 0:
        text, at = text + "\n", len(text)
    if owner is root and value.startswith("{"):
        # A new section has its entries below it.
        line = f"{path[0]}:\n  {value[1:-1]}"
    return text[: at + 1] + " " * column + line + "\n" + text[at + 1 :]


def _start(node: yaml.Node) -> int:
    return int(node.start_mark.index)


def _end(node: yaml.Node) -> int:
    """Where a node's own text ends, without what comes behind it."""
    if isinstance(node, yaml.ScalarNode) or node.flow_style:
        return int(node.end_mark.index)
    return max((_end(each) for each in _below(node)), default=int(node.start_mark.index))


def _below(node: yaml.Node) -> Iterator[yaml.Node]:
    for each in node.value:
        yield from each if isinstance(each, tuple) else (each,)
