"""Motions against what a held mechanism lets move: natural against artificial constraints.

A mechanism leaves the tool the twists T s, with one s for its coordinate and one for a free knob.
Motion axes S_v with rates v_d are consistent if S_v T s = v_d has a solution. That is a matter of
rank and of power, for the reactions do no work on T s; no axis is compared with another by angle.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from taskspec.control.state import ARM_LENGTH
from taskspec.geometry.axis import AXES, Axis
from taskspec.motion.path import PathShape
from taskspec.program.context import Context
from taskspec.program.execution.tracks import MOVE_SPEED
from taskspec.program.known import known_value
from taskspec.program.world.mechanisms import MechanismModel
from taskspec.spec import FILE, AxisEntry, key_of
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.show import show

register({"TS322": "a motion that the mechanism does not allow"})

Vector = NDArray[np.float64]

#: Share of the largest rate by which rates may differ: an axis is no more exact than a few deg.
_DIFFERS = 0.1
#: Slower than this is the rounding of a mechanism that stands still [m/s, rad/s].
_NOTHING = 1e-9


def check_yielding(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    rotation: Vector,
    path: PathShape | None,
    found: Diagnostics,
) -> None:
    """Reports constant rates of stage `name` that the mechanism which it holds does not allow.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        rotation: (3, 3) its frame at the start pose. path: its path. found: where findings go.
    """
    loaded = context.loaded
    stage = loaded.task.stages[name]
    law = context.law_of(stage)
    if not context.held or path is not None or not law.control_law.selects:
        return
    solved = _solve(context, name, axes, rotation)
    if solved is None:
        return
    wanted, scale, A, b, rows, s = solved
    moved = [a for a, rate in wanted.items() if rate]
    missing = np.abs(A @ s - b)
    worst = int(np.argmax(missing))
    if missing[worst] <= _DIFFERS * float(np.max(np.abs(b))):
        return
    axis = list(wanted)[worst]
    if found.says("TS232", loaded.span(FILE.stages[name].axes[axis])):
        return
    others = [i for i in rows if i != worst]
    if others:  # What the others ask of it, not a compromise with it.
        s = np.asarray(np.linalg.lstsq(A[others], b[others], rcond=_DIFFERS)[0])
    unit = "deg/s" if axis.is_rotation else "mm/s"
    has = float((A @ s)[worst]) / scale[axis]
    has = has if abs(has) > _NOTHING else 0.0
    asked = f"is to move with {show(wanted[axis] or 0.0, unit, 3)}" if wanted[axis] else "is held"
    free = "torque" if axis.is_rotation else "force"
    place = FILE.stages[name].axes[axis if axis in stage.axes else moved[0]]
    found.warning(
        "TS322",
        f"{axis!r} {asked}, and {context.held!r} lets it move with {show(has, unit, 3)} where the "
        "run begins: the arm works against the grip",
        loaded.span(key_of(place)),
        f"let it give way: {axis}: {{{free}: 0}}",
    )


def coordinate_rate(
    context: Context, name: str, axes: tuple[Axis, ...], rotation: Vector
) -> float | None:
    """Rate at which stage `name` moves the mechanism that it holds [rad/s, m/s].

    None where it holds none, or where no constant rate of a motion axis moves it.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        rotation: (3, 3) its frame at the start pose.
    """
    solved = _solve(context, name, axes, rotation) if context.held else None
    return None if solved is None else float(solved[-1][0])


def _solve(
    context: Context, name: str, axes: tuple[Axis, ...], rotation: Vector
) -> tuple[dict[Axis, float], dict[Axis, float], Vector, Vector, list[int], Vector] | None:
    """A s = b of the motion axes with a constant rate; None where none of them moves.

    Returns:
        The rates by axis, their scales [m], A, b, the rows of those that move, s.
    """
    stage = context.loaded.task.stages[name]
    rates = {a: _rate(context, a, stage.axes.get(a)) for a in axes}
    wanted = {a: rate for a, rate in rates.items() if rate is not None}
    moved = [a for a, rate in wanted.items() if rate]
    if not moved:
        return None
    T = _resolved_twists(context, name, rotation)
    scale = {a: ARM_LENGTH if a.is_rotation else 1.0 for a in wanted}
    A = np.array([scale[a] * T[AXES.index(a)] for a in wanted])
    b = np.array([scale[a] * rate for a, rate in wanted.items()])
    rows = [list(wanted).index(a) for a in moved]
    s = np.asarray(np.linalg.lstsq(A[rows], b[rows], rcond=_DIFFERS)[0], dtype=np.float64)
    if len(wanted) > len(moved):
        s = _with_holds(A, b, rows, s)
    return wanted, scale, A, b, rows, s


def _with_holds(A: Vector, b: Vector, rows: list[int], s: Vector) -> Vector:
    """Of all rates that give the wanted motion, those that move held axes least."""
    _, sizes, V = np.linalg.svd(A[rows])
    rank = int(np.sum(sizes > _DIFFERS * sizes[0])) if sizes[0] > 0 else 0
    free = V[rank:].T
    held = [i for i in range(len(A)) if i not in rows]
    if free.shape[1] == 0:
        return s
    more = np.linalg.lstsq(A[held] @ free, b[held] - A[held] @ s, rcond=_DIFFERS)[0]
    return np.asarray(s + free @ more)


def _rate(context: Context, axis: Axis, entry: AxisEntry | None) -> float | None:
    """The constant rate of a stiff motion axis [m/s, rad/s]; None of any other."""
    if entry is None or entry.hold is not None:
        return 0.0
    if entry.has_force or entry.follows is not None or entry.stiffness is not None:
        return None
    if entry.move is not None:
        kind = "angular" if axis.is_rotation else "linear"
        return math.copysign(entry.speed or MOVE_SPEED[kind], entry.move)
    value = None if entry.velocity is None else known_value(context, entry.velocity)
    return value if value is None or math.isfinite(value) else None


def _resolved_twists(context: Context, name: str, rotation: Vector) -> Vector:
    """(6, k) T of the held mechanism at the control point, in the axes of a stage's frame.

    A frame that turns with the handle turns held and commanded axes along, (docs/language.md);
    `hold: world` does not.
    """
    stage = context.loaded.task.stages[name]
    frame = context.frame_of(stage)
    mechanism = context.mechanisms[context.held]
    T = free_twists(mechanism, context.start_p, context.start_p + context.lever_of(frame))
    axis = mechanism.rotation[:, 2]
    if frame.mechanism is not None:
        T = T.copy()
        T[:3, 0] -= mechanism.lead * axis
    resolved = np.kron(np.eye(2), rotation.T) @ T
    if frame.mechanism is not None:
        for i, a in enumerate(AXES[3:]):
            entry = stage.axes.get(a)
            if entry is None or entry.hold != "world":
                resolved[3 + i, 0] -= float(rotation[:, i] @ axis)
    return np.asarray(resolved)


def free_twists(mechanism: MechanismModel, tip: Vector, point: Vector) -> Vector:
    """(6, k) twists of a point (3,) of the tool that a mechanism leaves free, world axes.

    The first belongs to its coordinate, a second to a free knob about the handle at `tip` (3,).
    """
    axis = mechanism.rotation[:, 2]
    turn = np.concatenate([np.cross(axis, point - mechanism.origin) + mechanism.lead * axis, axis])
    slide = np.concatenate([axis, np.zeros(3)])
    columns = [turn if mechanism.angular else slide]
    if mechanism.free:
        columns.append(np.concatenate([np.cross(axis, point - tip), axis]))
    return np.array(columns).T
