"""MCAP with the messages of ROS 2, which Foxglove, PlotJuggler and `ros2 bag` read directly."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence, Set
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES
from taskspec_runner.export.cdr import Layout, stamps
from taskspec_runner.export.chunks import ChannelColumn, ChunkedFile
from taskspec_runner.export.messages import SIGNALS, definition, signals_message
from taskspec_runner.export.poses import Poses
from taskspec_runner.export.stream import LogStream
from taskspec_runner.record.folder import json_text, mapping
from taskspec_runner.record.history import History, history_of
from taskspec_runner.record.names import SUMMARY, TASK

#: Frames; the wrench is about the origin of the last one, in axes that it shares with the task's.
WORLD, TOOL, TASK_FRAME, CONTROL_POINT = "world", "tool", "task", "control_point"
JOINT_STATES, WRENCH, WRENCH_MEASURED = "/joint_states", "/wrench", "/wrench_measured"
STAGE_ENTERED, TOOL_POSE, FRAME_POSE, TRANSFORMS = "/stage", "/tool", "/task_frame", "/tf"
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
SCALARS = "/signals"


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
        self._wrench = Layout().header(CONTROL_POINT).numbers(6)
        self._pose = Layout().header(WORLD).numbers(7)
        self._channels = self._registered(log)

    def _registered(self, log: LogStream) -> dict[str, int]:
        """Topics to their channels."""
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        topics = {t: m for t, m in TOPICS.items() if self._joints or t != JOINT_STATES}
        for topic, message in (topics | (POSES if self._poses is not None else {})).items():
            if message not in schemas:
                schemas[message] = self._file.schema(message, definition(message))
            channels[topic] = self._file.channel(topic, schemas[message], {})
        columns = self._signals.columns
        units = {field: log.units.get(name, "") for field, name in columns.items()}
        metadata = {"units": json.dumps(units), "columns": json.dumps(columns)}
        schema = self._file.schema(SIGNALS, self._signals.definition)
        channels[SCALARS] = self._file.channel(SCALARS, schema, metadata)
        return channels

    def add(self, rows: History) -> None:
        """Writes every message of some rows."""
        times, when = stamps(rows.columns["clock"])
        poses = dict[str, Poses]()
        if self._poses is not None:
            poses = dict(zip((TOOL, TASK_FRAME, CONTROL_POINT), self._poses.add(rows), strict=True))
        joints = self._joint_values(rows) if self._joints else []
        wrenches = {WRENCH: _wrench(rows, ""), WRENCH_MEASURED: _wrench(rows, ".measured")}
        names = self._signals.columns.values()
        values = np.column_stack([rows.columns[name] for name in names])
        firsts = {visit.first for visit in rows.visits()}
        for part, known in _parts(firsts, poses, len(rows)):
            stage, now = str(rows.stages[part.start]), when[part]
            # A stage that follows itself is entered anew; what goes on from the rows before is not.
            if part.start in firsts and (part.start or stage != self._last):
                entered = ChannelColumn(self._channels[STAGE_ENTERED], Layout().text(stage))
                self._file.add(times[part][:1], [entered])
            self._last = stage
            signals = Layout().header(WORLD).numbers(values.shape[1]).text(stage)
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
            columns += self._posed({name: poses[name].rows(part) for name in known}, now)
            self._file.add(times[part], columns)

    def _joint_values(self, rows: History) -> list[NDArray[np.float64]]:
        # Of a log from elsewhere some may be missing.
        none = np.full(len(rows), np.nan)
        names = range(1, self._joints + 1)
        return [
            np.column_stack([rows.columns.get(f"joint.{i}.{k}", none) for i in names])
            for k in ("position", "velocity", "torque")
        ]

    def _posed(
        self, poses: dict[str, NDArray[np.float64]], now: NDArray[np.uint32]
    ) -> Iterator[ChannelColumn]:
        """Messages of the poses (n, 7) that are known, by their frames."""
        for name, topic in ((TOOL, TOOL_POSE), (TASK_FRAME, FRAME_POSE)):
            if name in poses:
                yield ChannelColumn(self._channels[topic], self._pose, (now, poses[name]))
        if poses:
            layout, slots = Layout().count(len(poses)), list[NDArray[Any]]()
            for name, values in poses.items():
                layout.header(WORLD).text(name).numbers(7)
                slots += [now, values]
            yield ChannelColumn(self._channels[TRANSFORMS], layout, slots)


def _parts(
    visits: Set[int], poses: dict[str, Poses], rows: int
) -> Iterator[tuple[slice, Sequence[str]]]:
    """Rows that follow each other in one visit, with the names of those poses that are known."""
    known = np.array([each.known for each in poses.values()]).reshape(len(poses), rows)
    new = (known[:, 1:] != known[:, :-1]).any(axis=0)
    firsts = {*(np.flatnonzero(new) + 1).tolist(), *visits}
    for first, after in pairwise([*sorted(firsts), rows]):
        names = [name for name, each in zip(poses, known[:, first], strict=True) if each]
        yield slice(first, after), names


def _joint_state(names: list[str]) -> Layout:
    layout = Layout().header("").count(len(names))
    for name in names:
        layout.text(name)
    for _ in ("position", "velocity", "effort"):
        layout.count(len(names)).numbers(len(names))
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
