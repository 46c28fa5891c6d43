"""Environments of this project: what a step and a reset take, alone and over threads.

`tasks/wipe-table.yaml` with residuals of up to 5 N on z and 5 mm on x and y, its ball on the
table, 50 actions a second, physics and controller of 1 kHz; an observation is force, motion, stage
and time. A line of JSON has processor time of one environment: steps in contact, resets, and the
first step after a reset, which connects machine code with the new plant. Lines of several have the
clock's time, which is the machine's affair and that of whoever else uses it.

    python benchmarks/bench_gym.py --steps 300 --resets 30 --envs 8
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

import numpy as np

from taskspec_runner import gym
from taskspec_runner.gym.env import TaskEnv

TASK = Path(__file__).resolve().parents[1] / "tasks" / "wipe-table.yaml"
ACT = {"x": "position +- 5 mm", "y": "position +- 5 mm", "z": "force +- 5 N"}
RATE = 50
#: How many steps until the tool wipes, at most.
APPROACH = 400


def in_contact(env: TaskEnv) -> None:
    """Has an environment go on until the tool wipes."""
    env.reset(seed=0)
    still = np.zeros(env.action_space.shape, np.float32)
    for _ in range(APPROACH):
        if env.step(still)[4]["stage"] == "wipe":
            return
    raise AssertionError("the tool has not come to wipe")


def alone(steps: int, resets: int) -> dict[str, float]:
    """Processor time of one environment [s]."""
    env, random = gym.make(TASK, ACT, rate=RATE, worlds=True), np.random.default_rng(0)
    for _ in range(2):  # The first one compiles.
        in_contact(env)
    actions = random.uniform(-1, 1, (steps, *env.action_space.shape)).astype(np.float32)
    began = time.thread_time()
    for action in actions:
        ended = env.step(action)[2]
        assert not ended, "the episode has ended"
    seconds, reset, first = time.thread_time() - began, 0.0, 0.0
    for _ in range(resets):
        began = time.thread_time()
        env.reset()
        reset += time.thread_time() - began
        began = time.thread_time()
        env.step(actions[0])
        first += time.thread_time() - began
    return {
        "steps": steps,
        "seconds": seconds,
        "resets": resets,
        "reset_seconds": reset,
        "first_step_seconds": first,
        "control_hz": RATE,
        "sim_hz": 1000,
    }


def together(count: int, threads: int, steps: int) -> dict[str, float]:
    """Several environments over threads of this process, resets among their steps [s]."""
    envs = gym.make_vec(TASK, count, act=ACT, rate=RATE, worlds=True, threads=threads)
    envs.reset(seed=0)
    still = np.zeros(envs.action_space.shape, np.float32)
    envs.step(still)
    began = time.perf_counter()
    for _ in range(steps):
        envs.step(still)
    wall = time.perf_counter() - began
    envs.close()
    return {"envs": count, "threads": threads, "steps": count * steps, "wall": wall}


def main() -> None:
    """Prints a line of JSON for each."""
    parser = argparse.ArgumentParser(description="What steps and resets of environments take")
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--resets", type=int, default=30)
    parser.add_argument("--envs", type=int, default=8, help="0 for one environment alone")
    given = parser.parse_args()
    print(json.dumps(alone(given.steps, given.resets)), flush=True)
    for threads in (1, os.cpu_count() or 1) if given.envs else ():
        print(json.dumps(together(given.envs, threads, given.steps // 4)), flush=True)


if __name__ == "__main__":
    main()
