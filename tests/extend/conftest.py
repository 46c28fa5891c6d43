"""Everything that the commands say with what a module adds to the language."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from extension import Answer, answers


@pytest.fixture(scope="module")
def said(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> object:
    """Answers of all commands, by name."""
    folder = tmp_path_factory.mktemp(request.module.__name__)
    given: dict[str, Answer] = answers(request.module, folder)
    return given
