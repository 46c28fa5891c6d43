"""Logs that were recorded elsewhere: what is judged of them, and what is said of bad ones.

Round trips go through the project's own exports of a run, of which every verdict and number is
known.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import call
from mcap_ros2.writer import Writer
from short_tasks import TAP
from typer.testing import Result

from taskspec.compiler import compile_unchecked
from taskspec.spec import load_task, load_text
from taskspec_runner import read
from taskspec_runner.export import export_run
from taskspec_runner.record import file_array, mapped
from taskspec_runner.record.file_array import FileArray
from taskspec_runner.record.history import History
from taskspec_runner.recorded import guards, messages, sample_texts, source
from taskspec_runner.recorded.column_map import SCHEMA_FILE, read_columns, schema_text
from taskspec_runner.recorded.messages import read_mcap
from taskspec_runner.recorded.recording import read_recording
from taskspec_runner.recorded.ticks import Ticks
from taskspec_runner.runs import Run
from taskspec_runner.session import execute

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = ROOT / "tasks" / "wipe-table.yaml"
#: What a run knows and no log says.
OF_A_RUN = ("seed", "torque_step", "ending", "stages", "solver", "diagnostics", "forced")
#: Sums of a thousand numbers that differ in their last digit do so in the last three.
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A shipped task."""
    out = tmp_path_factory.mktemp("recorded") / "run"
    return execute(load_task(SHIPPED), out, report=False)


