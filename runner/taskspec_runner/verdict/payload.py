"""The payload that laws have adapted to, and what of it the run has shown.

In the stages that adapt, an error of the estimate falls by theta~' = -w A^T A / |g|^2 theta~, with
A as in `laws.adaptation`; `Adaptation.shown` has what is left of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES
from taskspec.laws.adaptation import PARAMETERS, SHOWN, described, gramian
from taskspec.program.bound import RowFunction
from taskspec.program.execution.payload_estimate import adaptation
from taskspec.program.program import Program
from taskspec.robot.rebuild import GRAVITY
from taskspec.robot.rigid_body import rigid_body
from taskspec.text.units import LENGTH, MASS, scaled
from taskspec_runner.record.history import History
from taskspec_runner.verdict.energy import MOST

Vector = NDArray[np.float64]

#: A mass is at its bound if it is so near [kg].
_AT_BOUND = 1e-6


def payload_block(program: Program, history: History) -> dict[str, Any]:
    """The entry of a summary, `payload`; empty of a task without adaptation, or without ticks.

    A longer run than of `MOST` ticks has no Gramian, as it would take its memory several times.
    """
    task = program.context.loaded.task
    adapted = adaptation(task, program.context.period)
    if adapted is None or "payload.mass" not in history.columns or not len(history):
        return {}
    known = [float(history.columns[f"payload.{name}"][-1]) for name in PARAMETERS]
    data: dict[str, Any] = dict(zip(PARAMETERS, known, strict=True))
    data["at_bound"] = known[0] > adapted.high - _AT_BOUND
    found = None if len(history) > MOST else _gramian(program, history)
    if found is not None:
        shows, time = found
        data["time"] = time
        data["least_eigenvalue"] = float(max(np.linalg.eigvalsh(shows)[0], 0.0))
        within = adapted.within(shows, known) or (None,) * len(PARAMETERS)
        data["within"] = dict(zip(PARAMETERS, within, strict=True))
        data["shown"] = dict(zip(PARAMETERS, adapted.shown(shows, time).tolist(), strict=True))
    return {"payload": data}


def unshown(data: Mapping[str, Any]) -> list[str]:
    """The parameters that a run has not shown, of its entry in a summary."""
    return [name for name, share in data.get("shown", {}).items() if share < SHOWN]


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """What a run has learned of a payload, and what it has not shown."""
    data = summary.get("payload")
    if not data:
        return
    mass, *centre = (_with_bounds(data, name) for name in PARAMETERS)
    text = f"payload: {mass} at [{', '.join(centre)}] of the tool"
    if data["at_bound"]:
        text += ", as heavy as its bounds let it be"
    missing = unshown(data)
    if missing:
        text += f"; this run does not show its {described(missing)}"
    yield text


def _with_bounds(data: Mapping[str, Any], name: str) -> str:
    """A parameter to the digits that a run determines; `?` for one that it does not show."""
    dimension = MASS if name == "mass" else LENGTH
    within = data.get("within", {}).get(name)
    if name in unshown(data):
        return "?"
    text = scaled(data[name], dimension, 3 if name == "mass" else 2)
    return text if within is None else f"{text} +- {scaled(within, dimension, 1)}"


def _gramian(program: Program, history: History) -> tuple[Vector, float] | None:
    """(4, 4) mean of A^T A / |g|^2 over the ticks that adapt, and their time [s]; None for none."""
    context = program.context
    adapting = {stage.name for stage in program.stages if stage.plan.adapts}
    rows = np.flatnonzero(np.isin(np.asarray(history.stages), sorted(adapting)))
    n = context.robot.n
    q, v = (
        np.column_stack([history.columns[f"joint.{i + 1}.{what}"] for i in range(n)])
        for what in ("position", "velocity")
    )
    if len(rows) < 2:
        return None
    acceleration = np.diff(v, axis=0, prepend=v[:1]) / context.period
    *_, J, _, R, drift = RowFunction(rigid_body(context.robot).function)(q[rows], v[rows])
    moved = _moved(context.robot.axes, n)
    (summed,) = moved(J, R, drift, v[rows], acceleration[rows])
    return summed.mean(axis=0).reshape(4, 4), len(rows) * context.period


def _moved(axes: tuple[str, ...], n: int) -> RowFunction:
    """A^T A / |g|^2 of a tick: J, R, J' q', q' and q'' -> (16,)."""
    J, R, drift, v, acceleration = (
        ca.SX.sym(name, size)
        for name, size in (("J", 6 * n), ("R", 9), ("drift", 6), ("v", n), ("a", n))
    )
    jacobian = ca.reshape(J, 6, n)
    tip = jacobian @ acceleration + drift
    gravity = ca.DM(GRAVITY)
    rows = [AXES.index(axis) for axis in axes]
    turning, g = (jacobian @ v)[3:], float(ca.norm_2(gravity))
    made = gramian(tip[:3] - gravity, turning, tip[3:], ca.reshape(R, 3, 3), rows, g)
    made = ca.densify(ca.vec(made))
    return RowFunction(ca.Function("gramian", [J, R, drift, v, acceleration], [made]))
