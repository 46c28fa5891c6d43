"""The fixture that holds a prediction against a run, and the table of all of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from ledger import Row, markdown

Prediction = Callable[..., None]
_ROWS = pytest.StashKey[list[Row]]()
_OPTION = "--theory-table"
_PRESSES = "--random-presses"
#: Of random files, which a proof that is held against runs takes.
_ALL = 200


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        _OPTION, type=Path, help="print the table of predictions and write it to this file"
    )
    parser.addoption(
        _PRESSES, type=int, default=20, help="how many random presses keep their bound"
    )


@pytest.fixture
def random_files(request: pytest.FixtureRequest) -> int:
    """How many random files a test draws that has slow ones: all of 200, and a fifth of a few."""
    count: int = request.config.getoption("random_presses")
    return count if count >= _ALL else max(count // 5, 2)


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_ROWS] = []
    table = config.getoption("theory_table", default=None)
    if table is not None and config.getoption("numprocesses", default=None):
        raise pytest.UsageError(f"{_OPTION} takes all tests in one process: leave out -n")


@pytest.fixture
def prediction(request: pytest.FixtureRequest) -> Prediction:
    """Assert that a measured number is the predicted one, and keep both for the table.

    The module says in `SECTION` which section of the chapter it holds to its word.
    """
    rows = request.config.stash.setdefault(_ROWS, [])

    def hold(
        what: str,
        equation: str,
        case: str,
        predicted: float,
        measured: float,
        *,
        rtol: float | None = None,
        atol: float | None = None,
        because: str,
    ) -> None:
        """One number against another.

        Args:
            what: the quantity, with its unit. equation: its source, such as "(4.27)".
            case: robot, law and numbers that make it this one.
            predicted, measured: the two numbers.
            rtol, atol: one of the two. because: where it comes from.

        Raises:
            AssertionError: they differ by more than the tolerance.
        """
        assert (rtol is None) != (atol is None)
        assert because
        section: str = request.module.SECTION
        row = Row(section, what, equation, case, float(predicted), float(measured), rtol, atol)
        rows.append(row)
        assert row.holds, (
            f"{what} {equation}, {case}: predicted {predicted:.9g}, measured {measured:.9g}, "
            f"difference {row.difference:.3g} against {rtol or atol:.3g} ({because})"
        )

    return hold


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, exitstatus: int, config: pytest.Config
) -> None:
    target: Path | None = config.getoption("theory_table", default=None)
    if target is None:
        return
    rows = config.stash.get(_ROWS, [])
    table = markdown(rows)
    terminalreporter.write_line(table)
    if exitstatus == 0 and rows:
        target.write_text(table, encoding="utf-8")
        terminalreporter.write_line(f"{len(rows)} predictions, written to {target}")
    else:
        terminalreporter.write_line(f"{target} is left as it was: not all predictions hold")
