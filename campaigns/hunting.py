"""How often stages hunt that compensate more friction than there is, and how often TS518 says so.

Random arms with random compensation, and with less friction in truth, are run: 2 s each, of which a
move takes the first. A run hunts that goes on changing joint velocities by more than 1 mrad/s from
tick to tick at its end, or that a limit stops. `make hunting` writes the table into
docs/laws/output-feedback.md.

    python campaigns/hunting.py --seed 7 --files 120 --page docs/laws/output-feedback.md
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from page_tables import write_table

from taskspec.compiler import compile_unchecked
from taskspec.spec import load_text
from taskspec.stability.hunting import gained
from taskspec.stability.sampled_stage import loop_of
from taskspec_runner import run

#: What a swing gains, as a part of what friction takes, from and up to.
BANDS = ((0.0, 0.0), (0.0, 1.0), (1.0, 4.0), (4.0, math.inf))
NAMES = ("none grows", "up to 1", "1 to 4", "more than 4")
HEADER = "| gain, of what friction takes | TS518 | files | hunt |\n| --- | --- | --- | --- |\n"
ARMS = ("panda", "ur5e", "planar3")
TASK = """\
taskspec: 1
robot: {{model: {arm}, start: {{xyz: [{start}]}}, joint_friction: {declared:.6g} N*m}}
control: {{friction: {{share: {share:.6g}, width: {width:.6g} rad/s, time: {time:.6g} s}}}}
law: {{kind: {law}}}
stages:
  go: {{axes: {{x: {{move: {x:.3g} mm}}, y: {{move: {y:.3g} mm}}}}, time: 2 s}}
truth: {{robot.joint_friction: {true:.6g} N*m}}
"""
#: [rad/s] from tick to tick.
HUNTS, TAIL = 1e-3, 300


def drawn(rng: np.random.Generator) -> tuple[str, float]:
    """A random file, and the friction that it truly has [N m]."""
    arm = ARMS[rng.choice(3, p=(0.45, 0.45, 0.1))]
    size, share = (0.3 if arm == "planar3" else 2.0), rng.uniform(0.4, 1)
    declared = size * rng.uniform(0.2, 1)
    true = declared * share * (0 if rng.random() < 0.15 else rng.uniform(0, 0.95))
    x, y = rng.uniform(-30, 30, 2)
    text = TASK.format(
        arm=arm,
        start="450 mm, 200 mm, 0" if arm == "planar3" else "450 mm, 100 mm, 310 mm",
        declared=declared,
        share=share,
        width=10 ** rng.uniform(-4.3, -2),
        time=10 ** rng.uniform(-1.5, -0.7),
        law=("pd", "impedance", "hybrid")[rng.integers(3)],
        x=x,
        y=y,
        true=true,
    )
    return text, true


def judged(text: str, true: float) -> tuple[float, bool]:
    """What a swing gains at most, and whether the run hunts."""
    loaded = load_text(text, "task.yaml")
    program = compile_unchecked(loaded)
    sampled, friction = loop_of(program.plan, "go"), program.context.friction
    assert sampled is not None
    assert friction is not None
    n = program.context.robot.n
    gain = gained(sampled, friction, np.full(n, true))
    with tempfile.TemporaryDirectory() as folder:
        made = run(loaded, Path(folder) / "run", force=True, report=False)
        v = np.column_stack([made.column(f"joint.{i + 1}.velocity") for i in range(n)])
        late = float(np.std(np.diff(v[-TAIL:], axis=0), axis=0).max())
        return gain, made.summary["status"] != "done" or late > HUNTS


def table(found: list[tuple[float, bool]]) -> str:
    """Rows by what a swing gains."""
    rows = [HEADER]
    for name, (low, high) in zip(NAMES, BANDS, strict=True):
        inside = [hunts for gain, hunts in found if low < gain <= high or gain == low == high]
        says = "warns" if low >= 1 else "silent"
        rows.append(f"| {name} | {says} | {len(inside)} | {sum(inside)} |\n")
    return "".join(rows)


def main() -> None:
    """Prints the table, or writes it into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--files", type=int, default=120)
    parser.add_argument("--page", type=Path, help="where the table is written to")
    given = parser.parse_args()
    rng, found = np.random.default_rng(given.seed), []
    for number in range(given.files):
        found.append(judged(*drawn(rng)))
        gain, hunts = found[-1]
        sys.stderr.write(f"{number}: gain {gain:.3g}, {'hunts' if hunts else 'rests'}\n")
    rows = table(found)
    sys.stdout.write(rows)
    if given.page is not None:
        write_table(given.page, "hunting", rows)


if __name__ == "__main__":
    main()
