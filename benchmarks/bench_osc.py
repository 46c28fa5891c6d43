"""The closed loop of robosuite's operational space controller, beside bare physics, in one process.

robosuite (Zhu et al.) drives its own Panda, which presses its wiping tool onto its own table and
moves it in circles (`robosuite_osc`). A new goal is set every 25 steps; in each step the controller
is evaluated, as `env.step` has it. Neither states nor rewards are worked out and nothing is
recorded: that is what `env.step` adds, which is given beside it. All are multiples of a bare
`mj_step` of the same scene in the same contact, in processor time; rounds alternate, medians are
printed.

    make robosuite
    .robosuite/bin/python benchmarks/bench_osc.py
"""

from __future__ import annotations

import statistics
import time

import mujoco
import robosuite
from robosuite_osc import OscLoop

#: Steps of physics of a round.
STEPS, ROUNDS = 1000, 9


def cost(run, steps: int) -> float:
    """Processor time of this thread [s]."""
    began = time.thread_time()
    run(steps)
    return time.thread_time() - began


def main() -> None:
    """Prints the ratios."""
    loop = OscLoop()
    assert loop.every == 25
    found: dict[str, list[float]] = {}
    for _ in range(ROUNDS):
        loop.begin()
        bare = loop.bare(STEPS)
        found.setdefault("bare step [us]", []).append(1e6 * bare / STEPS)
        for name, run in (("controller and step", loop.controlled), ("env.step", loop.whole)):
            taken = cost(run, STEPS)
            found.setdefault(f"{name}, x bare step", []).append(taken / bare)
            found.setdefault(f"{name}, beyond that [us]", []).append(1e6 * (taken - bare) / STEPS)
    print(f"robosuite {robosuite.__version__}, mujoco {mujoco.__version__}")
    print(f"contacts {loop.data.ncon}, rows of constraints {loop.data.nefc}")
    for name, values in found.items():
        print(f"{name:36} {statistics.median(values):9.2f}")


if __name__ == "__main__":
    main()
