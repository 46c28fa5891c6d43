"""What the world returns to the tool: unit wrenches of contacts, equations and mechanisms."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from taskspec.control.state import ARM_LENGTH
from taskspec.deferred_methods import dataclass
from taskspec.explain.bearing import bearing, gap_at_start, moment_arms
from taskspec.explain.springs import spring_contact
from taskspec.expression.tree import Name, walk
from taskspec.program.plan import StagePlan
from taskspec.program.walk.nominal import AT_SURFACE
from taskspec.statics.resistance import gradients

Vector = NDArray[np.float64]

#: Closer than this to the normal, the face of a flat tool lies on the surface (cosine of 1 deg).
_FLUSH = np.cos(np.deg2rad(1.0))
#: Signals that something is touched.
_CONTACT_SIGNALS = ("force", "torque", "touching")
#: What is left of a constraint on joints that no wrench on the tool returns.
_OFF = 1e-6
#: Unit gradients that differ by less are one.
_STRAIGHT = 1e-6


class State(Enum):
    """Whether a contact is there while a stage lasts."""

    THERE = "there"
    MET = "met"
    MAYBE = "maybe"


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


def reactions(plan: StagePlan) -> Reactions:
    """All that the world returns to the control point as a stage begins."""
    columns: list[Vector] = []
    names: list[str] = []
    states: list[State] = []
    sides: list[int] = []
    friction: dict[str, float] = {}
    for name, state, wrench in _contacts(plan):
        columns.append(wrench)
        names.append(name)
        states.append(state)
        sides.append(1 if np.linalg.norm(wrench[:3]) > 0 else 0)
        rubs = plan.context.loaded.task.shapes[name].friction
        if rubs:
            friction[name] = rubs
    for name, wrench, side in equation_wrenches(plan):
        columns.append(wrench)
        names.append(name)
        states.append(State.THERE)
        sides.append(side)
    for wrench in _grip(plan):
        columns.append(wrench)
        names.append(plan.contacts.held)
        states.append(State.THERE)
        sides.append(0)
    W = np.array(columns).reshape(-1, 6).T
    turning = frozenset(name for name in names if _turns(plan, name))
    return Reactions(W, tuple(names), tuple(states), tuple(sides), friction, turning)


def _turns(plan: StagePlan, name: str) -> bool:
    """Whether the direction of an object changes as the tool moves in a stage's frame."""
    context, frame = plan.context, plan.frame
    if name in context.surfaces:
        return not context.surfaces[name].flat and frame.surface_name != name
    if name in context.equations:
        model = context.equations[name]
        return not model.joints and np.ptp(gradients(context, model), axis=1).max() > _STRAIGHT
    mechanism = context.mechanisms[name]
    way, _ = mechanism.open_ways(context.start_p + plan.kinematics.lever)
    return mechanism.angular and frame.mechanism is None and bool(np.any(way))


def _contacts(plan: StagePlan) -> Iterator[tuple[str, State, Vector]]:
    """Shapes: along the normal, and under the face of a flat tool about two axes across it."""
    on = bearing(plan)
    for i, name in enumerate(on.names):
        state = _state(plan, name)
        if state is None:
            continue
        normal = on.normals[:, i]
        yield name, state, moment_arms(plan, normal)
        down = plan.rotation.T @ plan.context.start_R[:, 2]
        if plan.context.robot.tool.flat and abs(float(down @ normal)) > _FLUSH:
            for across in np.linalg.svd(normal[None, :])[2][1:]:
                yield name, state, np.concatenate([np.zeros(3), across])


def _state(plan: StagePlan, name: str) -> State | None:
    """Whether a contact is there; None for one that the stage stays away from."""
    pressed = spring_contact(plan)
    forces = any(p.set_point and not a.is_rotation for a, p in plan.plans.items())
    if forces or (pressed is not None and pressed.name == name):
        return State.THERE
    gap = gap_at_start(plan)
    apart = gap is not None and gap > AT_SURFACE
    if (gap is None or apart) and name == plan.contacts.approached and _waits_for_touch(plan, name):
        return State.MET
    return None if apart else State.MAYBE


def _waits_for_touch(plan: StagePlan, name: str) -> bool:
    """Whether a stage moves towards an object until something is measured there."""
    until, rates = plan.spec.until, np.zeros(3)
    for axis in plan.translations:
        entry = plan.spec.axes.get(axis)
        if entry is not None and entry.mode.moves:
            rates[axis.row] = entry.mode.settled_rate(plan.known) or 0.0
    closing = -float(plan.contacts.normal(name) @ plan.rotation @ np.nan_to_num(rates))
    names = [] if until is None else [n.path[0] for n in walk(until.tree) if isinstance(n, Name)]
    return closing > 0 and any(each in _CONTACT_SIGNALS for each in names)


def equation_wrenches(plan: StagePlan) -> Iterator[tuple[str, Vector, int]]:
    """Gradients of the equations where the run begins, and the side on which they let pass."""
    context = plan.context
    J = np.kron(np.eye(2), plan.rotation.T) @ context.start_jacobian
    J[:3] += np.cross(J[3:], plan.rotation.T @ plan.kinematics.lever, axis=0)
    for name, model in context.equations.items():
        gradient = context.start_equations[name].normal
        wrench, *_ = np.linalg.lstsq(J.T, gradient, rcond=1e-9)
        left = np.linalg.norm(J.T @ wrench - gradient)
        if left > _OFF * np.linalg.norm(gradient):
            continue
        side = {"=": 0, "<=": -1, ">=": 1}[model.constraint.relation]
        if side and name not in plan.active:
            continue
        yield name, np.where(np.abs(wrench) > 1e-9, wrench, 0.0), side


def _grip(plan: StagePlan) -> Iterator[Vector]:
    """What a held mechanism returns: the wrenches that do no work on its free twists."""
    T = mechanism_twists(plan)
    if T is None:
        return
    scale = np.array([1.0] * 3 + [ARM_LENGTH] * 3)
    _, sizes, V = np.linalg.svd((scale[:, None] * T).T)
    for row in V[int(np.sum(sizes > 1e-9 * sizes[0])) :]:
        yield row * scale


def mechanism_twists(plan: StagePlan) -> Vector | None:
    """(6, k) free twists of the held mechanism at the control point, in the stage's axes."""
    context = plan.context
    if not plan.contacts.held:
        return None
    point = context.start_p + plan.kinematics.lever
    T = context.mechanisms[plan.contacts.held].free_twists(context.start_p, point)
    return np.asarray(np.kron(np.eye(2), plan.rotation.T) @ T)
