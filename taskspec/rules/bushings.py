"""Bushings: springs that exert nothing, whose rotations are not unique, or that are too stiff."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.expression.tree import Name, walk
from taskspec.geometry.axis import ROTATIONS
from taskspec.program.plan import TaskPlan
from taskspec.program.world.bushings import quickest
from taskspec.program.world.stiffness import RESOLVED_PHASE
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.spec import FILE
from taskspec.text.units import show

#: Closer than this to half a turn, a rotation vector is about to turn over [rad].
_NEAR = float(np.deg2rad(5.0))


@rule(
    {
        "TS336": "a bushing that exerts nothing",
        "TS337": "rotations that are not unique where the run starts",
    },
    also=("TS307",),
    phase=Phase.TASK,
)
def bushings_at_the_start(task: TaskPlan) -> Iterator[Finding]:
    """Bushings that exert nothing, are half a turn away, or that the plant does not resolve."""
    context = task.context
    J = context.start_jacobian
    mobility = J @ np.linalg.solve(context.start_inertia, J.T)
    for name, model in context.bushings.items():
        place = FILE.world[name]
        if not (model.stiffness.any() or model.damping.any()):
            yield error(
                "TS336",
                f"{name!r} has neither stiffness nor damping, and so exerts nothing",
                place.stiffness,
                "give an axis a stiffness, or leave the object out",
            )
            continue
        turn = _turn(model.rotation.T @ context.start_R)
        if model.stiffness[3:].any() and turn > np.pi - _NEAR:
            declared = context.loaded.task.bushings[name]
            yield error(
                "TS337",
                f"the tool starts {show(turn, 'deg', 3)} from how {name!r} holds it at rest: at "
                "half a turn its moment could be about any axis",
                place.rpy if "rpy" in declared.model_fields_set else place.bushing,
                "'rpy' is the orientation of the tip, which points down at [180 deg, 0, 0]",
            )
        phase = quickest(model, mobility) / context.loaded.task.control.plant_rate
        if phase > RESOLVED_PHASE:
            yield warning(
                "TS307",
                f"{name!r} is stiffer than the plant's steps resolve: {phase**2:.3g} times as "
                "stiff as they can on this arm at this rate",
                place.stiffness,
                "raise control.plant_rate, or make it softer",
            )


@rule("TS338", "an equation on rotations that is singular where the run starts", phase=Phase.TASK)
def singular_rotations(task: TaskPlan) -> Iterator[Finding]:
    """Rotation vectors near half a turn, and angles between axes that are parallel."""
    context = task.context
    for name, model in context.equations.items():
        used = [n for n in walk(model.constraint.residual.tree) if isinstance(n, Name)]
        turn = _turn(model.rotation.T @ context.start_R)
        if any(n.path[0] in ROTATIONS for n in used) and turn > np.pi - _NEAR:
            yield error(
                "TS338",
                f"the tool starts {show(turn, 'deg', 3)} from the axes in which rx, ry and rz of "
                f"{name!r} count: half a turn could be about any axis",
                FILE.world[name].equation,
                "name a 'frame' with axes such as the tool's: it points down at rpy: "
                "[180 deg, 0, 0]",
            )
        elif context.start_equations[name].singular and not _slack(task, name):
            yield error(
                "TS338",
                f"the axes of {name!r} are parallel where the tool starts: they could turn apart "
                "about any axis",
                FILE.world[name].equation,
                "state parallel axes by two rotations that are zero, rx = 0 and ry = 0 in a "
                "'frame'",
            )


def _slack(task: TaskPlan, name: str) -> bool:
    """Whether an equation holds in one direction, with room where the run starts."""
    relation = task.context.equations[name].constraint.relation
    distance = task.context.start_equations[name].distance
    return distance < 0 if relation == "<=" else relation == ">=" and distance > 0


def _turn(R: NDArray[np.float64]) -> float:
    """The angle [rad] of a rotation matrix (3, 3)."""
    return float(np.arccos(np.clip((np.trace(R) - 1) / 2, -1.0, 1.0)))
