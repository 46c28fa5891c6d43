"""What `validate` and a run's start cost beside an earlier commit, in turns on the same files.

Two processes, one of each tree, take the files of `tasks/` and random ones in turns. Each gives the
processor time of its process that everything found about a file takes, and all that a run does
before its first tick; nothing that was found before is kept. Then both validate the folder `tasks/`
by the command, on the wall clock.

    python benchmarks/bench_beside.py --base d24c0bc7 --random 60 --seed 97
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TASKS = sorted((ROOT / "tasks").glob("*.yaml"))
#: What a process of a tree does: the same calls as its own commands.
SERVER = """
import sys, time
from pathlib import Path
from taskspec.compiler import admit
from taskspec.examination import examine
from taskspec.text.diagnostic import SpecError
from taskspec_runner.cli.loading import load
from taskspec_runner.loop.assembly import assemble
try:
    from taskspec_runner.trial.check import check
except ImportError:
    check = examine
for line in sys.stdin:
    path, spent = Path(line.strip()), []
    began = time.process_time()
    try:
        check(load(path, (), None))
    except SpecError:
        pass
    spent.append(time.process_time() - began)
    began = time.process_time()
    try:
        assemble(admit(examine(load(path, (), None)), force=True))
    except SpecError:
        pass
    spent.append(time.process_time() - began)
    print(*spent, flush=True)
"""


class Tree:
    """A process that works on files by the sources of a folder."""

    def __init__(self, folder: Path, store: Path) -> None:
        self.folder = folder
        # Machine code is kept in a store of each tree, which begins empty.
        self.environment = {
            **{k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"},
            "PYTHONPATH": f"{folder}{os.pathsep}{folder / 'runner'}",
            "TASKSPEC_CACHE": str(store),
        }
        self._process = subprocess.Popen(
            [sys.executable, "-c", SERVER],
            cwd=folder,
            env=self.environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def ask(self, path: Path) -> tuple[float, float]:
        """Processor time [s] of what is found about a file, and of a run's start."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{path}\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline().split()
        if len(answer) != 2:
            raise SystemExit(f"the process of {self.folder} ended at {path}")
        return float(answer[0]), float(answer[1])

    def folder_on_the_wall(self) -> float:
        """Wall time [s] of `taskspec validate tasks/`, nothing kept."""
        began = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "taskspec_runner", "validate", "--no-cache", "tasks/"],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=False,
        )
        return time.perf_counter() - began


def random_files(count: int, seed: int, folder: Path) -> list[Path]:
    """Files of the generator of `make truth`."""
    sys.path.insert(0, str(ROOT / "campaigns"))
    from truth_tasks import truth_task, write_companions

    write_companions(folder)
    paths = []
    for number in range(count):
        path = folder / f"random{number:03}.yaml"
        path.write_text(truth_task(seed, number), "utf-8")
        paths.append(path)
    return paths


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--base", default="d24c0bc7")
    parser.add_argument("--random", type=int, default=60)
    parser.add_argument("--seed", type=int, default=97)
    parser.add_argument("--shipped", type=int, default=len(TASKS), help="only the first of them")
    parser.add_argument("--walls", type=int, default=3)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        base = Path(place) / "base"
        subprocess.run(
            ["git", "worktree", "add", "--quiet", "--detach", base, asked.base],
            cwd=ROOT,
            check=True,
        )
        try:
            _measure(asked, base, Path(place))
        finally:
            subprocess.run(["git", "worktree", "remove", "--force", base], cwd=ROOT, check=True)


def _measure(asked: argparse.Namespace, base: Path, place: Path) -> None:
    trees = (Tree(base, place / "base-store"), Tree(ROOT, place / "store"))
    groups = {
        "shipped": TASKS[: asked.shipped],
        "random": random_files(asked.random, asked.seed, place),
    }
    for tree in trees:
        tree.ask(TASKS[0])  # Libraries are loaded, and the loop's own code compiled.
    for name, paths in groups.items():
        found = []
        for i, path in enumerate(paths):
            first = i % 2  # Who begins changes from file to file.
            answers = {k: trees[k].ask(path) for k in (first, 1 - first)}
            found.append([*answers[0], *answers[1]])
        if not found:
            continue
        was, was_run, now, now_run = (sum(column) for column in zip(*found, strict=True))
        ratios = [row[2] / row[0] for row in found]
        print(
            f"{name}: {len(found)} files; validate {1e3 * was / len(found):.0f} -> "
            f"{1e3 * now / len(found):.0f} ms a file, {now / was:.2f} (median of files "
            f"{statistics.median(ratios):.2f}); to the first tick {1e3 * was_run / len(found):.0f} "
            f"-> {1e3 * now_run / len(found):.0f} ms, {now_run / was_run:.2f}",
            flush=True,
        )
    if asked.walls:
        walls = [[tree.folder_on_the_wall() for tree in trees] for _ in range(asked.walls)]
        was, now = (statistics.median(column) for column in zip(*walls, strict=True))
        print(f"validate tasks/ on the wall: {was:.1f} -> {now:.1f} s, {now / was:.2f}")


if __name__ == "__main__":
    main()
