"""Runs as a LeRobot dataset: every file by pyarrow, numbers against a second way to them.

Poses and axes come from `PoseStream`, which goes by quaternions and chunks, and from Pinocchio.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import call
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from short_tasks import DRUM, TAP, UNFOLD
from sweeps import VARY

import taskspec_runner
from taskspec.spec import load_text
from taskspec_runner.dataset import export_dataset, source
from taskspec_runner.dataset.features import FrameLayout
from taskspec_runner.dataset.source import SweptRuns, source_of
from taskspec_runner.dataset.statistics import QUANTILES, Colours, statistics
from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.export.poses import PoseStream
from taskspec_runner.record.history import history_of
from taskspec_runner.record.whole import PARTIAL
from taskspec_runner.recorded.judging import judge_recording
from taskspec_runner.runs import Run
from taskspec_runner.session import execute
from taskspec_runner.sweep.table import read_table
from taskspec_runner.sweep.world_run import BROKEN
from taskspec_runner.video.canvas import NoCanvasError, new_context

Array = NDArray[Any]

FEATURES = {
    "observation.state": pa.list_(pa.float32(), 29),
    "observation.wrench": pa.list_(pa.list_(pa.float32())),
    "action": pa.list_(pa.float32(), 15),
    "next.done": pa.bool_(),
    "next.success": pa.bool_(),
    "stage": pa.string(),
    "log_row": pa.int64(),
    "timestamp": pa.float32(),
    "frame_index": pa.int64(),
    "episode_index": pa.int64(),
    "index": pa.int64(),
    "task_index": pa.int64(),
}
#: Turns under a law whose error is one of Euler angles, about a point that is not the tip.
ANGLES = """\
taskspec: 1
name: angles
robot: {model: panda, start: {xyz: [450 mm, 0, 400 mm], rpy: [170 deg, 10 deg, 20 deg]}}
world: {}
frames: {grip: {xyz: [450 mm, 30 mm, 380 mm], point: origin}}
frame: grip
law: {kind: impedance, orientation: rpy}
stages:
  around:
    axes: {rx: {velocity: 20 deg/s}, rz: {velocity: -30 deg/s}, y: {velocity: 20 mm/s}}
    time: 0.5 s
"""


def made(text: str, out: Path) -> Path:
    execute(load_text(text, "task.yaml"), out, report=False)
    return out


@pytest.fixture(scope="module")
def tap(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of a planar arm that passes."""
    return made(TAP, tmp_path_factory.mktemp("runs") / "tap")


