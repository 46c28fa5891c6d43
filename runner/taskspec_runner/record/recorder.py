"""The log: one row a tick, in batches of an Arrow IPC stream that survive a killed run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES
from taskspec.program import signals
from taskspec.program.stages.stage import CompiledStage
from taskspec.robot import RobotModel
from taskspec.spec import Task
from taskspec.text.expression.signals import OBJECT
from taskspec.text.units import ANGLE, FORCE, LENGTH, MOMENT
from taskspec_runner.record.bus import Bus
from taskspec_runner.record.distances import Distances

Vector = NDArray[np.float64]

#: Rows of one batch: what a killed run loses at most.
BATCH = 500

_KIND_UNITS = {
    "force": ("N", "N*m"),
    "position": ("m", "rad"),
    "velocity": ("m/s", "rad/s"),
    "error": ("m", "rad"),
}
_UNITS = {LENGTH: "m", ANGLE: "rad", FORCE: "N", MOMENT: "N*m"}


class Recorder:
    """Collects the bus tick by tick and writes it as named columns in SI units.

    Signals are the truth: the wrench is that of the tick's own step, and every `gap` is taken to
    the true objects. What the controller measured stands beside it as `force.*.measured`.
    """

    def __init__(
        self,
        path: Path | None,
        bus: Bus,
        robot: RobotModel,
        stages: tuple[CompiledStage, ...],
        task: Task,
    ) -> None:
        self._bus, self._stages, self._task = bus, stages, task
        self._rows: Vector = np.zeros((BATCH, len(bus.array)))
        self._filled = 0
        self._array = bus.array
        self._axes = tuple(a for a in AXES if any(a in s.axes for s in stages))
        self._joints = robot.pin.nv
        solved = any(s.resolution is not None for s in stages)
        self._solved = ("limits", "residual") if solved else ()
        self._distances = Distances(robot, task)
        self._schema = pa.schema([])
        self._writer: pa.ipc.RecordBatchStreamWriter | None = None
        self._path = path
        self._file = path.open("wb") if path is not None else None

    def add(self) -> None:
        """Records the bus as it is now."""
        filled = self._filled
        self._rows[filled] = self._array
        self._filled = filled = filled + 1
        if filled == BATCH:
            self.flush()

    def latest(self) -> dict[str, float | str]:
        """The bus as it is now, by column name."""
        columns = self._columns(self._array[:, np.newaxis])
        return {
            name: float(values[0]) if unit != "stage" else self._stages[int(values[0])].name
            for name, (values, unit) in columns.items()
        }

    def flush(self) -> None:
        """Writes the rows collected so far as one batch."""
        if self._filled == 0 or self._file is None:
            self._filled = 0
            return
        # One transposition makes every column contiguous, which is how Arrow wants it.
        columns = self._columns(np.ascontiguousarray(self._rows[: self._filled].T))
        if self._writer is None:
            self._schema = _schema(columns)
            self._writer = pa.ipc.new_stream(self._file, self._schema)
        arrays = [
            pa.array(values) if unit != "stage" else _stage_array(values, self._stages)
            for values, unit in columns.values()
        ]
        self._writer.write_batch(pa.record_batch(arrays, schema=self._schema))
        self._file.flush()
        self._filled = 0

    def close(self) -> None:
        """Writes what is left and ends the stream."""
        try:
            self.flush()
            if self._writer is not None:
                self._writer.close()
        finally:
            if self._file is not None:
                self._file.close()
                self._file = None

    def _columns(self, rows: Vector) -> dict[str, tuple[Vector, str]]:
        """Column name to values and unit; `rows` are (fields, ticks)."""

        def field(name: str) -> Vector:
            return rows[self._bus.slices[name]]

        applied = self._applied(field("frame"), field("offset"), field("wrench"))
        columns: dict[str, tuple[Vector, str]] = {
            "clock": (field("clock")[0], "s"),
            "t": (field("t")[0], "s"),
            "stage": (field("stage")[0], "stage"),
        }

        def six(kind: str, values: Vector, suffix: str = "") -> None:
            for axis in self._axes:
                i = AXES.index(axis)
                name = "torque" if kind == "force" and i > 2 else kind
                columns[f"{name}.{axis}{suffix}"] = (values[i], _KIND_UNITS[kind][i // 3])

        velocity = field("velocity")
        six("force", applied)
        six("force", field("force_ref"), ".ref")
        six("force", field("measured"), ".measured")
        six("position", field("position"))
        six("position", field("position_ref"), ".ref")
        six("velocity", velocity)
        six("velocity", field("velocity_ref"), ".ref")
        six("error", field("error"))
        size = np.sqrt(np.sum(field("wrench")[:3] ** 2, axis=0))
        gaps = self._distances(field)
        columns["gap"] = (self._contact_gap(field("stage")[0], gaps), "m")
        for name, value, unit in (
            ("tilt", field("tilt")[0], "rad"),
            ("speed", field("speed")[0], "m/s"),
            ("travel", field("travel")[0], "m"),
            ("touching", (size > signals.TOUCHING).astype(float), ""),
            ("power", np.sum(applied * velocity, axis=0, where=~np.isnan(velocity)), "W"),
            ("path_done", field("path_done")[0], ""),
            ("force_inconsistent", field("force_inconsistent")[0], "N"),
            ("limited", field("limited")[0], ""),
            *((name, field(name)[0], "") for name in self._solved),
        ):
            columns[name] = (value, unit)
        for i in range(self._joints):
            columns[f"joint.{i + 1}.position"] = (field("q")[i], "rad")
            columns[f"joint.{i + 1}.velocity"] = (field("v")[i], "rad/s")
            columns[f"joint.{i + 1}.torque"] = (field("torque")[i], "N*m")
        for name, declared in self._task.world.items():
            values = self._object_signals(name, gaps, field)
            for signal, dimension in OBJECT[declared.kind].items():
                columns[f"{name}.{signal}"] = (values[signal], _UNITS[dimension])
        for i, (name, equation) in enumerate(self._task.equations.items()):
            effort = "torque" if equation.equation.joints else "force"
            unit = columns[f"{name}.{effort}"][1]
            columns[f"{name}.{effort}.ref"] = (field("reaction_ref")[i], unit)
            columns[f"{name}.{effort}.measured"] = (field("reaction")[i], unit)
        return columns

    def _object_signals(
        self,
        name: str,
        gaps: Mapping[str, Vector],
        field: Callable[[str], Vector],
    ) -> dict[str, Vector]:
        """(ticks,) of every signal that an object of this kind may have."""
        task = self._task
        if name in task.shapes:
            return {"gap": gaps[name], "force": field("objects")[list(task.shapes).index(name)]}
        if name in task.equations:
            applied = field("equations")[list(task.equations).index(name)]
            return {"gap": gaps[name], "force": applied, "torque": applied}
        mechanism, number = task.mechanisms[name], list(task.mechanisms).index(name)
        place = field("mechanism_positions")[number]
        effort = field("mechanism_efforts")[number]
        way = mechanism.lead * place if mechanism.angular else place
        return {"angle": place, "travel": way, "torque": effort, "force": effort}

    @staticmethod
    def _applied(frame: Vector, offset: Vector, wrench: Vector) -> Vector:
        """(6, ticks) what the robot applies at the control point, in the stage's frame."""
        force = -wrench[:3]
        moment = -wrench[3:]
        moment[0] -= offset[1] * force[2] - offset[2] * force[1]
        moment[1] -= offset[2] * force[0] - offset[0] * force[2]
        moment[2] -= offset[0] * force[1] - offset[1] * force[0]
        axes = frame.reshape(3, 3, -1)  # axes[i] is the frame's axis i in the world
        return np.concatenate([np.sum(axes * force, axis=1), np.sum(axes * moment, axis=1)])

    def _contact_gap(self, stage: Vector, gaps: Mapping[str, Vector]) -> Vector:
        result = np.full(len(stage), np.nan)
        for number, compiled in enumerate(self._stages):
            gap = gaps.get(compiled.contact or "")
            if gap is not None:
                here = stage == number
                result[here] = gap[here]
        return result


def _stage_array(values: Vector, stages: tuple[CompiledStage, ...]) -> pa.Array:
    names = pa.array([s.name for s in stages])
    return pa.DictionaryArray.from_arrays(pa.array(values.astype(np.int32)), names)


def _schema(columns: Mapping[str, tuple[Vector, str]]) -> pa.Schema:
    return pa.schema(
        [
            pa.field(name, pa.dictionary(pa.int32(), pa.string()))
            if unit == "stage"
            else pa.field(name, pa.float64(), metadata={"unit": unit})
            for name, (_, unit) in columns.items()
        ]
    )
