"""The page docs/torque-steps.md: how far the torque steps at every change of stage of each task.

`make steps` runs all shipped tasks and writes it anew; then read the difference.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "torque-steps.md"
#: No change of a shipped task may step by more [N m].
MOST = 0.5
HEAD = ("task", "changes", "step", "tick to tick", "carried", "from", "to")
TITLE = f"""\
# Torque steps at changes of stage

Where one stage follows another, the torque goes on where it was, and what the two laws differ by
fades ([conventions](conventions.md#torque-between-stages)). `make steps` runs every shipped task
and makes this table.

- **Step**: the new stage's first torque against the one that the old stage makes of the same
  measurement, the joint with the most, over all changes of the run [N m]. It is `torque_step` in a
  run's `summary.json`. What limits under `solve: qp` take at once is in it. A test holds it
  below {MOST:g} N m.
- **Tick to tick**: the largest change of a joint's torque from the last tick of a stage to the
  first of the next [N m]. What a change of the measured force or velocity makes of it is in it too.
- **Carried**: the largest D, what the old stage's torque is off the closed form of the new one's
  law [N m], and at which change. Without the hand-over that is the step, but for what limits take.

"""


def rows() -> Iterator[list[str]]:
    """A row for each shipped task with more than one stage, of arms that take torques."""
    sys.path.insert(0, str(ROOT / "tests"))
    from conftest import TASKS, _simulated

    for task in sorted(TASKS.glob("*.yaml")):
        run = _simulated.__wrapped__(task.stem, (), 0)
        changes = list(pairwise(run.transitions))
        if not changes or not run.program.context.drives.torques:
            continue
        before, after = max(changes, key=lambda pair: pair[0].torque_carried)
        joints = run.program.context.robot.pin.nv
        torque = np.array([run[f"joint.{i + 1}.torque"] for i in range(joints)])
        firsts = [visit.first for visit in run.history.visits()][1:]
        most = max(float(np.max(np.abs(torque[:, k] - torque[:, k - 1]))) for k in firsts)
        step = max(end.torque_step for end, _ in changes)
        numbers = [f"{size:.2f}" for size in (step, most, before.torque_carried)]
        yield [task.stem, str(len(changes)), *numbers, before.stage, after.stage]


def page() -> str:
    """The page as it should be."""
    lines = [HEAD, ["---"] * len(HEAD), *rows()]
    return TITLE + "".join(f"| {' | '.join(line)} |\n" for line in lines)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    sys.stdout.write(f"written to {PAGE}\n")
