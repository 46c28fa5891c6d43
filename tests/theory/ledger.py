"""Predictions held against runs: each is asserted, and kept for the table."""

from __future__ import annotations

import math
from dataclasses import dataclass

TITLE = """\
# Predictions and runs

Each row is a number that the theory predicts and that was measured in a run: of a task file,
compiled and simulated on the MuJoCo plant as `taskspec run` does it. Rows of sections 4.3.1 and
4.3.2 hold on ideal rigid constraints. There the compiled controller runs on a reference integration
of (4.78), `tests/theory/rigid.py`; in *Equations that hold exactly* it runs on the plant, under
`stiffness: exact`. The tests in `tests/theory/` make the rows and fail where one
misses; `make theory` runs them and writes this page.

[Conventions](conventions.md) says what the signs, the contact and one tick are,
[the task language](language/law.md) what the laws are called. Equation numbers are those of the
textbook chapter "Motion and force control"; its sections are the ones below.

*Sampled* is a prediction of the discrete-time model in `tests/theory/sampled.py`: the torque is
held over one period, the force comes one tick late, the plant takes semi-implicit Euler steps, and
a contact has the virtual mass that MuJoCo gives it. That model is itself held against the chapter's
continuous formulas in the rows called *limit T → 0*: their second number is the model's at a period
of 1 µs or less, and not a run's. Rows that begin *first order in T* are of the same kind.

The difference is relative to the prediction where the tolerance is in %, otherwise absolute. Why a
tolerance is what it is stands beside each test.
"""


@dataclass(frozen=True, slots=True)
class Row:
    """One prediction and what was measured.

    Attributes:
        section: of the chapter. what: the quantity with its unit. equation: its source.
        case: robot, law and numbers. predicted, measured: the two numbers.
        rtol, atol: one of them bounds the difference, the other is None.
    """

    section: str
    what: str
    equation: str
    case: str
    predicted: float
    measured: float
    rtol: float | None
    atol: float | None

    @property
    def difference(self) -> float:
        """Relative to the prediction under `rtol`, else absolute."""
        away = abs(self.measured - self.predicted)
        return away if self.rtol is None else away / abs(self.predicted)

    @property
    def holds(self) -> bool:
        """Whether the difference is within the tolerance; NaN never is."""
        return self.difference <= (self.atol if self.rtol is None else self.rtol)  # type: ignore[operator]

    def cells(self) -> tuple[str, ...]:
        """The row as the table shows it."""
        relative = self.rtol is not None
        tolerance = self.rtol if self.rtol is not None else self.atol
        assert tolerance is not None
        show = _percent if relative else _absolute
        # Far below the tolerance only rounding is left to be seen.
        floor = 10.0 ** math.floor(math.log10(tolerance) - 3)
        small = self.difference < floor
        # A zero has no sign.
        predicted = f"{self.predicted + 0.0:.4g}"
        return (
            self.what,
            self.equation,
            self.case,
            predicted,
            # A measured zero is a rounding error, which is not worth its digits.
            f"{self.measured:.4g}" if relative or not small else predicted,
            f"< {show(floor)}" if small else show(self.difference),
            show(tolerance),
        )


HEAD = ("what", "equation", "case", "predicted", "measured", "difference", "tolerance")


def markdown(rows: list[Row]) -> str:
    """The page docs/theory.md."""
    parts = [TITLE]
    for section in sorted({row.section for row in rows}):
        lines = ["| " + " | ".join(HEAD) + " |", "| " + " | ".join(["---"] * len(HEAD)) + " |"]
        lines += ["| " + " | ".join(row.cells()) + " |" for row in rows if row.section == section]
        parts.append(f"## {section}\n\n" + "\n".join(lines) + "\n")
    return "\n".join(parts)


def _percent(value: float) -> str:
    return f"{100 * value:.2g} %"


def _absolute(value: float) -> str:
    return f"{value:.2g}"
