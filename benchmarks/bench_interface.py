"""What an arm's interface costs: the same tasks by torques, by velocities and by positions.

    python benchmarks/bench_interface.py          # all of it; writes docs/interface.md
    python benchmarks/bench_interface.py wipe-table

One arm, one world, one set point and speed. What differs is what the joints take, the servo that
follows it, and the law, whose gains are designed for that servo.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bench_referee import Result, table
from referee.metrics import BAND, metrics

from taskspec.compiler import compile_task
from taskspec.spec import load_task
from taskspec.text.diagnostic import SpecError
from taskspec_runner.session import execute_program

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "interface.md"
#: Tasks, the stage of each that is measured, its axis of force and the axes that are led; None
#: where no force is to be kept.
TASKS: dict[str, tuple[str, str, str] | None] = {
    "press-hybrid": ("slide", "z", "x"),
    "wipe-table": ("wipe", "z", "xy"),
    "polish-drum": ("polish", "z", "xy"),
    "slot-insertion": None,
}
#: Laws that stages of a task have of their own, beside that of the file.
OWN_LAWS = {"slot-insertion": ("stages.insert.law",)}
TORQUE_LAWS = ("hybrid", "parallel")
VELOCITY_LAWS = ("force-velocity", "hybrid-velocity", "admittance")


@dataclass(frozen=True)
class Interface:
    """What an arm's joints take.

    Attributes:
        name: in the page.
        about: the same with numbers.
        overrides: that give a task this interface.
        laws: that command it.
    """

    name: str
    about: str
    overrides: Mapping[str, str]
    laws: tuple[str, ...]


def _servo(command: str, servo: str) -> dict[str, str]:
    return {"robot.command": command, "robot.servo": servo}


INTERFACES = (
    Interface("torques", "at 1 kHz", {}, TORQUE_LAWS),
    Interface(
        "velocities, quick",
        "the Panda's own: 50 Hz, 1 ms late, 1 kHz (`panda`)",
        _servo("velocity", "panda"),
        VELOCITY_LAWS,
    ),
    Interface(
        "velocities, slow",
        "20 Hz, 6 ms late, 500 Hz, as `ur5e-speedj` has them",
        _servo("velocity", "{bandwidth: 20 Hz, delay: 6 ms, rate: 500 Hz}"),
        VELOCITY_LAWS,
    ),
    Interface(
        "positions, slow",
        "20 Hz, 34 ms late, 500 Hz, as `ur5e-servoj` has them",
        _servo("position", "{bandwidth: 20 Hz, delay: 34 ms, rate: 500 Hz}"),
        VELOCITY_LAWS,
    ),
)


def measured(task: str, interface: Interface, law: str, folder: Path) -> Result:
    """A task by an interface and a law with designed gains; runs it.

    Args:
        task: a shipped one.
        interface, law: see above.
        folder: for the run.
    """
    places = ("law", *OWN_LAWS.get(task, ()))
    overrides = {**interface.overrides, **dict.fromkeys(places, law)}
    name = f"{interface.name}: `{law}`"
    loaded = load_task(ROOT / "tasks" / f"{task}.yaml", overrides)
    try:
        program = compile_task(loaded)
    except SpecError as error:
        codes = sorted({each.code for each in error.diagnostics if each.severity == "error"})
        return Result(name, "", f"refused: {', '.join(codes)}", None, float("nan"), None)
    run = execute_program(program, folder, report=False)
    met = sum(each.passed for each in run.expectations)
    outcome = run.verdict if run.verdict in ("passed", "missed") else f"{run.verdict}: {run.reason}"
    outcome += f", {met} of {len(run.expectations)} met, {run.end:.1f} s"
    columns = run.history.columns
    peak = float(np.max(np.linalg.norm([columns[f"force.{a}"] for a in "xyz"], axis=0)))
    at = TASKS[task]
    visits = [] if at is None else [v.rows for v in run.history.visits() if v.stage == at[0]]
    if at is None or not visits:
        return Result(name, "", outcome, None, peak, None)
    rows, (_, axis, led) = visits[0], at
    time, force, wanted = (
        np.asarray(columns[each][rows]) for each in ("t", f"force.{axis}", f"force.{axis}.ref")
    )
    off = [columns[f"position.{a}.ref"][rows] - columns[f"position.{a}"][rows] for a in led]
    return Result(name, "", outcome, metrics(time, force, wanted, np.column_stack(off)), peak, None)


_PREFACE = f"""\
# What the interface costs

The same tasks by an arm that takes torques, and by the same arm behind a servo that follows
velocities or positions. `make interface` makes this page.

**The same for all**: the arm, the surface, its stiffness, the set point, the speeds, guards and
limits of the shipped file. **What differs**: what the joints take, and the law. All gains are
designed, for the servo that is declared.

**What is measured**, of one stage: the force's error where its set point has been reached, the
overshoot beyond it, when the force stays within {100 * BAND:.0f} % of it, the share of ticks
without contact, and the error of the axes that are led. The peak is that of the whole run, and so
is the time. The files' `expect` was written for torques and for their own gains: a row that misses
one is no verdict, its figures are what to look at.

| interface | bandwidth, delay, rate |
| --- | --- |
"""

_READING = """\
## How to read it

- A servo of 50 Hz with 1 ms costs nothing on these contacts. A velocity integrates the force on a
  spring by itself, and the force settles sooner than by the integral of `hybrid`.
- 20 Hz and 6 ms cost some newtons of peak where the tool lands, and a tenth of a millimetre of the
  path.
- 34 ms cost the task: at 30 mm/s the tool goes a millimetre on after it has touched, which is 20 N
  on 20 kN/m, and the [designed](language/gains.md) damping is so high that the force arrives
  seconds later. Land more slowly, lower the delay, or put a pad between.
- `force-velocity` has an integral, so that a surface that moves leaves less of an error than under
  `admittance`, which has none.
- `hybrid-velocity` is `force-velocity` where no limit is near. In `slot-insertion` it does not
  seat the part: its program replaces set points
  [that no contact returns](laws/limits.md#forces-that-contacts-cannot-return), and the file pushes
  into an open slot. With `solve: closed-form` it seats it on the quick servo.
"""


def page(results: Mapping[str, list[Result]]) -> Iterator[str]:
    """The lines of the document."""
    yield _PREFACE.rstrip("\n")
    for each in INTERFACES:
        yield f"| {each.name} | {each.about} |"
    for task, rows in results.items():
        at = TASKS[task]
        yield f"\n## {task}\n"
        yield "The whole run.\n" if at is None else f"Stage `{at[0]}`.\n"
        yield from table(rows)
    yield ""
    yield _READING.rstrip("\n")


def main() -> None:
    """Runs what the command line names; all of it is written as the page."""
    names = sys.argv[1:] or list(TASKS)
    results: dict[str, list[Result]] = {}
    for task in names:
        results[task] = []
        for interface in INTERFACES:
            for law in interface.laws:
                with tempfile.TemporaryDirectory() as folder:
                    found = measured(task, interface, law, Path(folder) / "run")
                results[task].append(found)
                print(f"{task}: {found.law}: {found.outcome}", flush=True)
    lines = "\n".join(page(results)) + "\n"
    if sys.argv[1:]:
        print(lines)
    else:
        PAGE.write_text(lines, encoding="utf-8")


if __name__ == "__main__":
    main()
