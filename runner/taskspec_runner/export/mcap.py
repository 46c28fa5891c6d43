"""MCAP with the messages of ROS 2, which Foxglove, PlotJuggler and `ros2 bag` read directly."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence, Set
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES
from taskspec.spec.servo import TORQUE
from taskspec_runner.export.cdr import MessageForm, stamps
from taskspec_runner.export.chunks import ChannelColumn, ChunkedFile
from taskspec_runner.export.foxglove import foxglove_layout
from taskspec_runner.export.markers import arrow_markers, arrow_slots, world_markers
from taskspec_runner.export.messages import SIGNALS, definition, signals_message
from taskspec_runner.export.poses import Poses
from taskspec_runner.export.robot_description import robot_description
from taskspec_runner.export.scene import CONTROL_POINT, TASK_FRAME, TOOL, WORLD, RunScene
from taskspec_runner.export.stream import LogStream
from taskspec_runner.record.folder import json_text, mapping
from taskspec_runner.record.history import History, commanded, history_of
from taskspec_runner.record.names import SUMMARY, TASK

JOINT_STATES, WRENCH, WRENCH_MEASURED = "/joint_states", "/wrench", "/wrench_measured"
#: What an arm is commanded that takes no torques, with positions or velocities alone.
JOINT_COMMANDS = "/joint_commands"
STAGE_ENTERED, TOOL_POSE, FRAME_POSE, TRANSFORMS = "/stage", "/tool", "/task_frame", "/tf"
DESCRIPTION, FIXED, OBJECTS, FORCES = "/robot_description", "/tf_static", "/world", "/forces"
#: Topic to message.
TOPICS = {
    JOINT_STATES: "sensor_msgs/msg/JointState",
    WRENCH: "geometry_msgs/msg/WrenchStamped",
    WRENCH_MEASURED: "geometry_msgs/msg/WrenchStamped",
    STAGE_ENTERED: "std_msgs/msg/String",
}
#: Topics that need the program of the run.
POSES = {
    TOOL_POSE: "geometry_msgs/msg/PoseStamped",
    FRAME_POSE: "geometry_msgs/msg/PoseStamped",
    TRANSFORMS: "tf2_msgs/msg/TFMessage",
}
#: Topics that need the scene of the run; those but the last are sent once.
SCENE = {
    DESCRIPTION: "std_msgs/msg/String",
    FIXED: "tf2_msgs/msg/TFMessage",
    OBJECTS: "visualization_msgs/msg/MarkerArray",
    FORCES: "visualization_msgs/msg/MarkerArray",
}
SCALARS = "/signals"
#: What was sent once waits for who comes later, where a log is played back into ROS.
_LATCHED = """\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 2147483647, nsec: 4294967295}
  lifespan: {sec: 2147483647, nsec: 4294967295}
  liveliness: 1
  liveliness_lease_duration: {sec: 2147483647, nsec: 4294967295}
  avoid_ros_namespace_conventions: false
