"""Velocities of a stage, as rows: those asked for, and how fast arm and tip may go."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.check.reach.rows import Asked, Line, System, kept, limit_place, shares_of
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.context import Context
from taskspec.program.trajectory import Place
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.robot.mobility import tip_jacobian
from taskspec.spec import FILE
from taskspec.text.show import show

Vector = NDArray[np.float64]

VELOCITY = "velocity limit"


def motion(context: Context, asked: Asked, place: Place) -> tuple[System, Vector]:
    """The rows of a stage's velocities at a place with known joint positions, and rates for them.

    Args:
        context: the task. asked: what the stage asks for. place: where, its `rates` what is asked.
    """
    assert place.q is not None
    robot, loaded, shares = context.robot, context.loaded, shares_of(context, asked.name)
    J = tip_jacobian(robot.pin, robot.tip_joint, robot.tip, place.q)
    inside = np.kron(np.eye(2), place.rotation.T) @ J
    system = System(len(place.q))
    for axis, rate in place.rates.items():
        line = _line(context, asked.name, axis, place.rates)
        system.add(inside[AXES.index(axis)], rate, rate, line)
    speed = context.limits_of(loaded.task.stages[asked.name]).speed
    v = place.rotation @ [place.rates.get(a, 0.0) for a in AXES[:3]]
    size = float(np.linalg.norm(v))
    if speed is not None and size > 0:
        words = f"limits.speed, {show(speed, 'mm/s')}{kept(shares.speed)}"
        line = Line("limit", words, limit_place(context, asked.name, "speed"), "raise the limit")
        system.add(v / size @ J[:3], -shares.speed * speed, shares.speed * speed, line)
    for i, most in enumerate(robot.velocity_limit):
        if not np.isfinite(most):
            continue
        unit = "deg/s" if turns_at(robot, i) else "mm/s"
        words = f"joint {i + 1} ({show(float(most), unit, 3)}{kept(shares.velocity)})"
        line = Line(VELOCITY, words, None, "start in another posture")
        fastest = shares.velocity * most
        system.add(np.eye(len(place.q))[i], -fastest, fastest, line)
    rows = [AXES.index(a) for a in place.rates]
    rates = np.array(list(place.rates.values()))
    return system, np.linalg.lstsq(inside[rows], rates, rcond=None)[0]


def _line(context: Context, name: str, axis: Axis, rates: Mapping[Axis, float]) -> Line:
    """What the velocity of an axis comes from: its own entry, the path, or nothing at all."""
    stage = context.loaded.task.stages[name]
    entry, turns = stage.axes.get(axis), axis.is_rotation
    unit = "deg/s" if turns else "mm/s"
    if entry is not None and entry.mode.moves:
        words = f"{show(rates[axis], unit, 3)} {'about' if turns else 'along'} {axis!r}"
        span = context.loaded.span(FILE.stages[name].axes[axis][entry.mode.pace])
        return Line("velocity", words, span, "move slower", rates[axis], unit)
    if stage.path is None or entry is not None or rates[axis] == 0:
        return Line("hold", repr(axis), None, "")
    own = [rate for a, rate in rates.items() if a not in stage.axes and a.is_rotation == turns]
    pace = float(np.linalg.norm(own))
    key = next((k for k in ("speed", "time") if getattr(stage.path, k) is not None), "file")
    span = context.loaded.span(FILE.stages[name].path[key])
    return Line("velocity", f"the path's {show(pace, unit, 3)}", span, "move slower", pace, unit)
