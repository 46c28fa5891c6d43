"""Other people's control laws in tasks of this project, beside its own: docs/referee.md.

    python benchmarks/bench_referee.py            # all of them; writes docs/referee.md
    python benchmarks/bench_referee.py --arms velocity      # of arms that take velocities alone
    python benchmarks/bench_referee.py --tune     # what the rules for these were tuned to

TSID is among them where `--tsid` names the Python of an environment that has it, by default that of
`make tsid`.

The file's plant is served by `taskspec plant` in lock-step, and each law answers its samples with
torques, or, where the same file's arm takes velocities, with these: the same world, sensor, joint
servo, rate, references, guards and limits for all. Whether a run is good says the file's `expect`.
"""

from __future__ import annotations

import argparse
import json
import re
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from referee import admittance, forward_dynamics
from referee.admittance import RosAdmittance
from referee.arm import Arm
from referee.direct import driven
from referee.forward_dynamics import ForwardDynamics
from referee.impedance import Impedance
from referee.metrics import BAND, Metrics, metrics
from referee.operational_space import DEFAULT, OperationalSpace
from referee.session import Law
from referee.tuning import (
    ABOUT,
    ANYWHERE,
    FORWARD_SPACE,
    ROS_SPACE,
    Space,
    cost,
    forward_gains,
    ros_gains,
    tuned,
)

from taskspec import load
from taskspec.compiler import compile_task
from taskspec.spec import load_task
from taskspec_runner import read
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.sensing import Sensing

ROOT = Path(__file__).resolve().parents[1]
PAGE, IMAGES = ROOT / "docs" / "referee.md", ROOT / "docs" / "images"
#: What laws of this project are designed for, where a file says nothing else [Hz].
BANDWIDTH = 5.0
#: Tasks, and the stage of each that is measured, its axis of force and the axes that are led.
TASKS = {
    "wipe-table": ("wipe", "z", "xy"),
    "press-parallel": ("slide", "z", "x"),
    "polish-drum": ("polish", "z", "xy"),
}
#: The task that gains are tuned on.
RUB = Path(__file__).parent / "referee" / "rub.yaml"
STAGES = {**TASKS, "rub": ("rub", "z", "x")}
#: What the arm of a file is commanded, and by which servo it follows.
ARMS: dict[str, dict[str, str]] = {
    "torque": {},
    "velocity": {"robot.command": "velocity", "robot.servo": "panda"},
}
#: Laws of this project on an arm that takes velocities.
OWN_RULES = ("admittance", "force-velocity")
#: What `--tune` has found.
ROS_TUNED = {"mass": 0.633, "damping": 71.3, "filter": 0.702, "stiffness": 3340.0}
FORWARD_TUNED = {"p": 0.19, "d_by_p": 0.01, "stiffness": 10300.0, "iterations": 1.0}
#: Ticks of this project's own controller that are timed, in Python as the others.
TICKS = 500
OWN = "taskspec"
#: The library, and the Python of the environment that `make tsid` makes for it.
TSID, TSID_PYTHON = "TSID", ROOT / ".tsid" / "bin" / "python"
TSID_GIVEN = (
    f"motion of {BANDWIDTH:g} Hz, damping ratio 1, with weight 100 on the axes that are led; a "
    "point contact along the axis of force, friction 0.2, whose force is commanded with weight 1, "
    "open loop, damped along it with 60 1/s; a posture with weight 1e-4; the arm's model and "
    "its limits of torque; tsid 1.7.1 with pin 3.4.0"
)
PROGRAM = (sys.executable, "-m", "taskspec_runner")


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
        taken: processor time of an answer, the median [s]; NaN where it was not measured.
    """

    law: str
    given: str
    outcome: str
    metrics: Metrics | None
    peak: float
    force: tuple[np.ndarray, np.ndarray, np.ndarray] | None
    taken: float = float("nan")


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


def rules(period: float) -> dict[str, Callable[[Arm], Law]]:
    """The rules of arms that take velocities, by name; they have a control period [s]."""
    ros, forward = ros_gains(ROS_TUNED), forward_gains(FORWARD_TUNED)
    return {
        "ROS 2 admittance, its example's gains": lambda arm: RosAdmittance(
            arm, admittance.EXAMPLE, period
        ),
        "ROS 2 admittance, tuned": lambda arm: RosAdmittance(arm, ros, period),
        "forward dynamics, its example's gains": lambda arm: ForwardDynamics(
            arm, forward_dynamics.EXAMPLE, period
        ),
        "forward dynamics, tuned": lambda arm: ForwardDynamics(arm, forward, period),
    }


def own(task: Path, folder: Path, overrides: dict[str, str]) -> Result:
    """This project's law in a task."""
    command = [*PROGRAM, "run", str(task), "--out", str(folder), *_set(overrides)]
    subprocess.run([*command, "--quiet"], check=False, capture_output=True)
    kind = read(folder).program.context.loaded.task.law.kind
    name = f"{OWN}, {kind}" if overrides else OWN
    found = _result(name, f"the file: `{kind}`", task, folder)
    return replace(found, taken=_own_time(task, overrides))


