"""The true signals of logged ticks: the formulas of the table, of what the plant has written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control.reference import opposite
from taskspec.expression import evaluate, resolve
from taskspec.expression.scope import CONSTANTS
from taskspec.expression.tree import Name, Node
from taskspec.geometry.axis import AXES
from taskspec.program.algebra import CasadiAlgebra
from taskspec.program.bound import RowFunction
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.world import frames, kinematics
from taskspec.program.world.bushings import bushing_models
from taskspec.program.world.equations import equation_models
from taskspec.program.world.mechanisms import mechanism_models
from taskspec.program.world.moving_base import moving_bases
from taskspec.robot import RobotModel
from taskspec.signals import MovingPose, ObjectState, Situation
from taskspec.signals.table import MEASURED
from taskspec.spec import Shape, Task
from taskspec.spec.params import worths
from taskspec_runner.record.bus import TRUE
from taskspec_runner.record.named import column_of, param_column, scope_of

if TYPE_CHECKING:
    from taskspec.native.rows import RowCode

Vector = NDArray[np.float64]
#: Expressions by a name, each by the stages in which it is one; it is 0 in the others.
Formulas = Mapping[str, Mapping[str, Node]]


class Truth:
    """Signals that the controller does not put out, or not as they truly are.

    The wrench is that of the tick's own step, and every distance is taken to the true objects. A
    shape that moves is where the clock has it, one on a mechanism where that has it, a loose body
    where the plant has it. From an equation the distance is r / |r_x|, to first order that from
    the constraint.

    Attributes:
        names: of the signals, in the order of their rows.
        by_code: whether machine code evaluates them, as soon as there is some.
    """

    def __init__(
        self,
        robot: RobotModel,
        task: Task,
        stages: Sequence[CompiledStage],
        fields: Mapping[str, slice],
        names: Sequence[str],
        columns: Mapping[str, int],
        *,
        formulas: Formulas | None = None,
        measured: bool = False,
    ) -> None:
        """Puts the formulas together, which are compiled at their first use.

        Args:
            robot: for its tool.
            task: with the true world.
            stages: of the program.
            fields: where the bus has each of its fields.
            names: of the signals.
            columns: where the bus has those of the log that are numbers of it, by their names.
            formulas: further ones that are no signals.
            measured: whether they are to be as the controller has them: of its measurements, and of
                objects as `task`, which is the nominal one then, declares them.
        """
        self.names, self.by_code = tuple(names), False
        row, self._places = _symbols(max(where.stop for where in fields.values()))
        parts = {name: row[where] for name, where in fields.items()}
        # Where joints are not exact, what the controller has of them is not the truth.
        for name in list(parts):
            if name.startswith(TRUE) and name != f"{TRUE}torque" and not measured:
                parts[name.removeprefix(TRUE)] = parts[name]
        objects = _objects(robot, task, parts)
        formulas = formulas or {}
        kinds = [
            (
                stage.plan.axes,
                stage.plan.contacts.of_gap,
                tuple(of_stage.get(stage.name) for of_stage in formulas.values()),
            )
            for stage in stages
        ]
        distinct = list(dict.fromkeys(kinds))
        #: Number of the situation of each stage, and where the bus has the stage.
        # As it is brought to rest it has the number of the stage that was broken off, behind all
        # stages.
        self._of_stage = np.array([distinct.index(kind) for kind in kinds * 2])
        self._stage = fields["stage"].start
        self._row = row
        self._situations = [_situation(parts, objects) for _ in distinct]
        counted = {name: row[place] for name, place in columns.items()}
        for at, (axes, contact, nodes) in zip(self._situations, distinct, strict=True):
            at.axes, at.contact = axes, contact
            if measured:
                _as_measured(at, parts, counted)
            for name, node in zip(formulas, nodes, strict=True):
                at.known[name] = ca.SX(0) if node is None else _value(node, task, at, counted)
        self._made: dict[tuple[str, ...], tuple[_Signals, ...]] = {}

    def __call__(self, rows: Vector, names: tuple[str, ...] | None = None) -> Vector:
        """(ticks, names) values, from rows of the bus (ticks, fields).

        A zero has no sign in them.

        Args:
            rows: of the ticks.
            names: of the signals that are wanted; None for all.
        """
        names = self.names if names is None else names
        functions = self._functions(names)
        if len(functions) == 1:
            # Choosing rows copies them.
            return functions[0].at(rows, by_code=self.by_code) + 0.0
        number = self._of_stage[rows[:, self._stage].astype(int)]
        values = np.empty((len(rows), len(names)))
        for each in np.unique(number):
            here = number == each
            values[here] = functions[each].at(rows[here], by_code=self.by_code)
        return values + 0.0

    def place(self, name: str) -> int | None:
        """Which number of the bus a signal is as it is, in all stages; None of all others."""
        found = {str(x) for x in (at.signal(*name.split(".")) for at in self._situations)}
        return self._places.get(found.pop()) if len(found) == 1 else None

    def _functions(self, names: tuple[str, ...]) -> tuple[_Signals, ...]:
        """Of each situation its function of a tick; made once for the same names."""
        if names not in self._made:
            self._made[names] = tuple(self._compiled(at, names) for at in self._situations)
        return self._made[names]

    def _compiled(self, at: Situation, names: tuple[str, ...]) -> _Signals:
        nothing = ca.SX(np.nan)
        found = [at.signal(*name.split(".")) for name in names]
        values = ca.densify(ca.vertcat(*(nothing if x is None else x for x in found)))
        return _Signals(ca.Function("truth", [self._row], [values]))


class _Signals:
    """A function of a row of the bus, evaluated at many: by CasADi, or by machine code."""

    def __init__(self, function: ca.Function) -> None:
        self._function, self._rows = function, RowFunction(function)

    def at(self, rows: Vector, *, by_code: bool) -> Vector:
        """(ticks, names) values, from (ticks, fields)."""
        # One row is somebody's look at a run that another thread is writing.
        values = self._code(rows) if by_code and len(rows) > 1 else None
        if values is None:
            (values,) = self._rows(rows)
        return values

    @cached_property
    def _code(self) -> RowCode:
        # With llvmlite it takes a tenth of a second to import.
        from taskspec.native.rows import RowCode

        return RowCode(self._function)


@lru_cache
def _symbols(size: int) -> tuple[ca.SX, dict[str, int]]:
    """A row of the bus, and the place of each of its numbers by its text: worlds share them."""
    row = ca.SX.sym("row", size)
    return row, {str(row[i]): i for i in range(size)}


def _situation(symbols: Mapping[str, ca.SX], objects: Mapping[str, ObjectState]) -> Situation:
    """The tool in its stage's frame, in world axes."""
    applied, offset = opposite(symbols["wrench"]), symbols["offset"]
    force = applied[:3]
    tip = MovingPose(symbols["tip"], ca.reshape(symbols["tip_rotation"], 3, 3))
    return Situation(
        axes=AXES,
        t=symbols["t"],
        clock=symbols["clock"],
        world=tip,
        tip=tip,
        frame=ca.reshape(symbols["frame"], 3, 3),
        applied=ca.vertcat(force, applied[3:] - ca.cross(offset, force)),
        q=symbols["q"],
        v=symbols["v"],
        torque=symbols["exerted" if "command" in symbols else "torque"],
        objects=objects,
        known={f"velocity.{axis}": symbols["velocity"][axis.row] for axis in AXES},
    )


