"""Datasets as LeRobot itself reads them; `make lerobot` brings the package, which is large."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import imageio_ffmpeg
import numpy as np
import pyarrow.parquet as pq
import pytest
from short_tasks import DRUM, TAP, UNFOLD

from taskspec.spec import load_text
from taskspec_runner.dataset import export_dataset
from taskspec_runner.dataset.camera import Camera
from taskspec_runner.dataset.source import source_of
from taskspec_runner.session import execute
from taskspec_runner.video.canvas import NoCanvasError

lerobot = pytest.importorskip("lerobot", reason="`make lerobot` runs this")
pytestmark = pytest.mark.filterwarnings("ignore")

KEY = "observation.images.camera"


@pytest.fixture(autouse=True)
def offline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A run that passes, one that misses."""
    path = tmp_path_factory.mktemp("runs")
    missing = TAP.replace("last(hold.force.x) within press", "last(hold.force.x) within 9 N")
    texts = {"tap": TAP, "missing": missing.replace("name: tap", "name: miss")}
    for name, text in texts.items():
        execute(load_text(text, "task.yaml"), path / name, report=False)
    return [path / name for name in texts]


@pytest.fixture(scope="module")
def path(folders: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of three episodes."""
    made = tmp_path_factory.mktemp("datasets") / "made"
    export_dataset([source_of(each) for each in (*folders, folders[0])], made)
    return made


def opened(path: Path, **given: Any) -> Any:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    return LeRobotDataset("local/made", root=path, **given)


def frames(path: Path) -> Any:
    return pq.read_table(path / "data/chunk-000/file-000.parquet")


def numbers(table: Any, name: str) -> Any:
    return np.array(table.column(name).to_pylist())


def test_every_number_is_what_was_written(path: Path) -> None:
    data, table = opened(path), frames(path)
    assert len(data) == data.num_frames == table.num_rows
    assert (data.num_episodes, data.fps, data.meta.robot_type) == (3, 30, "planar2")
    names = [name for name in table.column_names if name != "stage"]
    assert len(names) == 11
    columns = {name: numbers(table, name) for name in (*names, "stage")}
    for index in range(len(data)):
        item = data[index]
        for name in names:
            assert (np.asarray(item[name]) == columns[name][index]).all(), name
        assert item["stage"] == columns["stage"][index]
        assert item["task"] == "Touch a wall and press on it for a moment."
    assert tuple(data[0]["observation.wrench"].shape) == (34, 6)


def test_windows_over_frames_end_with_their_episodes(path: Path) -> None:
    steps = {"action": [0.0, 1 / 30, 2 / 30], "observation.wrench": [-1 / 30, 0.0]}
    data, table = opened(path, delta_timestamps=steps), frames(path)
    actions, wrenches = numbers(table, "action"), numbers(table, "observation.wrench")
    episode = numbers(table, "episode_index")
    padded = 0
    for index in range(len(data)):
        item = data[index]
        assert tuple(item["observation.wrench"].shape) == (2, 34, 6)
        within = np.flatnonzero(episode == episode[index])
        wanted = np.clip(index + np.arange(3), within[0], within[-1])
        assert (item["action"].numpy() == actions[wanted]).all()
        assert (item["action_is_pad"].numpy() == (index + np.arange(3) > within[-1])).all()
        before = max(index - 1, within[0])
        assert (item["observation.wrench"].numpy() == wrenches[[before, index]]).all()
        padded += int(item["action_is_pad"].sum())
    # Two frames at the end of each episode lack one, and two.
    assert padded == 3 * 3


def test_statistics_and_episodes_are_read(path: Path) -> None:
    data = opened(path)
    for name, size in (("observation.state", 19), ("action", 15), ("observation.wrench", 6)):
        assert data.meta.stats[name]["mean"].shape == (size,)
        values = numbers(frames(path), name).reshape(-1, size).astype(float)
        assert data.meta.stats[name]["std"] == pytest.approx(values.std(0), rel=1e-9)
    said = [data.meta.episodes[i] for i in range(3)]
    assert [each["taskspec/success"] for each in said] == [True, False, True]
    assert all((path / each["taskspec/log"]).is_file() for each in said)


def test_episodes_are_chosen(path: Path) -> None:
    every = opened(path).meta.episodes
    missed = [each["episode_index"] for each in every if not each["taskspec/success"]]
    data = opened(path, episodes=missed)
    assert data.num_episodes == 1
    assert {int(data[i]["episode_index"]) for i in range(len(data))} == {1}
    assert not any(bool(data[i]["next.success"]) for i in range(len(data)))


def test_batches_are_made_of_it(path: Path) -> None:
    import torch

    loader = torch.utils.data.DataLoader(opened(path), batch_size=8, shuffle=True)
    batch = next(iter(loader))
    assert tuple(batch["observation.wrench"].shape) == (8, 34, 6)
    assert len(batch["task"]) == len(batch["stage"]) == 8


def test_a_policy_takes_its_features(path: Path) -> None:
    try:
        from lerobot.utils.feature_utils import dataset_to_policy_features
    except ImportError:
        from lerobot.datasets.utils import dataset_to_policy_features

    found = dataset_to_policy_features(opened(path).meta.features)
    kinds = {name: each.type.value for name, each in found.items()}
    assert kinds == {"observation.state": "STATE", "observation.wrench": "STATE",
                     "action": "ACTION"}  # fmt: skip


def test_datasets_are_merged_by_lerobot(path: Path, folders: list[Path], tmp_path: Path) -> None:
    from lerobot.datasets.dataset_tools import merge_datasets

    export_dataset([source_of(folders[0])], tmp_path / "other")
    parts = [opened(path), opened(tmp_path / "other")]
    merged = merge_datasets(parts, "local/merged", output_dir=tmp_path / "merged")
    assert merged.num_episodes == 4
    assert len(merged) == sum(map(len, parts))
    last = merged[len(merged) - 1]
    assert bool(last["next.success"])
    assert last["task"] == "Touch a wall and press on it for a moment."


def test_frames_of_a_camera_are_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    execute(load_text(UNFOLD, "task.yaml"), tmp_path / "run", report=False)
    made, run = tmp_path / "made", tmp_path / "run"
    try:
        export_dataset([source_of(run), source_of(run)], made, 20, Camera(96, 64))
    except NoCanvasError as error:
        pytest.skip(str(error))
    data = opened(made, video_backend="pyav")
    assert data.meta.video_keys == [KEY]
    pictures = np.stack([data[i][KEY].numpy() for i in range(len(data))])
    assert pictures.shape == (len(data), 3, 64, 96)
    mean = data.meta.stats[KEY]["mean"]
    assert mean.shape == (3, 1, 1)
    # What is coded differs by some levels from what was drawn.
    assert pictures.mean(axis=(0, 2, 3)) == pytest.approx(mean.ravel(), abs=0.02)
    # Both episodes have every picture at its place: none is another's of the same video.
    count = len(data) // 2
    assert (pictures[:count] == pictures[count:]).all()
    video = made / "videos" / KEY / "chunk-000/file-000.mp4"
    one_by_one = decoded(video).transpose(0, 3, 1, 2) / 255
    assert len(one_by_one) == count
    far = np.abs(pictures[:count, np.newaxis] - one_by_one[np.newaxis]).mean(axis=(2, 3, 4))
    # Two decoders round colours differently.
    assert far.diagonal() == pytest.approx(far.min(axis=1), abs=1e-9)
    assert far.diagonal().max() < 2 / 255
    assert far.max() > 2 * far.diagonal().max()


def decoded(path: Path) -> Any:
    """(n, 64, 96, 3) the pictures of a video from its beginning to its end."""
    program = imageio_ffmpeg.get_ffmpeg_exe()
    command = [program, "-v", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, check=True, capture_output=True).stdout
    return np.frombuffer(raw, dtype=np.uint8).reshape(-1, 64, 96, 3)


def test_an_arm_of_seven_joints_is_read(tmp_path: Path) -> None:
    execute(load_text(DRUM, "task.yaml"), tmp_path / "run", report=False)
    export_dataset([source_of(tmp_path / "run")], tmp_path / "made", 50)
    data = opened(tmp_path / "made")
    assert tuple(data[3]["observation.state"].shape) == (29,)
    assert tuple(data[3]["observation.wrench"].shape) == (20, 6)