def _own_time(task: Path, overrides: dict[str, str]) -> float:
    """Processor time of a tick of this project's controller, in the stage that is measured [s]."""
    program = compile_task(load_task(task, overrides), force=True)
    parts, taken, number = assemble(program), list[float](), 0
    machine, plant = parts.machine, parts.plant
    sensing = Sensing(plant.arm, plant.views.equations, machine)
    sensing.read()
    machine.start()
    while len(taken) < TICKS:
        sensing.read()
        began = time.thread_time()
        machine.tick(number * program.context.period)
        if machine.stage.name == TASKS[task.stem][0]:
            taken.append(time.thread_time() - began)
        plant.step(machine.torque)
        number += 1
    return statistics.median(taken)


def foreign(
    name: str, make: Callable[[Arm], Law], task: Path, folder: Path, overrides: dict[str, str]
) -> Result:
    """Another law in a task."""
    law, program = make(Arm(task)), compile_task(load_task(task, overrides), force=True)
    taken = driven(law, name, program, folder)
    found = _result(name, getattr(law, "given", ""), task, folder)
    return replace(found, taken=statistics.median(taken))


def tune(which: str) -> None:
    """Prints what a rule is tuned to, and what each point costs."""
    period = 1.0 / load(RUB).task.control.rate
    searched: dict[str, tuple[Space, Callable[[Mapping[str, float]], Callable[[Arm], Law]]]] = {
        admittance.NAME: (
            ROS_SPACE,
            lambda at: lambda arm: RosAdmittance(arm, ros_gains(at), period),
        ),
        forward_dynamics.NAME: (
            FORWARD_SPACE,
            lambda at: lambda arm: ForwardDynamics(arm, forward_gains(at), period),
        ),
    }
    space, make = searched[which]

    def tried(at: Mapping[str, float]) -> float:
        with tempfile.TemporaryDirectory() as folder:
            found = foreign(which, make(at), RUB, Path(folder) / "run", {})
        set_point = float(found.force[2][-1]) if found.force is not None else 1.0
        price = cost(found.metrics, set_point, ended=not found.outcome.startswith("stopped"))
        print(f"{price:8.3f}", _rounded(at), flush=True)
        return price

    best, least = tuned(space, tried)
    print(which, _rounded(best), f"{least:.3f}")


def _rounded(values: Mapping[str, float]) -> dict[str, float]:
    return {key: float(f"{value:.3g}") for key, value in values.items()}


def _set(overrides: dict[str, str]) -> list[str]:
    return [part for key, value in overrides.items() for part in ("--set", f"{key}={value}")]


def with_tsid(python: Path, task: Path, folder: Path) -> Result:
    """TSID in a task, in an environment of its own.

    Raises:
        CalledProcessError: it has not come to the end of the session; its words are shown.
    """
    arm, port = folder.with_suffix(".json"), _free_port()
    arm.write_text(json.dumps(Arm(task).described()), "utf-8")
    command = [str(python), "-m", "referee.inverse_dynamics", str(arm), str(port), str(BANDWIDTH)]
    with _served(task, folder, port, {}):
        subprocess.run(command, check=True, cwd=Path(__file__).parent)
    return _result(TSID, TSID_GIVEN, task, folder)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@contextmanager
