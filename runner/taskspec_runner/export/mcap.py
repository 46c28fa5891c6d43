"""MCAP with the messages of ROS 2, which Foxglove, PlotJuggler and `ros2 bag` read directly."""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec_runner.export.cdr import Layout, stamps
from taskspec_runner.export.messages import SIGNALS, definition, signals_message
from taskspec_runner.export.missing import library
from taskspec_runner.export.poses import Poses
from taskspec_runner.export.stream import LogStream
from taskspec_runner.record.folder import json_text, mapping
from taskspec_runner.record.history import History, history_of
from taskspec_runner.record.names import SUMMARY, TASK

WORLD, TOOL, TASK_FRAME = "world", "tool", "task"
JOINT_STATES = "/joint_states"
#: Topic to message.
TOPICS = {
    JOINT_STATES: "sensor_msgs/msg/JointState",
    "/wrench": "geometry_msgs/msg/WrenchStamped",
    "/wrench_measured": "geometry_msgs/msg/WrenchStamped",
    "/stage": "std_msgs/msg/String",
}
#: Topics that need the program of the run.
POSES = {
    "/tool": "geometry_msgs/msg/PoseStamped",
    "/task_frame": "geometry_msgs/msg/PoseStamped",
    "/tf": "tf2_msgs/msg/TFMessage",
}
SCALARS = "/signals"
#: What a reader of an unfinished file may lose [bytes].
_CHUNK = 256 * 1024

Messages = Iterator[tuple[str, int, bytes]]


@dataclass(slots=True)
class _LastPoses:
    """The stage of the last row so far."""

    stage: str = ""


def write_mcap(log: LogStream, path: Path) -> None:
    """Writes a log as messages, stamped with the simulated time.

    Raises:
        MissingLibraryError: the library mcap is not installed.
    """
    Writer = library("mcap.writer", "MCAP", "mcap").Writer
    encoder = _Encoder(log)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=_CHUNK)
        writer.start("ros2", "taskspec")
        channels = _register(writer, encoder, with_poses=log.poses is not None)
        for batch in log:
            for topic, time, data in encoder.encode(history_of(batch)):
                writer.add_message(channels[topic], time, data, time)
        writer.add_metadata("taskspec", log.metadata)
        if log.run.content and not log.run.damage:
            writer.add_attachment(0, 0, TASK, "application/yaml", log.run.content)
        if log.run.summary:
            summary = json_text(log.run.summary).encode()
            writer.add_attachment(0, 0, SUMMARY, "application/json", summary)
        writer.finish()


def _register(writer: Any, encoder: _Encoder, *, with_poses: bool) -> dict[str, int]:
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    topics = {t: m for t, m in TOPICS.items() if encoder.joints or t != JOINT_STATES}
    for topic, message in (topics | (POSES if with_poses else {})).items():
        if message not in schemas:
            text = definition(message).encode()
            schemas[message] = writer.register_schema(message, "ros2msg", text)
        channels[topic] = writer.register_channel(topic, "cdr", schemas[message])
    signals = encoder.signals
    scalars = writer.register_schema(SIGNALS, "ros2msg", signals.definition.encode())
    units = {"units": json.dumps(signals.units)}
    channels[SCALARS] = writer.register_channel(SCALARS, "cdr", scalars, units)
    return channels


class _Encoder:
    """Rows of a log as messages, in the order of time."""

    def __init__(self, log: LogStream) -> None:
        self.signals = signals_message(log.schema.names, log.units)
        self._poses, self._last = log.poses, _LastPoses()
        self.joints = sum(name.endswith(".position") and name.startswith("joint.")
                           for name in log.units)  # fmt: skip
        names = list(mapping(log.run.summary.get("robot")).get("joints") or ())
        if len(names) != self.joints:
            names = [f"joint{i + 1}" for i in range(self.joints)]
        self._joint_state = _joint_state(names)
        self._wrench = Layout().header(TASK_FRAME).numbers(6)

    def encode(self, rows: History) -> Messages:
        """Topic, time [ns] and bytes of every message of some rows."""
        times, when = stamps(rows.columns["clock"])
        found = [
            ("/wrench", times, self._wrench.messages(when, _wrench(rows, ""))),
            ("/wrench_measured", times, self._wrench.messages(when, _wrench(rows, ".measured"))),
            (SCALARS, times, self._scalars(rows, when)),
            *self._posed(rows, times, when),
        ]
        if self.joints:
            joints = self._joint_state.messages(when, *self._joint_values(rows))
            found.insert(0, (JOINT_STATES, times, joints))
        streams = [_stream(topic, at, messages) for topic, at, messages in found]
        yield from heapq.merge(self._stages(rows, times), *streams, key=lambda entry: entry[1])

    def _joint_values(self, rows: History) -> list[NDArray[np.float64]]:
        # Of a log from elsewhere some may be missing.
        none = np.full(len(rows), np.nan)
        names = range(1, self.joints + 1)
        return [
            np.column_stack([rows.columns.get(f"joint.{i}.{k}", none) for i in names])
            for k in ("position", "velocity", "torque")
        ]

    def _scalars(self, rows: History, when: NDArray[np.uint32]) -> Iterator[bytes]:
        values = np.column_stack([rows.columns[name] for name in self.signals.columns])
        start = 0
        for stage, run in groupby(rows.stages.tolist()):
            here = slice(start, start := start + len(list(run)))
            layout = Layout().header(WORLD).numbers(values.shape[1]).text(stage)
            yield from layout.messages(when[here], values[here])

    def _stages(self, rows: History, times: NDArray[np.int64]) -> Messages:
        """The name of a stage, when it is entered."""
        for visit in rows.visits():
            if visit.first or visit.stage != self._last.stage:
                yield "/stage", int(times[visit.first]), Layout().text(visit.stage).message()
            self._last.stage = visit.stage

    def _posed(
        self, rows: History, times: NDArray[np.int64], when: NDArray[np.uint32]
    ) -> Iterator[tuple[str, NDArray[np.int64], Iterator[bytes]]]:
        if self._poses is None:
            return
        tool, frame = self._poses.add(rows)
        layout = Layout().header(WORLD).numbers(7)
        for topic, poses in (("/tool", tool), ("/task_frame", frame)):
            known = poses.known
            values = (when[known], poses.places[known], poses.turns[known])
            yield topic, times[known], layout.messages(values[0], np.hstack(values[1:]))
        for poses, known in ((tool, tool.known), (frame, frame.known)):
            child = TOOL if poses is tool else TASK_FRAME
            yield "/tf", times[known], _transforms(child, poses, when, known)


def _stream(topic: str, times: NDArray[np.int64], messages: Iterator[bytes]) -> Messages:
    for time, message in zip(times.tolist(), messages, strict=True):
        yield topic, time, message


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


def _transforms(
    child: str, poses: Poses, when: NDArray[np.uint32], known: NDArray[np.bool_]
) -> Iterator[bytes]:
    layout = Layout().count(1).header(WORLD).text(child).numbers(7)
    return layout.messages(when[known], np.hstack([poses.places[known], poses.turns[known]]))
