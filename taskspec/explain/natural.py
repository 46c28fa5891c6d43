"""Natural constraints of a stage: what contacts, equations and mechanisms impose on each axis.

The world can return wrenches f = W phi at the control point and lets the tool move with W^T v = 0.
With W^T brought to R = (1 | C), the identity on as many axes as it has rows, every axis has one
natural constraint: on those axes the velocity is decided, on the others the force,

    v_i = -sum_j C_ij v_j,        f_j = sum_i C_ij f_i + s_j Q,

where Q is what the held mechanism takes along its coordinate and s_j how that goes with v_j. Which
axes these are is free where directions lie between them; those with a force are taken first.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taskspec.control.state import ARM_LENGTH
from taskspec.deferred_methods import dataclass
from taskspec.explain.reactions import Reactions, State, mechanism_twists, reactions
from taskspec.geometry.axis import Axis
from taskspec.program.plan import StagePlan

Vector = NDArray[np.float64]

#: Share of a direction below which it is none: a contact's is no more exact than 1 deg, that of a
#: mechanism or an equation is as its geometry has it: the pitch of a thread is a small one.
_INEXACT, _NONE = float(np.sin(np.deg2rad(1.0))), 1e-6
#: A row of constraints that others make up leaves no more than this of itself.
_NOTHING = 1e-9


@dataclass(frozen=True, slots=True)
class Natural:
    """What the world imposes on one axis.

    Attributes:
        axis: of the stage's frame.
        decides: `velocity` or `force`.
        terms: (axis, factor) of the sum that it equals; none for zero.
        by: the object, equation or mechanism; empty where there is nothing.
        state: whether that is tplan.
        pushes: the sign of the velocity that it lets pass; 0 if none.
        friction: coefficient with which it rubs along this axis.
        against: the axis whose force presses there; empty without friction.
        effort: factor of the mechanism's own force or moment in the sum.
        springs: bushings that return what the displacement takes, on an axis whose force they
            decide.
        turns: the direction is that where the stage, or the run, begins, and changes on the way.
    """

    axis: Axis
    decides: str
    terms: tuple[tuple[Axis, float], ...] = ()
    by: str = ""
    state: State = State.THERE
    pushes: int = 0
    friction: float = 0.0
    against: str = ""
    effort: float = 0.0
    springs: tuple[str, ...] = ()
    turns: bool = False


def natural(plan: StagePlan) -> tuple[Natural, ...]:
    """One constraint for each axis of a stage, as it begins."""
    rows = reactions(plan)
    axes = plan.axes
    index = [a.row for a in axes]
    wanted = [a for a in axes if plan.plans[a].set_point]
    pivots, R, mixed = reduced(rows.W[index].T, axes, wanted)
    effort = _efforts(plan, pivots, R)
    decided = [
        _decided(plan, axes[p], i, R, mixed, rows) for i, p in enumerate(pivots)
    ]  # fmt: skip
    found = {one.axis: one for one in decided}
    for j, axis in enumerate(axes):
        if axis not in found:
            factors = {one.axis: float(R[i, j]) for i, one in enumerate(decided)}
            found[axis] = _free(plan, axis, factors, decided, rows, effort.get(axis, 0.0))
    return tuple(
        replace(one, springs=plan.environment.springs(axis)) if one.decides == "force" else one
        for axis in axes
        for one in (found[axis],)
    )


def _decided(
    plan: StagePlan, axis: Axis, i: int, R: Vector, mixed: Vector, rows: Reactions
) -> Natural:
    """An axis whose velocity the world decides."""
    row = int(np.argmax(np.abs(mixed[i])))
    terms = {a: -float(c) for a, c in zip(plan.axes, R[i], strict=True) if a != axis}
    side = int(np.sign(mixed[i, row])) * rows.sides[row]
    name = rows.names[row]
    return Natural(
        axis, "velocity", _kept(axis, terms, _least(plan, name)), name, rows.states[row], side,
        turns=name in rows.turning,
    )  # fmt: skip


def _free(
    plan: StagePlan,
    axis: Axis,
    factors: Mapping[Axis, float],
    decided: Sequence[Natural],
    rows: Reactions,
    effort: float,
) -> Natural:
    """An axis whose force the world decides: by ratio, by friction, by what a mechanism takes."""
    terms: tuple[tuple[Axis, float], ...] = ()
    for one in decided:
        own = {one.axis: factors[one.axis]}
        terms += _kept(axis, own, _least(plan, one.by), forces=True)
    rubs = 0.0
    pressing = {one.by: one for one in decided if not one.axis.is_rotation}
    by = max(terms, key=lambda term: abs(term[1]))[0] if terms else ""
    source = next((one for one in decided if one.axis == by), None)
    if source is None and not axis.is_rotation:
        source = next((pressing[o] for o in rows.friction if o in pressing), None)
    if source is not None and not axis.is_rotation:
        rubs = rows.friction.get(source.by, 0.0)
    if effort:
        return Natural(axis, "force", terms, plan.contacts.held, effort=effort)
    if source is None:
        return Natural(axis, "force")
    return Natural(
        axis, "force", terms, source.by, source.state,
        friction=rubs, against=source.axis if rubs else "",
    )  # fmt: skip


def _kept(
    axis: Axis, terms: Mapping[Axis, float], least: float, *, forces: bool = False
) -> tuple[tuple[Axis, float], ...]:
    """The terms of a sum of velocities, or of forces, that are more than the least share."""
    way = -1 if forces else 1
    return tuple(
        (a, c) for a, c in terms.items() if abs(c) * (_size(axis) / _size(a)) ** way > least
    )


def _least(plan: StagePlan, name: str) -> float:
    return _INEXACT if name in plan.context.surfaces else _NONE


def _size(axis: Axis) -> float:
    """What a velocity along or about an axis counts: a turn by its way at an arm's length [m]."""
    return ARM_LENGTH if axis.is_rotation else 1.0


