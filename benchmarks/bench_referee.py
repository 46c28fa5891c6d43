"""Other people's control laws in tasks of this project, beside its own: docs/referee.md.

    python benchmarks/bench_referee.py            # all of them; writes docs/referee.md

TSID is among them where `--tsid` names the Python of an environment that has it, by default that of
`make tsid`.

The file's plant is served by `taskspec plant` in lock-step, and each law answers its samples with
torques: the same world, sensor, rate, references, guards and limits for all. Whether a run is good
says the file's `expect`.
"""

from __future__ import annotations

import argparse
import json
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from referee.arm import Arm
from referee.impedance import Impedance
from referee.metrics import BAND, Metrics, metrics
from referee.operational_space import DEFAULT, OperationalSpace
from referee.session import Law, Session

from taskspec_runner import read

ROOT = Path(__file__).resolve().parents[1]
PAGE, PICTURE = ROOT / "docs" / "referee.md", ROOT / "docs" / "images" / "referee.svg"
#: What laws of this project are designed for, where a file says nothing else [Hz].
BANDWIDTH = 5.0
#: Tasks, and the stage of each that is measured, its axis of force and the axes that are led.
TASKS = {
    "wipe-table": ("wipe", "z", "xy"),
    "press-parallel": ("slide", "z", "x"),
    "polish-drum": ("polish", "z", "xy"),
}
OWN = "taskspec"
#: The library, and the Python of the environment that `make tsid` makes for it.
TSID, TSID_PYTHON = "TSID", ROOT / ".tsid" / "bin" / "python"
TSID_GIVEN = (
    f"motion of {BANDWIDTH:g} Hz, damping ratio 1, with weight 100 on the axes that are led; a "
    "point contact along the axis of force, friction 0.2, whose force is commanded with weight 1, "
    "open loop, damped along it with 60 1/s; a posture with weight 1e-4; the arm's model and "
    "its limits of torque; tsid 1.7.1 with pin 3.4.0"
)
PROGRAM = str(Path(sys.executable).with_name("taskspec"))


@dataclass(frozen=True)
class Result:
    """One law in one task.

    Attributes:
        law: its name.
        given: what it was given.
        outcome: as the summary has it, with the expectations that were met.
        metrics: of the stage that is measured; None where the run did not come to it.
        peak: largest force on the tool [N].
        force: (k,) along the axis in that stage, time (k,) with it, and its set point.
    """

    law: str
    given: str
    outcome: str
    metrics: Metrics | None
    peak: float
    force: tuple[np.ndarray, np.ndarray, np.ndarray] | None


def laws() -> dict[str, Callable[[Arm], Law]]:
    """The laws by name."""
    same = (2 * np.pi * BANDWIDTH) ** 2
    found: dict[str, Callable[[Arm], Law]] = {
        "impedance": lambda arm: Impedance(arm, BANDWIDTH),
        "operational space, robosuite's gains": lambda arm: OperationalSpace(arm, DEFAULT),
        f"operational space, coupled, {BANDWIDTH:g} Hz": lambda arm: OperationalSpace(
            arm, same, coupled=True
        ),
    }
    return found


def own(task: Path, folder: Path) -> Result:
    """This project's law in a task."""
    command = [PROGRAM, "run", str(task), "--out", str(folder)]
    subprocess.run([*command, "--quiet"], check=False, capture_output=True)
    kind = read(folder).program.context.loaded.task.law.kind
    return _result(OWN, f"the file: `{kind}`", task, folder)


def foreign(name: str, make: Callable[[Arm], Law], task: Path, folder: Path) -> Result:
    """Another law in a task."""
    law, port = make(Arm(task)), _free_port()
    with _served(task, folder, port):
        Session(port, name).drive(law)
    return _result(name, getattr(law, "given", ""), task, folder)


def with_tsid(python: Path, task: Path, folder: Path) -> Result:
    """TSID in a task, in an environment of its own.

    Raises:
        CalledProcessError: it has not come to the end of the session; its words are shown.
    """
    arm, port = folder.with_suffix(".json"), _free_port()
    arm.write_text(json.dumps(Arm(task).described()), "utf-8")
    command = [str(python), "-m", "referee.inverse_dynamics", str(arm), str(port), str(BANDWIDTH)]
    with _served(task, folder, port):
        subprocess.run(command, check=True, cwd=Path(__file__).parent)
    return _result(TSID, TSID_GIVEN, task, folder)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@contextmanager
