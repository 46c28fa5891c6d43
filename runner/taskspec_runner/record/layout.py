"""The columns of a log, and how rows of the bus become a batch of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred import pa
from taskspec.deferred_methods import dataclass
from taskspec.faults import TORQUE
from taskspec.geometry.axis import AXES, Axis, axes_of
from taskspec.laws.tank import OUTPUTS
from taskspec.program import ports
from taskspec.program.program import Program
from taskspec.program.stages.stage import CompiledStage
from taskspec.robot import RobotModel
from taskspec.signals import (
    ESTIMATE,
    GAIN,
    GRIP,
    JOINT,
    LINK,
    OBJECT,
    PAYLOAD,
    SCALARS,
    TANK,
    VECTORS,
    Index,
)
from taskspec.signals.table import MEASURED, REFERENCE
from taskspec.spec import Task
from taskspec.text.units import FORCE, LENGTH, VELOCITY, si_unit
from taskspec_runner.record.bus import TRUE, Bus
from taskspec_runner.record.history import TO_REST, column_field, log_schema
from taskspec_runner.record.named import param_column
from taskspec_runner.record.truth import Formulas, Truth

Vector = NDArray[np.float64]

#: The column of what a file rewards in a second.
REWARD = "reward"
#: Signals without axes that are the arm's alone, and of which the controller may be wrong.
_OF_MOTION = ("tilt", "speed", "travel")
#: What a joint's columns are of one that slides; of one that turns, what these are about an axis.
_SLIDING = {
    "position": LENGTH,
    "velocity": VELOCITY,
    "torque": FORCE,
    "disturbance": FORCE,
}


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the log.

    Attributes:
        name: its own.
        unit: of its values, empty for plain numbers.
        field: of the bus; empty for a true signal.
        row: in that field.
    """

    name: str
    unit: str
    field: str
    row: int = 0


class LogLayout:
    """What the columns of a log are, and what each of them takes from the bus.

    Signals are the truth: the wrench is that of the tick's own step, and every `gap` is taken to
    the true objects. What the controller measured stands beside it as `force.*.measured`;
    where joints are not exact, also `position.*.measured`, `joint.*.position.measured` and so on.

    Attributes:
        fields: how many numbers a tick has.
    """

    def __init__(
        self,
        slices: Mapping[str, slice],
        robot: RobotModel,
        stages: tuple[CompiledStage, ...],
        task: Task,
        *,
        measured: bool = False,
    ) -> None:
        """Compiles the true signals.

        Args:
            slices: where the bus has each of its fields.
            robot, stages: of the program.
            task: with the true world.
            measured: whether it is of a robot, of which nobody knows the truth: the measurement
                takes its place, and what nobody measures is left out.
        """
        self._slices, self._stages = slices, stages
        self.fields = max(each.stop for each in slices.values())
        if measured:
            slices = {n: where for n, where in slices.items() if not n.startswith(TRUE)}
        whole: list[Column] = list(_columns(slices, robot, stages, task))
        whole += LINK_COLUMNS if "link" in slices else ()
        unknown = frozenset(_unmeasured(task, robot) if measured else ())
        self._layout = tuple(column for column in whole if column.name not in unknown)
        self._columns = {column.name: column for column in self._layout}
        true = [column.name for column in self._layout if not column.field]
        together: dict[str, list[str]] = {}
        for name in true:
            signal = name.partition(".")[0]
            sensed = signal in VECTORS and VECTORS[signal].sensed
            together.setdefault("wrench" if sensed else signal, []).append(name)
        self._together = {key: tuple(names) for key, names in together.items()}
        places, rates = self.fields_of_columns, reward_rates(task)
        self._truth = Truth(robot, task, stages, slices, true, places, formulas=rates)
        self._unknown = unknown

    @cached_property
    def _schema(self) -> pa.Schema:
        fields = [column_field(each.name, each.unit) for each in self._layout]
        return log_schema(fields, self._unknown)

    @classmethod
    def of(
        cls, program: Program, task: Task, *, linked: bool = False, measured: bool = False
    ) -> LogLayout:
        """Of a run of a program in the world of a task.

        Args:
            program: that ran.
            task: whose world it was.
            linked: whether plant and controller met at the wall clock.
            measured: whether it ran on a robot.
        """
        context = program.context
        slices = Bus(context.robot.n, task, linked=linked).slices
        return cls(slices, context.robot, program.stages, task, measured=measured)

    @property
    def fields_of_columns(self) -> dict[str, int]:
        """Where the bus has each column that is a number of it as it is."""
        slices = self._slices
        return {c.name: slices[c.field].start + c.row for c in self._layout if c.field}

    @property
    def units(self) -> dict[str, str]:
        """Column to its unit, in their order; empty for plain numbers, `stage` for stages."""
        return {each.name: each.unit for each in self._layout}

    def batch(self, rows: Vector) -> pa.RecordBatch:
        """Rows of the bus, (ticks, fields), as a batch of a log."""
        arrays = [
            pa.array(values) if unit != "stage" else _stage_array(values, self._stages)
            for values, unit in self.columns(rows).values()
        ]
        return pa.record_batch(arrays, schema=self._schema)

    def by_machine_code(self) -> None:
        """Has machine code work out true signals from now on, with the same bits."""
        self._truth.by_code = True

    def beside(self, name: str) -> tuple[str, ...]:
        """The derived columns that are worked out with one of them: what makes one makes all."""
        return next(names for names in self._together.values() if name in names)

    def derive(self, rows: Vector, names: tuple[str, ...]) -> Vector:
        """(ticks, names) values of derived columns, from rows of the bus (ticks, fields)."""
        return self._truth(rows, names)

    def is_true(self, name: str) -> bool:
        """Whether a column is a true signal, which no number of the bus is by its name."""
        return not self._columns[name].field

    def place(self, name: str) -> int | None:
        """Where in a tick a column is; None of one that is derived from several numbers of it.

        Raises:
            KeyError: there is no such column.
        """
        column = self._columns[name]
        if column.field:
            start: int = self._slices[column.field].start
            return start + column.row
        return self._truth.place(name)

    def columns(self, rows: Vector) -> dict[str, tuple[Vector, str]]:
        """Column name to values and unit; `rows` are (ticks, fields)."""
        # Transposed, every column is contiguous, which is how Arrow wants it; and it is a copy.
        true = iter(np.array(self._truth(rows).T, order="C"))
        fields = np.array(rows.T, order="C")

        def field(name: str) -> Vector:
            return fields[self._slices[name]]

        columns = {}
        for column in self._layout:
            values = field(column.field)[column.row] if column.field else next(true)
            columns[column.name] = (values, column.unit)
        return columns


