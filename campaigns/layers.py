"""What a boundary layer costs: the errors of a wipe over its layer, beside what its torques do.

The shipped task `wipe-sliding` is run with layers from wide ones to those that every tick
overshoots, under the plain law, and with a disturbance observer in place of the sliding term.
`make layers` writes the table into docs/laws/sliding.md.

    python campaigns/layers.py --page docs/laws/sliding.md
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from page_tables import write_table

from taskspec.examination import examine
from taskspec.spec import load_text
from taskspec_runner import Run, run

ROOT = Path(__file__).resolve().parents[1]
TASK = ROOT / "tasks" / "wipe-sliding.yaml"
#: Of the task, which the others take the place of.
LAW = "{kind: hybrid, sliding: {layer: 25 mm/s, payload: 300 g, joint_torque: 0.5 N*m}}"
#: [mm/s].
LAYERS = (200, 100, 50, 25, 15, 8)
OTHERS = {"none: `hybrid` alone": "hybrid", "none, but an observer of 20 Hz":
          "{kind: hybrid, disturbance_observer: 20 Hz}"}  # fmt: skip
#: Designed: 2 pi 5 Hz.
SLOPE = 2 * np.pi * 5
HEADER = (
    "| layer φ | bound φ/Λ | greatest error | torques change by | speeds change by | `validate` |\n"
    "| --- | --- | --- | --- | --- | --- |\n"
)
#: What a hold-up of the start and of changes of stage takes [ticks].
SETTLED = 100


@dataclass(frozen=True)
class Cost:
    """What one run came to.

    Attributes:
        name: the layer. bound: of the error [m]; None without a layer.
        error: greatest of a motion axis [m].
        torque: RMS of what a tick changes of the joints' torques [N m].
        speed: the same of the tool's velocity [m/s].
        codes: of the findings about the layer.
    """

    name: str
    bound: float | None
    error: float
    torque: float
    speed: float
    codes: tuple[str, ...]

    def row(self) -> str:
        """Of the table."""
        bound = "—" if self.bound is None else f"{1000 * self.bound:.2f} mm"
        codes = ", ".join(f"[{code}](../diagnostics/{code}.md)" for code in self.codes) or "—"
        return (
            f"| {self.name} | {bound} | {1000 * self.error:.2f} mm | {self.torque:.3f} N·m "
            f"| {1000 * self.speed:.2f} mm/s | {codes} |\n"
        )


def cost(name: str, law: str, bound: float | None) -> Cost:
    """Of the task under a law."""
    text = TASK.read_text(encoding="utf-8")
    assert LAW in text
    loaded = load_text(text.replace(LAW, law), str(TASK))
    codes = sorted({each.code for each in examine(loaded).findings} & {"TS351", "TS352", "TS501"})
    with tempfile.TemporaryDirectory() as folder:
        made = run(loaded, Path(folder) / "run", force=True, report=False)
        return Cost(name, bound, *_measured(made), tuple(codes))


def _measured(made: Run) -> tuple[float, float, float]:
    n = made.program.context.robot.n
    errors = [made.column(f"error.{axis}") for axis in "xyz"]
    moved = _columns(made, [f"velocity.{axis}" for axis in "xyz"])
    torques = _columns(made, [f"joint.{i + 1}.torque" for i in range(n)])
    return float(np.nanmax(np.abs(errors))), _activity(torques), _activity(moved)


def _columns(made: Run, names: list[str]) -> np.ndarray:
    return np.column_stack([np.asarray(made.column(name)) for name in names])


def _activity(values: np.ndarray) -> float:
    """RMS of the second difference: what a smooth course has next to none of."""
    return float(np.sqrt(np.mean(np.diff(values[SETTLED:], n=2, axis=0) ** 2)))


def table() -> str:
    """All rows."""
    rows = [cost(name, law, None) for name, law in OTHERS.items()]
    rows[1:1] = [
        cost(f"{layer} mm/s", LAW.replace("25 mm/s", f"{layer} mm/s"), layer / 1000 / SLOPE)
        for layer in LAYERS
    ]
    return HEADER + "".join(each.row() for each in rows)


def main() -> None:
    """Prints the table, or writes it into a page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", type=Path, help="where the table is written to")
    page = parser.parse_args().page
    found = table()
    sys.stdout.write(found)
    if page is not None:
        write_table(page, "layers", found)


if __name__ == "__main__":
    main()
