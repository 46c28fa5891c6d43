"""Arrays in files: what is computed from them is the same bit by bit, and lies in files too."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from taskspec_runner.record import file_array
from taskspec_runner.record.file_array import FileArray, counted, empty, full, in_file

N = 5000
VALUES = np.random.default_rng(1).normal(size=N)
GAPS = np.where(np.arange(N) % 7 == 0, np.nan, VALUES)
MASK = VALUES > 0.3

LARGE_RESULTS: dict[str, Callable[[Any], Any]] = {
    "sum": lambda x: x + 1.5,
    "reflected": lambda x: 3 - x,
    "square": lambda x: x**2,
    "root": lambda x: np.sqrt(np.abs(x)),
    "two": lambda x: np.arctan2(x, VALUES),
    "comparison": lambda x: x > 0.1,
    "both": lambda x: (x > 0.1) & (x < 0.5),
    "clip": lambda x: np.clip(x, -0.1, 0.2),
    "where": lambda x: np.where(x > 0, x, -1),
    "running sum": lambda x: np.cumsum(x**2),
    "hull": lambda x: np.maximum.accumulate(np.abs(x)[::-1])[::-1],
    "difference": np.diff,
    "type": lambda x: (1e3 * np.nan_to_num(x)).astype(np.int64),
    "mask": lambda x: x[MASK],
    "piece": lambda x: x[(np.arange(N) > 100) & (np.arange(N) < 4000)],
    "rows": lambda x: x[np.arange(0, N, 2)],
    "found": lambda x: np.flatnonzero(x > -0.5),
    "broadcast": lambda x: np.broadcast_to(x, (N,))[MASK],
}
NUMBERS: dict[str, Callable[[Any], Any]] = {
    "mean": np.mean,
    "spread": np.std,
    "largest": np.max,
    "rms": lambda x: np.sqrt(np.mean(x**2)),
    "range": np.ptp,
    "largest number": np.nanmax,
    "mean number": np.nanmean,
    "sum of numbers": np.nansum,
    "place": lambda x: np.nanargmax(np.abs(x)),
    "median": np.median,
    "any": lambda x: np.isnan(x).any(),
    "count": lambda x: np.count_nonzero(x > 0),
    "one": lambda x: x[17],
    "product": lambda x: np.nan_to_num(x) @ np.asarray(np.nan_to_num(x)),
}


@pytest.fixture(autouse=True)
def _all_is_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(file_array, "LARGE", 100)
    monkeypatch.setattr(file_array, "BLOCK_ROWS", 333)


def same(one: Any, other: Any) -> bool:
    one, other = np.asarray(one), np.asarray(other)
    return (
        one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    )


@pytest.mark.parametrize("values", [VALUES, GAPS], ids=["values", "gaps"])
@pytest.mark.parametrize("name", LARGE_RESULTS)
def test_large_results_lie_in_files_and_are_the_same(name: str, values: np.ndarray) -> None:
    made = LARGE_RESULTS[name](in_file(values))
    assert isinstance(made, FileArray)
    assert same(made, LARGE_RESULTS[name](values))


@pytest.mark.parametrize("values", [VALUES, GAPS], ids=["values", "gaps"])
@pytest.mark.parametrize("name", NUMBERS)
def test_numbers_are_the_same(name: str, values: np.ndarray) -> None:
    assert same(NUMBERS[name](in_file(values)), NUMBERS[name](values))


def test_names_of_stages() -> None:
    stages = in_file(np.array(["approach", "press"])[np.arange(N) // 3000])
    assert same(stages == "press", np.arange(N) >= 3000)
    assert same(stages[1:] != stages[:-1], np.arange(N - 1) == 2999)


def test_what_is_given_is_not_written() -> None:
    x = in_file(VALUES)
    for part in (x, x[np.arange(N) < 4000]):
        with pytest.raises(ValueError, match="read-only"):
            part[3] = 0.0
    assert same(counted(N, 1), np.arange(1, N + 1))
    assert same(full(N, np.nan), np.full(N, np.nan))


def test_the_room_of_an_array_is_used_again_once_nobody_has_it() -> None:
    first = full(N, 1.0)
    view, place = first[10:20], first.ctypes.data
    del first
    # A part of it is somebody's still.
    second = full(N, 2.0)
    assert second.ctypes.data != place
    np.testing.assert_array_equal(view, 1.0)
    del view
    third = full(N, 3.0)
    assert third.ctypes.data == place
    np.testing.assert_array_equal(second, 2.0)


def test_what_another_process_maps_too_is_not_used_again() -> None:
    """A fork shares the pages: what the one writes the other one reads."""
    before = full(N, 1.0)
    gone = full(N, 5.0)
    del gone
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        # The parent has given up its own by now, and filled others.
        os.read(reading, 1)
        held = float(before.sum())
        os._exit(0 if held == N else 1)
    del before
    others = [full(N, 7.0) for _ in range(20)]
    os.write(writing, b"x")
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert all((each == 7.0).all() for each in others)
    os.close(reading)
    os.close(writing)


def test_without_room_arrays_stay_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_room(*_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(file_array, "_ROOMS", file_array._Rooms())
    monkeypatch.setattr(os, "posix_fallocate", no_room)
    assert not isinstance(empty(N, float), FileArray)
    assert same(in_file(VALUES), VALUES)


_GROWTH = """
import re
from pathlib import Path
import numpy as np
from taskspec_runner.record.file_array import counted

def anonymous():
    return int(re.search(r"RssAnon:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) / 1000

begin, most = anonymous(), 0.0
x = counted(4_000_000) * 1e-3
y = np.where(x > 100.0, x**2, np.nan)
most = max(most, anonymous() - begin)
for value in (np.nanmean(y), np.median(x), np.std(x), np.cumsum(x)[-1], np.nanmax(np.abs(y))):
    most = max(most, anonymous() - begin)
print(most)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_anonymous_memory_does_not_grow() -> None:
    """A column of 32 MB, and seven made of it."""
    done = subprocess.run(
        [sys.executable, "-c", _GROWTH], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert float(re.sub(r"\s", "", done.stdout)) < 12
