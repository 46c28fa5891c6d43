"""What validating costs: one file from a cold start, and a folder of a thousand, at full depth.

The folder holds copies of the shipped tasks with changed numbers. Times are told in seconds and as
multiples of a bare start of Python, measured in between, so that a slow machine slows both. Modules
have been compiled by a start before, as those of an installed package are.

    python benchmarks/bench_validate.py
"""

from __future__ import annotations

import argparse
import os
import random
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TASKS = ROOT / "tasks"
VALIDATE = "from taskspec_runner.cli import main; main()"
#: Else a package that is not installed would be compiled at every start.
ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
_FORCE = re.compile(r"(-?\d+(?:\.\d+)?) (N|mm/s)\b")


def folder_of(count: int, folder: Path) -> None:
    """Fills a folder with copies of the shipped tasks, forces and speeds changed by up to 5 %."""
    rng = random.Random(0)
    texts = [path.read_text("utf-8") for path in sorted(TASKS.glob("*.yaml"))]
    for kept in ("robots", "leaf.csv"):
        source = TASKS / kept
        (shutil.copytree if source.is_dir() else shutil.copy)(source, folder / kept)

    def other(match: re.Match[str]) -> str:
        return f"{float(match[1]) * rng.uniform(0.95, 1.05):.4g} {match[2]}"

    for i in range(count):
        (folder / f"task{i:04}.yaml").write_text(_FORCE.sub(other, texts[i % len(texts)]), "utf-8")


def timed(*command: str) -> tuple[float, float, str]:
    """Real and processor time of a Python command [s], and the last line that it says."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, *command], env=ENVIRONMENT, capture_output=True, text=True, check=False
    )
    real = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    if done.returncode not in (0, 2):
        raise SystemExit(done.stderr)
    return real, used, (done.stdout + done.stderr).strip().rpartition("\n")[2]


def validated(name: str) -> tuple[float, float, str]:
    """What validating a shipped task from a cold start takes, as `timed` has it."""
    return timed("-c", VALIDATE, "validate", str(TASKS / name))


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=5)
    asked = parser.parse_args()
    validated("wipe-table.yaml")
    bare, cold = [], []
    for _ in range(asked.rounds):
        bare.append(timed("-c", "pass"))
        cold.append(validated("wipe-table.yaml"))
    start = statistics.median(real for real, _, _ in bare)
    for name, times in (("a bare start of Python", bare), ("one file, cold", cold)):
        real, used = (statistics.median(t[i] for t in times) for i in (0, 1))
        print(f"{name}: {real:.2f} s, {used:.2f} s of a processor, {real / start:.0f} bare starts")
    each = {path.name: validated(path.name) for path in TASKS.glob("*.yaml")}
    slowest = max(each, key=lambda name: each[name][1])
    real, used, _ = each[slowest]
    print(f"the slowest that is shipped, {slowest}: {real:.2f} s, {used:.2f} s of a processor")
    with tempfile.TemporaryDirectory() as place:
        folder_of(asked.files, Path(place))
        real, used, said = timed("-c", VALIDATE, "validate", "--format", "concise", place)
    cores = len(os.sched_getaffinity(0))
    print(
        f"{asked.files} files on {cores} processors: {real:.1f} s, {real / start:.0f} bare starts,"
    )
    print(f"  {used:.1f} s of a processor, {1e3 * used / asked.files:.0f} ms each; {said}")


if __name__ == "__main__":
    main()
