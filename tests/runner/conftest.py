from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from short_tasks import TAP

from browser import Browser, browser_path


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--random-tasks", type=int, help="how many random tasks keep their limits")


@pytest.fixture
def tap(tmp_path: Path) -> Path:
    path = tmp_path / "tap.yaml"
    path.write_text(TAP, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A headless browser; tests that need one are skipped without."""
    path = browser_path()
    if path is None:
        pytest.skip("there is no chromium or chrome on this machine")
    with Browser(path) as found:
        yield found
