"""Runs to hold predictions against: a compiled task on its plant, read back from its log."""

from __future__ import annotations

import gc
import os
import signal
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

# Reports of test runs go without a still: drawing takes longer than most runs do.
os.environ.setdefault("MUJOCO_GL", "disable")
# As for the command line: threads wait for each other longer than small matrices take.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Else every process that a test starts compiles this package anew; an installed one is compiled.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import numpy as np
import pytest
from numpy.typing import NDArray

from taskspec import kept_findings
from taskspec.compiler import compile_unchecked
from taskspec.program.execution.transition import Transition
from taskspec.program.program import Program
from taskspec.spec import load_task, load_text
from taskspec.store import Store
from taskspec_runner.loop import fixed_step as loop
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.record.history import History
from taskspec_runner.record.log import Log

# What a shell starts in the background ignores Ctrl-C, and so would all that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Nor does this process rewrite the assertions of all files anew: that is half of collecting them.
sys.dont_write_bytecode = False

TASKS = Path(__file__).resolve().parent.parent / "tasks"


@dataclass(frozen=True)
class SimulatedTask:
    """What a simulated task left behind."""

    program: Program
    outcome: loop.Outcome
    transitions: list[Transition]
    history: History

    def __getitem__(self, column: str) -> NDArray[np.float64]:
        return self.history.columns[column]

    def during(
        self, stage: str, column: str, start: float = 0.0, end: float = np.inf
    ) -> NDArray[np.float64]:
        """A column while `stage` was on, from `start` to `end` seconds into it."""
        t = self["t"]
        inside = self.history.window(stage) & (t >= start) & (t < end)
        return self[column][inside]


Simulate = Callable[..., SimulatedTask]


#: Tests of a module that nothing binds go to a process so many at a time. After each test xdist 3.8
#: counts those that are left in every group that it has handed out: with a group for each test,
#: that took 3 ms a test.
_TOGETHER = 16


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests of a module that share its fixtures or runs go to one process: they are made once.

    So do those of the group `shipped`, which share runs of shipped tasks as they are.
    """
    unbound: Counter[str] = Counter()
    for item in items:
        if item.get_closest_marker("xdist_group"):
            continue
        name = item.path.stem
        fixtures: Mapping[str, Sequence[pytest.FixtureDef[object]]]
        fixtures = item._fixtureinfo.name2fixturedefs  # type: ignore[attr-defined]
        if "simulate" not in fixtures and all(f[-1].scope != "module" for f in fixtures.values()):
            unbound[name] += 1
            name = f"{name} {unbound[name] // _TOGETHER}"
        item.add_marker(pytest.mark.xdist_group(name))


@pytest.fixture(autouse=True)
def nothing_found_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is found in a process in which tests replace functions is not kept for others."""
    monkeypatch.setattr(kept_findings, "_store_in", lambda _: Store(None))


def pytest_collection_finish() -> None:
    """The collector leaves alone what stays: modules, and a few thousand tests.

    It takes a tenth of the time of examining many files otherwise. Cycles of a test are still
    collected, after more allocations: a test that measures memory collects them first.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 20, 20)


def _simulation(task: str, overrides: tuple[tuple[str, str], ...], seed: int) -> SimulatedTask:
    loaded = (
        load_text(task, "task.yaml", dict(overrides))
        if "\n" in task
        else load_task(TASKS / f"{task}.yaml", dict(overrides))
    )
    program = compile_unchecked(loaded)
    parts = assemble(program)
    with TemporaryDirectory() as folder:
        log = Log(Path(folder) / "log.arrow")
        recorder = parts.recorder(log)
        with closing(recorder):
            outcome = loop.run(
                parts.machine,
                parts.plant,
                parts.bus,
                recorder,
                program.context.period,
                seed=seed,
                loop=None,
                faults=parts.faults,
            )
        history = log.history()
    for column in history.columns.values():
        column.flags.writeable = False
    return SimulatedTask(program, outcome, parts.machine.transitions, history)


_simulated = lru_cache(maxsize=16)(_simulation)
#: Runs of shipped tasks as they are, which tests of several modules look at.
_shipped = cache(_simulation)


@pytest.fixture
def simulate() -> Simulate:
    """Simulate a task: `simulate("wipe-table")` for a shipped one, or its text; `set` overrides.

    Tests that ask for the same run look at one run: nothing of it is changed.
    """

    def run(task: str, set: Mapping[str, str] | None = None, seed: int = 0) -> SimulatedTask:
        kept = _simulated if "\n" in task or set or seed else _shipped
        return kept(task, tuple((set or {}).items()), seed)

    return run