def _value(node: Node, task: Task, at: Situation, columns: Mapping[str, ca.SX]) -> ca.SX:
    """An expression of a tick.

    Args:
        node: as a reward has it, or an expectation without a frame, a reducer or visits.
        task: with its params.
        at: the tool.
        columns: what the log has as a number of the tick, by its name.
    """
    scope, algebra = scope_of(task), CasadiAlgebra(None, 1 / task.control.rate)
    params = worths(task.params, algebra, lambda live: columns[param_column(live)])

    def value(name: Name) -> ca.SX:
        meaning = resolve(name.path, scope)
        assert meaning is not None, name
        if meaning.kind == "constant":
            return ca.SX(CONSTANTS[meaning.name][0])
        if meaning.kind == "param":
            return params[meaning.name]
        column = column_of(meaning)
        found = columns.get(column)
        if found is None and meaning.kind == "link":
            # Plant and controller are one loop, or one waits for the other.
            return ca.SX(0)
        found = at.signal(*column.split(".")) if found is None else found
        return ca.SX(np.nan) if found is None else found

    return ca.SX(evaluate(node, algebra, value))


def _as_measured(at: Situation, symbols: Mapping[str, ca.SX], columns: Mapping[str, ca.SX]) -> None:
    """Gives a situation what the controller has measured, in place of the truth.

    The wrench at the control point is that of the log, in the axes of the frame.
    """
    at.known |= columns
    at.known |= {
        name.removesuffix(f".{MEASURED}"): value
        for name, value in columns.items()
        if name.endswith(f".{MEASURED}")
    }
    force = symbols["force"]
    at.applied = ca.vertcat(at.frame @ force[:3], at.frame @ force[3:])


