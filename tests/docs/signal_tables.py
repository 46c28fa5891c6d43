"""The tables of signals in docs/language/signals.md, as the entries of the code have them.

Run this file to write them anew after an entry has changed; then read the difference.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from taskspec import signals
from taskspec.signals.table import REFERENCE
from taskspec.spec.fields import MECHANISMS
from taskspec.text.units import NUMBER, si_unit

PAGE = Path(__file__).resolve().parents[2] / "docs" / "language" / "signals.md"
_NAMES = {
    signals.Index.JOINT: "joint.N.{0}",
    signals.Index.STAGE: "STAGE.{0}",
    signals.Index.LINK: "link.{0}",
    signals.Index.GRIP: "grip.{0}",
    signals.Index.ESTIMATE: "estimate.{0}.AXIS",
    signals.Index.GAIN: "gain.{0}.ENTRY",
}


def signal_rows() -> Iterator[list[str]]:
    """Rows of signals that belong to no object."""
    tables = (signals.VECTORS, signals.SCALARS, signals.CLOCKS, signals.JOINT, signals.STAGE)
    tables = (*tables, signals.LINK, signals.GAIN, signals.ESTIMATE, signals.GRIP, signals.ENERGY)
    tables = (*tables, signals.TANK, signals.PAYLOAD)
    for signal in (signal for table in tables for signal in table.values()):
        members: dict[str, list[str]] = {}
        for key in signal.dimensions:
            members.setdefault(signal.meanings[key], []).append(key)
        for meaning, keys in members.items():
            pattern = _NAMES.get(signal.index, "{0}")
            names = [f"`{pattern.format(signal.name)}`"]
            if signal.axes:
                names = [f"`{signal.name}.{key}`" for key in keys]
            unit = "condition" if signal.condition else _unit(signal, keys[0])
            yield [" ".join(names), unit, meaning, *_places(signal, "yes")]


def object_rows() -> Iterator[list[str]]:
    """Rows of the signals of objects."""
    for kind, entries in signals.OBJECT.items():
        known = "held" if kind in MECHANISMS else "yes"
        for name, signal in entries.items():
            row = [f"`{kind}`", f"`{name}`", _unit(signal, kind), signal.meanings[kind]]
            yield [*row, *_places(signal, known)]


def _unit(signal: signals.Signal, member: str) -> str:
    dimension = signal.dimensions[member]
    if signal.unit:
        return f"`{signal.unit}`"
    return "number" if dimension == NUMBER else f"`{si_unit(dimension)}`"


def _places(signal: signals.Signal, known: str) -> list[str]:
    """Whether references, guards and expectations may use it."""
    guards = "no" if signal.unmeasured else known
    references = "no" if signal.condition or signal.reference else guards
    return [references, guards, "yes, `.ref`" if REFERENCE in signal.beside else "yes"]


def with_tables(text: str) -> str:
    """The reference of the language with the rows of both tables as they should be."""
    for comment, rows in (("signals", signal_rows()), ("object signals", object_rows())):
        lines = "".join(f"| {' | '.join(row)} |\n" for row in rows)
        head = rf"(<!-- table: {comment} -->\n(?:\|.*\n){{2}})(?:\|.*\n)+"
        text, found = re.subn(head, lambda match, lines=lines: match[1] + lines, text)
        assert found == 1, comment
    return text


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
