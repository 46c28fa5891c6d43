"""Logs for other tools: what was written is read back by the libraries that those tools use."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections import defaultdict
from contextlib import closing
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from short_tasks import DRUM, TAP
from typer.testing import CliRunner, Result

from taskspec.spec import load_task, load_text
from taskspec_runner import runs
from taskspec_runner.cli import app
from taskspec_runner.errors import InputError
from taskspec_runner.export import MissingLibraryError, export_run
from taskspec_runner.export.cdr import MessageForm
from taskspec_runner.export.poses import PoseStream
from taskspec_runner.record.history import history_of
from taskspec_runner.record.log import Log, read_log
from taskspec_runner.recorded.source import read_parquet
from taskspec_runner.runs import Run
from taskspec_runner.session import execute
from taskspec_runner.verdict.replay import Replay

SHIPPED = Path(__file__).resolve().parent.parent.parent / "tasks"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of a task with a planar arm."""
    out = tmp_path_factory.mktemp("tap") / "run"
    execute(load_text(TAP, "tap.yaml"), out, report=False)
    return out


@pytest.fixture(scope="module")
def drum(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run in three kinds of frames, one of them turning along."""
    out = tmp_path_factory.mktemp("drum") / "run"
    execute(load_text(DRUM, "drum.yaml"), out, report=False)
    return out


def call(*args: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    assert "Traceback" not in result.output
    return result


def messages(path: Path) -> dict[str, list[Any]]:
    found = defaultdict(list)
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            found[channel.topic].append((message.log_time, decoded))
    return found


# tables


def test_csv_has_units_in_its_header_and_every_number(folder: Path, tmp_path: Path) -> None:
    done = export_run(Run(folder), "csv", tmp_path / "out.csv")
    history = read_log(folder / "log.arrow")
    with done.path.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert {"clock [s]", "stage", "force.x [N]", "joint.1.torque [N*m]", "touching"} <= set(header)
    assert '"' not in done.path.read_text(encoding="utf-8")
    # The last line is no tick: it says when the run ended, and that it came to `end`.
    *rows, last = rows
    ended = dict(zip(header, last, strict=True))
    assert {name: text for name, text in ended.items() if text} == {
        "clock [s]": f"{done.extent.until:.12g}", "stage": "end",
    }  # fmt: skip
    assert len(rows) == len(history) == done.extent.ticks
    columns = dict(zip(header, zip(*rows, strict=True), strict=True))
    assert columns["stage"] == tuple(history.stages)
    for name, values in history.columns.items():
        unit = history.units[name]
        texts = columns[f"{name} [{unit}]" if unit else name]
        assert [t == "" for t in texts] == np.isnan(values).tolist(), name
        # Every digit is written, so that a number comes back as it was.
        assert [float(t) for t in texts if t] == values[~np.isnan(values)].tolist(), name


def test_parquet_is_the_log_with_units_and_what_is_known_of_the_run(
    folder: Path, tmp_path: Path
) -> None:
    table = pq.read_table(export_run(Run(folder), "parquet", tmp_path / "out.parquet").path)
    with (folder / "log.arrow").open("rb") as file:
        log = pa.ipc.open_stream(file).read_all()
    assert table.column_names == log.column_names
    assert table.schema.field("force.x").metadata[b"unit"] == b"N"
    for name in log.column_names:
        if name == "stage":
            assert table[name].to_pylist() == log[name].to_pylist()
        else:
            np.testing.assert_array_equal(table[name].to_numpy(), log[name].to_numpy())
    said = pq.read_metadata(tmp_path / "out.parquet").metadata
    assert said[b"taskspec.task"] == b"tap"
    assert (said[b"taskspec.partial"], said[b"taskspec.ticks"]) == (b"false", b"%d" % len(table))


def test_flipped_bits_of_a_parquet_export_are_found(folder: Path, tmp_path: Path) -> None:
    """Parts that no checksum covers, such as statistics, hold nothing that is read."""
    path = export_run(Run(folder), "parquet", tmp_path / "out.parquet").path
    content, found = path.read_bytes(), 0

    def read() -> tuple[dict[str, str], list[bytes]]:
        table = read_parquet(path)
        names = [name for name in table.units if name != "stage"]
        numbers = table.numbers(names)
        return dict(table.units), [numbers[name].tobytes() for name in names]

    whole, drawn = read(), np.random.default_rng(2).integers(0, 8 * len(content), 400)
    for bit in drawn.tolist():
        spoiled = bytearray(content)
        spoiled[bit // 8] ^= 1 << bit % 8
        path.write_bytes(spoiled)
        try:
            assert read() == whole, bit
        except InputError:
            found += 1
    assert found > 300


_MEMORY = """
import sys, resource
from pathlib import Path
import pyarrow as pa
from taskspec_runner import runs
from taskspec_runner.export import export_run
from taskspec_runner.runs import Run
runs.ROWS = 1000
def now():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
export_run(Run(Path(sys.argv[1])), sys.argv[3])
before = now()
export_run(Run(Path(sys.argv[2])), sys.argv[3])
print(now() - before)
"""


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """2000 and 40 000 ticks of 60 columns: the log of the second has 19 MB."""
    folder = tmp_path_factory.mktemp("logs")
    for name, batches in (("short", 4), ("long", 80)):
        _write_log(folder / name, batches)
    return folder / "short", folder / "long"


@pytest.mark.parametrize("form", ["csv", "parquet", "mcap"])
def test_memory_does_not_grow_with_the_log(logs: tuple[Path, Path], form: str) -> None:
    command = [sys.executable, "-c", _MEMORY, *logs, form]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    # Two chunks of 1000 rows are in memory at a time: 1 MB, both of them. In one chunk it grows by
    # 58 to 91 MB.
    assert int(done.stdout) < 6_000  # kB


def _write_log(folder: Path, batches: int) -> None:
    folder.mkdir()
    joint = [f"joint.1.{kind}" for kind in ("position", "velocity", "torque")]
    names = ["clock", "t", *joint, *(f"object.s{i}" for i in range(55))]
    fields = [pa.field(name, pa.float64(), metadata={"unit": "s"}) for name in names]
    schema = pa.schema([*fields, pa.field("stage", pa.dictionary(pa.int32(), pa.string()))])
    random = np.random.default_rng(0)
    stages = pa.DictionaryArray.from_arrays(pa.array(np.zeros(500, dtype=np.int32)), ["only"])
    with closing(Log(folder / "log.arrow", keep=False)) as writer:
        for number in range(batches):
            clock = 1e-3 * (500 * number + np.arange(500))
            columns = [clock, clock, *(random.random(500) for _ in names[2:])]
            writer.write(pa.record_batch([*columns, stages], schema=schema))


# MCAP


def test_mcap_has_joints_wrench_and_scalars_of_every_tick(folder: Path, tmp_path: Path) -> None:
    found = messages(export_run(Run(folder), "mcap", tmp_path / "out.mcap").path)
    history = read_log(folder / "log.arrow")
    columns = history.columns
    assert set(found) == {
        "/joint_states", "/wrench", "/wrench_measured", "/signals", "/stage", "/tool",
        "/task_frame", "/tf", "/tf_static", "/robot_description", "/world", "/forces",
    }  # fmt: skip
    times = np.round(1e9 * columns["clock"]).astype(int).tolist()
    for topic in ("/joint_states", "/wrench", "/wrench_measured", "/signals", "/tool"):
        assert [time for time, _ in found[topic]] == times, topic
        stamps = [m.header.stamp for _, m in found[topic]]
        assert [10**9 * s.sec + s.nanosec for s in stamps] == times, topic
    for row, (_, joints) in enumerate(found["/joint_states"]):
        assert joints.name == json.loads((folder / "summary.json").read_text())["robot"]["joints"]
        kinds = {"position": joints.position, "velocity": joints.velocity, "torque": joints.effort}
        for kind, values in kinds.items():
            assert values == [columns[f"joint.{i + 1}.{kind}"][row] for i in range(2)]
    for topic, suffix in (("/wrench", ""), ("/wrench_measured", ".measured")):
        for row, (_, message) in enumerate(found[topic]):
            force, torque = message.wrench.force, message.wrench.torque
            assert message.header.frame_id == "control_point"
            assert force.x == columns[f"force.x{suffix}"][row]
            assert torque.z == 0  # a planar arm with two joints feels no moment of its own
            assert force.y == columns[f"force.y{suffix}"][row]
    last = found["/signals"][-1][1]
    assert last.force.x == columns["force.x"][-1]
    assert last.force.x_ref == columns["force.x.ref"][-1] == 5.0
    assert np.isnan(last.force.y_ref)
    assert last.gap == columns["gap"][-1]
    assert last.wall.gap == columns["wall.gap"][-1]
    assert last.stage == "hold"
    assert [m.data for _, m in found["/stage"]] == ["approach", "hold"]


def test_mcap_states_units_and_carries_task_and_summary(folder: Path, tmp_path: Path) -> None:
    path = export_run(Run(folder), "mcap", tmp_path / "out.mcap").path
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        assert summary is not None
        signals = next(c for c in summary.channels.values() if c.topic == "/signals")
        units = json.loads(signals.metadata["units"])
        assert (units["force.x"], units["force.x_ref"], units["wall.gap"]) == ("N", "N", "m")
        schema = summary.schemas[signals.schema_id]
        assert schema.encoding == "ros2msg"
        assert b"float64 x  # [N]\n" in schema.data
        attached = {a.name: a.data for a in reader.iter_attachments()}
        assert attached["task.yaml"] == (folder / "task.yaml").read_bytes()
        told = next(m.metadata for m in reader.iter_metadata() if m.name == "taskspec")
        assert (told["taskspec.status"], told["taskspec.partial"]) == ("done", "false")
        # In the file itself, too, time never runs backwards: readers need not sort.
        order = [m.log_time for _, _, m in reader.iter_messages(log_time_order=False)]
    assert order == sorted(order)


def test_mcap_knows_where_tool_and_task_frame_are(drum: Path, tmp_path: Path) -> None:
    found = messages(export_run(Run(drum), "mcap", tmp_path / "out.mcap").path)
    program, history = Run(drum).program, read_log(drum / "log.arrow")
    replay = Replay(program.context.robot, program.context.frames, program.stages, history)
    tilt = replay.signal("tilt", None, "skin")
    for row in range(0, len(history), 50):
        tool, frame = (found[topic][row][1].pose for topic in ("/tool", "/task_frame"))
        if history.stages[row] != "follow":
            continue
        # The foot is on the drum below the tool, and z points from the one to the other.
        away = np.array([tool.position.x, tool.position.y, tool.position.z]) - np.array(
            [frame.position.x, frame.position.y, frame.position.z]
        )
        w, x, y, z = (getattr(frame.orientation, name) for name in "wxyz")
        normal = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        radius = np.hypot(frame.position.y, frame.position.z - 0.25)
        assert radius == pytest.approx(0.15, abs=1e-9)
        assert np.linalg.norm(normal) == pytest.approx(1, abs=1e-12)
        a, b, c, d = (getattr(tool.orientation, name) for name in "wxyz")
        axis = np.array([2 * (b * d + a * c), 2 * (c * d - a * b), 1 - 2 * (b * b + c * c)])
        # arccos loses half of the digits where the tool stands on the normal.
        assert np.arccos(np.clip(-axis @ normal, -1, 1)) == pytest.approx(tilt[row], abs=1e-7)
        # What is between them: the gap along z, and the tool's lean over its radius.
        assert abs(away @ normal - history.columns["drum.gap"][row]) < 1e-3
    children = [[t.child_frame_id for t in m.transforms] for _, m in found["/tf"]]
    posed = [each for each in children if "tool" in each]
    assert posed == [["tool", "task", "control_point"]] * len(history)


@pytest.mark.parametrize("task", ["drum", "unknown-normal", "contour-unknown"])
def test_poses_do_not_depend_on_the_chunks(
    task: str, drum: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = drum
    if task != "drum":
        folder = tmp_path / "run"
        execute(load_task(SHIPPED / f"{task}.yaml"), folder, report=False)
    program, found = Run(folder).program, []
    for rows in (500, 10_000_000):
        monkeypatch.setattr(runs, "ROWS", rows)
        stream = PoseStream(program)
        parts = [stream.add(history_of(batch)) for batch in Run(folder).batches()]
        assert (len(parts) > 1) == (rows == 500)
        found.append([np.vstack([np.hstack([p[i].places, p[i].turns]) for p in parts])
                      for i in (0, 1, 2)])  # fmt: skip
    for chunked, whole in zip(*found, strict=True):
        np.testing.assert_array_equal(chunked, whole)


def test_run_whose_task_is_gone_is_exported_without_poses(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    copy.mkdir()
    for name in ("log.arrow", "manifest.json"):
        (copy / name).write_bytes((folder / name).read_bytes())
    result = call("export", copy, "--mcap")
    assert result.exit_code == 1
    assert "task.yaml is missing" in result.stderr
    assert "without arm, world, and the poses of tool and task frame" in result.stderr
    assert not (copy / "log.foxglove.json").exists()
    assert "/tf" not in messages(copy / "log.mcap")


def test_cdr_aligns_numbers_behind_texts_of_any_length() -> None:
    for text in ("", "a", "abc", "abcd", "abcdefgh"):
        layout = MessageForm().text(text).numbers(1)
        made = np.frombuffer(layout.template, dtype=np.uint8)[np.newaxis].copy()
        layout.fill(made, [np.array([[1.5]])])
        message = made.tobytes()
        end = 4 + len(text) + 1
        padding = -end % 8
        assert message[:4] == b"\x00\x01\x00\x00"
        assert message[8 : 8 + len(text) + 1] == text.encode() + b"\x00"
        assert message[4 + end + padding :] == np.float64(1.5).tobytes()


# what is optional


def test_missing_library_is_told_with_the_command(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for form, module in (("mcap", "mcap.records"), ("rerun", "rerun")):
        monkeypatch.setitem(sys.modules, module, None)
        path = tmp_path / f"out.{form}"
        result = call("export", folder, path, f"--{form}")
        assert result.exit_code == 2
        assert f"pip install 'taskspec-robotics[{form}]'" in result.stderr
        assert not list(tmp_path.iterdir())
    with pytest.raises(MissingLibraryError):
        export_run(Run(folder), "mcap", tmp_path / "out.mcap")


def test_tables_need_no_further_library(folder: Path, tmp_path: Path) -> None:
    code = (
        "import sys; sys.modules['mcap'] = sys.modules['rerun'] = None\n"
        "from taskspec_runner.cli import main; main()"
    )
    command = [sys.executable, "-c", code, "export", folder, tmp_path / "log.csv", "--csv"]
    assert subprocess.run(command, capture_output=True, check=False).returncode == 0


class _Recording:
    """What is asked of Rerun, noted."""

    def __init__(self, name: str, **_: object) -> None:
        self.name, self.sent, self.logged = name, [], []
        _RECORDINGS.append(self)

    def save(self, path: str, default_blueprint: Any) -> None:
        Path(path).write_bytes(b"RRF2")
        self.panels = default_blueprint

    def log(self, entity: str, *what: Any, **_: object) -> None:
        self.logged += [(entity, each) for each in what]

    def set_time(self, timeline: str, **_: object) -> None:
        assert timeline == "clock"

    def send_columns(self, entity: str, indexes: Any, columns: Any) -> None:
        self.sent.append((entity, indexes, columns))

    def disconnect(self) -> None:
        pass


_RECORDINGS: list[_Recording] = []


class _Archetype:
    RIGHT_HAND_Z_UP = "right-handed, z up"

    def __init__(self, *parts: object, **fields: object) -> None:
        self.parts, self.fields = parts, fields

    @staticmethod
    def columns(**columns: Any) -> dict[str, Any]:
        return columns

    @classmethod
    def from_fields(cls, **fields: object) -> _Archetype:
        return cls(**fields)


_ARCHETYPES = (
    "Scalars", "SeriesLines", "TextLog", "Transform3D", "ViewCoordinates", "Quaternion",
    "Boxes3D", "Ellipsoids3D", "Cylinders3D", "Mesh3D", "Arrows3D", "LineStrips3D",
)  # fmt: skip
_VIEWS = (
    "TimeSeriesView", "TextLogView", "Spatial3DView", "Vertical", "Horizontal", "Blueprint",
)  # fmt: skip


def test_rerun_gets_every_column(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The library has 500 MB; what it is asked for was tried with version 0.41.
    rerun = ModuleType("rerun")
    rerun.blueprint = ModuleType("rerun.blueprint")  # type: ignore[attr-defined]
    for module, names in ((rerun, _ARCHETYPES), (rerun.blueprint, _VIEWS)):
        for name in names:
            setattr(module, name, type(name, (_Archetype,), {}))
    rerun.new_entity_path = "/".join  # type: ignore[attr-defined]
    rerun.RecordingStream = _Recording  # type: ignore[attr-defined]
    rerun.TimeColumn = lambda name, duration: (name, duration)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "rerun", rerun)
    assert export_run(Run(folder), "rerun", tmp_path / "out.rrd").path.is_file()
    columns = read_log(folder / "log.arrow").columns
    sent = {entity: columns for entity, _, columns in _RECORDINGS[-1].sent}
    np.testing.assert_array_equal(sent["signals/force/x/ref"]["scalars"], columns["force.x.ref"])
    assert sent["world/tool"]["translation"].shape == (len(columns["clock"]), 3)
    assert {"world/task", "signals/wall/gap", "world/link1", "world/arrows/force"} <= set(sent)
    kinds = {type(what).__name__ for _, what in _RECORDINGS[-1].logged}
    assert {"Boxes3D", "Cylinders3D", "Transform3D", "LineStrips3D"} <= kinds
    (panels,) = _RECORDINGS[-1].panels.parts
    assert [type(part).__name__ for part in panels.parts] == ["Spatial3DView", "Vertical"]


# the command


def test_command_writes_beside_the_log_and_a_new_run_clears_it(tap: Path, tmp_path: Path) -> None:
    assert call("run", tap, "--out", tmp_path / "run", "--quiet").exit_code == 0
    result = call("export", tmp_path / "run", "--csv", "--mcap", "--parquet")
    assert result.exit_code == 0
    assert result.stderr == ""
    names = [f"log.{form}" for form in ("csv", "parquet", "mcap", "foxglove.json")]
    assert result.stdout.split() == [str(tmp_path / "run" / name) for name in names]
    assert call("run", tap, "--out", tmp_path / "run", "--quiet").exit_code == 0
    assert not any((tmp_path / "run" / name).exists() for name in names)


def test_command_says_what_it_cannot_do(folder: Path, tmp_path: Path) -> None:
    for args, said in (
        ((folder,), "name a format"),
        ((folder, tmp_path / "x", "--csv", "--mcap"), "can hold one format"),
        ((tmp_path, "--csv"), "not the folder of a run"),
        ((folder, tmp_path / "no" / "x.csv", "--csv"), "cannot write"),
    ):
        result = call("export", *args)
        assert result.exit_code == 2
        assert said in result.stderr


def test_damaged_log_is_told(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    copy.mkdir()
    for path in folder.iterdir():
        (copy / path.name).write_bytes(path.read_bytes())
    with (copy / "log.arrow").open("ab") as file:
        file.write(b"more")
    result = call("export", copy, "--csv")
    assert result.exit_code == 1
    assert "no evidence of the run" in result.stderr
