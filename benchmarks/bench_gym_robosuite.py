"""Environments of this project beside robosuite's OSC environment, in turns, at the same rates.

Both have 50 actions a second, physics of 1 kHz and a controller in each of its steps. Here it is
`tasks/wipe-table.yaml` by a Panda, its ball on the table, with residuals of up to 5 N on z and 5 mm
on x and y as actions; an observation is force, motion, stage and time. There it is what
`robosuite_osc` says: a Panda of robosuite's pressing on its own table. `lean` is robosuite with
next to no observables and no reward. robosuite 1.5.2 needs another MuJoCo than this project, so
that it runs in a process of its own, and one side waits while the other is measured. Figures are
medians of processor time; a round has every side once.

    make robosuite
    python benchmarks/bench_gym_robosuite.py
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np

from taskspec_runner.gym import make

ROOT = Path(__file__).resolve().parents[1]
PYTHON = ROOT / ".robosuite" / "bin" / "python"
ACT = {"x": "position +- 5 mm", "y": "position +- 5 mm", "z": "force +- 5 N"}
RATE, ROUNDS, STEPS, RESETS = 50, 9, 100, 5
#: How many steps until the tool wipes, at most.
APPROACH = 400
#: Sides: the environment and what it observes, and whether a reset makes the model anew.
SIDES = [*product(("Wipe", "Lift"), ("all", "lean"), (False,)), ("Lift", "lean", True)]


class Ours:
    """The environment of a task, in contact."""

    def __init__(self) -> None:
        """Makes it; the first reset compiles the loop."""
        self._env = make(ROOT / "tasks" / "wipe-table.yaml", ACT, rate=RATE)
        self._actions = np.random.default_rng(0)

    def begin(self) -> None:
        """Goes on until the tool wipes."""
        self._env.reset(seed=0)
        still = np.zeros(self._env.action_space.shape, dtype=np.float32)
        for _ in range(APPROACH):
            if self._env.step(still)[4]["stage"] == "wipe":
                return
        raise AssertionError("the tool has not come to wipe")

    def steps(self, count: int) -> None:
        """Steps with random actions."""
        shape = self._env.action_space.shape
        for action in self._actions.uniform(-1, 1, (count, *shape)).astype(np.float32):
            ended = self._env.step(action)[2]
            assert not ended, "the episode has ended"

    def resets(self, count: int) -> None:
        """Resets, each to another episode."""
        for _ in range(count):
            self._env.reset()


class Theirs:
    """robosuite's, in a process of its own."""

    def __init__(self, env: str, observe: str, hard: bool) -> None:
        """Starts it."""
        command = [PYTHON, ROOT / "benchmarks" / "robosuite_osc.py", "--env", env]
        command += ["--observe", observe, "--control", str(RATE), "--sim", "1000"]
        self._process = subprocess.Popen(
            [*map(str, command), *["--hard-reset"] * hard], stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        self.about = self._answer()

    def ask(self, request: str) -> float:
        """Processor time of what is requested [s]."""
        self._process.stdin.write(f"{request}\n")
        self._process.stdin.flush()
        return self._answer()["seconds"]

    def close(self) -> None:
        """Ends it."""
        self._process.stdin.close()
        self._process.wait(timeout=30)

    def _answer(self) -> dict:
        line = self._process.stdout.readline()
        assert line, "robosuite's side has ended"
        return json.loads(line)


def cost(run: Callable[[int], None], count: int) -> float:
    """Processor time of this process [s]."""
    began = time.process_time()
    run(count)
    return time.process_time() - began


def main() -> None:
    """Prints the table."""
    if not PYTHON.exists():
        sys.exit("there is no robosuite: `make robosuite`")
    ours = Ours()
    theirs = {side: Theirs(*side) for side in SIDES}
    step: dict[object, list[float]] = {}
    reset: dict[object, list[float]] = {}
    bare: dict[object, list[float]] = {}
    for _ in range(ROUNDS):
        ours.begin()
        step.setdefault("", []).append(cost(ours.steps, STEPS) / STEPS)
        reset.setdefault("", []).append(cost(ours.resets, RESETS) / RESETS)
        for side, process in theirs.items():
            hard = side[2]
            step.setdefault(side, []).append(process.ask(f"go {STEPS}") / STEPS)
            bare.setdefault(side, []).append(process.ask("bare 2000") / 100)
            count = 1 if hard else RESETS
            reset.setdefault(side, []).append(process.ask(f"reset {count}") / count)
    own = statistics.median(step[""])
    versions = theirs[SIDES[0]].about["versions"]
    print(", ".join(f"{name} {version}" for name, version in versions.items()))
    print(f"{'':28} steps/s   of them physics   times slower   reset [ms]")
    for side, values in step.items():
        name = "this project" if not side else f"{side[0]}, {side[1]}{', hard reset' * side[2]}"
        median, again = statistics.median(values), 1e3 * statistics.median(reset[side])
        share = f"{statistics.median(bare[side]) / median:15.0%}" if side else f"{'':15}"
        print(f"{name:28} {1 / median:7.0f} {share:>15} {median / own:15.1f} {again:12.2f}")
    for process in theirs.values():
        process.close()


if __name__ == "__main__":
    main()
