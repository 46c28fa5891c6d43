from __future__ import annotations

from pathlib import Path

import pytest
from short_tasks import TAP


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--random-tasks", type=int, help="how many random tasks keep their limits")


@pytest.fixture
def tap(tmp_path: Path) -> Path:
    path = tmp_path / "tap.yaml"
    path.write_text(TAP, encoding="utf-8")
    return path
