"""How long findings take while one types, over the shipped tasks in one warm process.

    python benchmarks/bench_editor.py

With each change a text is taken and read: what is wrong with its words, names and units. Examining
it asks all rules, without those on stability first. Everything is done twice and counted the second
time, as an editor has a file open: wall time, and time of the processor, which says what an idle
machine would take.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from taskspec_runner.editor.completion import proposals
from taskspec_runner.editor.opened import OpenedFile
from taskspec_runner.editor.places import hover

TASKS = sorted((Path(__file__).resolve().parents[1] / "tasks").glob("*.yaml"))


def seconds(work: Callable[[], object]) -> tuple[float, float]:
    """Wall time and processor time of one call, after another one [s]."""
    work()
    before = time.perf_counter(), time.process_time()
    work()
    return time.perf_counter() - before[0], time.process_time() - before[1]


def main() -> None:
    """Prints the quantiles."""
    rows: dict[str, list[tuple[float, float]]] = {}
    for path in TASKS:
        text = path.read_text(encoding="utf-8")
        opened = OpenedFile(path, text)
        middle = len(text) // 2
        works = {
            "take a change": partial(opened.change, text),
            "text, names, units": opened.read,
            "all rules but stability": partial(opened.examined, stability=False),
            "all rules": opened.examined,
            "complete": partial(proposals, opened, middle),
            "hover": partial(hover, opened, middle),
        }
        for name, work in works.items():
            rows.setdefault(name, []).append(seconds(work))
    print(f"{len(TASKS)} tasks [ms]             wall: median   90 %   CPU: median   90 %  largest")
    for name, found in rows.items():
        wall, cpu = (1e3 * np.quantile(each, [0.5, 0.9, 1.0]) for each in np.transpose(found))
        print(f"{name:24}{wall[0]:13.1f}{wall[1]:7.1f}{cpu[0]:14.1f}{cpu[1]:7.1f}{cpu[2]:9.1f}")


if __name__ == "__main__":
    main()