def reward_rates(task: Task) -> Formulas:
    """What a file rewards in a second, as a formula of its log; none where it does not."""
    if task.reward is None or not task.reward.rate:
        return {}
    return {REWARD: {stage: rate.tree for stage, rate in task.reward.rate.items()}}


#: What the log has of a link at the wall clock.
LINK_COLUMNS = tuple(
    Column(f"{Index.LINK}.{name}", si_unit(signal.dimension), "link", i)
    for i, (name, signal) in enumerate(LINK.items())
)


def _unmeasured(task: Task, robot: RobotModel) -> Iterator[str]:
    """Columns that a robot does not measure: forces of single objects, multipliers, motions.

    What the drives of one exert that takes no torques is among them.
    """
    equations = task.equations
    if not task.robot.takes_torques:
        joints = range(1, robot.n + 1)
        yield from (f"joint.{i}.{name}" for i in joints for name in ("torque", "position.servo"))
    for owner, declared in task.world.items():
        if owner in equations:
            signals = OBJECT[declared.kind].items()
            yield from (f"{owner}.{name}" for name, signal in signals if signal.unmeasured)
            continue
        if owner in task.bushings:
            yield from (
                f"{owner}.{name}" for name in OBJECT[declared.kind] if "position" not in name
            )
            continue
        shape = task.shapes.get(owner)
        known = shape is not None and not shape.free and shape.on is None
        still = ("gap",) if known else ()
        yield from (f"{owner}.{name}" for name in OBJECT[declared.kind] if name not in still)


def _columns(
    slices: Mapping[str, slice], robot: RobotModel, stages: tuple[CompiledStage, ...], task: Task
) -> Iterator[Column]:
    """The columns of a log, in their order."""
    # Where joints are not exact, what is measured of the arm stands beside what is true.
    spoiled = f"{TRUE}q" in slices
    yield Column("clock", "s", "clock")
    yield Column("t", "s", "t")
    yield Column("stage", "stage", "stage")
    axes = [axis for axis in AXES if any(axis in stage.plan.axes for stage in stages)]
    for group, beside in ports.groups().items():
        members = [
            (axis, f"{signal.name}.{axis}", si_unit(signal.dimensions[axis]), signal.sensed)
            for signal in VECTORS.values()
            for axis in signal.axes
            if signal.group == group and axis in axes
        ]
        true = f"{TRUE}{group}" if spoiled else group
        for axis, name, unit, sensed in members:
            yield Column(name, unit, "" if sensed else true, axis.row)
        if spoiled and MEASURED not in beside:
            beside = (*beside, MEASURED)
        for suffix in beside:
            field = group if suffix == MEASURED else f"{group}_{suffix}"
            for axis, name, unit, _ in members:
                yield Column(f"{name}.{suffix}", unit, field, axis.row)
    for name, signal in SCALARS.items():
        field = f"{TRUE}{name}" if spoiled and name in _OF_MOTION else name
        yield Column(name, si_unit(signal.dimension), field if signal.port else "")
    solved = any(stage.resolution is not None for stage in stages)
    yield from (Column(name, "", name) for name in ("limits", "residual") if solved)
    yield from _of_gains(task, axes)
    yield from _of_estimates(task, axes)
    yield from _of_params(task)
    yield from _of_grip(task)
    yield from _of_tanks(task)
    yield from _of_payload(task)
    yield from _of_joints(robot, task, spoiled=spoiled)
    for owner, declared in task.world.items():
        for name, signal in OBJECT[declared.kind].items():
            if not signal.output:
                yield Column(f"{owner}.{name}", si_unit(signal.dimensions[declared.kind]), "")
    yield from _of_equations(task)
    if reward_rates(task):
        yield Column(REWARD, "1/s", "")


