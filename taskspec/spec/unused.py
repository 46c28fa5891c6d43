"""Params and frames that a file declares and then does not use."""

from __future__ import annotations

import re
from collections.abc import Iterator

from taskspec.text import nodes
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics

register({"TS130": "a name that nothing uses"})

_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
#: Texts for people, in which a word is no use of a name.
_PROSE = ("name", "about")
#: Section -> what one of its entries is, and how it would be used.
_DECLARED = {
    "params": ("param", "use it by its bare name where a number stands, or leave it out"),
    "frames": ("frame", "name it as 'frame' of the task or of a stage, or leave it out"),
}


def unused(root: nodes.Mapping) -> set[tuple[str, str]]:
    """Sections and names of params and frames whose name no value of the file has as a word.

    A word that means something else, as a coordinate that hides a param, counts as a use: what is
    found is certain.

    Args:
        root: of a file.
    """
    words = set(_words(root))
    return {
        (section, name)
        for section in _DECLARED
        if isinstance(declared := root.get(section), nodes.Mapping)
        for name in declared.entries
        if name not in words
    }


def warn_unused(root: nodes.Mapping, names: set[tuple[str, str]], found: Diagnostics) -> None:
    """Reports names that nothing uses.

    Args:
        root: of a file without errors. names: sections and names. found: where findings go.
    """
    for section, name in sorted(names):
        noun, hint = _DECLARED[section]
        span = nodes.place(root, (section, name), key=True)
        found.warning("TS130", f"nothing uses the {noun} '{name}'", span, hint)


def _words(root: nodes.Mapping) -> Iterator[str]:
    """Words of all values: keys are names of the language, or declare one."""
    for key, (_, value) in root.entries.items():
        if key not in _PROSE:
            for scalar in nodes.scalars(value):
                yield from _WORD.findall(scalar.value)