def _served(task: Path, folder: Path, port: int, overrides: dict[str, str]) -> Iterator[None]:
    """The plant of a task in lock-step, until its run has ended; stopped if nobody drives it."""
    command = [*PROGRAM, "plant", str(task), "--out", str(folder), *_set(overrides)]
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
    stage, axis, led = STAGES[task.stem]
    met = sum(each.passed for each in run.expectations)
    outcome = run.verdict if run.verdict in ("passed", "missed") else f"{run.verdict}: {run.reason}"
    outcome += f", {met} of {len(run.expectations)} met"
    columns = run.history.columns
    peak = float(np.max(np.linalg.norm([columns[f"force.{a}"] for a in "xyz"], axis=0)))
    visits = [visit.rows for visit in run.history.visits() if visit.stage == stage]
    if not visits:
        return Result(law, given, outcome, None, peak, None)
    rows = visits[0]
    at, force, wanted = (
        np.asarray(columns[name][rows]) for name in ("t", f"force.{axis}", f"force.{axis}.ref")
    )
    off = [columns[f"position.{a}.ref"][rows] - columns[f"position.{a}"][rows] for a in led]
    found = metrics(at, force, wanted, np.column_stack(off))
    return Result(law, given, outcome, found, peak, (at, force, wanted))


def table(results: list[Result]) -> Iterator[str]:
    """The rows of a task; what a tick takes has a column where it was measured."""
    timed = any(np.isfinite(each.taken) for each in results)
    heads = ("law", "outcome", "force error, rms", "overshoot", "peak", "settled")
    heads += ("contact lost", "path error, rms", *(["a tick takes"] if timed else []))
    yield f"| {' | '.join(heads)} |"
    yield f"|{' --- |' * len(heads)}"
    for each in results:
        m = each.metrics
        taken = f"{1e6 * each.taken:.0f} µs" if np.isfinite(each.taken) else "-"
        if m is None:
            cells = ["-", "-", f"{each.peak:.1f} N", "-", "-", "-"]
        else:
            settled = f"{m.settled:.2f} s" if np.isfinite(m.settled) else "never"
            cells = [f"{m.force_rms:.2f} N", f"{m.overshoot:.2f} N", f"{each.peak:.1f} N"]
            cells += [settled, f"{100 * m.lost:.1f} %", f"{1e3 * m.path_rms:.2f} mm"]
        cells += [taken] if timed else []
        yield f"| {' | '.join([each.law, each.outcome, *cells])} |"


_COLOURS = ("#1f6f5c", "#b3541e", "#3b5ba9", "#8a4f9e", "#6b6b6b", "#c29a1c")
_WIDE, _HIGH, _LEFT, _TOP, _APART = 940, 170, 60, 78, 230
_A_ROW = 3
_POINTS = 800


