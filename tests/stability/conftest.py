"""`--stability-table FILE` runs the whole grid and writes its page."""

from __future__ import annotations

from pathlib import Path

import pytest

from stability.table import page
from stability.trial import Verdict

_OPTION = "--stability-table"
_VERDICTS = pytest.StashKey[list[Verdict]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(_OPTION, type=Path, help="run the whole grid and write it to this file")


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_VERDICTS] = []
    target = config.getoption("stability_table", default=None)
    if target is not None and config.getoption("numprocesses", default=None):
        raise pytest.UsageError(f"{_OPTION} takes all cases in one process: leave out -n")


@pytest.fixture
def verdicts(request: pytest.FixtureRequest) -> list[Verdict]:
    """What has been found so far, for the page."""
    return request.config.stash.setdefault(_VERDICTS, [])


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, exitstatus: int, config: pytest.Config
) -> None:
    target: Path | None = config.getoption("stability_table", default=None)
    found = config.stash.get(_VERDICTS, [])
    if target is None:
        return
    if exitstatus == 0 and found:
        target.write_text(page(found), encoding="utf-8")
        terminalreporter.write_line(f"{len(found)} cases, written to {target}")
    else:
        terminalreporter.write_line(f"{target} is left as it was: not all predictions hold")