"""


#: Times that differ by less are the same [s].
_ROUNDING = 1e-9


def foxglove_layout_of(log: LogStream) -> dict[str, Any] | None:
    """The layout of Foxglove that goes with the messages of a log; None without its scene."""
    if log.scene is None:
        return None
    columns = signals_message(log.schema.names, log.units).columns
    return foxglove_layout(SCALARS, columns, STAGE_ENTERED, list(SCENE), log.scene)


def write_mcap(log: LogStream, path: Path) -> None:
    """Writes a log as messages, stamped with the simulated time.

    Raises:
        MissingLibraryError: the library mcap is not installed.
    """
    with path.open("wb") as file:
        made = ChunkedFile(file, "ros2", "taskspec")
        encoder = _Encoder(log, made)
        for batch in log:
            encoder.add(history_of(batch))
        made.state("taskspec", log.metadata)
        if log.run.content and not log.run.damage:
            made.attach(TASK, "application/yaml", log.run.content)
        if log.run.summary:
            made.attach(SUMMARY, "application/json", json_text(log.run.summary).encode())
        made.finish()


class _Encoder:
    """Rows of a log as messages, in the order of time."""

    def __init__(self, log: LogStream, file: ChunkedFile) -> None:
        self._file, self._poses, self._last = file, log.poses, ""
        self._signals = signals_message(log.schema.names, log.units)
        self._joints = sum(name.endswith(".position") and name.startswith("joint.")
                           for name in log.units)  # fmt: skip
        names = list(mapping(log.run.summary.get("robot")).get("joints") or ())
        if len(names) != self._joints:
            names = [f"joint{i + 1}" for i in range(self._joints)]
        self._joint_state = _joint_state(names)
        kind = commanded(log.units)
        self._commanded = "" if kind == TORQUE else kind
        self._joint_command = _joint_state(names, self._commanded)
        self._wrench = MessageForm().header(CONTROL_POINT).numbers(6)
        self._pose = MessageForm().header(WORLD).numbers(7)
        self._scene, self._robot = log.scene, log.run.robot or "robot"
        self._arrows = arrow_markers()
        self._channels = self._registered(log)

    def _registered(self, log: LogStream) -> dict[str, int]:
        """Topics to their channels."""
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        topics = {t: m for t, m in TOPICS.items() if self._joints or t != JOINT_STATES}
        topics |= {JOINT_COMMANDS: TOPICS[JOINT_STATES]} if self._commanded else {}
        topics |= POSES if self._poses is not None or self._scene is not None else {}
        topics |= SCENE if self._scene is not None else {}
        for topic, message in topics.items():
            if message not in schemas:
                schemas[message] = self._file.schema(message, definition(message))
            once = topic in SCENE and topic != FORCES
            latched = {"offered_qos_profiles": _LATCHED} if once else {}
            channels[topic] = self._file.channel(topic, schemas[message], latched)
        columns = self._signals.columns
        units = {field: log.units.get(name, "") for field, name in columns.items()}
        metadata = {"units": json.dumps(units), "columns": json.dumps(columns)}
        schema = self._file.schema(SIGNALS, self._signals.definition)
        channels[SCALARS] = self._file.channel(SCALARS, schema, metadata)
        return channels

    def add(self, rows: History) -> None:
        """Writes every message of some rows."""
        clock = rows.columns["clock"]
        times, when = stamps(clock)
        poses = dict[str, Poses]()
        if self._poses is not None:
            poses = dict(zip((TOOL, TASK_FRAME, CONTROL_POINT), self._poses.add(rows), strict=True))
        joints = self._joint_values(rows) if self._joints else []
        commands = self._of_joints(rows, f"{self._commanded}.command") if self._commanded else None
        wrenches = {WRENCH: _wrench(rows, ""), WRENCH_MEASURED: _wrench(rows, ".measured")}
        names = self._signals.columns.values()
        values = np.column_stack([rows.columns[name] for name in names])
        firsts = {visit.first for visit in rows.visits()}
        drawn = self._drawn(clock)
        for part, known in _parts({*firsts, *drawn}, poses, len(rows)):
            if part.start in drawn:
                self._add_scene(drawn[part.start])
            stage, now = str(rows.stages[part.start]), when[part]
            # A stage that follows itself is entered anew; what goes on from the rows before is not.
            if part.start in firsts and (part.start or stage != self._last):
                entered = ChannelColumn(self._channels[STAGE_ENTERED], MessageForm().text(stage))
                self._file.add(times[part][:1], [entered])
            self._last = stage
            signals = MessageForm().header(WORLD).numbers(values.shape[1]).text(stage)
            columns = [
                ChannelColumn(self._channels[topic], self._wrench, (now, wrench[part]))
                for topic, wrench in wrenches.items()
            ]
            columns.append(ChannelColumn(self._channels[SCALARS], signals, (now, values[part])))
            if joints:
                slots: list[NDArray[Any]] = [now, *(each[part] for each in joints)]
                columns.insert(
                    0, ChannelColumn(self._channels[JOINT_STATES], self._joint_state, slots)
                )
            if commands is not None:
                channel, sent = self._channels[JOINT_COMMANDS], commands[part]
                columns.append(ChannelColumn(channel, self._joint_command, (now, sent)))
            columns += self._posed({name: poses[name].rows(part) for name in known}, now)
            self._file.add(times[part], columns)

    def _drawn(self, clock: NDArray[np.float64]) -> dict[int, int]:
        """Rows of the scene by the rows of the log, at times (n,) [s], that they belong to."""
        if self._scene is None:
            return {}
        at = self._scene.clock
        first, after = np.searchsorted(at, [clock[0] - _ROUNDING, clock[-1] + _ROUNDING])
        rows = np.searchsorted(clock, at[first:after] - _ROUNDING)
        return dict(zip(rows.tolist(), range(int(first), int(after)), strict=True))

    def _add_scene(self, row: int) -> None:
        """Writes a row of the scene; before the first one, what stands still."""
        scene, rows = self._scene, slice(row, row + 1)
        assert scene is not None
        times, now = stamps(scene.clock[rows])
        if row == 0:
            self._add_still(scene, times, now)
        moving = {name: (parent, poses[rows]) for name, (parent, poses) in scene.moving.items()}
        columns = [_transforms(self._channels[TRANSFORMS], moving, now)] if moving else []
        arrows = arrow_slots(scene, rows, now)
        columns.append(ChannelColumn(self._channels[FORCES], self._arrows, arrows))
        self._file.add(times, columns)

    def _add_still(self, scene: RunScene, time: NDArray[np.int64], now: NDArray[np.uint32]) -> None:
        """Writes what is sent once: the arm, what stands still, and what the world is made of."""
        text = MessageForm().text(robot_description(scene, self._robot))
        fixed = {name: (parent, pose[None]) for name, (parent, pose) in scene.fixed.items()}
        markers, stamped = world_markers(scene)
        columns = [
            ChannelColumn(self._channels[DESCRIPTION], text),
            _transforms(self._channels[FIXED], fixed, now),
            ChannelColumn(self._channels[OBJECTS], markers, [now] * stamped),
        ]
        self._file.add(time, columns)

    def _joint_values(self, rows: History) -> list[NDArray[np.float64]]:
        return [self._of_joints(rows, kind) for kind in ("position", "velocity", "torque")]

    def _of_joints(self, rows: History, kind: str) -> NDArray[np.float64]:
        """(n, joints) of a signal of joints."""
        # Of a log from elsewhere some may be missing.
        none = np.full(len(rows), np.nan)
        names = range(1, self._joints + 1)
        found = [rows.columns.get(f"joint.{i}.{kind}", none) for i in names]
        return np.column_stack(found or [np.zeros((len(rows), 0))])

    def _posed(
        self, poses: dict[str, NDArray[np.float64]], now: NDArray[np.uint32]
    ) -> Iterator[ChannelColumn]:
        """Messages of the poses (n, 7) that are known, by their frames."""
        for name, topic in ((TOOL, TOOL_POSE), (TASK_FRAME, FRAME_POSE)):
            if name in poses:
                yield ChannelColumn(self._channels[topic], self._pose, (now, poses[name]))
        if poses:
            frames = {name: (WORLD, values) for name, values in poses.items()}
            yield _transforms(self._channels[TRANSFORMS], frames, now)


def _transforms(
    channel: int, frames: Mapping[str, tuple[str, NDArray[np.float64]]], now: NDArray[np.uint32]
) -> ChannelColumn:
    """Messages of the poses (k, 7) of frames in their parents, stamped `now` (k, 2)."""
    layout, slots = MessageForm().count(len(frames)), list[NDArray[Any]]()
    for name, (parent, poses) in frames.items():
        layout.header(parent).text(name).numbers(7)
        slots += [now, poses]
    return ChannelColumn(channel, layout, slots)


def _parts(
    starts: Set[int], poses: dict[str, Poses], rows: int
) -> Iterator[tuple[slice, Sequence[str]]]:
    """Rows from one of some first ones to the next, with the names of the poses that are known."""
    known = np.array([each.known for each in poses.values()]).reshape(len(poses), rows)
    new = (known[:, 1:] != known[:, :-1]).any(axis=0)
    firsts = {*(np.flatnonzero(new) + 1).tolist(), *starts}
    for first, after in pairwise([*sorted(firsts), rows]):
        names = [name for name, each in zip(poses, known[:, first], strict=True) if each]
        yield slice(first, after), names


def _joint_state(names: list[str], only: str = "") -> MessageForm:
    """States of joints, or one of their three arrays alone: the others are empty then."""
    layout = MessageForm().header("").count(len(names))
    for name in names:
        layout.text(name)
    for kind in ("position", "velocity", "effort"):
        if only in ("", kind):
            layout.count(len(names)).numbers(len(names))
        else:
            layout.count(0)
    return layout


def _wrench(rows: History, suffix: str) -> NDArray[np.float64]:
    """(n, 6) what the robot applies; zero along what the sensor does not measure.

    What was not recorded is not a number.
    """
    names = [f"{'torque' if axis.startswith('r') else 'force'}.{axis}{suffix}" for axis in AXES]
    nothing = [np.nan if name in rows.unrecorded else 0.0 for name in names]
    columns = (
        rows.columns.get(n, np.full(len(rows), x)) for n, x in zip(names, nothing, strict=True)
    )
    return np.column_stack([*columns])