def _served(task: Path, folder: Path, port: int) -> Iterator[None]:
    """The plant of a task in lock-step, until its run has ended; stopped if nobody drives it."""
    command = [PROGRAM, "plant", str(task), "--out", str(folder)]
    listen = ["--listen", f"udp://127.0.0.1:{port}", "--answer", "60", "--quiet"]
    with subprocess.Popen(
        [*command, *listen], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as plant:
        try:
            yield
        except BaseException:
            plant.terminate()
            raise


def _result(law: str, given: str, task: Path, folder: Path) -> Result:
    run = read(folder)
    stage, axis, led = TASKS[task.stem]
    met = sum(each.passed for each in run.expectations)
    outcome = run.verdict if run.verdict in ("passed", "missed") else f"{run.verdict}: {run.reason}"
    outcome += f", {met} of {len(run.expectations)} met"
    columns = run.history.columns
    peak = float(np.max(np.linalg.norm([columns[f"force.{a}"] for a in "xyz"], axis=0)))
    visits = [visit.rows for visit in run.history.visits() if visit.stage == stage]
    if not visits:
        return Result(law, given, outcome, None, peak, None)
    rows = visits[0]
    time, force, wanted = (
        np.asarray(columns[name][rows]) for name in ("t", f"force.{axis}", f"force.{axis}.ref")
    )
    off = [columns[f"position.{a}.ref"][rows] - columns[f"position.{a}"][rows] for a in led]
    found = metrics(time, force, wanted, np.column_stack(off))
    return Result(law, given, outcome, found, peak, (time, force, wanted))


def table(results: list[Result]) -> Iterator[str]:
    """The rows of a task."""
    heads = ("law", "outcome", "force error, rms", "overshoot", "peak", "settled")
    heads += ("contact lost", "path error, rms")
    yield f"| {' | '.join(heads)} |"
    yield f"|{' --- |' * len(heads)}"
    for each in results:
        m = each.metrics
        if m is None:
            yield f"| {each.law} | {each.outcome} | - | - | {each.peak:.1f} N | - | - | - |"
            continue
        settled = f"{m.settled:.2f} s" if np.isfinite(m.settled) else "never"
        yield (
            f"| {each.law} | {each.outcome} | {m.force_rms:.2f} N | {m.overshoot:.2f} N | "
            f"{each.peak:.1f} N | {settled} | {100 * m.lost:.1f} % | {1e3 * m.path_rms:.2f} mm |"
        )


_COLOURS = ("#1f6f5c", "#b3541e", "#3b5ba9", "#8a4f9e", "#6b6b6b")
_WIDE, _HIGH, _LEFT, _TOP, _APART = 940, 170, 60, 60, 230
_POINTS = 800


def picture(results: dict[str, list[Result]]) -> str:
    """Forces of all laws over the time of the stage, a panel a task, as SVG."""
    size = f'width="{_WIDE + 100}" height="{_APART * len(results) + 60}"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="12">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for i, each in enumerate(next(iter(results.values()))):
        x = _LEFT + 215 * i
        parts.append(f'<rect x="{x}" y="12" width="16" height="4" fill="{_COLOURS[i]}"/>')
        parts.append(f'<text x="{x + 20}" y="18">{each.law}</text>')
    for number, (task, rows) in enumerate(results.items()):
        parts += _panel(task, rows, _TOP + _APART * number)
    return "\n".join([*parts, "</svg>"]) + "\n"


def _panel(task: str, rows: list[Result], y0: int) -> Iterator[str]:
    drawn = [(i, each.force) for i, each in enumerate(rows) if each.force is not None]
    final = float(drawn[0][1][2][-1])
    end = max(float(force[0][-1]) for _, force in drawn)
    low, most = sorted((0.0, 2.0 * final))

    def y(force: float) -> float:
        return y0 + _HIGH - (force - low) / (most - low) * _HIGH

    title = f"{task}: {final:g} N are commanded"
    yield f'<text x="{_LEFT}" y="{y0 - 8}" font-weight="bold">{title}</text>'
    yield f'<rect x="{_LEFT}" y="{y0}" width="{_WIDE}" height="{_HIGH}" fill="#f5f6f6"/>'
    for value in np.linspace(low, most, 5):
        line = f'x1="{_LEFT}" x2="{_LEFT + _WIDE}" y1="{y(value):.1f}" y2="{y(value):.1f}"'
        yield f'<line {line} stroke="#dddddd"/>'
        place = f'x="{_LEFT - 6}" y="{y(value) + 4:.1f}"'
        yield f'<text {place} text-anchor="end">{value:g} N</text>'
    for i, (time, force, _) in drawn:
        step = max(1, len(time) // _POINTS)
        points = " ".join(
            f"{_LEFT + _WIDE * t / end:.1f},{y(f):.1f}"
            for t, f in zip(time[::step], np.clip(force[::step], low, most), strict=True)
        )
        line = f'fill="none" stroke="{_COLOURS[i]}" stroke-width="1.3"'
        yield f'<polyline points="{points}" {line}/>'
    place = f'x="{_LEFT + _WIDE}" y="{y0 + _HIGH + 16}"'
    yield f'<text {place} text-anchor="end">{end:.0f} s</text>'


_PREFACE = f"""\
# Laws of other packages

Control laws that others have published drive tasks of this project, beside its own. `make referee`
makes this page and its picture.

**The same for all.** The plant is served by [`taskspec plant`](protocol.md) in lock-step at the
file's rate: one world, one sensor, the file's references, guards and limits. Who answers the
samples with torques drives the arm. The file's `expect` says whether a run is good. All have the
arm's own model with its tool, and no controller is given the surface's stiffness.

**What differs.** A task's file commands force along one axis and motion along the others, which
this project's laws are for. TSID has such axes too; its contacts stick, and its force is commanded
without feedback. An impedance and operational space control as robosuite has it know no
set points of force: they are given it as a feed-forward, as is usual to press with them. They are
not given the accelerations of references, which the protocol does not send and they do not
use. So the columns of force show what feedback of force is worth, and that of the path what the
acceleration of references is, at this bandwidth. It is {BANDWIDTH:g} Hz, which is what this
project's laws are designed for where a file says nothing else; robosuite's own gains are a row of
their own. What the files expect was written for this project's laws: a row that misses it is no
verdict on a law, its figures are what to look at.

**What is measured**, of one stage: the force's error where its set point has been reached, the
overshoot beyond it, when the force stays within {100 * BAND:.0f} % of it, the share of ticks
without contact, and the error of the axes that are led; the peak is that of the whole run. Settling
time, overshoot and steady error are what NISTIR 8097 measures of a step of force.
"""


def page(results: dict[str, list[Result]]) -> str:
    """The document."""
    lines = [_PREFACE, "![The force of every law in each task](images/referee.svg)", ""]
    for task, rows in results.items():
        lines += [f"## {task}", "", f"Stage `{TASKS[task][0]}`.", "", *table(rows), ""]
    given = {each.law: each.given for rows in results.values() for each in rows if each.law != OWN}
    lines += ["## What each was given", ""]
    lines += [f"- **{OWN}**: what the file says, its gains designed where it says nothing."]
    lines += [f"- **{law}**: {text}." for law, text in given.items()]
    if TSID not in given:
        lines += ["", "TSID was not among them: `make tsid` makes the environment that it needs."]
    lines += [
        "",
        "What TSID's loop costs beside this project's is in [performance](performance.md).",
    ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Makes table and picture."""
    options = argparse.ArgumentParser()
    options.add_argument("--task", action="append", choices=list(TASKS))
    options.add_argument("--page", type=Path, default=PAGE)
    options.add_argument("--picture", type=Path, default=PICTURE)
    options.add_argument("--tsid", type=Path, default=TSID_PYTHON, help="Python that has it")
    given = options.parse_args()
    if not given.tsid.exists():
        print(f"{given.tsid} is not there, so TSID is left out: `make tsid` makes it")
    results: dict[str, list[Result]] = {}
    with tempfile.TemporaryDirectory() as name:
        for task in given.task or TASKS:
            file, folder = ROOT / "tasks" / f"{task}.yaml", Path(name)
            results[task] = [own(file, folder / f"{task} own")]
            for number, (law, make) in enumerate(laws().items()):
                results[task].append(foreign(law, make, file, folder / f"{task} {number}"))
            if given.tsid.exists():
                results[task].append(with_tsid(given.tsid, file, folder / f"{task} tsid"))
            print(task, *table(results[task]), sep="\n")
    given.page.write_text(page(results), "utf-8")
    given.picture.write_text(picture(results), "utf-8")


if __name__ == "__main__":
    main()
