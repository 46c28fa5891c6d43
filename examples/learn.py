"""Learns how fast to approach a table: an evolution strategy on an environment of a task file.

    python examples/learn.py docs/how-to/learning.yaml

The policy is linear in what is observed. It is trained in worlds of one seed and judged in worlds
of another, beside the file alone, which is the action 0.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from taskspec_runner import gym
from taskspec_runner.gym.env import TaskEnv

Vector = NDArray[np.float64]
Policy = Callable[[Vector], Vector]

TRAINING, JUDGING = 1, 2
OBSERVED = ("position.z", "param.feed", "stage")
#: Where the tool may be, and how fast: what is observed is made of size 1 by these.
_OFFSET, _SCALE = np.array([0.31, 0.06, 0, 0]), np.array([0.02, 0.06, 1, 1])


def linear(weights: Vector) -> Policy:
    """The policy of weights: one for each observation, and a constant."""
    return lambda observation: np.array(
        [weights[:-1] @ ((observation - _OFFSET) / _SCALE) + weights[-1]]
    )


def episode(env: TaskEnv, policy: Policy, seed: int, world: int) -> tuple[float, str]:
    """The reward of a world, and its verdict."""
    observation, _ = env.reset(seed=seed, options={"world": world})
    total = 0.0
    while True:
        observation, reward, terminated, truncated, info = env.step(
            np.clip(policy(observation), -1, 1)
        )
        total += reward
        if terminated or truncated:
            return total, str(info["verdict"])


def mean_reward(env: TaskEnv, policy: Policy, seed: int, worlds: range) -> tuple[float, int]:
    """The mean reward of some worlds, and how many passed."""
    found = [episode(env, policy, seed, world) for world in worlds]
    return float(np.mean([r for r, _ in found])), sum(v == "passed" for _, v in found)


def learned(env: TaskEnv, generations: int = 12, children: int = 12) -> Vector:
    """Weights by an evolution strategy: the mean of the best quarter, and their spread."""
    random = np.random.default_rng(0)
    mean, spread = np.zeros(len(_SCALE) + 1), np.full(len(_SCALE) + 1, 0.5)
    for generation in range(generations):
        tried = mean + spread * random.standard_normal((children, len(mean)))
        # Every child in the same worlds, every generation in others.
        worlds = range(6 * generation, 6 * generation + 6)
        earned = [mean_reward(env, linear(each), TRAINING, worlds)[0] for each in tried]
        best = tried[np.argsort(earned)[-children // 4 :]]
        mean, spread = best.mean(axis=0), best.std(axis=0) + 0.05
        print(f"generation {generation + 1}: best {max(earned):.2f}")
    return mean


def main(path: str) -> None:
    """Trains and judges."""
    env = gym.make(path, observe=OBSERVED, worlds=True)
    worlds = range(50)
    alone, passed = mean_reward(env, lambda _: np.zeros(1), JUDGING, worlds)
    print(f"the file alone: reward {alone:.2f}, {passed} of {len(worlds)} worlds passed")
    reward, passed = mean_reward(env, linear(learned(env)), JUDGING, worlds)
    print(f"learned: reward {reward:.2f}, {passed} of {len(worlds)} worlds passed")


if __name__ == "__main__":
    main(sys.argv[1])
