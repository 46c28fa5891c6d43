"""MCAP exports read back by the three readers of ROS 2 messages that people have in Python."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import mcap_ros2_support_fast.decoder as fast
import numpy as np
import pytest
from command_line import call
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

from taskspec.spec import load_task, load_text
from taskspec_runner.export import export_run
from taskspec_runner.export.messages import signals_message
from taskspec_runner.record.log import read_log
from taskspec_runner.recorded.messages import read_mcap
from taskspec_runner.runs import Run
from taskspec_runner.session import execute

SHIPPED = Path(__file__).resolve().parents[2] / "tasks"
#: Names that the language takes; those that ROS 2 would not, two that become one when mapped, and
#: words of ROS 2 and Python. The first one is pressed on.
NAMES = (
    "Table", "table", "tableTop", "table_", "my__table", "my_table", "A_1b", "A1b", "header",
    "stage_", "class", "None", "self", "data", "float64", "string", "X",
)  # fmt: skip
#: A field, and a message, of the ROS 2 interface definition.
FIELD = re.compile(r"(?!.*__)(?!.*_$)[a-z][a-z0-9_]*")
MESSAGE = re.compile(r"[A-Z][A-Za-z0-9]*")
NAMED = """\
taskspec: 1
name: names
robot: {{model: panda, start: {{xyz: [500 mm, 0, 301 mm]}}}}
world:
  {first}: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}
{others}
frames: {{task: {{surface: {first}}}}}
frame: task
stages:
  approach:
    axes: {{z: {{velocity: -20 mm/s}}}}
    until: force.z < -2 N
    within: {{time: 1 s}}
  press: {{axes: {{z: {{force: -10 N}}}}, time: 50 ms}}
expect:
  - press.{first}.gap < 1 mm
  - max(norm(force)) < 30 N
"""

Read = Callable[[Path], dict[str, list[tuple[int, Any]]]]


def _by(factory: Any) -> Read:
    def read(path: Path) -> dict[str, list[tuple[int, Any]]]:
        found = defaultdict(list)
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True, decoder_factories=[factory()])
            for _, channel, message, decoded in reader.iter_decoded_messages():
                found[channel.topic].append((message.log_time, decoded))
        return found

    return read


def _by_rosbags(path: Path) -> dict[str, list[tuple[int, Any]]]:
    found = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, time, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found[connection.topic].append((time, message))
    return found


READERS = {
    "mcap-ros2-support": _by(DecoderFactory),
    "mcap-ros2-support-fast": _by(fast.DecoderFactory),
    "rosbags": _by_rosbags,
}
readers = pytest.mark.parametrize("reader", READERS)


@pytest.fixture(scope="module")
def named(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run among objects of all names, with its export."""
    out = tmp_path_factory.mktemp("named") / "run"
    far = "{{shape: plane, xyz: [0, 0, {z} mm], stiffness: 20 kN/m}}"
    others = [f"  {name}: {far.format(z=-100 - i)}" for i, name in enumerate(NAMES[1:])]
    text = NAMED.format(
        first=NAMES[0], others="\n".join(others).replace("{{", "{").replace("}}", "}")
    )
    execute(load_text(text, "names.yaml"), out, report=False)
    export_run(Run(out), "mcap")
    return out


def _columns(path: Path) -> dict[str, str]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    (channel,) = (c for c in summary.channels.values() if c.topic == "/signals")
    found: dict[str, str] = json.loads(channel.metadata["columns"])
    return found


@readers
def test_every_column_is_read_whatever_its_name_is(named: Path, reader: str) -> None:
    found, history = READERS[reader](named / "log.mcap"), read_log(named / "log.arrow")
    columns = _columns(named / "log.mcap")
    assert {f"{name}.gap" for name in NAMES} <= set(columns.values())
    wanted = {n for n in history.columns if n != "clock" and not n.startswith("joint.")}
    assert set(columns.values()) == wanted
    assert len(found["/signals"]) == len(history) > 50
    for path, column in columns.items():
        values = []
        for _, message in found["/signals"]:
            for part in path.split("."):
                message = getattr(message, part)
            values.append(message)
        np.testing.assert_array_equal(values, history.columns[column], err_msg=column)
    assert [m.stage for _, m in found["/signals"]] == history.stages.tolist()
    topics = {"/joint_states", "/wrench", "/wrench_measured", "/stage", "/tool", "/tf"}
    assert topics <= found.keys()


