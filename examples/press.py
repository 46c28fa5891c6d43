"""Presses on tables of different stiffness and measures how fast the force settles.

    python examples/press.py [FOLDER]

The runs and the picture of the last one go into FOLDER, by default `runs`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from taskspec import load
from taskspec_runner import Run, run

TASK = Path(__file__).resolve().parent.parent / "tasks" / "press-hybrid.yaml"
STIFFNESSES = ("5 kN/m", "10 kN/m", "20 kN/m")


def settling_time(result: Run, stage: str, band: float) -> float:
    """Time into a stage after which the force stays within a band around its reference.

    Args:
        result: of the run. stage: in which the force is to be reached. band: of the error [N].

    Returns:
        The time [s].
    """
    signals = result.during(stage).signals
    error = np.abs(signals["force.z.ref"] - signals["force.z"])
    outside = np.flatnonzero(error > band)
    return float(signals["t"][outside[-1]]) if len(outside) else 0.0


def main(folder: Path) -> dict[str, float]:
    """Runs the press on each table.

    Args:
        folder: where the runs go.

    Returns:
        Stiffness to the time after which the force is within 0.2 N [s].
    """
    found = {}
    for stiffness in STIFFNESSES:
        task = load(TASK, set={"world.table.stiffness": stiffness})
        result = run(task, folder / f"press-{stiffness.split()[0]}", report=False)
        found[stiffness] = settling_time(result, "slide", 0.2)
        print(f"{stiffness:>8}: {result.verdict}, settled after {found[stiffness]:.3f} s")
    result.plot("force.z", "force.z.ref").save(folder / "press.svg")
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "runs"))
