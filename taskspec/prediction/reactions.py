"""What the world returns to the tool: unit wrenches of contacts, equations and mechanisms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from taskspec.control.state import ARM_LENGTH
from taskspec.deferred_methods import dataclass
from taskspec.prediction.at_start import StageAtStart
from taskspec.prediction.reach import bearing, moment_arms
from taskspec.prediction.types import StagePrediction, State
from taskspec.program.walk.nominal import AT_SURFACE
from taskspec.statics.resistance import gradients

Vector = NDArray[np.float64]

#: Closer than this to the normal, the face of a flat tool lies on the surface (cosine of 1 deg).
_FLUSH = np.cos(np.deg2rad(1.0))
#: What is left of a constraint on joints that no wrench on the tool returns.
_OFF = 1e-6
#: Unit gradients that differ by less are one.
_STRAIGHT = 1e-6


@dataclass(frozen=True, slots=True)
class Reactions:
    """Unit wrenches that the world returns.

    Attributes:
        W: (6, r) in the stage's axes.
        names: (r,) what returns each.
        states: (r,).
        sides: (r,) the velocity's sign that it lets pass along its column, 0 for none.
        friction: by object.
        turning: objects whose direction changes in the stage's axes.
    """

    W: Vector
    names: tuple[str, ...]
    states: tuple[State, ...]
    sides: tuple[int, ...]
    friction: Mapping[str, float] = field(default_factory=dict)
    turning: frozenset[str] = frozenset()


def reactions(here: StageAtStart, predicted: StagePrediction) -> Reactions:
    """All that the world returns to the control point as a stage begins.

    Args:
        here: the stage.
        predicted: what it is expected to do.
    """
    columns: list[Vector] = []
    names: list[str] = []
    states: list[State] = []
    sides: list[int] = []
    friction: dict[str, float] = {}
    for name, state, wrench in _contacts(here, predicted):
        columns.append(wrench)
        names.append(name)
        states.append(state)
        sides.append(1 if np.linalg.norm(wrench[:3]) > 0 else 0)
        rubs = here.context.loaded.task.shapes[name].friction
        if rubs:
            friction[name] = rubs
    for name, wrench, side in equation_wrenches(here):
        columns.append(wrench)
        names.append(name)
        states.append(State.THERE)
        sides.append(side)
    for wrench in _grip(here):
        columns.append(wrench)
        names.append(here.stage.plan.contacts.held)
        states.append(State.THERE)
        sides.append(0)
    W = np.array(columns).reshape(-1, 6).T
    turning = frozenset(name for name in names if _turns(here, name))
    return Reactions(W, tuple(names), tuple(states), tuple(sides), friction, turning)


def _turns(here: StageAtStart, name: str) -> bool:
    """Whether the direction of an object changes as the tool moves in a stage's frame."""
    context, frame = here.context, here.stage.plan.frame
    if name in context.surfaces:
        return not context.surfaces[name].flat and frame.surface_name != name
    if name in context.equations:
        model = context.equations[name]
        return not model.joints and np.ptp(gradients(context, model), axis=1).max() > _STRAIGHT
    mechanism = context.mechanisms[name]
    way, _ = mechanism.open_ways(context.start_p + here.stage.plan.kinematics.lever)
    return mechanism.angular and frame.mechanism is None and bool(np.any(way))


def _contacts(
    here: StageAtStart, predicted: StagePrediction
) -> Iterator[tuple[str, State, Vector]]:
    """Shapes: along the normal, and under the face of a flat tool about two axes across it."""
    on = bearing(here)
    for i, name in enumerate(on.names):
        state = _state(here, predicted, name)
        if state is None:
            continue
        normal = on.normals[:, i]
        yield name, state, moment_arms(here, normal)
        down = here.rotation.T @ here.context.start_R[:, 2]
        if here.context.robot.tool.flat and abs(float(down @ normal)) > _FLUSH:
            for across in np.linalg.svd(normal[None, :])[2][1:]:
                yield name, state, np.concatenate([np.zeros(3), across])


def _state(here: StageAtStart, predicted: StagePrediction, name: str) -> State | None:
    """Whether a contact is there; None for one that the stage stays away from."""
    if name in predicted.depths or any(
        p.set_point and not a.is_rotation for a, p in here.stage.plan.plans.items()
    ):
        return State.THERE
    if predicted.impact is not None and predicted.impact.contact == name:
        return State.MET
    return None if here.gap is not None and here.gap > AT_SURFACE else State.MAYBE


def equation_wrenches(here: StageAtStart) -> Iterator[tuple[str, Vector, int]]:
    """Gradients of the equations where the run begins, and the side on which they let pass."""
    context = here.context
    J = np.kron(np.eye(2), here.rotation.T) @ context.start_jacobian
    J[:3] += np.cross(J[3:], here.rotation.T @ here.stage.plan.kinematics.lever, axis=0)
    for name, model in context.equations.items():
        gradient = context.start_equations[name].normal
        wrench, *_ = np.linalg.lstsq(J.T, gradient, rcond=1e-9)
        left = np.linalg.norm(J.T @ wrench - gradient)
        if left > _OFF * np.linalg.norm(gradient):
            continue
        side = {"=": 0, "<=": -1, ">=": 1}[model.constraint.relation]
        if side and name not in here.stage.plan.active:
            continue
        yield name, np.where(np.abs(wrench) > 1e-9, wrench, 0.0), side


def _grip(here: StageAtStart) -> Iterator[Vector]:
    """What a held mechanism returns: the wrenches that do no work on its free twists."""
    T = mechanism_twists(here)
    if T is None:
        return
    scale = np.array([1.0] * 3 + [ARM_LENGTH] * 3)
    _, sizes, V = np.linalg.svd((scale[:, None] * T).T)
    for row in V[int(np.sum(sizes > 1e-9 * sizes[0])) :]:
        yield row * scale


def mechanism_twists(here: StageAtStart) -> Vector | None:
    """(6, k) free twists of the held mechanism at the control point, in the stage's axes."""
    context = here.context
    if not here.stage.plan.contacts.held:
        return None
    point = context.start_p + here.stage.plan.kinematics.lever
    T = context.mechanisms[here.stage.plan.contacts.held].free_twists(context.start_p, point)
    return np.asarray(np.kron(np.eye(2), here.rotation.T) @ T)
