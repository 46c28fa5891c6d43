"""What a command costs until it does its work, beside the same of an earlier commit.

`validate` of one shipped task, `run` of it until its first tick, each from a cold start, and
`validate` of a folder of files: as if they were new, and as they were the last time, so that their
findings are known. In each round both trees and a bare start of Python follow each other, so that a
slow machine slows all; ratios are medians of rounds. Modules have been compiled before, as those of
an installed package are, and what is kept from run to run is there, but for the line "nothing
kept".

    python benchmarks/bench_start.py --base COMMIT
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bench_validate import folder_of

ROOT = Path(__file__).resolve().parent.parent
TASK = "tasks/wipe-table.yaml"
COMMAND = "from taskspec_runner.cli import main; main()"
#: The process ends where the first tick would begin.
FIRST_TICK = """
import os
from taskspec.program.execution.machine import Machine
Machine.tick = lambda *_: os._exit(0)
"""

#: What the language, the robots and the laws are made of, and nothing else.
LIBRARIES = """
import os
import casadi, numpy, pinocchio, pydantic, typer, yaml
os._exit(0)
"""


@dataclass(frozen=True)
class Cost:
    """Real and processor time of a process and those that it starts [s]."""

    real: float
    used: float


@dataclass(frozen=True)
class Tree:
    """A tree of the project, with a folder for what it keeps from run to run.

    Attributes:
        root: where it lies.
        cache: the folder.
        anew: what has it examine files anew; an earlier commit does so without being asked.
    """

    root: Path
    cache: Path
    anew: tuple[str, ...] = ()

    def cost(
        self, *arguments: str, before: str = "", keeps: bool = True, known: bool = False
    ) -> Cost:
        """What a command costs, from its folder.

        Args:
            arguments: of `taskspec`.
            before: a program that is run before it, in the same process.
            keeps: whether there is what was kept before.
            known: whether it may tell again what it found about a file.
        """
        if arguments and not known:
            arguments = (*arguments, *self.anew)
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        # What an earlier commit needs and this one does not may be on the caller's path.
        own = [
            str(self.root),
            str(self.root / "runner"),
            *environment.get("PYTHONPATH", "").split(os.pathsep),
        ]
        environment["PYTHONPATH"] = os.pathsep.join(own)
        environment["TASKSPEC_CACHE"] = str(self.cache) if keeps else ""
        program = f"{before}\nimport sys\nsys.argv[1:] = {list(arguments)!r}\n{COMMAND}"
        return cost(["-c", program if arguments else "pass"], environment, self.root)


def cost(arguments: Sequence[str], environment: dict[str, str], folder: Path) -> Cost:
    """What a Python process costs."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    done = subprocess.run(
        [sys.executable, *arguments],
        env=environment, cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    real = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 2) or "cannot be imported" in done.stderr + done.stdout:
        raise SystemExit(done.stderr or done.stdout)
    return Cost(real, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def tree_of(commit: str, folder: Path) -> Path:
    """The files of a commit, in a folder."""
    archive = folder / "tree.tar"
    subprocess.run(["git", "archive", "--output", archive, commit], cwd=ROOT, check=True)
    with tarfile.open(archive) as tar:
        tar.extractall(folder / "tree", filter="data")
    return folder / "tree"


def told(name: str, here: Sequence[Cost], base: Sequence[Cost], bare: Sequence[Cost]) -> None:
    """Prints medians: of both sides, in bare starts of Python, and of their ratio."""
    for kind in ("real", "used"):
        mine, theirs, starts = (
            [float(getattr(each, kind)) for each in costs] for costs in (here, base, bare)
        )
        ratio = statistics.median(a / b for a, b in zip(mine, theirs, strict=True))
        in_starts = [
            statistics.median(a / b for a, b in zip(side, starts, strict=True))
            for side in (theirs, mine)
        ]
        print(
            f"{name}, {'real time' if kind == 'real' else 'processor'}: "
            f"{statistics.median(mine):.3f} s, {in_starts[1]:.1f} bare starts; "
            f"base {in_starts[0]:.1f}; ratio {ratio:.2f}"
        )


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--base", required=True, help="the commit that is measured beside")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--files", type=int, default=140, help="of the folder; 0 for none")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        trees = [
            Tree(ROOT, folder / "cache", ("--no-cache",)),
            Tree(tree_of(asked.base, folder), folder / "base-cache"),
        ]
        validate = ("validate", TASK)
        run = ("run", TASK, "--quiet", "--out", str(folder / "run"))
        cases = {
            "the libraries of validate, imported": (validate, LIBRARIES, True, False),
            "those of run": (run, "import mujoco\n" + LIBRARIES, True, False),
            "validate of one file": (validate, "", True, False),
            "validate of one file, nothing kept": (validate, "", False, False),
            "validate of one file, its findings known": (validate, "", True, True),
            "run until its first tick": (run, FIRST_TICK, True, False),
            "run until its first tick, its findings known": (run, FIRST_TICK, True, True),
        }
        for name, (arguments, before, keeps, known) in cases.items():
            options = {"before": before, "keeps": keeps, "known": known}
            for tree in trees:
                tree.cost(*arguments, **options)
            rounds = [
                (trees[0].cost(), *(tree.cost(*arguments, **options) for tree in trees))
                for _ in range(asked.rounds)
            ]
            bare, here, base = zip(*rounds, strict=True)
            told(name, here, base, bare)
        if asked.files:
            files = folder / "files"
            files.mkdir()
            folder_of(asked.files, files)
            for name, known in (("", False), (", their findings known", True)):
                if known:
                    trees[0].cost("validate", str(files), known=True)
                rounds = [
                    (
                        trees[0].cost(),
                        *(tree.cost("validate", str(files), known=known) for tree in trees),
                    )
                    for _ in range(3)
                ]
                bare, here, base = zip(*rounds, strict=True)
                told(f"validate of {asked.files} files{name}", here, base, bare)
            shutil.rmtree(files)


if __name__ == "__main__":
    main()