def _objects(robot: RobotModel, task: Task, symbols: Mapping[str, ca.SX]) -> dict[str, ObjectState]:
    """The true objects, as the plant has them."""
    p, axes = symbols["tip"], ca.reshape(symbols["tip_rotation"], 3, 3)
    clock, loose = symbols["clock"], symbols["loose"]
    bodies = [name for name, shape in task.shapes.items() if shape.free]
    bases, models, carriers = moving_bases(task), mechanism_models(task), list(task.mechanisms)
    found: dict[str, ObjectState] = {}
    for i, (name, shape) in enumerate(task.shapes.items()):
        place, turned = p, axes
        if shape.free:
            start = 7 * bodies.index(name)
            place, turned = _seen_from_body(shape, loose[start : start + 7], p, axes)
        elif shape.motion is not None:
            now = bases[name].at(clock)
            place, turned = now.place(p), now.A.T @ axes
        elif shape.on is not None:
            at = symbols["mechanism_positions"][carriers.index(shape.on)]
            place, turned = models[shape.on].taken_back(at, p, axes)
        gap = kinematics.gap(robot, frames.surface(shape), place, turned)
        found[name] = ObjectState("shape", gap, effort=symbols["objects"][i])
    for i, (name, model) in enumerate(equation_models(task).items()):
        distance = model.terms(model.place(symbols["q"], p, axes), clock).distance
        kind = task.equations[name].kind
        found[name] = ObjectState(kind, distance, effort=symbols["equations"][i])
    for i, (name, bushing) in enumerate(bushing_models(task).items()):
        found[name] = ObjectState(
            "bushing",
            displacement=bushing.coordinates(p, axes),
            wrench=symbols["bushings"][6 * i : 6 * i + 6],
        )
    for i, (name, mechanism) in enumerate(task.mechanisms.items()):
        place = symbols["mechanism_positions"][i]
        travel = mechanism.lead * place if mechanism.angular else place
        effort = symbols["mechanism_efforts"][i]
        found[name] = ObjectState(mechanism.kind, coordinate=place, travel=travel, effort=effort)
    return found


def _seen_from_body(shape: Shape, pose: ca.SX, p: ca.SX, R: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The tool's pose if the loose body were where it is declared."""
    w, x, y, z = (pose[i] for i in range(3, 7))
    moved = ca.blockcat(
        [
            [1 - 2 * (y**2 + z**2), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x**2 + z**2), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x**2 + y**2)],
        ]
    )
    declared, origin = (ca.DM(value) for value in frames.pose(shape))
    back = declared @ moved.T
    return origin + back @ (p - pose[:3]), back @ R
