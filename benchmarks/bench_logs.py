"""What an MCAP export and the judging of it cost beside an earlier commit, in turns.

Each tree runs a press of some minutes, writes its log as MCAP and judges that file, as commands of
its own: processor time and time on the wall of each, interpreter and imports and page included.

    python benchmarks/bench_logs.py --base d24c0bc7 --minutes 10
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "campaigns"))

from long_runs import TASK  # noqa: E402


def taskspec(tree: Path, *arguments: str | Path) -> tuple[float, float]:
    """Processor time and time on the wall of a command by the sources of a folder [s]."""
    environment = {**os.environ, "PYTHONPATH": f"{tree}{os.pathsep}{tree / 'runner'}"}
    command = [sys.executable, "-m", "taskspec_runner", *map(str, arguments)]
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, cwd=tree, env=environment, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return spent, time.perf_counter() - begun


def commands(folder: Path) -> Iterator[tuple[str, tuple[str | Path, ...]]]:
    """What is measured: its name and its arguments."""
    log = folder / "run" / "log.mcap"
    yield "export --mcap", ("export", folder / "run", "--mcap")
    yield "judge FILE log.mcap", ("judge", folder / "long.yaml", log, "--out", folder / "judged",
                                  "--quiet")  # fmt: skip


def main() -> None:
    """Measures both trees in turns and prints the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--base", default="d24c0bc7", help="the commit to measure beside")
    parser.add_argument("--minutes", type=float, default=10, help="simulated, of the run")
    parser.add_argument("--rounds", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        base = Path(name) / "base"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "--quiet", "--detach", str(base), options.base], check=True)
        try:
            trees = {options.base: base, "now": ROOT}
            folders = {each: Path(name) / f"of-{each}" for each in trees}
            for each, tree in trees.items():
                folders[each].mkdir()
                task = folders[each] / "long.yaml"
                task.write_text(TASK.format(minutes=f"{options.minutes:g}"), encoding="utf-8")
                taskspec(tree, "run", task, "--out", folders[each] / "run", "--quiet")
            print(f"{'':22}{'processor':>30}{'wall':>30}")
            for _ in range(options.rounds):
                pairs = zip(*(commands(folder) for folder in folders.values()), strict=True)
                for (what, own), (_, other) in pairs:
                    (cpu, wall), (cpu_now, wall_now) = (
                        taskspec(tree, *each)
                        for tree, each in zip(trees.values(), (own, other), strict=True)
                    )
                    print(
                        f"{what:22}{cpu:8.1f} s {cpu_now:7.1f} s {cpu / cpu_now:7.1f} x"
                        f"{wall:10.1f} s {wall_now:7.1f} s {wall / wall_now:7.1f} x",
                        flush=True,
                    )
        finally:
            subprocess.run([*git, "remove", "--force", str(base)], check=True)


if __name__ == "__main__":
    main()
