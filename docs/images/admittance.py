"""Makes the pictures of docs/how-to/admittance.md: each trouble beside its cure.

    python docs/images/admittance.py            # all of them
    python docs/images/admittance.py bounce     # one

Each picture lays runs of one task over each other, which differ by what `--set` gives.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

from taskspec.compiler import compile_task
from taskspec.laws.case import Case
from taskspec.program import drives
from taskspec.spec import load_task
from taskspec_runner.pages.chart import Chart, Trace
from taskspec_runner.pages.picture import Picture, picture_svg
from taskspec_runner.pages.timeline import Timeline
from taskspec_runner.runs import Run
from taskspec_runner.session import execute_program

HERE = Path(__file__).resolve().parent
TASKS = HERE.parent / "how-to"
Overrides = Mapping[str, str]

#: Meanings of colours, one for each run of a picture.
_ROLES = ("x", "z", "y")
#: Stands for the overrides of a run from which a cure is taken out that no file can leave out.
TAKEN_OUT: Overrides = {"": ""}


@dataclass(frozen=True)
class Signal:
    """A column of the log as a chart.

    Attributes:
        column: its name.
        title: of the chart.
        unit: that it is shown in.
        scale: of that unit by the one of the log.
    """

    column: str
    title: str
    unit: str
    scale: float = 1.0


FORCE = Signal("force.z", "Force along z", "N")
TRAVEL = Signal("travel", "Distance from the start of the stage", "mm", 1e3)


@dataclass(frozen=True)
class Trouble:
    """A task, runs of it by their names, and what is drawn of them.

    Attributes:
        runs: their overrides, by names.
        signals: that are drawn, one above the other.
        cure: an attribute of something, and its value without the cure.
    """

    runs: Mapping[str, Overrides]
    signals: tuple[Signal, ...]
    cure: tuple[object, str, object] | None = None


TROUBLES = {
    "bounce": Trouble(
        {
            "damping 300 N*s/m": {"law": "{kind: admittance, damping: {z: 300 N*s/m}}"},
            "designed": {},
        },
        (FORCE,),
    ),
    "drift": Trouble(
        {
            "no tare": {"stages.zero.tare": "false"},
            "tare alone": {"law": "admittance"},
            "tare and dead band": {},
        },
        (TRAVEL,),
    ),
    "switch": Trouble(
        {"not carried": TAKEN_OUT, "as it is": {}},
        (
            Signal("joint.3.velocity.command", "Command of joint 3", "deg/s", 57.29578),
            Signal("joint.3.torque", "Torque of the drive of joint 3", "N*m"),
        ),
        # Over at once.
        (drives, "VELOCITY_FADING", 1e-9),
    ),
    "windup": Trouble(
        {"memory goes on": TAKEN_OUT, "as it is": {}},
        (
            Signal("torque.rz.ref", "Set point about the tool", "N*m"),
            Signal("joint.6.position", "Joint 6, whose limit is 360 deg", "deg", 57.29578),
        ),
        (Case, "kept", lambda *given: given[-1]),
    ),
    "delay": Trouble(
        {
            "10 ms": {"robot.servo.delay": "10 ms"},
            "2 ms": {},
            "10 ms, designed": {"robot.servo.delay": "10 ms", "law": "admittance"},
        },
        (FORCE,),
    ),
}
"""By the names of their files, `admittance-NAME.yaml`."""


def main() -> None:
    """Makes what the command line names."""
    for name in sys.argv[1:] or TROUBLES:
        draw(name, TROUBLES[name])


def draw(name: str, trouble: Trouble) -> None:
    """Runs a task as a trouble has it, and draws all of it as admittance-NAME.svg."""
    with tempfile.TemporaryDirectory() as folder:
        runs = {
            each: _run(name, trouble, given, Path(folder) / each)
            for each, given in trouble.runs.items()
        }
        roles = dict(zip(runs, _ROLES, strict=False))
        charts = [
            Chart(
                signal.column,
                signal.title,
                signal.unit,
                tuple(
                    Trace(each, signal.scale * run.columns[signal.column], roles[each], run=each)
                    for each, run in runs.items()
                ),
            )
            for signal in trouble.signals
        ]
        timeline = Timeline(runs, next(iter(runs)), dict.fromkeys(runs, 0.0))
        drawn = picture_svg(name, ", ".join(runs), "", timeline, charts)
        Picture(drawn).save(HERE / f"admittance-{name}.svg")


def _run(name: str, trouble: Trouble, overrides: Overrides, folder: Path) -> Run:
    whole = overrides is not TAKEN_OUT
    loaded = load_task(TASKS / f"admittance-{name}.yaml", overrides if whole else {})
    without = nullcontext() if whole or trouble.cure is None else patch.object(*trouble.cure)
    with without:
        program = compile_task(loaded, force=True)
    return execute_program(program, folder, report=False)


if __name__ == "__main__":
    main()
