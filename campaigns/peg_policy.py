"""A policy on top of a task file, the file alone, and the same learner without it.

Both learners are CMA-ES on the weights of a = tanh(W f) with f the measured force, the depth of
the peg, the time and 1, twenty times a second. With W = 0 an action is 0, which is what
the file does by itself. `make peg-policy` trains each with five seeds and writes the table of
docs/how-to/learning.md; what was trained is kept below runs/peg-policy, so that a campaign that
was broken off goes on.

    python campaigns/peg_policy.py --seeds 5 --generations 12 --page docs/how-to/learning.md
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cma
import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "campaigns"))

from seatings import HEAD, HOLE, Seating, cells, seating  # noqa: E402

from taskspec_runner.gym import make  # noqa: E402
from taskspec_runner.gym.env import TaskEnv  # noqa: E402

Vector = NDArray[np.float64]

#: Steps of a policy [Hz], and where an episode is truncated [s]: as in Factory's PegInsert.
RATE, LONGEST = 20.0, 10.0
#: What a policy sees, and what is 1 of it [SI].
SEEN = {"clock": 10.0, "force.x": 10.0, "force.y": 10.0, "force.z": 10.0, "position.z": 0.025}
#: Candidates of a generation, worlds that each is tried in, first step of the weights.
CANDIDATES, TRIED, STEP = 10, 6, 0.2
#: Of the last so many generations the policy that earns most in so many fresh worlds is kept.
LAST, FRESH = 6, 30
#: Seed of the worlds that judge; those of training are 1000 more than the learner's.
JUDGED = 7027


@dataclass(frozen=True, slots=True)
class Learner:
    """What a policy acts on.

    Attributes:
        name: of its rows.
        file: the task.
        act: as `make` has it.
    """

    name: str
    file: Path
    act: Mapping[str, Any]

    def env(self) -> TaskEnv:
        """Its environment."""
        longest = {"max_time": LONGEST, "decide": False}
        return make(self.file, self.act, list(SEEN), worlds=True, rate=RATE, **longest)


LEARNERS = (
    Learner(
        "on the file",
        ROOT / "tasks" / "tight-peg.yaml",
        dict.fromkeys(("fall", "push", "shake", "rise", "sink"), True),
    ),
    Learner(
        "without the file",
        ROOT / "campaigns" / "bare-peg.yaml",
        {
            "x": "position +- 6 mm at 40 mm/s",
            "y": "position +- 6 mm at 40 mm/s",
            "z": "position +- 40 mm at 60 mm/s",
            "rx": "position +- 20 deg at 60 deg/s",
            "ry": "position +- 20 deg at 60 deg/s",
        },
    ),
)


@dataclass(frozen=True, slots=True)
class Policy:
    """a = tanh(W f).

    Attributes:
        weights: (actions, features).
    """

    weights: Vector

    def __call__(self, seen: NDArray[np.float32]) -> Vector:
        """The action (actions,) for what is observed (len(SEEN),) [SI]."""
        return np.tanh(self.weights @ np.array([1.0, *(seen / np.array(list(SEEN.values())))]))


#: The number of features.
FEATURES = 1 + len(SEEN)


def nothing(env: TaskEnv) -> Policy:
    """The policy whose actions are 0."""
    return Policy(np.zeros((env.action_space.shape[0], FEATURES)))


def episode(env: TaskEnv, policy: Policy, seed: int, number: int) -> float:
    """The return of a policy in a world."""
    seen, _ = env.reset(seed=seed, options={"world": number})
    earned, over = 0.0, False
    while not over:
        seen, reward, terminated, truncated, _ = env.step(policy(seen))
        earned, over = earned + reward, terminated or truncated
    return earned


def seated(env: TaskEnv) -> Seating:
    """What became of the peg in the last episode."""
    assert env.episode is not None
    run = env.episode.trial()
    nominal = float(env.setup.program.context.loaded.task.shapes[HOLE].xyz[2])
    return seating(run.history, run.world, nominal)


def train(env: TaskEnv, seed: int, generations: int) -> Iterator[tuple[float, Policy]]:
    """After each generation the mean return of its candidates, and the policy so far.

    All candidates of a generation are tried in the same worlds, the next ones in others.
    """
    shape = (env.action_space.shape[0], FEATURES)
    options = {"seed": seed, "popsize": CANDIDATES, "CMA_diagonal": True, "verbose": -9}
    search = cma.CMAEvolutionStrategy(np.zeros(shape).ravel(), STEP, options)
    for generation in range(generations):
        candidates = search.ask()
        worlds = [generation * TRIED + i for i in range(TRIED)]
        earned = [
            np.mean([episode(env, Policy(c.reshape(shape)), 1000 + seed, w) for w in worlds])
            for c in candidates
        ]
        search.tell(candidates, [-each for each in earned])
        yield float(np.mean(earned)), Policy(search.result.xfavorite.reshape(shape))


def trained(learner: Learner, env: TaskEnv, seed: int, generations: int, kept: Path) -> Policy:
    """The policy of a learner and a seed: the kept one, or one that is trained now."""
    path = kept / f"{learner.file.stem}-{seed}-{generations}.json"
    if path.exists():
        return Policy(np.array(json.loads(path.read_text(encoding="utf-8"))["weights"]))
    course, found = [], []
    for mean, policy in train(env, seed, generations):
        found.append(policy)
        course.append(mean)
        say(f"{learner.name}, seed {seed}: generation {len(course)}, return {mean:.2f}")
    fresh = [generations * TRIED + i for i in range(FRESH)]
    earned = [np.mean([episode(env, p, 1000 + seed, w) for w in fresh]) for p in found[-LAST:]]
    policy = found[-LAST:][int(np.argmax(earned))]
    say(f"{learner.name}, seed {seed}: of the last ones {', '.join(f'{e:.2f}' for e in earned)}")
    kept.mkdir(parents=True, exist_ok=True)
    said = {
        "features": ["1", *(f"{name}/{one:g}" for name, one in SEEN.items())],
        "actions": [channel.name for channel in env.setup.actions.channels],
        "returns": course,
        "weights": policy.weights.tolist(),
    }
    path.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
    return policy


def judged(env: TaskEnv, policy: Policy, worlds: int) -> Iterator[Seating]:
    """The pegs of a policy in the worlds that judge."""
    for number in range(worlds):
        episode(env, policy, JUDGED, number)
        yield seated(env)


def say(line: str) -> None:
    """Prints a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def rows(seeds: int, generations: int, worlds: int, kept: Path) -> Iterator[list[str]]:
    """The rows of the table, each when it is measured."""
    yield ["policy", "seed", *HEAD]
    for learner in LEARNERS:
        env = learner.env()
        if learner is LEARNERS[0]:
            yield ["the file alone", "", *cells(list(judged(env, nothing(env), worlds)))]
        for seed in range(1, seeds + 1):
            policy = trained(learner, env, seed, generations, kept)
            yield [learner.name, str(seed), *cells(list(judged(env, policy, worlds)))]


def main() -> None:
    """Trains and judges, prints the table, and keeps it in a page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5, help="of each learner")
    parser.add_argument("--generations", type=int, default=12, help="of a training")
    parser.add_argument("--worlds", type=int, default=100, help="that judge")
    parser.add_argument("--kept", type=Path, default=ROOT / "runs" / "peg-policy")
    parser.add_argument("--page", type=Path, help="whose table is written anew")
    given = parser.parse_args()
    lines = []
    for row in rows(given.seeds, given.generations, given.worlds, given.kept):
        lines.append(f"| {' | '.join(row)} |")
        say(lines[-1])
    lines.insert(1, "|" + " --- |" * (lines[0].count("|") - 1))
    if given.page:
        text = given.page.read_text(encoding="utf-8")
        table = "\n".join(lines)
        mark = r"(<!-- measured: peg-policy -->\n).*?\n\n"
        new = re.sub(mark, lambda found: f"{found[1]}{table}\n\n", text, flags=re.S)
        given.page.write_text(new, encoding="utf-8")


if __name__ == "__main__":
    main()
