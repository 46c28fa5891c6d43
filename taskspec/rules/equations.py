"""Constraint equations at the start: regular, kept, independent of each other (4.80), (4.101)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.program.context import Context
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.world.equations import StartEquation
from taskspec.program.world.stiffness import equation_mass
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.signals.entries import TOUCHING
from taskspec.spec import FILE, KeyPath, key_of
from taskspec.text.units import FORCE, LENGTH, VELOCITY, Dimension, show

#: A constraint: what it is, its place, and its (n,) normal on the joints' rates.
Row = tuple[str, KeyPath, NDArray[np.float64]]

#: Below this length a gradient, in its own units, is none.
_FLAT = 1e-9
#: Smallest singular value of unit normals, on joints' rates, that are told apart.
_DEPENDENT = 1e-3


@rule(
    {
        "TS311": "an equation without a gradient",
        "TS312": "a start off a constraint",
        "TS341": "a start off an exact equation",
        "TS342": "an exact equation that moves as the run begins",
    },
    also=("TS117",),
    phase=Phase.TASK,
)
def equations_at_the_start(task: TaskPlan) -> Iterator[Finding]:
    """Equations that have no gradient at the start, or that the start does not keep."""
    context = task.context
    for name, at in context.start_equations.items():
        model = context.equations[name]
        place = FILE.world[name].equation
        what = "joints start" if model.joints else "tool starts"
        if not (np.isfinite(at.distance) and np.isfinite(at.normal).all()):
            yield error("TS117", f"this has no finite value where the {what}", place)
            continue
        if at.scale < _FLAT:
            yield error(
                "TS311",
                f"{name!r} has no gradient where the {what}, so no direction to push in",
                place,
                "start elsewhere, or state the same constraint by a regular equation",
            )
            continue
        if context.compliances[name].exact:
            yield from _begins_with_a_blow(task, name, at, what)
            continue
        broken = {"=": True, "<=": at.distance > 0, ">=": at.distance < 0}
        force = abs(at.distance) * context.compliances[name].stiffness
        if broken[model.constraint.relation] and force > TOUCHING:
            off = show(abs(at.distance), LENGTH.on(rotation=model.angular))
            effort = show(force, FORCE.on(rotation=model.angular), 3)
            yield warning(
                "TS312",
                f"the {what} {off} off {name!r}: the run begins with {effort} of it",
                FILE.robot.start,
                "start on the constraint",
            )


def _begins_with_a_blow(
    task: TaskPlan, name: str, at: StartEquation, what: str
) -> Iterator[Finding]:
    """An exact equation that the state of the start, at rest, does not keep.

    The plant's first step would bring the mass along the gradient onto it, and its second stop it.
    """
    context, place = task.context, FILE.world[name].equation
    angular, period = context.equations[name].angular, 1.0 / context.loaded.task.control.plant_rate
    mass = equation_mass(context.equations[name], context.robot, context.start)

    def text(value: float, dimension: Dimension) -> str:
        return show(value, dimension.on(rotation=angular), 3)

    if mass * abs(at.distance) / period**2 > TOUCHING:
        yield error(
            "TS341",
            f"the {what} {text(abs(at.distance), LENGTH)} off {name!r}, which holds exactly: its "
            f"first step would take {text(mass * abs(at.distance) / period**2, FORCE)}",
            place,
            "start on it, or have its numbers follow from the start, to all digits",
        )
    if mass * abs(at.rate) / period > TOUCHING:
        yield error(
            "TS342",
            f"{name!r}, which holds exactly, moves at {text(abs(at.rate), VELOCITY)} as the run "
            f"begins, and the arm rests: its first step would take "
            f"{text(mass * abs(at.rate) / period, FORCE)}",
            place,
            "have it begin at rest, such as 10 mm * (1 - cos(2*pi*clock*1 Hz))",
        )


@rule({}, also=("TS313",), phase=Phase.TASK)
def dependent_exact_equations(task: TaskPlan) -> Iterator[Finding]:
    """Exact equations that say the same as others, or more than the arm has, under any law."""
    yield from _dependent(_exact(task.context))


def _exact(context: Context) -> list[Row]:
    """The exact equations of a task; none where one of them has no gradient, as its rule says."""
    found = [(n, context.start_equations[n]) for n, c in context.compliances.items() if c.exact]
    if any(at.scale < _FLAT for _, at in found):
        return []
    return [(repr(name), FILE.world[name].equation, at.normal) for name, at in found]


@rule("TS313", "constraints that depend on each other", phase=Phase.AXES)
def dependent_constraints(stage: StagePlan) -> Iterator[Finding]:
    """Constraints that say the same as others, or more than the arm has."""
    context = stage.context
    if not stage.law.control_law.multipliers:
        return
    if any(True for _ in _dependent(_exact(context))):
        return  # It is so under any law.
    J = np.kron(np.eye(2), stage.rotation.T) @ context.start_jacobian
    own = FILE.stages[stage.name]
    rows: list[Row] = [
        (f"axis {a!r}", own.axes[a], J[a.row])
        for a, axis in stage.spec.axes.items()
        if a in stage.axes and axis.has_force
    ]
    for equation in stage.active:
        at = context.start_equations[equation]
        if at.scale < _FLAT:
            return  # The rule about the equation itself says so.
        place = own.constraints[equation] if equation in stage.spec.constraints else own
        rows.append((repr(equation), place, at.normal))
    yield from _dependent(rows)


def _dependent(rows: Sequence[Row]) -> Iterator[Finding]:
    """The first row that follows from those before it, or along which the arm cannot move."""
    kept: list[NDArray[np.float64]] = []
    for row, place, normal in rows:
        size = float(np.linalg.norm(normal))
        if size < _FLAT:
            yield error(
                "TS313",
                f"the arm cannot move along the normal of {row}, so no force can be set there",
                key_of(place),
                "leave it out",
            )
            return
        unit = normal / size
        if np.linalg.svd(np.array([*kept, unit]), compute_uv=False)[-1] < _DEPENDENT:
            before = ", ".join(text for text, *_ in rows[: len(kept)])
            yield error(
                "TS313",
                f"the constraint of {row} follows from those before it ({before}), so their forces "
                "cannot be distinguished",
                key_of(place),
                "leave one of them out",
            )
            return
        kept.append(unit)