def _of_equations(task: Task) -> Iterator[Column]:
    """The columns of equations that are the controller's."""
    generalised = {name for each in task.stages.values() for name in each.generalised}
    for i, (owner, equation) in enumerate(task.equations.items()):
        signals = OBJECT[equation.kind]
        ((name, signal),) = ((n, s) for n, s in signals.items() if MEASURED in s.beside)
        unit = si_unit(signal.dimensions[equation.kind])
        yield Column(f"{owner}.{name}.ref", unit, "reaction_ref", i)
        yield Column(f"{owner}.{name}.measured", unit, "reaction", i)
        if task.in_joints:
            gap = si_unit(signals["gap"].dimensions[equation.kind])
            yield Column(f"{owner}.gap.ref", gap, "gap_ref", i)
        if owner in generalised:
            residual = signals["residual"]
            unit = si_unit(residual.dimensions[equation.kind])
            yield Column(f"{owner}.residual", unit, residual.output, i)


def _of_params(task: Task) -> Iterator[Column]:
    """The columns of the params that may be set while a stage runs."""
    for i, (name, param) in enumerate(task.live.items()):
        yield Column(param_column(name), si_unit(param.dimension), "param", i)


def _of_grip(task: Task) -> Iterator[Column]:
    """The columns of the gripper: what it reports, what it is commanded, and the load."""
    if not task.gripped:
        return
    first = len(task.equations)
    rows = {"force": ("equations", first), "slip": ("equations", first + 1)}
    rows |= {"command": ("grip", 0), "load": ("grip", 1)}
    for name, (field, row) in rows.items():
        yield Column(f"{Index.GRIP}.{name}", si_unit(GRIP[name].dimension), field, row)


def _of_tanks(task: Task) -> Iterator[Column]:
    """The columns of energy tanks, where a law has one."""
    for name, signal in TANK.items() if task.tanks else ():
        unit = signal.unit or si_unit(signal.dimension)
        yield Column(name, unit, "tank", OUTPUTS.index(name.removeprefix("tank.")))


def _of_payload(task: Task) -> Iterator[Column]:
    """The columns of a payload that laws adapt to."""
    for i, (name, signal) in enumerate(PAYLOAD.items() if task.adapt is not None else ()):
        yield Column(name, si_unit(signal.dimension), "payload", i)


def _of_gains(task: Task, axes: Sequence[Axis]) -> Iterator[Column]:
    """The columns of the gains that vary, as far as the arm has their axes."""
    for i, (name, on) in enumerate(task.varying_gains):
        if {*axes_of(on)} <= {*axes}:
            unit = si_unit(GAIN[name].dimensions[on])
            yield Column(f"{Index.GAIN}.{name}.{on}", unit, "gain", i)


def _of_estimates(task: Task, axes: Sequence[Axis]) -> Iterator[Column]:
    """The columns of what laws estimate, as far as the arm has their axes."""
    for axis in task.estimates:
        for signal, output in ports.ESTIMATED.items():
            if axis in axes:
                unit = si_unit(ESTIMATE[signal].dimension)
                yield Column(f"{Index.ESTIMATE}.{signal}.{axis}", unit, output, axis.row)


def _of_joints(robot: RobotModel, task: Task, *, spoiled: bool) -> Iterator[Column]:
    """The columns of all joints: where devices are not exact, also what is not the truth, or is it.

    Of an arm that takes no torques, what is commanded, and what its servo holds joints to.
    """
    beside = [("position", MEASURED, "q"), ("velocity", MEASURED, "v")]
    beside = beside if spoiled else []
    beside += [("position", REFERENCE, "joint_ref")] if task.in_joints else []
    beside += [("torque", "exerted", f"{TRUE}torque")] if task.truth.of(TORQUE) else []
    beside += [("torque", "friction", "friction")] if task.control.friction is not None else []
    if not task.robot.takes_torques:
        beside += [(task.robot.command, "command", "command"), ("position", "servo", "servo")]
    for i, turns in enumerate(robot.hinges):
        units = {name: si_unit(each.on(rotation=turns)) for name, each in _SLIDING.items()}
        for name, signal in JOINT.items():
            if not signal.output:
                yield Column(f"joint.{i + 1}.{name}", units[name], "")
            elif task.observes:
                yield Column(f"joint.{i + 1}.{name}", units[name], signal.output, i)
        for name, suffix, field in beside:
            yield Column(f"joint.{i + 1}.{name}.{suffix}", units[name], field, i)


def stage_names(stages: tuple[CompiledStage, ...]) -> list[str]:
    """What a tick can be in, by its number: a stage, or beyond these the stop to rest."""
    return [*(s.name for s in stages), TO_REST]


def _stage_array(values: Vector, stages: tuple[CompiledStage, ...]) -> pa.Array:
    codes = np.minimum(values, len(stages)).astype(np.int32)
    return pa.DictionaryArray.from_arrays(pa.array(codes), pa.array(stage_names(stages)))
