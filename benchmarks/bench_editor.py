"""How long findings take while one types, over the shipped tasks in one warm process.

    python benchmarks/bench_editor.py

Reading a text finds what is wrong with its words, names and units; examining it asks all rules.
Both are done twice and counted the second time, as an editor has a file open.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from taskspec_runner.editor.completion import proposals
from taskspec_runner.editor.opened import OpenedFile

TASKS = sorted((Path(__file__).resolve().parents[1] / "tasks").glob("*.yaml"))


def seconds(work: Callable[[], object]) -> float:
    """Wall time of one call, after another one [s]."""
    work()
    before = time.perf_counter()
    work()
    return time.perf_counter() - before


def main() -> None:
    """Prints the quantiles."""
    rows: dict[str, list[float]] = {"read": [], "all rules": [], "complete": []}
    for path in TASKS:
        opened = OpenedFile(path, path.read_text(encoding="utf-8"))
        middle = len(opened.source.text) // 2
        rows["read"].append(seconds(opened.read))
        rows["all rules"].append(seconds(opened.examined))
        rows["complete"].append(seconds(lambda at=middle, of=opened: proposals(of, at)))
    print(f"{len(TASKS)} tasks      median     90 %  largest [ms]")
    for name, found in rows.items():
        cuts = 1e3 * np.quantile(found, [0.5, 0.9, 1.0])
        print(f"{name:12} {cuts[0]:9.1f} {cuts[1]:8.1f} {cuts[2]:8.1f}")


if __name__ == "__main__":
    main()