def reduced(
    A: Vector, axes: Sequence[Axis], wanted: Sequence[Axis] = ()
) -> tuple[list[int], Vector, Vector]:
    """Rows of constraints with the identity on some of the axes, by Gauss and Jordan.

    Args:
        A: (k, m) rows on the velocities of m axes.
        axes: their names.
        wanted: those that are to be decided rather than others.

    Returns:
        The r decided axes by number, (r, m) R, and (r, k) what R is made of, R = mixed A.
    """
    A, mixed = A.astype(float), np.eye(len(A))
    scale = np.array([1 / _size(a) for a in axes])
    wants = np.array([2.0 if a in wanted else 1.0 for a in axes])
    pivots: list[int] = []
    done: list[int] = []
    while len(done) < len(A):
        rest = [i for i in range(len(A)) if i not in done]
        sizes = np.linalg.norm(A[rest] * scale, axis=1, keepdims=True)
        weight = np.abs(A[rest]) * scale / np.maximum(sizes, 1e-300) * (sizes > _NOTHING)
        weight[:, pivots] = 0.0
        best = np.unravel_index(int(np.argmax(weight * wants)), weight.shape)
        if weight[best] < _NONE:
            break
        i, j = rest[int(best[0])], int(best[1])
        mixed[i] /= A[i, j]
        A[i] /= A[i, j]
        for other in range(len(A)):
            if other != i:
                mixed[other] -= A[other, j] * mixed[i]
                A[other] -= A[other, j] * A[i]
        pivots.append(j)
        done.append(i)
    return pivots, A[done], mixed[done]


def _efforts(plan: StagePlan, pivots: Sequence[int], R: Vector) -> dict[Axis, float]:
    """s_j: rate of the held mechanism's coordinate per velocity of each axis that is left free."""
    T, axes = mechanism_twists(plan), plan.axes
    if T is None:
        return {}
    T = T[[a.row for a in axes]]
    found = {}
    for j, axis in enumerate(axes):
        if j in pivots:
            continue
        twist = np.zeros(len(axes))
        twist[j] = 1.0
        for i, p in enumerate(pivots):
            twist[p] = -R[i, j]
        s, *_ = np.linalg.lstsq(T, twist, rcond=1e-9)
        found[axis] = float(s[0]) if abs(s[0]) > 1e-9 else 0.0
    return found