@pytest.fixture(scope="module")
def drum(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in three kinds of frames, one of which turns along."""
    return made(DRUM, tmp_path_factory.mktemp("runs") / "drum")


@pytest.fixture(scope="module")
def dataset(drum: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of one run."""
    path = tmp_path_factory.mktemp("datasets") / "drum"
    done = export_dataset([source_of(drum)], path)
    assert (done.episodes, done.tasks) == (1, 1)
    return path


def frames(path: Path) -> dict[str, Array]:
    """Columns of all frames."""
    table = pq.read_table(path / "data/chunk-000/file-000.parquet")
    return {name: np.array(table.column(name).to_pylist()) for name in table.column_names}


def episodes(path: Path) -> list[dict[str, Any]]:
    found = pq.read_table(path / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert found
    return found


def left(folder: Path) -> list[str]:
    """What is in a folder, but for runs and sweeps."""
    return sorted(each.name for each in folder.iterdir())


# files


def test_frames_have_the_columns_that_info_names(dataset: Path) -> None:
    info = json.loads((dataset / "meta/info.json").read_text())
    schema = pq.read_schema(dataset / "data/chunk-000/file-000.parquet")
    assert {field.name: field.type for field in schema} == FEATURES
    assert [*info["features"]] == [*FEATURES]
    values = frames(dataset)
    for name, said in info["features"].items():
        assert [*said] == ["dtype", "shape", "names"]
        shape = () if said["shape"] == [1] else tuple(said["shape"])
        assert values[name].shape == (info["total_frames"], *shape), name
        if len(said["shape"]) == 1 and said["names"] is not None:
            assert len(said["names"]) == said["shape"][0]
    assert (
        info["features"]["action"]["names"] == info["features"]["observation.state"]["names"][14:]
    )


def test_info_names_what_there_is(dataset: Path) -> None:
    info = json.loads((dataset / "meta/info.json").read_text())
    rows = pq.read_metadata(dataset / "data/chunk-000/file-000.parquet").num_rows
    assert {key: value for key, value in info.items() if key != "features"} == {
        "codebase_version": "v3.0",
        "robot_type": "panda",
        "total_episodes": 1,
        "total_frames": rows,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": 30,
        "splits": {"train": "0:1"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
    }
    assert left(dataset) == ["README.md", "data", "log", "meta"]


def test_the_page_beside_names_every_feature(dataset: Path) -> None:
    text = (dataset / "README.md").read_text(encoding="utf-8")
    assert all(f"| `{name}` |" in text for name in FEATURES)


def test_tasks_are_the_index_of_their_table(tap: Path, drum: Path, tmp_path: Path) -> None:
    again = shutil.copytree(tap, tmp_path / "again")
    export_dataset([source_of(tap), source_of(again)], tmp_path / "one")
    table = pq.read_table(tmp_path / "one/meta/tasks.parquet")
    words = "Touch a wall and press on it for a moment."
    assert table.to_pylist() == [{"task_index": 0, "task": words}]
    said = json.loads(table.schema.metadata[b"pandas"])
    assert said["index_columns"] == ["task"]
    # Without a description it is the name.
    export_dataset([source_of(drum)], tmp_path / "two")
    assert pq.read_table(tmp_path / "two/meta/tasks.parquet")["task"].to_pylist() == ["drum"]


# time


@pytest.mark.parametrize("fps", [7, 30, 333, 1000])
def test_frames_are_the_newest_ticks_of_their_times(tap: Path, tmp_path: Path, fps: int) -> None:
    export_dataset([source_of(tap)], tmp_path / "made", fps)
    found, clock = frames(tmp_path / "made"), Run(tap).history.columns["clock"]
    numbers, rows = found["frame_index"], found["log_row"]
    assert (numbers == np.arange(len(numbers))).all()
    # At 1 kHz that is the thousandth before, without drift over the whole run.
    assert (rows == numbers * 1000 // fps).all()
    late = numbers / fps - clock[rows]
    assert (late > -1e-9).all()
    assert (late < 1e-3).all()
    assert found["timestamp"] == pytest.approx(numbers / fps, abs=1e-6)
    # Another frame would lie after the last tick.
    assert (numbers[-1] + 1) / fps > clock[-1]


def test_windows_hold_every_sample_up_to_their_frame(tap: Path, tmp_path: Path) -> None:
    export_dataset([source_of(tap)], tmp_path / "made", 30)
    export_dataset([source_of(tap)], tmp_path / "all", 1000)
    found, every = frames(tmp_path / "made"), frames(tmp_path / "all")
    windows, samples = found["observation.wrench"], every["observation.wrench"][:, -1]
    # 33 1/3 samples come in a frame.
    assert windows.shape[1:] == (34, 6)
    assert every["observation.wrench"].shape[1:] == (1, 6)
    for window, row in zip(windows, found["log_row"], strict=True):
        wanted = samples[np.maximum(np.arange(row - 33, row + 1), 0)]
        assert (window == wanted).all()
    assert (np.diff(found["log_row"]) <= 34).all()
    assert (windows[:, -1] == found["observation.state"][:, -6:]).all()
    assert np.abs(windows).max() > 1.0


@pytest.mark.parametrize(
    ("rate", "fps", "window"),
    [(1000, 30, 34), (1000, 50, 20), (500, 60, 9), (40, 30, 2), (30, 30, 1)],
)
def test_a_window_is_as_long_as_a_frame(rate: float, fps: int, window: int) -> None:
    assert FrameLayout("panda", 7, rate, fps).window == window


# what is measured and commanded


def matrices(turns: Array) -> Array:
    return Rotation.from_quat(turns).as_matrix()


def streamed(run: Run) -> tuple[Any, Any, Any]:
    """Poses of tip, frame and wrench at every tick, by the way of exports."""
    stream = PoseStream(run.program)
    [found] = [stream.add(history_of(batch)) for batch in run.batches()]
    return found


def logged(run: Run, name: str) -> Array:
    """(n, 6) of the log in the axes of each tick's frame; 0 where it has none."""
    axes = ("force.x", "force.y", "force.z", "torque.rx", "torque.ry", "torque.rz")
    names = [name.format(effort=each, axis=each.partition(".")[2]) for each in axes]
    nothing = np.zeros(len(run))
    columns = run.history.columns
    return np.nan_to_num(np.column_stack([columns.get(each, nothing) for each in names]))


@pytest.mark.parametrize("text", [TAP, DRUM, ANGLES], ids=["tap", "drum", "angles"])
def test_wrench_and_pose_are_of_the_tip(text: str, tmp_path: Path) -> None:
    run = Run(made(text, tmp_path / "run"))
    export_dataset([source_of(run.folder)], tmp_path / "made", 100)
    found, n = frames(tmp_path / "made"), run.program.context.robot.n
    tip, frame, point = streamed(run)
    R, F = matrices(tip.turns), matrices(frame.turns)
    measured = logged(run, "{effort}.measured")
    force = np.einsum("kij,kj->ki", F, measured[:, :3])
    moment = np.einsum("kij,kj->ki", F, measured[:, 3:])
    moment = moment + np.cross(point.places - tip.places, force)
    wrench = np.hstack([np.einsum("kji,kj->ki", R, each) for each in (force, moment)])
    rows, state = found["log_row"], found["observation.state"]
    # Single precision keeps seven digits, of forces of some 10 N.
    assert state[:, -6:] == pytest.approx(wrench[rows], abs=1e-5)
    columns = run.history.columns
    for i in range(n):
        assert state[:, i] == pytest.approx(columns[f"joint.{i + 1}.position"][rows], abs=1e-6)
        assert state[:, n + i] == pytest.approx(columns[f"joint.{i + 1}.velocity"][rows], abs=1e-6)
    assert state[:, 2 * n : 2 * n + 3] == pytest.approx(tip.places[rows], abs=1e-6)
    columns_of_R = np.hstack([R[rows][:, :, 0], R[rows][:, :, 1]])
    assert state[:, 2 * n + 3 : 2 * n + 9] == pytest.approx(columns_of_R, abs=1e-6)
    # The other two of a planar arm's runs stay at rest without contact.
    assert text is not DRUM or np.abs(wrench).max() > 1.0


def test_action_is_the_reference_of_the_tip_and_the_set_point(drum: Path, dataset: Path) -> None:
    run, found = Run(drum), frames(dataset)
    tip, frame, _ = streamed(run)
    R, F, error = matrices(tip.turns), matrices(frame.turns), logged(run, "error.{axis}")
    place = tip.places + np.einsum("kij,kj->ki", F, error[:, :3])
    turned = np.einsum("kij,kj->ki", F, error[:, 3:])
    reference = Rotation.from_rotvec(turned).as_matrix() @ R
    force = np.einsum("kij,kj->ki", F, logged(run, "{effort}.ref")[:, :3])
    rows, action = found["log_row"], found["action"]
    assert action[:, :3] == pytest.approx(place[rows], abs=1e-6)
    assert action[:, 3:6] == pytest.approx(reference[rows][:, :, 0], abs=1e-6)
    assert action[:, 6:9] == pytest.approx(reference[rows][:, :, 1], abs=1e-6)
    own = np.einsum("kji,kj->ki", R, force)
    assert action[:, 9:12] == pytest.approx(own[rows], abs=1e-5)
    # Pressed with 5 N along the normal of the drum, which the tool points at, where it follows it.
    pressed = found["stage"] == "follow"
    assert np.linalg.norm(action[pressed, 9:12], axis=1).max() == pytest.approx(5.0, rel=1e-3)
    assert not action[~pressed, 9:].any()


def test_a_reference_in_a_fixed_frame_is_that_of_the_log(tap: Path, tmp_path: Path) -> None:
    export_dataset([source_of(tap)], tmp_path / "made", 100)
    found, columns = frames(tmp_path / "made"), Run(tap).history.columns
    rows, approaching = found["log_row"], found["stage"] == "approach"
    assert approaching.sum() > 5
    for axis, name in enumerate("xy"):
        wanted = columns[f"position.{name}.ref"][rows]
        assert found["action"][approaching, axis] == pytest.approx(wanted[approaching], abs=1e-6)
    # Along x the second stage has a force, and its reference is where the tip is.
    place = found["observation.state"][~approaching, 4]
    assert found["action"][~approaching, 0] == pytest.approx(place, abs=1e-7)


def test_live_params_are_commanded(tap: Path, tmp_path: Path) -> None:
    text = TAP.replace("press: 5 N", "press: {value: 5 N, live: 3..6 N, rate: 5 N/s}")
    loaded = load_text(text, "task.yaml")
    # It goes there at its rate, in 0.2 s.
    folder = taskspec_runner.run(loaded, out=tmp_path / "run", live=["press = 4 N @ 0.1 s"]).folder
    export_dataset([source_of(folder)], tmp_path / "made", 100)
    info = json.loads((tmp_path / "made/meta/info.json").read_text())
    assert info["features"]["action"]["names"][15:] == ["param.press"]
    found = frames(tmp_path / "made")
    pressed = found["action"][:, 15]
    assert pressed == pytest.approx(Run(folder).history.columns["param.press"][found["log_row"]])
    assert (pressed[0], pressed[-1]) == (5.0, pytest.approx(4.0, abs=1e-9))
    done = call("export", tap, folder, "--lerobot", tmp_path / "both")
    assert done.exit_code == 2
    assert "at 1000 Hz with param.press" in done.output


def test_a_reference_of_joints_is_where_they_put_the_tip(tmp_path: Path) -> None:
    run = Run(made(UNFOLD, tmp_path / "run"))
    export_dataset([source_of(run.folder)], tmp_path / "made", 100)
    found, twin = frames(tmp_path / "made"), run.program.context.robot.twin()
    on_path = found["stage"] == "unfold"
    assert on_path.sum() > 5
    columns = run.history.columns
    for row, action in zip(found["log_row"][on_path], found["action"][on_path], strict=True):
        q = np.array([columns[f"joint.{i}.position.ref"][row] for i in (1, 2)])
        tip = twin.tip(q)
        assert action[:3] == pytest.approx(tip.translation, abs=1e-6)
        assert action[3:6] == pytest.approx(tip.rotation[:, 0], abs=1e-6)


def test_a_reference_in_angles_lies_its_angles_beyond(tmp_path: Path) -> None:
    run = Run(made(ANGLES, tmp_path / "run"))
    export_dataset([source_of(run.folder)], tmp_path / "made", 100)
    found, (tip, frame, point) = frames(tmp_path / "made"), streamed(run)
    error, rows = logged(run, "error.{axis}"), found["log_row"]
    R, F = matrices(tip.turns), matrices(frame.turns)
    local = Rotation.from_matrix(np.swapaxes(F, 1, 2) @ R)
    beyond = Rotation.from_euler("xyz", local.as_euler("xyz") + error[:, 3:]).as_matrix()
    reference = F @ beyond
    assert found["action"][:, 3:6] == pytest.approx(reference[rows][:, :, 0], abs=1e-6)
    # The point that the stage is about belongs to the tool.
    lever = np.einsum("kji,kj->ki", R, point.places - tip.places)
    wanted = point.places + np.einsum("kij,kj->ki", F, error[:, :3])
    wanted = wanted - np.einsum("kij,kj->ki", reference, lever)
    assert found["action"][:, :3] == pytest.approx(wanted[rows], abs=1e-6)
    assert np.linalg.norm(lever, axis=1).min() > 0.01
    assert np.abs(error[:, 3:]).max() > 1e-4


# statistics


def test_statistics_are_those_of_numpy(dataset: Path) -> None:
    said, found = json.loads((dataset / "meta/stats.json").read_text()), frames(dataset)
    assert [*said] == [name for name in FEATURES if name != "stage"]
    for name, each in said.items():
        values = found[name].astype(float)
        values = values.reshape(-1, values.shape[-1]) if values.ndim > 1 else values[:, np.newaxis]
        assert each["count"] == [len(found[name])]
        wanted = {"min": values.min(0), "max": values.max(0)}
        wanted |= {"mean": values.mean(0), "std": values.std(0)}
        wanted |= {key: np.quantile(values, q, axis=0) for key, q in QUANTILES.items()}
        assert [*each] == ["min", "max", "mean", "std", "count", *QUANTILES]
        for key, value in wanted.items():
            assert np.array(each[key]).shape == value.shape
            assert each[key] == pytest.approx(value, abs=1e-9, rel=1e-9), (name, key)
    assert np.array(said["observation.wrench"]["mean"]).shape == (6,)


def test_statistics_of_an_episode_are_of_its_frames_alone(drum: Path, tmp_path: Path) -> None:
    shorter = made(DRUM.replace("time: 0.4 s", "time: 0.2 s"), tmp_path / "shorter")
    export_dataset([source_of(drum), source_of(shorter)], tmp_path / "made")
    found = frames(tmp_path / "made")
    one, two = episodes(tmp_path / "made")
    assert one["length"] > two["length"]
    for number, row in enumerate((one, two)):
        own = found["action"][found["episode_index"] == number]
        assert row["stats/action/mean"] == pytest.approx(own.mean(0, dtype=float), rel=1e-9)
        assert row["stats/action/count"] == [len(own)]
    said = json.loads((tmp_path / "made/meta/stats.json").read_text())
    both = found["action"].astype(float)
    # Of all frames, not the mean of the episodes'.
    assert said["action"]["q90"] == pytest.approx(np.quantile(both, 0.9, axis=0), rel=1e-9)


def test_colours_are_counted_exactly() -> None:
    values = np.random.default_rng(5).integers(0, 200, (7, 24, 32, 3), dtype=np.uint8)
    colours, more = Colours(), Colours()
    for picture in values[:4]:
        colours.add(picture)
    for picture in values[4:]:
        more.add(picture)
    colours += more
    found = colours.statistics()
    pixels = values.reshape(-1, 3) / 255
    assert found["count"] == [7]
    assert np.array(found["mean"]).shape == (3, 1, 1)
    wanted = statistics(pixels)
    for key in ("min", "max", "mean", "std", *QUANTILES):
        # A quantile may lie between two levels, of which this has the lower one.
        near = 1 / 255 if key in QUANTILES else 1e-12
        assert np.array(found[key]).ravel() == pytest.approx(wanted[key], abs=near), key


# episodes


def test_episodes_follow_each_other(tap: Path, tmp_path: Path) -> None:
    failing = made(TAP.replace("last(hold.force.x) within press", "last(hold.force.x) within 9 N"),
                   tmp_path / "failing")  # fmt: skip
    folders = (tap, failing, tap)
    done = export_dataset([source_of(each) for each in folders], tmp_path / "made")
    assert (done.episodes, done.good) == (3, 2)
    found, rows = frames(tmp_path / "made"), episodes(tmp_path / "made")
    assert (found["index"] == np.arange(len(found["index"]))).all()
    assert rows[0]["dataset_from_index"] == 0
    assert all(a["dataset_to_index"] == b["dataset_from_index"] for a, b in pairwise(rows))
    for number, row in enumerate(rows):
        here = slice(row["dataset_from_index"], row["dataset_to_index"])
        assert (found["episode_index"][here] == number).all()
        assert row["length"] == here.stop - here.start
        assert (row["data/chunk_index"], row["data/file_index"]) == (0, 0)
        assert found["next.done"][here].tolist() == [False] * (row["length"] - 1) + [True]
        good = number != 1
        assert found["next.success"][here].tolist() == [False] * (row["length"] - 1) + [good]
        assert (row["taskspec/success"], row["taskspec/verdict"]) == (
            (True, "passed") if good else (False, "missed")
        )
        assert (row["taskspec/seed"], row["taskspec/status"]) == (0, "done")
    assert [row["taskspec/run"] for row in rows] == ["tap", "failing", "tap"]
    groups = pq.read_metadata(tmp_path / "made/data/chunk-000/file-000.parquet").num_row_groups
    assert groups == 3


def test_the_whole_log_lies_beside(drum: Path, dataset: Path) -> None:
    [row], history = episodes(dataset), Run(drum).history
    assert row["taskspec/log"] == "log/episode-000000.parquet"
    table = pq.read_table(dataset / row["taskspec/log"])
    assert row["taskspec/rows"] == table.num_rows == len(history)
    for name, values in history.columns.items():
        assert np.array_equal(table[name].to_numpy(), values, equal_nan=True), name
    assert table.schema.field("force.z").metadata[b"unit"] == b"N"
    found = frames(dataset)
    stages = np.array(table["stage"].cast(pa.string()).to_pylist())
    assert (stages[found["log_row"]] == found["stage"]).all()
    # LeRobot reads every Parquet file two folders below these two.
    assert not list((dataset / "log").glob("*/*"))


def test_data_goes_on_in_another_file_when_one_is_large(
    tap: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("taskspec_runner.dataset.writer._DATA_SIZE", 1e-6)
    export_dataset([source_of(tap)] * 3, tmp_path / "made")
    names = left(tmp_path / "made/data/chunk-000")
    assert names == ["file-000.parquet", "file-001.parquet", "file-002.parquet"]
    rows = episodes(tmp_path / "made")
    assert [row["data/file_index"] for row in rows] == [0, 1, 2]
    for name, row in zip(names, rows, strict=True):
        table = pq.read_table(tmp_path / "made/data/chunk-000" / name)
        assert set(table["episode_index"].to_pylist()) == {row["episode_index"]}
    said = json.loads((tmp_path / "made/meta/stats.json").read_text())
    assert said["index"]["max"] == [sum(row["length"] for row in rows) - 1]


# sweeps


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sweep of four worlds, one of whose runs is kept."""
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "tap.yaml").write_text(TAP + VARY, encoding="utf-8")
    given = ("--worlds", "4", "--seed", "3", "--jobs", "1", "--keep", "2", "--out", folder / "made")
    call("sweep", folder / "tap.yaml", *given)
    assert left(folder / "made/worlds") == ["000002"]
    return folder / "made"


def test_worlds_of_a_sweep_are_run_again(swept: Path, tmp_path: Path) -> None:
    done = call("export", swept, "--lerobot", tmp_path / "made")
    assert done.exit_code == 0
    rows, table = episodes(tmp_path / "made"), read_table(swept / "worlds.parquet").to_pylist()
    assert [row["taskspec/run"] for row in rows] == [f"made/{i}" for i in range(4)]
    assert f"4 episodes, {sum(row['success'] for row in table)} good" in done.output
    for number, (row, world) in enumerate(zip(rows, table, strict=True)):
        assert row["taskspec/success"] == world["success"]
        assert (row["taskspec/seed"], row["taskspec/rows"]) == (3, world["ticks"])
        said = json.loads(row["taskspec/world"])
        assert said["draws"] == json.loads(world["draws"])
        again = tmp_path / f"world-{number}"
        file = swept.parent / "tap.yaml"
        call("run", file, "--seed", "3", "--world", str(number), "--out", again, "--no-report")
        log = pq.read_table(tmp_path / "made" / row["taskspec/log"])
        for name, values in Run(again).history.columns.items():
            assert np.array_equal(log[name].to_numpy(), values, equal_nan=True), name
    assert len({row["taskspec/world"] for row in rows}) == 4
    assert left(swept / "worlds") == ["000002"]


def test_a_world_that_broke_is_left_out(
    swept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result, read = source.read_result(swept)
    rows = tuple({**row, "status": BROKEN} if i == 1 else row for i, row in enumerate(result.rows))
    changed = type(result)(result.task, result.path, rows, result.summary)
    monkeypatch.setattr(source, "read_result", lambda _: (changed, read))
    done = call("export", swept, "--lerobot", tmp_path / "made")
    assert done.exit_code == 0
    assert f"without the worlds of {swept} that broke: 1" in done.output
    assert [row["taskspec/run"] for row in episodes(tmp_path / "made")] == [
        "made/0", "made/2", "made/3",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("versions", lambda: {"mujoco": "0.1"}, "mujoco 0.1, not"),
        ("inputs", lambda _: {"robot.xml": "0"}, "has changed"),
    ],
)
def test_worlds_that_would_be_others_are_refused(
    swept: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    value: Any,
    message: str,
) -> None:
    monkeypatch.setattr(source, name, value)
    with pytest.raises(InputError, match=message):
        source_of(swept)
    assert not left(tmp_path)


def test_a_world_that_comes_out_otherwise_is_an_error(swept: Path, tmp_path: Path) -> None:
    found = SweptRuns.of(swept)
    rows = ({**found.rows[0], "ticks": 3}, *found.rows[1:])
    found = SweptRuns(found.path, found.program, found.worlds, rows, "")
    with pytest.raises(InputError, match=r"world 0 of .* and to 3 in the sweep"):
        export_dataset([found], tmp_path / "made")
    assert not left(tmp_path)


# runs that are not whole, or from elsewhere


def test_a_run_that_was_stopped_is_an_episode_without_success(tmp_path: Path) -> None:
    text = TAP.replace("params:", "limits: {force: 2 N}\nparams:")
    run = Run(made(text, tmp_path / "run"))
    assert run.verdict == "stopped"
    export_dataset([source_of(run.folder)], tmp_path / "made")
    found, [row] = frames(tmp_path / "made"), episodes(tmp_path / "made")
    assert row["taskspec/status"] == "stopped"
    assert not found["next.success"].any()
    assert found["next.done"].sum() == 1
    # The arm is brought to rest after the run, which no frame shows and the log has.
    assert row["taskspec/rows"] == len(run)
    assert pq.read_metadata(tmp_path / "made" / row["taskspec/log"]).num_rows > len(run)


def test_a_damaged_run_is_reported(tap: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(tap, tmp_path / "copy")
    (copy / "summary.json").write_text("{}", encoding="utf-8")
    done = call("export", copy, "--lerobot", tmp_path / "made")
    assert done.exit_code == 1
    assert "summary.json" in done.output
    [row] = episodes(tmp_path / "made")
    assert (row["taskspec/verdict"], row["taskspec/success"]) == ("damaged", False)


def test_a_recorded_log_is_an_episode(tap: Path, tmp_path: Path) -> None:
    call("export", tap, tmp_path / "log.csv", "--csv")
    loaded = load_text(TAP, "tap.yaml")
    judged = judge_recording(loaded, tmp_path / "log.csv", out=tmp_path / "judged")
    export_dataset([source_of(tap)], tmp_path / "own")
    export_dataset([source_of(judged.folder)], tmp_path / "recorded")
    own, found = frames(tmp_path / "own"), frames(tmp_path / "recorded")
    for name, values in own.items():
        # A CSV has the shortest text of each number.
        assert (found[name] == values).all(), name


def test_a_recorded_log_without_a_signal_names_it(tap: Path, tmp_path: Path) -> None:
    call("export", tap, tmp_path / "log.csv", "--csv")
    lines = (tmp_path / "log.csv").read_text().splitlines()
    at = lines[0].split(",").index("joint.2.velocity [rad/s]")
    cut = [",".join(c for i, c in enumerate(line.split(",")) if i != at) for line in lines]
    (tmp_path / "cut.csv").write_text("\n".join(cut) + "\n")
    loaded = load_text(TAP, "tap.yaml")
    judged = judge_recording(loaded, tmp_path / "cut.csv", out=tmp_path / "judged")
    done = call("export", judged.folder, "--lerobot", tmp_path / "made")
    assert done.exit_code == 2
    assert "joint.2.velocity was not recorded" in done.output
    assert left(tmp_path) == ["cut.csv", "judged", "log.csv"]


# errors, after which nothing is left


def test_runs_of_different_robots_are_no_dataset(tap: Path, drum: Path, tmp_path: Path) -> None:
    done = call("export", tap, drum, "--lerobot", tmp_path / "made")
    assert done.exit_code == 2
    assert "drum is a run of panda with 7 joints at 1000 Hz, tap of planar2 with 2" in done.output
    assert not left(tmp_path)


def test_runs_of_different_rates_are_no_dataset(tap: Path, tmp_path: Path) -> None:
    slow = made(TAP + "control: {rate: 500 Hz}\n", tmp_path / "slow")
    done = call("export", tap, slow, "--lerobot", tmp_path / "made")
    assert done.exit_code == 2
    assert "at 500 Hz" in done.output
    assert left(tmp_path) == ["slow"]


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("{tap}", "--lerobot", "{new}", "--fps", "2000"), "give --fps 1000 or less"),
        (("{tap}", "--lerobot", "{new}", "--fps", "0"), "--fps"),
        (("{tap}", "--lerobot", "{new}", "--csv"), "--csv is of the log of one run"),
        (("{tap}", "--lerobot", "{new}", "--from", "0.1"), "--from is of the log of one run"),
        (("{tap}", "--lerobot", "{new}", "--c", "{new}"), "name one of"),
        (("{tap}", "--lerobot", "{new}", "--set", "press=3N"), "--set is of a task file"),
        (("{tap}", "--lerobot", "{new}", "--size", "96x96"), "name a camera"),
        (("{tap}", "--lerobot", "{new}", "--camera", "top"), "--camera needs auto, or azimuth"),
        (("{tap}", "--lerobot", "{new}", "--camera", "auto", "--size", "9x9"), "--size needs"),
        (("{tap}", "--csv", "--fps", "20"), "--fps is of a dataset"),
        (("{tap}", "{new}", "{new}", "--csv"), "one path too many"),
        (("{new}", "--lerobot", "{new}"), "not the folder of a run"),
        (("{tap}",), "--lerobot"),
    ],
)
def test_bad_words_are_refused(
    tap: Path, tmp_path: Path, args: tuple[str, ...], message: str
) -> None:
    given = [each.format(tap=tap, new=tmp_path / "new") for each in args]
    done = call("export", *given)
    assert done.exit_code == 2
    assert message in " ".join(done.output.replace("│", " ").split())
    assert not left(tmp_path)


def test_nothing_is_written_over(tap: Path, tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full/notes.txt").write_text("mine")
    done = call("export", tap, "--lerobot", tmp_path / "full")
    assert done.exit_code == 2
    assert "the folder is not empty; name a new one" in done.output
    assert left(tmp_path / "full") == ["notes.txt"]
    (tmp_path / "file").write_text("mine")
    with pytest.raises(OutputError, match="Not a directory"):
        export_dataset([source_of(tap)], tmp_path / "file")
    assert left(tmp_path) == ["file", "full"]


def test_who_breaks_off_leaves_nothing(tap: Path, tmp_path: Path) -> None:
    held: list[str] = []

    def watch(_: Run, done: int, of: int) -> None:
        held.extend(left(tmp_path))
        assert (done, of) == (1, 2)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_dataset([source_of(tap), source_of(tap)], tmp_path / "made", watch=watch)
    [name] = held
    assert name.startswith(PARTIAL)
    assert not left(tmp_path)


def test_an_empty_folder_is_taken(tap: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    done = call("export", tap, "--lerobot", tmp_path / "empty")
    assert done.exit_code == 0
    assert (tmp_path / "empty/meta/info.json").is_file()
    assert f'root="{tmp_path / "empty"}"' in done.output
    assert not any(name.startswith(PARTIAL) for name in left(tmp_path))


def test_a_run_without_a_tick_is_refused(tap: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(tap, tmp_path / "copy")
    (copy / "log.arrow").unlink()
    done = call("export", copy, "--lerobot", tmp_path / "made")
    assert done.exit_code == 2
    assert "holds no tick" in done.output
    assert left(tmp_path) == ["copy"]


def test_a_run_without_its_task_is_refused(tap: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(tap, tmp_path / "copy")
    (copy / "task.yaml").unlink()
    done = call("export", copy, "--lerobot", tmp_path / "made")
    assert done.exit_code == 2
    assert "cannot be an episode: its task" in done.output


# pictures


def test_the_camera_films_every_frame(
    tap: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    try:
        new_context(64, 64).free()
    except NoCanvasError as error:
        pytest.skip(str(error))
    imageio = pytest.importorskip("imageio_ffmpeg")
    given = ("--camera", "90,-20,1.5", "--size", "96x64", "--fps", "20")
    done = call("export", tap, tap, "--lerobot", tmp_path / "made", *given)
    assert done.exit_code == 0
    rows, info = (
        episodes(tmp_path / "made"),
        json.loads((tmp_path / "made/meta/info.json").read_text()),
    )
    key = "observation.images.camera"
    assert info["features"][key]["shape"] == [64, 96, 3]
    assert info["features"][key]["info"]["video.codec"] == "h264"
    pictures = []
    for number, row in enumerate(rows):
        assert row[f"videos/{key}/file_index"] == number
        assert row[f"videos/{key}/to_timestamp"] == pytest.approx(row["length"] / 20)
        where = {"chunk_index": 0, "file_index": number}
        path = tmp_path / "made" / info["video_path"].format(video_key=key, **where)
        raw = subprocess.run(
            [imageio.get_ffmpeg_exe(), "-v", "error", "-i", str(path), "-f", "rawvideo",
             "-pix_fmt", "rgb24", "-"],
            check=True, capture_output=True,
        ).stdout  # fmt: skip
        shown = np.frombuffer(raw, dtype=np.uint8).reshape(-1, 64, 96, 3)
        assert len(shown) == row["length"]
        pictures.append(shown)
    # The same run from the same place; the arm moves.
    assert (pictures[0] == pictures[1]).all()
    assert (pictures[0][0] != pictures[0][-1]).any()
    said = json.loads((tmp_path / "made/meta/stats.json").read_text())[key]
    # What is coded differs by some levels from what was drawn.
    mean = pictures[0].reshape(-1, 3).mean(0) / 255
    assert np.array(said["mean"]).ravel() == pytest.approx(mean, abs=0.02)
    assert np.array(said["std"]).min() > 0.01
    assert said["count"] == [len(pictures[0]) * 2]