def test_fields_and_messages_are_those_of_ros_and_all_different(named: Path) -> None:
    columns = _columns(named / "log.mcap")
    assert all(FIELD.fullmatch(part) for path in columns for part in path.split("."))
    # A name that is legal keeps its field, also beside others that would like to have it.
    assert columns["table.gap"] == "table.gap"
    assert columns["my_table.gap"] == "my_table.gap"
    assert columns["table_top.gap"] == "tableTop.gap"
    with (named / "log.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    (schema,) = (s for s in summary.schemas.values() if s.name == "taskspec_msgs/msg/Signals")
    kinds = re.findall(r"^MSG: taskspec_msgs/(\w+)$", schema.data.decode(), re.MULTILINE)
    assert len(kinds) == len(set(kinds)) >= len(NAMES)
    assert all(MESSAGE.fullmatch(kind) for kind in kinds)


def test_columns_that_would_share_a_field_do_not() -> None:
    # Of a part of an object and of an object whose name has a line at the same place.
    names = ("a.b_c", "a.b.c", "gap", "gap.tilt", "force.z.ref", "force.z_ref")
    columns = signals_message(names, {}).columns
    assert sorted(columns.values()) == sorted(names)


def test_the_projects_own_reader_finds_columns_by_their_names(named: Path, tmp_path: Path) -> None:
    log = read_mcap(named / "log.mcap")
    assert {"Table.gap", "my__table.gap", "force.z.ref"} <= log.columns.keys()
    result = call("judge", named / "task.yaml", named / "log.mcap", "--out", tmp_path / "judged")
    assert result.exit_code == 0, result.stderr
    assert "2 of 2" in result.stdout
    judged, own = (Run(folder).history for folder in (tmp_path / "judged", named))
    for name in NAMES:
        np.testing.assert_array_equal(
            judged.columns[f"{name}.gap"], own.columns[f"{name}.gap"], err_msg=name
        )


# The wrench and its frame.


def _vector(xyz: Any) -> np.ndarray:
    return np.array([xyz.x, xyz.y, xyz.z])


def _pose(transform: Any) -> tuple[np.ndarray, np.ndarray]:
    q = transform.rotation
    return _vector(transform.translation), Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()


def _moved(wrench: Any, frames: dict[str, Any], to: str) -> np.ndarray:
    """(6,) a wrench about the origin of another frame in world axes, as a reader of /tf does it."""
    p, R = _pose(frames[wrench.header.frame_id])
    force, torque = R @ _vector(wrench.wrench.force), R @ _vector(wrench.wrench.torque)
    origin, _ = _pose(frames[to])
    return np.concatenate([force, torque + np.cross(p - origin, force)])


def _at_rest(run: Run, found: dict[str, list[tuple[int, Any]]]) -> Iterator[tuple[int, np.ndarray]]:
    """What the robot applies at the tip (6,), of the joint torques alone: by Pinocchio.

    u - (H q'' + C q' + g) = J^T w, with accelerations that are differences of the velocities.
    """
    twin, states = run.program.context.robot.twin(), [m for _, m in found["/joint_states"]]
    q, v, u = (
        np.array([getattr(m, k) for m in states]) for k in ("position", "velocity", "effort")
    )
    a = np.gradient(v, run.program.context.period, axis=0)
    for row in range(20, len(q) - 1, 20):
        J = twin.jacobian(q[row])
        rest = u[row] - twin.torque(q[row], v[row], a[row])
        yield row, np.linalg.lstsq(J.T, rest, rcond=None)[0]


#: Task, stage, how far torques may be from those of the joints, and how far those about the origin
#: of `task` are at least [N m]. Accelerations that are differences leave 1e-7 at rest and 1e-3 in
#: motion; a fixed frame lies 0.5 m from a contact with 10 to 20 N.
MOVED = {
    "corner": ("press", 1e-5, 9.0),
    "groove-following": ("follow", 1e-4, 5.0),
    "face-alignment": ("align", 1e-4, 9.0),
    "conveyor": ("draw", 1e-3, 0.0),
    "contour-unknown": ("trace", 1e-4, 0.0),
}


@pytest.mark.parametrize("task", MOVED)
def test_wrench_that_tf_moves_is_the_one_of_the_joints(task: str, tmp_path: Path) -> None:
    stage, accuracy, lever = MOVED[task]
    execute(load_task(SHIPPED / f"{task}.yaml"), tmp_path / "run", report=False)
    run = Run(tmp_path / "run")
    found = READERS["mcap-ros2-support-fast"](export_run(run, "mcap").path)
    frames = {
        time: {t.child_frame_id: t.transform for t in m.transforms} for time, m in found["/tf"]
    }
    stages, apart, about_task = [m.stage for _, m in found["/signals"]], [], []
    for row, truth in _at_rest(run, found):
        if stages[row] != stage:
            continue
        time, wrench = found["/wrench"][row]
        apart.append(_moved(wrench, frames[time], "tool") - truth)
        wrench.header.frame_id = "task"
        about_task.append(_moved(wrench, frames[time], "tool") - truth)
    assert len(apart) > 10
    assert np.median(np.linalg.norm(np.array(apart)[:, 3:], axis=1)) < accuracy
    # That the frame is not the task's makes the difference.
    assert np.median(np.linalg.norm(np.array(about_task)[:, 3:], axis=1)) >= lever
