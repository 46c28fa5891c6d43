"""The true signals of logged ticks: the formulas of the table, told what the plant has written."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control.reference import opposite
from taskspec.geometry.axis import AXES
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.world import frames, kinematics
from taskspec.program.world.equations import equation_models
from taskspec.program.world.moving_base import moving_bases
from taskspec.robot import RobotModel
from taskspec.signals import ObjectState, Pose, Situation
from taskspec.spec import Shape, Task

Vector = NDArray[np.float64]

#: What is not on the bus under this name: what the robot applies at the tip.
_APPLIED = "applied"


class Truth:
    """Signals that the controller does not put out, or not as they truly are.

    The wrench is that of the tick's own step, and every distance is taken to the true objects. A
    shape that moves is where the clock has it, a loose body where the plant has it. From an
    equation the distance is r / |r_x|, to first order that from the constraint.

    Attributes:
        names: of the signals, in the order of their rows.
    """

    def __init__(
        self,
        robot: RobotModel,
        task: Task,
        stages: Sequence[CompiledStage],
        sizes: Mapping[str, int],
        names: Sequence[str],
    ) -> None:
        """Compiles the formulas.

        Args:
            robot: for its tool. task: with the true world. stages: of the program.
            sizes: of the bus's fields. names: of the signals.
        """
        self.names = tuple(names)
        symbols = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
        symbols[_APPLIED] = ca.SX.sym(_APPLIED, 6)
        objects = _objects(robot, task, symbols)
        kinds = [(stage.plan.axes, stage.plan.gap_contact) for stage in stages]
        distinct = list(dict.fromkeys(kinds))
        #: Number of the function of each stage.
        self._of_stage = np.array([distinct.index(kind) for kind in kinds])
        nothing = ca.SX(np.nan)
        self._functions: list[tuple[ca.Function, tuple[str, ...]]] = []
        for axes, contact in distinct:
            at = _situation(symbols, objects)
            at.axes, at.contact = axes, contact
            found = [at.signal(*name.split(".")) for name in names]
            values = ca.densify(ca.vertcat(*(nothing if x is None else x for x in found)))
            # Handing over what no signal depends on would take most of the time.
            used = {name: x for name, x in symbols.items() if ca.depends_on(values, x)}
            function = ca.Function("truth", list(used.values()), [values])
            self._functions.append((function, tuple(used)))

    def __call__(self, field: Callable[[str], Vector]) -> Vector:
        """(names, ticks) values, from the bus's fields by name, (size, ticks) each.

        A zero has no sign in them.
        """

        def look(name: str) -> Vector:
            return opposite(field("wrench")) if name == _APPLIED else field(name)

        number = self._of_stage[field("stage")[0].astype(int)]
        first = int(number[0])
        if (number == first).all():
            function, used = self._functions[first]
            return np.array(function(*(look(name) for name in used))) + 0.0
        values = np.empty((len(self.names), len(number)))
        for each in np.unique(number):
            here = number == each
            function, used = self._functions[each]
            values[:, here] = np.array(function(*(look(name)[:, here] for name in used)))
        return values + 0.0


def _situation(symbols: Mapping[str, ca.SX], objects: Mapping[str, ObjectState]) -> Situation:
    """The tool in its stage's frame, in world axes."""
    applied, offset = symbols[_APPLIED], symbols["offset"]
    force = applied[:3]
    tip = Pose(symbols["tip"], ca.reshape(symbols["tip_rotation"], 3, 3))
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
        torque=symbols["torque"],
        objects=objects,
        known={f"velocity.{axis}": symbols["velocity"][axis.row] for axis in AXES},
    )


def _objects(robot: RobotModel, task: Task, symbols: Mapping[str, ca.SX]) -> dict[str, ObjectState]:
    """The true objects, as the plant has them."""
    p, axes = symbols["tip"], ca.reshape(symbols["tip_rotation"], 3, 3)
    clock, loose = symbols["clock"], symbols["loose"]
    bodies = [name for name, shape in task.shapes.items() if shape.free]
    bases = moving_bases(task)
    found: dict[str, ObjectState] = {}
    for i, (name, shape) in enumerate(task.shapes.items()):
        place, turned = p, axes
        if shape.free:
            start = 7 * bodies.index(name)
            place, turned = _seen_from_body(shape, loose[start : start + 7], p, axes)
        elif shape.motion is not None:
            now = bases[name].at(clock)
            place, turned = now.place(p), now.A.T @ axes
        gap = kinematics.gap(robot, frames.surface(shape), place, turned)
        found[name] = ObjectState("shape", gap, effort=symbols["objects"][i])
    for i, (name, model) in enumerate(equation_models(task).items()):
        x = symbols["q"] if model.joints else p
        distance = model.terms(x, ca.SX.zeros(x.shape[0]), clock).distance
        kind = task.equations[name].kind
        found[name] = ObjectState(kind, distance, effort=symbols["equations"][i])
    for i, (name, mechanism) in enumerate(task.mechanisms.items()):
        place = symbols["mechanism_positions"][i]
        way = mechanism.lead * place if mechanism.angular else place
        effort = symbols["mechanism_efforts"][i]
        found[name] = ObjectState(mechanism.kind, coordinate=place, way=way, effort=effort)
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
