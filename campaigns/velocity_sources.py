"""What sources of joint velocity, and compensated friction, make of two shipped tasks.

`coarse-encoders` is run with every source of velocity, and `sticking-joints` with and without its
compensation, in their true worlds. `make sources` writes the tables into
docs/laws/output-feedback.md.

    python campaigns/velocity_sources.py --page docs/laws/output-feedback.md
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from page_tables import write_table

from taskspec.rules.output_feedback import torque_noise
from taskspec.spec import load_text
from taskspec_runner import Run, run

TASKS = Path(__file__).resolve().parents[1] / "tasks"
ENCODERS, STICKING = TASKS / "coarse-encoders.yaml", TASKS / "sticking-joints.yaml"
#: Of the tasks, which the others take the place of.
OBSERVER, FRICTION = "{observer: 30 Hz}", "control: {friction: 80 %}\n"
#: Of the filter [Hz].
CORNERS = (10, 20, 30, 50, 70, 100)
SOURCES = ("differences", *(f"{{filter: {f} Hz}}" for f in CORNERS), "{observer: 20 Hz}", OBSERVER)
HEADS = {
    "velocity": ("`velocity`", "ends", "velocities off by", "torques off by, at most",
                 "force in `wipe`", "error along y", "met"),
    "friction": ("`friction`", "error in `right`, y", "in `up`, x",
                 "at the end of `left`, y", "met"),
}  # fmt: skip


@contextmanager
def made(file: Path, old: str, new: str) -> Iterator[Run]:
    """A run of a task of which a piece of text is another."""
    text = file.read_text(encoding="utf-8")
    assert old in text
    with tempfile.TemporaryDirectory() as folder:
        loaded = load_text(text.replace(old, new), str(file))
        yield run(loaded, Path(folder) / "run", force=True, report=False)


def joints(found: Run, signal: str) -> np.ndarray:
    """(ticks, n) of a signal of all joints."""
    n = found.program.context.robot.n
    return np.column_stack([found.column(f"joint.{i + 1}.{signal}") for i in range(n)])


def during(found: Run, stage: str, signal: str) -> np.ndarray:
    """A signal while a stage is on; empty where the run did not come to it."""
    return np.asarray(found.column(signal))[found.history.window(stage)]


def met(found: Run) -> str:
    """How many expectations are met, of how many."""
    passed = sum(each.passed is True for each in found.expectations)
    return f"{passed} of {len(found.expectations)}"


def of_source(source: str) -> tuple[str, ...]:
    """A row of the table of `coarse-encoders`."""
    with made(ENCODERS, OBSERVER, source) as found:
        ends, stopped = "done", found.summary["status"] != "done"
        if stopped:
            reason = found.summary["ending"]["reason"]
            ends = f"limit on {reason} in `{found.visits[-1].stage}`"
        off = np.abs(joints(found, "velocity.measured") - joints(found, "velocity")).max()
        noise = torque_noise(found.program.plan)
        assert noise is not None
        force, error = during(found, "wipe", "force.z"), during(found, "wipe", "error.y")
        shown = ("–", "–", "–")
        if not stopped:
            shown = (
                f"{force.min():.1f} to {force.max():.1f} N",
                f"{1000 * np.abs(error).max():.2f} mm",
                met(found),
            )
        return (
            f"`{source}`",
            ends,
            f"{1000 * off:.0f} mrad/s",
            f"{100 * noise.share:.0f} % of the motor",
            *shown,
        )


def of_friction(name: str, new: str) -> tuple[str, ...]:
    """A row of the table of `sticking-joints`."""
    with made(STICKING, FRICTION, new) as found:
        errors = (
            np.abs(during(found, "right", "error.y")).max(),
            np.abs(during(found, "up", "error.x")).max(),
            np.abs(during(found, "left", "error.y")[-1]),
        )
        return name, *(f"{1000 * error:.2f} mm" for error in errors), met(found)


def table(kind: str) -> str:
    """All rows of one of both."""
    rows: list[tuple[str, ...]] = [HEADS[kind], ("---",) * len(HEADS[kind])]
    if kind == "velocity":
        rows += [of_source(source) for source in SOURCES]
    else:
        rows += [of_friction("none", ""), of_friction("80 %", FRICTION)]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def main() -> None:
    """Prints the tables, or writes them into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", type=Path, help="where the tables are written to")
    page = parser.parse_args().page
    for kind in HEADS:
        found = table(kind)
        sys.stdout.write(found)
        if page is not None:
            write_table(page, kind, found)


if __name__ == "__main__":
    main()
