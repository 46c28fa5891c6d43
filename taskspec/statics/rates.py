"""Velocities of a stage, as rows: those asked for, and how fast arm and tip may go."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, Axis
from taskspec.program.plan import StagePlan
from taskspec.program.trajectory import Place
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.spec import FILE
from taskspec.statics.rows import RowCause, RowSystem, kept, limit_place, shares_of
from taskspec.text import units
from taskspec.text.units import show

Vector = NDArray[np.float64]

VELOCITY = "velocity limit"


def motion(stage: StagePlan, place: Place) -> tuple[RowSystem, Vector]:
    """The rows of a stage's velocities at a place with known joint positions, and rates for them.

    Args:
        stage: the stage.
        place: where; its `rates` are what is asked for.
    """
    assert place.q is not None
    robot, shares = stage.context.robot, shares_of(stage)
    J = robot.twin().resolved_jacobian(place.q)
    inside = np.kron(np.eye(2), place.rotation.T) @ J
    system = RowSystem(len(place.q))
    for axis, rate in place.rates.items():
        system.add(inside[axis.row], rate, rate, _cause(stage, axis, place.rates))
    speed = stage.limits.speed
    v = place.rotation @ [place.rates.get(a, 0.0) for a in AXES[:3]]
    size = float(np.linalg.norm(v))
    if speed is not None and size > 0:
        text = f"limits.speed, {show(speed, units.VELOCITY)}{kept(shares.speed)}"
        cause = RowCause("limit", text, limit_place(stage, "speed"), "raise the limit")
        system.add(v / size @ J[:3], -shares.speed * speed, shares.speed * speed, cause)
    for i, most in enumerate(robot.velocity_limit):
        if not np.isfinite(most):
            continue
        limit = units.VELOCITY.on(rotation=turns_at(robot, i))
        text = f"joint {i + 1} ({show(float(most), limit, 3)}{kept(shares.velocity)})"
        cause = RowCause(VELOCITY, text, None, "start in another posture")
        fastest = shares.velocity * most
        system.add(np.eye(len(place.q))[i], -fastest, fastest, cause)
    rows = [a.row for a in place.rates]
    rates = np.array(list(place.rates.values()))
    return system, np.linalg.lstsq(inside[rows], rates, rcond=None)[0]


def _cause(stage: StagePlan, axis: Axis, rates: Mapping[Axis, float]) -> RowCause:
    """What the velocity of an axis comes from: its own entry, the path, or nothing at all."""
    own, path = FILE.stages[stage.name], stage.spec.path
    entry, turns = stage.spec.axes.get(axis), axis.is_rotation
    dimension = axis.of(units.VELOCITY)
    if entry is not None and entry.mode.moves:
        text = f"{show(rates[axis], dimension, 3)} {'about' if turns else 'along'} {axis!r}"
        return RowCause(
            "velocity", text, own.axes[axis][entry.mode.pace], "move slower", rates[axis], dimension
        )
    if path is None or entry is not None or rates[axis] == 0:
        return RowCause("hold", repr(axis), None, "")
    others = [
        rate for a, rate in rates.items() if a not in stage.spec.axes and a.is_rotation == turns
    ]
    pace = float(np.linalg.norm(others))
    key = next((k for k in ("speed", "time") if getattr(path, k) is not None), "file")
    text = f"the path's {show(pace, dimension, 3)}"
    return RowCause("velocity", text, own.path[key], "move slower", pace, dimension)
