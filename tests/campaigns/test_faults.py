"""A small, fixed part of `make corruptions`."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import corruptions
import faults
import pytest


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of runs, of a comparison, of a sweep and of a log of elsewhere."""
    return faults.made(tmp_path_factory.mktemp("faults"))


@pytest.mark.parametrize("first", [0])
def test_spoiled_folders_are_told(folders: Path, first: int) -> None:
    found = faults.spoiled(folders, first, 16)
    assert [each for each in found if not each.survived] == []
    assert len({each.spoiled.kind for each in found}) > 7


def test_values_of_sealed_folders_are_tried(folders: Path) -> None:
    """As many as it takes to have some of them."""
    numbers = [n for n in range(200) if kind_of(folders, n) == corruptions.SEALED][:5]
    assert len(numbers) == 5
    found = [each for n in numbers for each in faults.spoiled(folders, n, 1)]
    assert [each for each in found if not each.survived] == []


def kind_of(folders: Path, number: int) -> str:
    """What a corruption does, by its number."""
    subject = corruptions.Subject.of(number)
    with tempfile.TemporaryDirectory() as work:
        copied = Path(work) / "run"
        shutil.copytree(folders / subject.folder, copied)
        return corruptions.spoil(copied, number, subject.names).kind


def test_logs_that_are_cut_have_the_code_that_follows_from_the_file() -> None:
    tally = faults.cuts(3)
    assert tally.tried > 7
    assert tally.failures == []


def test_robots_of_any_value(tmp_path: Path) -> None:
    for tally in faults.robots(12, tmp_path):
        assert (tally.tried, tally.failures) == (12, [])


def test_a_killed_run_loses_at_most_the_tick_under_way(tmp_path: Path) -> None:
    tally = faults.kills(4, tmp_path, seed=1)
    assert (tally.tried, tally.failures) == (4, [])


def test_a_folder_has_one_writer(tmp_path: Path) -> None:
    tally = faults.locks(2, tmp_path)
    assert (tally.tried, tally.failures) == (2, [])


def test_full_disks_lose_no_tick(tmp_path: Path) -> None:
    for tally in faults.disks(4, tmp_path):
        assert tally.failures == []