@pytest.fixture(scope="module")
def tap(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A task of 0.5 s whose stages are found by guards and by time."""
    folder = tmp_path_factory.mktemp("tap")
    (folder / "tap.yaml").write_text(TAP, encoding="utf-8")
    return execute(load_task(folder / "tap.yaml"), folder / "run", report=False)


@pytest.fixture
def task(tap: Run) -> Path:
    return tap.folder.parent / "tap.yaml"


def judged(task: Path, log: Path, out: Path, columns: str = "", *options: str) -> Result:
    given = []
    if columns:
        path = log.with_name("map.yaml")
        path.write_text(columns, encoding="utf-8")
        given = ["--columns", path]
    return call("judge", task, log, "--out", out, *given, *options)


def summary(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return found


def same(a: object, b: object, tolerance: float = 0.0) -> bool:
    """Whether two pieces of JSON are equal, numbers to a share of themselves."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k], tolerance) for k in a)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(same(x, y, tolerance) for x, y in zip(a, b, strict=True))
    if isinstance(a, float) and isinstance(b, float):
        return abs(a - b) <= tolerance * max(abs(a), abs(b), 1e-3)
    return a == b


def table(history: History) -> dict[str, Any]:
    return {"clock": history.columns["clock"], "stage": history.stages.tolist(),
            **{n: v for n, v in history.columns.items() if n not in ("clock", "t")}}  # fmt: skip


def written(path: Path, columns: dict[str, Any], units: dict[str, str] | None = None) -> Path:
    """A CSV file of some columns."""
    units = units or {}
    header = [f"{name} [{units[name]}]" if units.get(name) else name for name in columns]
    rows = [["" if v != v else str(v) for v in row] for row in zip(*columns.values(), strict=True)]
    lines = [",".join(row) for row in (header, *rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


# Round trips.


@pytest.mark.parametrize("log", [".", "log.arrow"])
def test_a_run_is_judged_by_another_file_after_an_export(
    run: Run, tmp_path: Path, log: str
) -> None:
    said = judged(SHIPPED, run.folder / log, tmp_path / "out").stderr
    assert f"taskspec export {run.folder} --parquet" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("form", ["csv", "parquet", "mcap"])
def test_own_export_needs_no_map_and_is_judged_as_the_run_was(
    run: Run, tmp_path: Path, form: str
) -> None:
    log = export_run(run, form, tmp_path / f"log.{form}").path
    result = judged(SHIPPED, log, tmp_path / "out")
    assert (result.exit_code, run.exit_code) == (0, 0), result.output
    mine, theirs = summary(tmp_path / "out"), dict(run.summary)
    for key in theirs:
        assert key in OF_A_RUN or mine[key] == theirs[key], key
    again = read(tmp_path / "out")
    assert again.damage == ""
    assert again.verdict == "passed"
    assert again.reason.startswith("All 3 expectations held. This is as measured")
    for name, values in run.history.columns.items():
        np.testing.assert_array_equal(again.history.columns[name], values)
    assert again.stages == run.stages
    said = again.manifest["recorded"]
    assert (said["log"], said["stages"]) == (log.name, "column")
    assert len(said["sha256"]) == 64
    assert "3 of 3 expectations met; as measured" in result.stdout
    assert call("judge", tmp_path / "out").exit_code == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "as measured" in page
    assert "taskspec judge, measured elsewhere" in page
    assert "Columns of the log" in page
    assert "recorded.columns" not in page
    # That a log goes on with the next stage is no fault.
    assert "the log goes on with stage" in page
    assert '<tr class="bad">' not in page


def test_renamed_columns_in_other_units_with_other_signs(run: Run, tmp_path: Path) -> None:
    columns, names = run.history.columns, [*run.history.columns]
    forces = [n for n in names if n.startswith("force.") and n.count(".") == 1]
    data = {"stamp": 1e3 * columns["clock"], "phase": run.history.stages.tolist()}
    lines = ["time: {column: stamp, unit: ms}", "stage: phase", "signals:"]
    for i, name in enumerate(forces):
        data[f"F{i}"] = -1e-3 * columns[name]
        lines.append(f"  {name}: {{column: F{i}, unit: kN, sign: -1}}")
    data |= {"Fset": -columns["force.z.ref"], "q1": np.degrees(columns["joint.1.position"])}
    data["e"] = 1e3 * columns["error.x"]
    lines += ["  force.z.ref: {column: Fset, unit: N, sign: -1}",
              "  joint.1.position: {column: q1, unit: deg}",
              "  error.x: {column: e, unit: mm}"]  # fmt: skip
    # That the moves of its last stage are done shows in no log: what follows says it.
    data = {name: [*values, np.nan] for name, values in data.items() if name != "phase"}
    data["stamp"][-1] = 1e3 * run.end
    data["phase"] = [*run.history.stages.tolist(), "end"]
    log = tmp_path / "log.parquet"
    pq.write_table(pa.table(data), log)
    result = judged(SHIPPED, log, tmp_path / "out", "\n".join(lines))
    assert result.exit_code == 0, result.output
    again = read(tmp_path / "out")
    for name in (*forces, "force.z.ref", "joint.1.position", "error.x"):
        # A unit there and back, and degrees, round three times.
        np.testing.assert_allclose(again.history.columns[name], columns[name], rtol=4 * 2.3e-16)
    mine, theirs = summary(tmp_path / "out"), run.summary
    assert same(mine["expectations"], theirs["expectations"], ROUNDING)
    for stage, own in theirs["metrics"].items():
        assert same(mine["metrics"][stage].get("force.z"), own.get("force.z"), ROUNDING)


def between(values: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """What is left of a column by straight lines between the samples that were kept."""
    rows = np.arange(len(values))
    return np.asarray(np.interp(rows, rows[kept], values[kept]))


@pytest.mark.parametrize("lost", ["a tenth", "nine of ten"])
def test_lost_samples_and_a_lower_rate_are_bridged_by_straight_lines(
    run: Run, tmp_path: Path, lost: str
) -> None:
    """Every number is within what a straight line misses of the run's own samples."""
    history, n = run.history, len(run.history)
    kept = np.random.default_rng(1).random(n) > 0.1 if lost == "a tenth" else np.arange(n) % 10 == 0
    kept[[0, -1]] = True
    assert np.diff(np.flatnonzero(kept)).max() <= 10
    names = ("force.x", "force.y", "force.z")
    data = {"time": history.columns["clock"][kept], "stage": history.stages[kept].tolist()}
    units = {"time": "s"} | dict.fromkeys(names, "N")
    data |= {name: history.columns[name][kept] for name in names}
    log = written(tmp_path / "log.csv", data, units)
    assert judged(SHIPPED, log, tmp_path / "out").exit_code in (0, 1, 5)
    again = read(tmp_path / "out").history
    assert len(again) == n
    for name in names:
        straight = between(history.columns[name], kept)
        np.testing.assert_allclose(again.columns[name], straight, atol=1e-9)
    # A stage is that of the last sample: it begins late by less than the samples are apart.
    for mine, theirs in zip(again.visits(), history.visits(), strict=True):
        assert mine.stage == theirs.stage
        assert 0 <= mine.first - theirs.first < 10
    # The mean of |f| cannot be further off than what the lines miss, and the ticks that moved.
    wipe, force = history.stages == "wipe", history.columns["force.z"]
    missed = float(np.abs(between(force, kept) - force)[wipe].mean())
    moved = 20 * float(np.abs(history.columns["force.z"]).max()) / int(wipe.sum())
    mine = float(again.columns["force.z"][again.stages == "wipe"].mean())
    assert abs(mine - float(history.columns["force.z"][wipe].mean())) <= missed + moved


@pytest.mark.parametrize("way", ["guards", "times"])
def test_stages_without_a_column(tap: Run, task: Path, tmp_path: Path, way: str) -> None:
    columns = table(tap.history)
    del columns["stage"]
    log = written(tmp_path / "log.csv", columns, dict(tap.history.units) | {"clock": "s"})
    start = tap.visits[1].start
    said = f"stages: [{{stage: approach, at: 0 s}}, {{stage: hold, at: {start:.6f} s}}]"
    result = judged(task, log, tmp_path / "out", said if way == "times" else "")
    assert result.exit_code == 0, result.output
    again = read(tmp_path / "out")
    assert (again.history.stages == tap.history.stages).all()
    assert summary(tmp_path / "out")["expectations"] == tap.summary["expectations"]
    assert again.manifest["recorded"]["stages"] == way


def test_what_was_not_recorded_is_neither_met_nor_missed(
    tap: Run, task: Path, tmp_path: Path
) -> None:
    """`error.y` and the true force are missing; the measured force takes the place of the true."""
    columns = tap.history.columns
    data = {"clock": columns["clock"], "stage": tap.history.stages.tolist(),
            "force.x.measured": columns["force.x.measured"]}  # fmt: skip
    log = written(tmp_path / "log.csv", data, {"clock": "s", "force.x.measured": "N"})
    result = judged(task, log, tmp_path / "out")
    assert result.exit_code == 5, result.output
    assert "3 of 4 expectations met, 1 cannot be judged; as measured" in result.stdout
    assert "needs error.y, which was not recorded" in " ".join(result.stdout.split())
    again = read(tmp_path / "out")
    assert [each.passed for each in again.expectations] == [True, True, None, True]
    assert again.expectations[2].unrecorded == ("error.y",)
    assert again.verdict == "undecided"
    assert not again.passed
    assert again.manifest["recorded"]["as_measured"] == ["force.x"]
    assert call("judge", tmp_path / "out").exit_code == 5
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "cannot be judged, as error.y was not recorded" in page
    for command, *options in (("report",), *(("export", f"--{f}") for f in ("csv", "mcap"))):
        assert call(command, tmp_path / "out", *options).exit_code == 0, command
    assert call("diff", tmp_path / "out", tap.folder).exit_code == 1
    # What is missed counts more than what cannot be told.
    told = judged(task, log, tmp_path / "out", "", "--set", "params.press=9N")
    assert told.exit_code == 1
    assert read(tmp_path / "out").verdict == "missed"


def test_norm_of_a_force_of_which_a_part_was_not_recorded_cannot_be_judged(
    run: Run, tmp_path: Path
) -> None:
    columns = run.history.columns
    data = {"clock": columns["clock"], "stage": run.history.stages.tolist(),
            "force.z": columns["force.z"]}  # fmt: skip
    log = written(tmp_path / "log.csv", data, {"clock": "s", "force.z": "N"})
    assert judged(SHIPPED, log, tmp_path / "out").exit_code == 5
    found = {each.text: each for each in read(tmp_path / "out").expectations}
    assert found["max(norm(force)) < 40 N"].unrecorded == ("force.x", "force.y")
    assert read(tmp_path / "out").summary["peaks"]["wipe"]["force"] is None


def test_log_that_ends_before_the_task_is_no_pass(tap: Run, task: Path, tmp_path: Path) -> None:
    columns = table(tap.history)
    part = {name: values[:50] for name, values in columns.items()}
    log = written(tmp_path / "log.csv", part, dict(tap.history.units) | {"clock": "s"})
    result = judged(task, log, tmp_path / "out")
    assert result.exit_code == 6
    assert "the log ends, and 'hold' would follow" in " ".join(result.stdout.split())


def test_names_and_idle_samples_of_a_stage_column(tap: Run, task: Path, tmp_path: Path) -> None:
    """A log that begins before the task and calls its stages by numbers."""
    history = tap.history
    n, idle = len(history), 30
    words = ["0"] * idle + ["1" if s == "approach" else "2" for s in history.stages] + ["0"] * idle
    data = {"time": np.arange(n + 2 * idle) * 1e-3 + 1.7e9, "mode": words}
    for name in ("force.x", "error.y"):
        data[name] = np.pad(history.columns[name], idle)
    log = written(tmp_path / "log.csv", data, {"time": "s", "force.x": "N", "error.y": "m"})
    names = "stage: {column: mode, names: {0: '', 1: approach, 2: hold}}\n"
    result = judged(task, log, tmp_path / "out", names)
    assert result.exit_code == 0, result.output
    assert (read(tmp_path / "out").history.stages == history.stages).all()
    theirs = tap.summary["expectations"]
    # Seconds since 1970 have a resolution of 0.2 us: a value is off by what it changes in that.
    assert same(summary(tmp_path / "out")["expectations"][0], theirs[0], 1e-3)


# What is wrong is said with its place.


GOOD = "time: {column: clock}\nstage: stage\nsignals:\n  force.x: {column: Fx, unit: N}\n"


@pytest.fixture
def log(tap: Run, tmp_path: Path) -> Path:
    data = {"clock": tap.columns["clock"], "stage": tap.history.stages.tolist()}
    return written(tmp_path / "log.csv", data | {"Fx": tap.columns["force.x"]}, {"clock": "s"})


@pytest.mark.parametrize(
    ("said", "told"),
    [
        (GOOD.replace("column: Fx", "colum: Fx"), ":4:13: error[TS020]: unknown key 'colum'"),
        (GOOD.replace("unit: N", "unit: Ntn"), "error[TS111]: unknown unit 'Ntn'"),
        (GOOD.replace("unit: N", "unit: mm"), "force.x is a force (N), and mm is a length (m)"),
        (GOOD.replace("{column: Fx, unit: N}", "{unit: N}"), "'force.x' needs the key 'column'"),
        (GOOD.replace("Fx,", "Fy,"), "has no column 'Fy'; columns: clock, stage, Fx"),
        (GOOD.replace("force.x:", "force.w:"), ":4:3: the task has no signal 'force.w'"),
        (GOOD.replace("unit: N", "unit: N, sign: 2"), "a sign is 1 or -1"),
        (GOOD.replace("stage: stage", "stage: mode"), "has no column 'mode'"),
        (GOOD.replace("column: clock", "column: stamp"), "has no column 'stamp'"),
        (GOOD.replace("stage: stage", "stages: [{stage: grind, at: 0 s}]"), "no stage 'grind'"),
        (GOOD.replace("stage: stage", "stages: [{stage: hold, at: 1 s}]"), "begins with the log"),
        (GOOD + "stages: [{stage: hold, at: 0 s}]\n", "both say where stages begin"),
        (GOOD + "rate: 250 Hz\n", "it has 1000 samples a second, and the map says 250 Hz"),
        (GOOD.replace("column: clock", "column: clock, unit: N"), "and N is a force (N)"),
        (GOOD.replace("column: clock", "column: clock, unit: us"), "state the unit of the time"),
        (GOOD.replace("column: clock", "column: clock, start: 9 s"), "has samples from 0 s"),
        ("signals: [1]\n", "this is a mapping of names"),
        ("- a\n", "a column map is a mapping"),
        ("a: [\n", "error[TS"),
    ],
)  # fmt: skip
def test_bad_map_is_named_with_its_place(
    task: Path, log: Path, tmp_path: Path, said: str, told: str
) -> None:
    result = judged(task, log, tmp_path / "out", said)
    assert result.exit_code == 2, result.output
    assert told in result.stderr
    assert not (tmp_path / "out").exists()
    if "log.csv" not in result.stderr:
        assert "map.yaml" in result.stderr


def lines_of(log: Path, change: Callable[[list[str]], Sequence[str]]) -> None:
    log.write_text("\n".join(change(log.read_text(encoding="utf-8").splitlines())) + "\n")


def cell(row: int, column: int, text: str) -> Callable[[list[str]], list[str]]:
    def change(lines: list[str]) -> list[str]:
        parts = lines[row].split(",")
        parts[column] = text
        return [*lines[:row], ",".join(parts), *lines[row + 1 :]]

    return change


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (cell(20, 0, "0.002"), "time does not rise in line 21: 0.002 s after 0.018 s"),
        (cell(20, 0, "nan"), "there is no time in line 21"),
        (cell(20, 2, "inf"), "'Fx' is not finite in line 21"),
        (cell(20, 2, "4,5"), "its lines do not all have as many columns as its header"),
        (cell(20, 2, "4.5.6"), "'4.5.6' is no number, in column 'Fx', line 21"),
        (cell(20, 1, "press"), "'press' in column 'stage', line 21, is no stage of the task"),
        (cell(20, 1, ""), "column 'stage' names no stage in line 21, between stages"),
        (lambda lines: lines[:1], "it has a header and no sample"),
        (lambda lines: lines[:2], "there is one sample"),
        (lambda lines: [*lines[:30], *lines[60:]], "there is no sample for 31 ms from 0.028 s on"),
        (lambda lines: [*lines[:30], *(",".join([*li.split(",")[:2], ""]) for li in lines[30:60]),
                        *lines[60:]], "force.x in stage 'approach' has no value for 30 ms"),
        (lambda lines: [*lines[:1], *(",".join([*li.split(",")[:2], "nan"]) for li in lines[1:])],
         "column 'Fx' has no value"),
        (lambda lines: [lines[0], *lines[1::20]], "the time, or the bound: gap: 20 ms"),
        (lambda _: [""], "it is empty"),
    ],
)  # fmt: skip
def test_bad_log_is_named_with_its_place(
    task: Path, log: Path, tmp_path: Path, change: Callable[[list[str]], list[str]], told: str
) -> None:
    lines_of(log, change)
    result = judged(task, log, tmp_path / "out", GOOD)
    assert result.exit_code == 2, result.output
    assert told in result.stderr
    assert "log.csv" in result.stderr


def test_short_gap_is_bridged_and_a_stated_bound_widens_it(
    tap: Run, task: Path, log: Path, tmp_path: Path
) -> None:
    lines_of(log, lambda lines: [*lines[:30], *lines[60:]])
    result = judged(task, log, tmp_path / "out", f"{GOOD}gap: 40 ms\n")
    assert result.exit_code in (1, 5), result.output
    assert len(read(tmp_path / "out")) == len(tap)


@pytest.mark.parametrize("form", ["csv", "parquet", "mcap"])
def test_file_that_was_cut_short(tap: Run, task: Path, tmp_path: Path, form: str) -> None:
    path = export_run(tap, form, tmp_path / f"log.{form}").path
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 2 // 3])
    result = judged(task, path, tmp_path / "out")
    if form == "csv":
        # A text has no end of its own; its last line is left out, and the task is not complete.
        assert result.exit_code == 6, result.output
        assert "into the stage, which takes 0.3 s" in " ".join(result.stdout.split())
        assert len(read(tmp_path / "out")) < len(tap)
        return
    assert result.exit_code == 2, result.output
    whole = {"parquet": "it is no whole Parquet file", "mcap": "it is no whole MCAP file"}
    assert whole[form] in result.stderr


def test_log_that_is_none(task: Path, tmp_path: Path) -> None:
    assert "cannot read" in judged(task, tmp_path / "none.csv", tmp_path / "out").stderr
    assert "cannot read" in judged(task, tmp_path, tmp_path / "out").stderr
    other = tmp_path / "log.bin"
    other.write_bytes(bytes(range(256)) * 4)
    assert "it is no text, nor Parquet nor MCAP" in judged(task, other, tmp_path / "out").stderr
    told = call("judge", task)
    assert told.exit_code == 2
    assert "name the log too" in told.stderr


def test_log_in_the_folder_that_is_written_is_kept(tap: Run, task: Path) -> None:
    assert call("export", tap.folder, "--csv").exit_code == 0
    log = tap.folder / "log.csv"
    result = judged(task, log, tap.folder)
    assert result.exit_code == 2
    assert "lies in it" in result.stderr
    assert log.is_file()
    log.unlink()


def test_guard_that_a_log_cannot_show_is_named(run: Run, tmp_path: Path) -> None:
    """Moves that are done end a stage; where it is the last one, nobody knows whether they were."""
    columns = table(run.history)
    del columns["stage"]
    log = tmp_path / "log.parquet"
    schema = [pa.field(n, pa.float64(), metadata={"unit": run.history.units[n]}) for n in columns]
    pq.write_table(pa.table([*map(pa.array, columns.values())], schema=pa.schema(schema)), log)
    assert judged(SHIPPED, log, tmp_path / "out").exit_code == 5
    assert (read(tmp_path / "out").history.stages == run.history.stages).all()
    task = tmp_path / "more.yaml"
    more = "  again: {axes: {z: {move: 1 mm}}}\nexpect:"
    task.write_text(SHIPPED.read_text().replace("\nexpect:", f"\n{more}", 1))
    result = judged(task, log, tmp_path / "more")
    assert result.exit_code == 2
    assert "ends when its moves are done" in result.stderr
    assert "'stages'" in result.stderr


# The pieces.


def test_rule_of_resampling() -> None:
    ticks = Ticks(1e-3, 4, 1e-2)
    times, values = np.array([0.0, 0.001004, 0.0025, 0.003]), np.array([0.0, 10.0, 40.0, 50.0])
    # The second sample is within a hundredth of a tick; the third tick lies 996 of 1496 parts on.
    expected = [0.0, 10.0, 10.0 + 30.0 * 996 / 1496, 50.0]
    assert ticks.values(times, values, held=False).tolist() == pytest.approx(expected, abs=1e-9)
    assert ticks.values(times, values, held=True).tolist() == [0.0, 10.0, 10.0, 50.0]


def test_messages_whose_texts_and_lists_differ_in_length(tmp_path: Path) -> None:
    """A text, then a list of numbers that is aligned behind it, as another library writes them."""
    definition = "string name\nfloat64[] values\nuint8 last\n"
    path = tmp_path / "log.mcap"
    with path.open("wb") as file, Writer(file) as writer:
        schema = writer.register_msgdef("pkg/msg/X", definition)
        for number, (name, count) in enumerate((("ab", 1), ("abcdef", 3))):
            message = {"name": name, "values": [*map(float, range(1, count + 1))], "last": 7}
            writer.write_message("/x", schema, message, log_time=number, publish_time=number)
    log = read_mcap(path)
    assert log.words("/x.name").names == ("ab", "abcdef")
    read = log.numbers(["/x.values[0]", "/x.values[2]", "/x.last"])
    assert {name: values.tolist() for name, values in read.items()} == {
        "/x.values[0]": [1, 1], "/x.values[2]": [3], "/x.last": [7, 7]}  # fmt: skip
    assert log.times("/x.values[2]", ()).tolist() == [1e-9]


@pytest.mark.parametrize(
    ("form", "way"),
    [("csv", "column"), ("parquet", "column"), ("mcap", "column"), ("csv", "guards")],
)
def test_a_long_log_is_read_in_parts_to_the_same_end(
    run: Run, tap: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str, way: str
) -> None:
    """Parts of some ticks and files instead of memory: the same numbers, bit by bit."""
    chosen = run if way == "column" else tap
    log = export_run(chosen, form, tmp_path / f"log.{form}").path
    # Half of the samples, and some values missing: there is something to bridge.
    if form == "parquet":
        whole = pq.read_table(log)
        values = whole["force.z.measured"].to_numpy().copy()
        values[5000:5004] = np.nan
        at = whole.schema.get_field_index("force.z.measured")
        whole = whole.set_column(at, whole.schema.field(at), pa.array(values))
        pq.write_table(whole.take(np.arange(0, len(whole), 2)), log)
    program = chosen.program
    columns = tmp_path / "map.yaml"
    columns.write_text("gap: 50 ms\n")
    if way == "guards":
        lines = log.read_text().splitlines()
        at = lines[0].split(",").index("stage")
        kept = [",".join(p for i, p in enumerate(line.split(",")) if i != at) for line in lines]
        log.write_text("\n".join(kept) + "\n")
    plain = read_recording(program, log, read_columns(columns))
    monkeypatch.setattr(mapped, "SPILL_ROWS", 2900)
    monkeypatch.setattr(mapped, "_FIRST_CAPACITY", 2048)
    monkeypatch.setattr(file_array, "LARGE", 1000)
    monkeypatch.setattr(file_array, "BLOCK_ROWS", 3000)
    monkeypatch.setattr(guards, "BLOCK_ROWS", 60)
    monkeypatch.setattr(messages, "_MESSAGES", 2500)
    monkeypatch.setattr(source, "_BLOCK", 1 << 18)
    monkeypatch.setattr(source, "ROWS", 3000)
    parts = read_recording(program, log, read_columns(columns))
    assert parts.facts == plain.facts
    assert parts.facts["stages"] == way
    assert parts.history.stages.tolist() == plain.history.stages.tolist()
    assert parts.history.columns.keys() == plain.history.columns.keys()
    for name, values in plain.history.columns.items():
        found = parts.history.columns[name]
        assert isinstance(found, FileArray) or len(found) * found.itemsize <= 1000, name
        assert found.tobytes() == values.tobytes(), name


def test_texts_that_are_too_many_name_no_stages(
    task: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sample_texts, "_MOST_TEXTS", 100)
    columns = {"time": np.arange(500) * 1e-3, "stage": [f"s{i}" for i in range(500)]}
    columns["force.x.measured"] = np.zeros(500)
    log = written(tmp_path / "log.csv", columns, {"time": "s", "force.x.measured": "N"})
    result = judged(task, log, tmp_path / "out")
    assert result.exit_code == 2
    assert "column 'stage' has more than 100 different texts" in " ".join(result.output.split())


def test_schema_on_disk_is_that_of_the_models() -> None:
    path = ROOT / "schemas" / SCHEMA_FILE
    assert path.read_text(encoding="utf-8") == schema_text()


def test_every_shipped_kind_of_log_gives_the_verdicts_of_its_run(tmp_path: Path) -> None:
    """In frames that move, with a tare, with objects."""
    for name in ("wrist-sensor", "vibrating-table", "crank"):
        path = ROOT / "tasks" / f"{name}.yaml"
        made = execute(load_task(path), tmp_path / name, report=False)
        log = export_run(made, "parquet", tmp_path / f"{name}.parquet").path
        program = compile_unchecked(load_task(path))
        again = read_recording(program, log, read_columns(None)).history
        for column, values in made.history.columns.items():
            np.testing.assert_array_equal(again.columns[column], values, err_msg=column)
        assert (again.stages == made.history.stages).all()


def test_python_reads_a_task_from_text_too(tap: Run, tmp_path: Path) -> None:
    log = export_run(tap, "parquet", tmp_path / "log.parquet").path
    program = compile_unchecked(load_text(TAP, "tap.yaml"))
    assert len(read_recording(program, log, read_columns(None)).history) == len(tap)