def picture(results: dict[str, list[Result]]) -> str:
    """Forces of all laws over the time of the stage, a panel a task, as SVG."""
    size = f'width="{_WIDE + 100}" height="{_TOP + _APART * len(results)}"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="12">',
        '<rect width="100%" height="100%" fill="white"/>',
    ]
    for i, each in enumerate(next(iter(results.values()))):
        x, y = _LEFT + _WIDE // _A_ROW * (i % _A_ROW), 18 + 18 * (i // _A_ROW)
        parts.append(f'<rect x="{x}" y="{y - 6}" width="16" height="4" fill="{_COLOURS[i]}"/>')
        parts.append(f'<text x="{x + 20}" y="{y}">{each.law}</text>')
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
    for i, (at, force, _) in drawn:
        step = max(1, len(at) // _POINTS)
        points = " ".join(
            f"{_LEFT + _WIDE * t / end:.1f},{y(f):.1f}"
            for t, f in zip(at[::step], np.clip(force[::step], low, most), strict=True)
        )
        line = f'fill="none" stroke="{_COLOURS[i]}" stroke-width="1.3"'
        yield f'<polyline points="{points}" {line}/>'
    place = f'x="{_LEFT + _WIDE}" y="{y0 + _HIGH + 16}"'
    yield f'<text {place} text-anchor="end">{end:.0f} s</text>'


_PREFACE = """\
# Laws of other packages

Control laws that others have published drive tasks of this project, beside its own. `make referee`
makes this page and its pictures.

**The same for all.** The plant is served by [`taskspec plant`](protocol.md) in lock-step at the
file's rate: one world, one sensor, the file's references, guards and limits. Who answers the
samples with torques, or velocities, drives the arm. The file's `expect` says whether a run is good.
All have the arm's own model with its tool.

"""
_MEASURED = f"""\
**What is measured**, of one stage: the force's error where its set point has been reached, the
overshoot beyond it, when the force stays within {100 * BAND:.0f} % of it, the share of ticks
without contact, and the error of the axes that are led; the peak is that of the whole run. Settling
time, overshoot and steady error are what NISTIR 8097 measures of a step of force. What a tick
takes, where it stands, is the median of the processor time of an answer, called from Python.

"""
_TORQUES = f"""\
## Arms that take torques

**What differs.** A task's file commands force along one axis and motion along the others, which
this project's laws are for. TSID has such axes too; its contacts stick, and its force is commanded
without feedback. An impedance and operational space control as robosuite has it know no
set points of force: they are given it as a feed-forward, as is usual to press with them. They are
not given the accelerations of references, which the protocol does not send and they do not
use. So the columns of force show what feedback of force is worth, and that of the path what the
acceleration of references is, at this bandwidth. It is {BANDWIDTH:g} Hz, which is what this
project's laws are designed for where a file says nothing else; robosuite's own gains are a row of
their own. What the files expect was written for this project's laws: a row that misses it is no
verdict on a law, its figures are what to look at. No controller is given the surface's stiffness.
"""
_VELOCITIES = f"""\
## Arms that take velocities

The same files, with `robot: {{command: velocity, servo: panda}}`: the same
[joint servo](language/robot.md) follows all answers. Two published rules are written from their
equations, in `benchmarks/referee`:

- the admittance rule of ROS 2's controllers (package `admittance_controller` of ros2_controllers,
  read at commits 033cc03d and 015decf2): M x'' + D x' + K x = F on the measured pose, in joints by
  a damped inverse, with its wrench filter, its selected axes and its damping of joints;
- forward dynamics compliance (FZI's `cartesian_controllers`, CartesianComplianceController, branch
  `ros2`, read at commits 082b3811 and 017b68d6; Scherzinger, Roennau and Dillmann, IROS 2017): a
  virtual arm whose mass is at its tip falls under the spring and the error of force.

**Gains.** Each rule has a row with the gains of its package's example, and one that is tuned:
{ANYWHERE + ABOUT} runs of `benchmarks/referee/rub.yaml`, {ANYWHERE} of them drawn evenly (by
logarithms) from the ranges of `benchmarks/referee/tuning.py`, {ABOUT} about the best so far;
`--tune` of the benchmark does it again. The task rubs a bench of 15 kN/m elsewhere, with another
force, friction and path; no run of the tasks below had a part in it. In stages without a set point
of force, the axis of force then has the gains of the others. This project's gains are designed from
what the file says of its surfaces and its servo; those two rules are not given these, but were
tuned on a contact of the same kind. So tuned, the rule of ROS 2 is as good as this project's laws;
with its example's gains it bounces on 20 kN/m.

**The reference.** Both move off a pose that they are given. It follows the file's references; along
the axis of force it stays where the approach has brought it. The rule of ROS 2 takes it as joints:
they are solved for before it, with their velocities.
"""
_SURPRISES = """\
### What surprised

Of the rule of ROS 2:

- A damper is given by its ratio alone, D = 2 ζ √(M K). An axis without a spring has none: what is
  left is `joint_damping` (5 1/s), 38 N s/m on the example's 7.7 kg. A spring on an axis of force
  takes K x off the set point. The tuned row has a spring of 1 N/m, and a ratio to match.
- `filter_coefficient` is per sample. The default of 0.05 is 8.2 Hz at 1 kHz and 0.8 Hz at 100 Hz;
  the example's 0.005 is 0.8 Hz at 1 kHz, which is too slow for these surfaces.
- K and D are turned into the control frame, M is not: in a frame turned by 90°, a push along its z
  meets the mass of y.
- Axes that are not selected keep spring and damper on the measured pose. They take off what the
  servo lags by, so that a path is followed well.

Of forward dynamics compliance:

- Its virtual step is 20 ms whatever the control period is. On velocities it yields like a damper of
  1 kg / (0.18 s · error_scale · p), 222 N s/m with the example's gains, behind a lag of 9.5 control
  periods: 9.5 ms at 1 kHz, 95 ms at 100 Hz. Where it is stable depends on the rate.
- Its derivative is divided by these 20 ms, though errors of force are one control period apart: at
  1 kHz, `d` acts like a twentieth of itself.
- Nothing holds the posture of an arm with more than six joints. A joint of this one comes to its
  limit of velocity in the wipe (both rows) and on the drum (tuned), which ends the run.
- The target has no velocity. A path is followed D/K late, 0.44 s with the example's gains.
- On positions a command is 20 ms of virtual motion ahead of the measured joints, in each period.
  How fast the arm goes then is up to its servo: at 1 kHz, one without lag goes 20 times as fast.
"""


def section(arms: str, results: dict[str, list[Result]]) -> str:
    """The tables of arms that take torques, or velocities."""
    velocities = arms == "velocity"
    lines = [_VELOCITIES if velocities else _TORQUES]
    lines += [f"![The force of every law in each task](images/{_image(arms).name})", ""]
    for task, rows in results.items():
        lines += [f"### {task}", "", f"Stage `{TASKS[task][0]}`.", "", *table(rows), ""]
    rows = [each for rows in results.values() for each in rows]
    given = {each.law: each.given for each in rows if not each.law.startswith(OWN)}
    lines += ["### What each was given", ""]
    lines += [f"- **{OWN}**: what the file says, its gains designed where it says nothing."]
    lines += [f"- **{law}**: {text}." for law, text in given.items()]
    if velocities:
        return "\n".join([*lines, "", _SURPRISES])
    if TSID not in given:
        lines += ["", "TSID was not among them: `make tsid` makes the environment that it needs."]
    lines += [
        "",
        "What TSID's loop costs beside this project's is in [performance](performance.md).",
        "",
    ]
    return "\n".join(lines)


def page(sections: Mapping[str, str], before: str) -> str:
    """The document: new sections, and those of the one before that are not made anew."""
    kept = dict(_SECTION.findall(before))
    body = (f"{_mark(arms)}\n{sections.get(arms, kept.get(arms, ''))}" for arms in ARMS)
    return _PREFACE + _MEASURED + "".join(body)


def _mark(arms: str) -> str:
    return f"<!-- arms: {arms} -->"


_SECTION = re.compile(r"<!-- arms: (\w+) -->\n(.*?)(?=<!-- arms: |\Z)", re.DOTALL)


def _image(arms: str) -> Path:
    return IMAGES / ("referee.svg" if arms == "torque" else f"referee-{arms}.svg")


def results_of(arms: str, task: Path, folder: Path, tsid: Path) -> list[Result]:
    """All laws on the arms of one kind, in a task."""
    overrides = ARMS[arms]
    if arms == "velocity":
        makers = rules(1.0 / load(task).task.control.rate)
        given = [{**overrides, "law": law} for law in OWN_RULES]
    else:
        makers, given = laws(), [overrides]
    found = [own(task, folder / f"own {i}", each) for i, each in enumerate(given)]
    for number, (law, make) in enumerate(makers.items()):
        found.append(foreign(law, make, task, folder / f"{number}", given[0]))
    if arms == "torque" and tsid.exists():
        found.append(with_tsid(tsid, task, folder / "tsid"))
    return found


def main() -> None:
    """Makes tables and pictures."""
    options = argparse.ArgumentParser()
    options.add_argument("--tune", choices=[admittance.NAME, forward_dynamics.NAME])
    options.add_argument("--task", action="append", choices=list(TASKS))
    options.add_argument("--arms", action="append", choices=list(ARMS))
    options.add_argument("--page", type=Path, default=PAGE)
    options.add_argument("--tsid", type=Path, default=TSID_PYTHON, help="Python that has it")
    given = options.parse_args()
    if given.tune is not None:
        tune(given.tune)
        return
    kinds = given.arms or list(ARMS)
    if "torque" in kinds and not given.tsid.exists():
        print(f"{given.tsid} is not there, so TSID is left out: `make tsid` makes it")
    sections: dict[str, str] = {}
    for arms in kinds:
        results: dict[str, list[Result]] = {}
        for task in given.task or TASKS:
            with tempfile.TemporaryDirectory() as name:
                file = ROOT / "tasks" / f"{task}.yaml"
                results[task] = results_of(arms, file, Path(name), given.tsid)
            print(task, *table(results[task]), sep="\n", flush=True)
        sections[arms] = section(arms, results)
        _image(arms).write_text(picture(results), "utf-8")
    before = given.page.read_text("utf-8") if given.page.exists() else ""
    given.page.write_text(page(sections, before), "utf-8")


if __name__ == "__main__":
    main()
