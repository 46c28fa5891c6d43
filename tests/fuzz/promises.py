"""What is promised about any text: what `held` asserts of one, at full depth."""

from __future__ import annotations

import gc
import json
import resource
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import FrameType

import jsonschema

from taskspec.examination import ExaminationBounds, examine
from taskspec.schema import schema_text
from taskspec.spec import LoadedTask, load_text
from taskspec.text.diagnostic import Diagnostic, Severity, SpecError
from taskspec.text.render import render
from taskspec.text.source import Source

sys.path.insert(0, str(Path(__file__).parent.parent / "corpus"))

from reading import assert_place, json_of

TASKS = Path(__file__).parents[2] / "tasks"
#: How many times as long as a shipped task a file may take of a processor. The slowest take 7 times
#: as long: a pose that is out of reach is looked for from everywhere. Shared cores differ by a
#: factor of two, and which they are by as much again.
LIMIT = 28.0
SCHEMA = json.loads(schema_text())
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)


class HangError(BaseException):
    """A file took far longer than it may; no handler of the code under test swallows it."""


@contextmanager
def watched(limit: float) -> Iterator[None]:
    """Ends what takes more processor time than it may, as far as Python is what takes it."""

    def end(_number: int, _frame: FrameType | None) -> None:
        raise HangError(f"more than {limit:g} s")

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


@cache
def usual() -> float:
    """What the examination of a shipped task takes of this machine, once it is warm [s]."""
    text = (TASKS / "press-hybrid.yaml").read_text(encoding="utf-8")
    times = []
    for _ in range(3):
        began = time.process_time()
        found_in(text, TASKS)
        times.append(time.process_time() - began)
    return min(times)


def found_in(text: str, base: Path) -> tuple[tuple[Diagnostic, ...], dict[str, Source], bool]:
    """What `validate` finds in a text, the texts it refers to, and whether the text was read."""
    found, sources, loaded = _examined(text, base)
    return found, sources, loaded is not None


def _examined(
    text: str, base: Path
) -> tuple[tuple[Diagnostic, ...], dict[str, Source], LoadedTask | None]:
    try:
        loaded = load_text(text, "t.yaml", base=base)
    except SpecError as error:
        return error.diagnostics, dict(error.sources), None
    return examine(loaded, bounds=ExaminationBounds()).findings, dict(loaded.sources), loaded


def held(text: str, base: Path, *, twice: bool = True) -> bool:
    """Holds a text to the promises; returns whether it came as far as the checks.

    No exception but `SpecError`, no more than `LIMIT` times what is usual, places inside the text,
    output that a terminal can show, the same findings when it is examined again, and a schema that
    accepts what is read.
    """
    limit = LIMIT * usual()
    with watched(10 * limit):
        began = time.process_time()
        found, sources, loaded = _examined(text, base)
        took = time.process_time() - began
    assert took < limit, f"took {took:.2f} s"
    assert loaded or any(d.severity is Severity.ERROR for d in found)
    for diagnostic in found:
        assert_place(diagnostic, sources[diagnostic.source])
    shown = render(found, sources)
    assert all(c == "\n" or c.isprintable() for c in shown)
    # The schema lists the built-in robots, which reading does not know.
    if loaded and all(d.code != "TS401" for d in found):
        assert_accepted(loaded)
    if twice:
        assert found_in(text, base)[0] == found, "other findings on the second run"
    return loaded is not None


def assert_accepted(loaded: LoadedTask) -> None:
    """Holds the JSON Schema to accept a text that is read without an error."""
    errors = VALIDATOR.iter_errors(json_of(loaded.root))
    told = [f"{'.'.join(map(str, e.path))}: {e.message}" for e in errors]
    assert not told, told


def resident() -> float:
    """Memory that this process holds now, after a collection [MiB]."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20
