"""A process that validates hostile files, so that its hangs and crashes can be outlived."""

from __future__ import annotations

import multiprocessing
import resource
import time
import traceback
import warnings
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

#: What a file may take: so many times the processor time of a shipped task, and memory above what
#: was held before [MiB]. The slowest took 7 times as much; shared cores differ by a factor of two,
#: and which they are by as much again.
TIMES, MEMORY = 28.0, 150
SHIPPED = Path(__file__).resolve().parents[2] / "tasks" / "press-hybrid.yaml"
#: Real seconds after which the process counts as hanging, on a machine that others use too.
_GIVEN_UP = 60
#: All memory that the process may ask for; what grows without bound ends in a MemoryError.
_ALL = 4 << 30


@dataclass(frozen=True)
class Answer:
    """What came of a file.

    Attributes:
        codes: that were found. errors: those of errors. unreadable: why the file could not be read.
        broken: an internal error. seconds: of processor time. memory: at its highest [MiB].
        text: everything that was printed, in every format.
    """

    codes: frozenset[str]
    errors: frozenset[str]
    unreadable: tuple[str, ...]
    broken: tuple[str, ...]
    seconds: float
    memory: float
    text: str


class Victim:
    """The process; it is begun anew after it died."""

    def __init__(self) -> None:
        self._process: Any = None
        self._ours: Connection | None = None
        self._usual: float | None = None

    def validate(self, path: Path) -> Answer:
        """Validates a file at full depth and renders what is found in every format.

        Raises:
            AssertionError: the process hangs, or has died of the file.
        """
        if self._process is None:
            context = multiprocessing.get_context("spawn")
            self._ours, theirs = context.Pipe()
            self._process = context.Process(target=serve, args=(theirs,), daemon=True)
            self._process.start()
            theirs.close()
        assert self._ours is not None
        self._ours.send(path)
        try:
            assert self._ours.poll(_GIVEN_UP), f"{path.name} hangs"
            answer = self._ours.recv()
        except (AssertionError, EOFError) as error:
            self.close()
            raise AssertionError(f"the process was lost over {path.name}: {error}") from None
        assert isinstance(answer, Answer), answer
        return answer

    def slow(self, answer: Answer) -> bool:
        """Whether a file took far longer than a shipped task takes of this machine."""
        if self._usual is None:
            self._usual = min(self.validate(SHIPPED).seconds for _ in range(3))
        return answer.seconds > TIMES * self._usual

    def close(self) -> None:
        """Ends the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
        self._process = None


def serve(theirs: Connection) -> None:
    """Answers paths until the other end is closed."""
    warnings.simplefilter("error")
    resource.setrlimit(resource.RLIMIT_AS, (_ALL, _ALL))
    from taskspec import examination  # noqa: F401  # Loading it is no part of what a file takes.

    while True:
        try:
            path = theirs.recv()
        except EOFError:
            return
        try:
            answer: object = _answer(path)
        except BaseException:
            answer = traceback.format_exc()
        theirs.send(answer)


def _answer(path: Path) -> Answer:
    from taskspec_runner.cli.reporters import REPORTERS
    from taskspec_runner.cli.validate import examine

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    found = examine([path], keeps=False)
    text = "\n".join(reporter.report(found) for reporter in REPORTERS.values())
    took = time.process_time() - began
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    diagnostics = [d for list_ in found.diagnostics.values() for d in list_]
    return Answer(
        frozenset(d.code for d in diagnostics),
        frozenset(d.code for d in diagnostics if str(d.severity) == "error"),
        tuple(f.message for f in found.unreadable),
        tuple(f.message for f in found.broken),
        took,
        (after - before) / 1024,
        text,
    )
