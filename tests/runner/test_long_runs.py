"""Long runs lie in files that are mapped into memory; every number is as without them.

`campaigns/long_runs.py` measures an hour.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from short_tasks import TAP
from typer.testing import CliRunner

from taskspec.signals import SCALARS, VECTORS
from taskspec.spec import load_task, load_text
from taskspec_runner.cli import app
from taskspec_runner.pages import decimate, samples
from taskspec_runner.record import file_array, mapped
from taskspec_runner.record.history import HistoryBuilder, column_field
from taskspec_runner.report.page import render
from taskspec_runner.result import RunResult
from taskspec_runner.runs import Run
from taskspec_runner.session import execute
from taskspec_runner.verdict.replay import Replay

TASKS = Path(__file__).resolve().parents[2] / "tasks"


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], RunResult]:
    """Runs of shipped tasks as they are, by name, each made once."""
    folder = tmp_path_factory.mktemp("shipped")

    @cache
    def run(name: str) -> RunResult:
        return execute(load_task(TASKS / f"{name}.yaml"), folder / name, report=False)

    return run


@pytest.fixture
def spilled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything is long: blocks are of 700 ticks, and files begin with room for 1024."""
    monkeypatch.setattr(mapped, "SPILL_ROWS", 700)
    monkeypatch.setattr(file_array, "LARGE", 1000)
    monkeypatch.setattr(file_array, "_MAPPED", 1 << 16)
    monkeypatch.setattr(file_array, "BLOCK_ROWS", 300)
    monkeypatch.setattr(mapped, "_FIRST_CAPACITY", 1024)


@pytest.mark.parametrize("name", ["wipe-table", "crank", "unknown-normal", "press-qp", "conveyor"])
def test_numbers_are_those_of_a_run_in_memory(
    name: str, shipped: Callable[[str], RunResult], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """Verdicts, metrics, findings and the page: byte for byte, through run and reader."""
    plain = shipped(name)
    said = render(Run.load(plain.folder))
    request.getfixturevalue("spilled")
    long = execute(load_task(TASKS / f"{name}.yaml"), tmp_path / "long", report=False)
    column = next(iter(long.history.columns.values()))
    assert not column.flags.writeable, "nothing was brought to a file"
    for file in ("log.arrow", "summary.json"):
        assert (plain.folder / file).read_bytes() == (long.folder / file).read_bytes()
    assert long.history.stages.tolist() == plain.history.stages.tolist()
    again = render(Run.load(plain.folder))
    # The path of the folder is the same; nothing else may differ.
    assert again == said


@pytest.mark.parametrize("name", ["wipe-table", "crank", "unknown-normal", "conveyor"])
def test_signals_in_other_frames_do_not_depend_on_how_many_ticks_are_worked_on(
    name: str, shipped: Callable[[str], RunResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames that follow, turn with a handle, move or are estimated; sums over a visit, turns."""
    run = shipped(name)
    context, signals = run.program.context, {**VECTORS, **SCALARS}

    def values() -> dict[tuple[str, str | None, str], bytes]:
        stages = run.program.stages
        replay = Replay(context.robot, context.frames, stages, run.history, context.moving_bases)
        return {
            (signal, axis, frame): replay.signal(signal, axis, frame).tobytes()
            for frame in context.frames
            for signal, entry in signals.items()
            if entry.framed
            for axis in (("x", "y", "z", "rz") if entry.axes else (None,))
        }

    plain = values()
    monkeypatch.setattr(file_array, "LARGE", 1000)
    monkeypatch.setattr(file_array, "BLOCK_ROWS", 37)
    assert values() == plain


def batch(rows: int, columns: int, first: int) -> pa.RecordBatch:
    fields = [column_field("clock", "s"), column_field("stage", "")]
    fields += [column_field(f"c{i}", "N") for i in range(columns)]
    stages = pa.DictionaryArray.from_arrays(np.zeros(rows, dtype=np.int32), ["press"])
    numbers = [pa.array(first + i + np.arange(rows) * 1.0) for i in range(columns)]
    clock = pa.array((first + np.arange(rows)) * 1e-3)
    return pa.record_batch([clock, stages, *numbers], schema=pa.schema(fields))


def test_without_room_for_files_columns_stay_in_memory(
    spilled: None,  # noqa: ARG001
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    builder, written = HistoryBuilder(), []
    own = mapped._write

    def full(descriptor: int, content: np.ndarray, at: int) -> None:
        written.append(at)
        if len(written) > 9:
            raise OSError(28, "No space left on device")
        own(descriptor, content, at)

    monkeypatch.setattr(mapped, "_write", full)
    for first in range(0, 5000, 500):
        builder.add(batch(500, 3, first))
    history = builder.build()
    assert history.columns["c2"].tolist() == [
        first + 2 + k for first in range(0, 5000, 500) for k in range(500)
    ]
    assert history.stages.tolist() == ["press"] * 5000


_GROWTH = """
import re, sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from test_long_runs import batch
from taskspec_runner.record.history import HistoryBuilder

def anonymous():
    return int(re.search(r"RssAnon:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) / 1000

builder, begin = HistoryBuilder(), anonymous()
most = 0.0
for first in range(0, 300_000, 500):
    builder.add(batch(500, 100, first))
    most = max(most, anonymous() - begin)
history = builder.build()
assert history.columns["c7"][250_123] == 250_000 + 7 + 123
print(max(most, anonymous() - begin))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_anonymous_memory_does_not_grow_with_columns() -> None:
    """240 MB of columns pass; what waits is a block of 26 MB, there twice when it is written."""
    done = subprocess.run(
        [sys.executable, "-c", _GROWTH, str(Path(__file__).parent)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 100


def test_window_of_an_export(tmp_path: Path) -> None:
    run = execute(load_text(TAP, "tap.yaml"), tmp_path / "run", report=False)

    def export(*options: str) -> tuple[int, str]:
        done = CliRunner().invoke(app, ["export", str(run.folder), *options])
        assert "Traceback" not in done.output
        return done.exit_code, done.output

    assert export("--parquet", "--from", "0.1", "--to", "0.2")[0] == 0
    table = pq.read_table(run.folder / "log.parquet")
    assert table["clock"].to_numpy().tolist() == run.columns["clock"][100:200].tolist()
    code, said = export("--csv", "--from", "7")
    assert (code, "has no tick from 7 s" in said) == (2, True)
    assert not (run.folder / "log.csv").exists()
    code, said = export("--mcap", "--from", "0.1")
    assert (code, "for --csv and --parquet" in said) == (2, True)


def test_page_that_draws_fewer_ticks_names_the_command_for_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = execute(load_text(TAP, "tap.yaml"), tmp_path / "run", report=False)
    assert "taskspec export" not in render(run)
    monkeypatch.setattr(samples, "POINTS_BYTES", 1000)
    monkeypatch.setattr(decimate, "POINTS", 60)
    assert f"taskspec export {run.folder.name} --csv --from 0 --to 1" in render(run)


def test_picture_of_a_long_run_keeps_the_ends_of_its_stages(tmp_path: Path) -> None:
    run = execute(load_text(TAP, "tap.yaml"), tmp_path / "run", report=False)
    thin = run.history.thinned(50)
    assert 40 < len(thin) < 60
    ends = {run.columns["clock"][row] for v in run.history.visits() for row in (v.first, v.last)}
    assert ends <= set(thin.columns["clock"].tolist())
    assert [v.stage for v in thin.visits()] == [v.stage for v in run.history.visits()]
    assert run.history.thinned(10_000) is run.history
    assert json.loads((run.folder / "summary.json").read_text())["ticks"] == len(run)
