"""Task files as the command line names them."""

from __future__ import annotations

import functools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TextIO

from taskspec.spec import LoadedTask, load_task, load_text, read_text, tree_of
from taskspec.text import nodes
from taskspec.text.diagnostic import Diagnostic, Note, SpecError, in_order
from taskspec.text.source import OVERRIDES, Source, Span
from taskspec.text.yaml import MAX_BYTES
from taskspec.unread import with_robot
from taskspec_runner.cli.given import LAW, STDIN, changes
from taskspec_runner.errors import InputError

_STDIN_NAME = "<stdin>"


def load(
    path: Path,
    sets: Sequence[str] = (),
    law: str | None = None,
    gains: Mapping[str, str] | None = None,
) -> LoadedTask:
    """Loads a task file.

    Args:
        path: the file, or `STDIN`; what standard input brings lies in the working folder.
        sets: overrides as `KEY=VALUE`.
        law: a law that replaces that of the file and of every stage.
        gains: of that law, in the words of a file.

    Raises:
        SpecError: the task is wrong.
        InputError: the file cannot be opened or is not UTF-8, or an override is not one.
    """
    given = changes(sets, law)
    try:
        laws = _laws(path, law, gains or {}) if law is not None else {}
        overrides = laws | given
        try:
            if path == STDIN:
                return load_text(_read_once(sys.stdin), _STDIN_NAME, overrides)
            return load_task(path, overrides)
        except SpecError as error:
            lines = {number: key for number, key in enumerate(overrides, 1)}
            by_law = {n: key for n, key in lines.items() if key in laws and key not in given}
            found = with_robot(error).diagnostics
            traced = [_traced(_of_law(d, by_law), lines) for d in found]
            sources = {**error.sources, LAW: Source(LAW, law or "")}
            raise SpecError(in_order(traced), sources) from error
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        place = f"byte {error.start}"
        raise InputError(f"cannot read {path}: it is not UTF-8 ({place})") from error


@functools.lru_cache(maxsize=1)
def _read_once(stream: TextIO) -> str:
    """The text of a stream, read once: some commands load a task more than once."""
    return read_text(stream.buffer)


def _of_law(found: Diagnostic, by_law: Mapping[int, str]) -> Diagnostic:
    """A finding about an override that `--law` stands for, as one about `--law`."""
    span = found.span
    if found.source != OVERRIDES or span is None or span.line not in by_law:
        return found
    shift = len(by_law[span.line]) + 1
    columns = (max(span.column - shift, 1), max(span.end_column - shift, 2))
    return replace(found, source=LAW, span=Span(1, columns[0], 1, columns[1], LAW))


def _traced(found: Diagnostic, lines: Mapping[int, str]) -> Diagnostic:
    """A finding about a param in the file, with the override that gave the param its value."""
    for number, key in lines.items():
        name = key.removeprefix("params.")
        if found.source != OVERRIDES and found.hint.startswith(f"'{name}' is defined"):
            span = Span(number, 1, number, len(key) + 1, OVERRIDES)
            note = Note(f"'{name}' is given here", OVERRIDES, span)
            return replace(found, notes=(*found.notes, note))
    return found


def _laws(path: Path, law: str, gains: Mapping[str, str]) -> dict[str, str]:
    """Overrides of every `law` in a file; a file that cannot be parsed has none to replace.

    How the torques follow from a law is not part of it: `solve` and `solver` stay.
    """
    if path == STDIN:
        text = _read_once(sys.stdin)
    else:
        with path.open("rb") as file:
            # A file that is too long or not UTF-8 is found out when it is loaded.
            text = file.read(MAX_BYTES).decode("utf-8", "replace")
    root = tree_of(text, str(path), None if path == STDIN else path.parent)
    stages = root.get("stages") if root is not None else None
    owners: dict[str, nodes.Node | None] = {"law": root}
    if isinstance(stages, nodes.Mapping):
        owners |= {f"stages.{name}.law": stage for name, (_, stage) in stages.entries.items()}
    found = {}
    for place, owner in owners.items():
        own = owner.get("law") if isinstance(owner, nodes.Mapping) else None
        if own is None and place != "law":
            continue
        found[place] = law
        found |= {f"{place}.{name}": value for name, value in gains.items()}
        for key in ("solve", "solver"):
            kept = own.get(key) if isinstance(own, nodes.Mapping) else None
            if isinstance(kept, nodes.Scalar):
                found[f"{place}.{key}"] = kept.value
    return found
