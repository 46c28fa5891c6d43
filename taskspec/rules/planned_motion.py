"""Planned motions against natural constraints: into a surface, off an equation, (4.101)."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.axes import MOSTLY
from taskspec.program.plan import StagePlan
from taskspec.program.world.equations import EquationModel
from taskspec.rules import Finding, rule, warning
from taskspec.rules.places import motion_of
from taskspec.signals.entries import TOUCHING
from taskspec.text.units import show

Vector = NDArray[np.float64]

#: A planned motion may leave an equation by this much [m]: a spline does so between its points.
_OFF = 1e-3
#: Share of a gradient along axes that give way, from which the constraint decides about them.
_DECIDED = 0.1
#: Below this length, against that at the start, a gradient is none.
_FLAT = 1e-3


@rule("TS321", "a motion into a surface", predicts=("TS321",))
def motions_into_a_surface(stage: StagePlan) -> Iterator[Finding]:
    """Motion axes that lead into the nominal contact, and how hard they press."""
    contact, walked = stage.contacts.main, stage.nominal
    if not _way(stage) or contact is None or walked.gap is None or walked.start is None:
        return
    if stage.frame.at_origin or not stage.translations:
        return
    if stage.context.loaded.task.shapes[contact].on is not None:
        return  # It goes on its mechanism's way: what then resists the trial shows.
    normal = stage.contacts.normal(contact)
    along = {a: abs(float(walked.rotation[:, a.column] @ normal)) for a in stage.translations}
    axis = max(along, key=lambda a: along[a])
    entry = stage.spec.axes.get(axis)
    if along[axis] < MOSTLY or any(e.has_force for e in stage.spec.axes.values()):
        return
    depths = [-walked.gap - float(normal @ (p - walked.start)) for p in walked.lasting()]
    depth, begun = max(depths), -walked.gap
    if depth <= max(0.0, begun) or (entry is not None and entry.stiffness is not None):
        return
    own = stage.spring_of(axis)
    k = stage.environment.stiffness
    force = depth * own * k / (own + k)
    if force > TOUCHING:
        yield warning(
            "TS321",
            f"stage {stage.name!r} moves {show(depth, 'mm', 3)} into {contact!r}: the motion does "
            f"not give way there, and presses with about {show(force, 'N', 2)}",
            motion_of(stage),
            f"shorten the way, give {axis!r} a force, or move until one is measured",
        )


@rule(
    {
        "TS323": "a motion that leaves a constraint",
        "TS324": "a motion to where a constraint has no gradient",
    },
    predicts=("TS323", "TS324"),
)
def motions_off_an_equation(stage: StagePlan) -> Iterator[Finding]:
    """Ways that leave an equation which holds, or on which one has no gradient: the first place.

    What a law with multipliers leaves to the constraints gives way: axes that the stage does not
    name. An equation along whose gradient they can move is kept whatever the others do.
    """
    way = _way(stage)
    if not way:
        return
    path, equations = stage.path, stage.context.equations
    free = [
        stage.nominal.rotation[:, a.column]
        for a in stage.translations
        if stage.law.control_law.multipliers
        and a not in stage.spec.axes
        and (path is None or a not in path.axes)
    ]
    for equation, model in equations.items():
        finding = None
        if not (model.joints or model.turns or model.moves):
            finding = _off(stage, equation, model, way, free)
        if finding is not None:
            yield finding


def _off(
    stage: StagePlan,
    equation: str,
    model: EquationModel,
    way: list[tuple[float, Vector]],
    free: list[Vector],
) -> Finding | None:
    x = ca.SX.sym("x", 3)
    terms = model.terms(x, ca.SX(0))
    at = ca.Function("at", [x], [terms.distance, terms.normal, terms.scale])
    least = _FLAT * stage.context.start_equations[equation].scale
    both = model.constraint.relation == "=" or equation in stage.active
    for time, p in way:
        distance, normal, scale = (np.array(v).ravel() for v in at(p))
        if not np.isfinite(distance[0]) or scale[0] < least:
            return warning(
                "TS324",
                f"stage {stage.name!r} leads at t = {show(time, 's', 3)} to where {equation!r} has "
                "no gradient, so no direction to push in",
                motion_of(stage),
                "keep away from there, or state the same constraint by a regular equation",
            )
        off = float(distance[0])
        wrong = {"<=": off > 0, ">=": off < 0}.get(model.constraint.relation, True)
        decided = any(abs(float(normal @ direction)) > _DECIDED for direction in free)
        if abs(off) <= _OFF or not (both or wrong) or decided:
            continue
        if time > 0.0:  # A stage that starts off it does not leave it.
            return warning(
                "TS323",
                f"stage {stage.name!r} leaves {equation!r}: at t = {show(time, 's', 3)} it would "
                f"be {show(abs(off), 'mm', 3)} {'off' if both else 'beyond'} it",
                motion_of(stage),
                "plan a motion that keeps the equation, phi(q_d(t)) = 0 (4.101)",
            )
    return None


def _way(stage: StagePlan) -> list[tuple[float, Vector]]:
    """Times [s] and places of the tip (3,) on the planned way of a stiff motion; else none."""
    stiff = stage.law.control_law.selects and stage.spec.until is None
    return stage.nominal.way() if stiff else []
