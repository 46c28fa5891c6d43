"""Places of a stage where the arm is close to a singularity in the axes that it controls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.control.state import ARM_LENGTH
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.context import Context
from taskspec.program.stages.conditions import SINGULAR
from taskspec.program.trajectory import Place
from taskspec.robot.mobility import tip_jacobian
from taskspec.spec import FILE, key_of
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.show import number, show

register({"TS422": "a place close to a singularity"})

Vector = NDArray[np.float64]

#: An axis that feels a hundredth of the mass that stops the run is near a singularity.
_NEAR = 100 * SINGULAR


def check_singular(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    places: Sequence[Place],
    found: Diagnostics,
) -> None:
    """Reports the place of stage `name` at which its arm is nearest to a singularity, if near.

    What counts is the measure that stops a run: the pivots of J H^-1 J^T in the frame's axes, the
    reciprocals of the masses that the axes feel.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        places: where it is looked at. found: where findings go.
    """
    looked = [(_pivot(context, axes, p), p) for p in places if p.q is not None]
    if not looked:
        return
    pivot, place = min(looked, key=lambda pair: pair[0])
    if pivot >= _NEAR:
        return
    sizes = _singular_values(context, axes, place)
    felt = "nothing moves it" if pivot <= 0 else f"an axis feels {show(1 / pivot, 'kg', 2)}"
    stops = "stops the run" if pivot < SINGULAR else f"{show(1 / SINGULAR, 'kg')} stop the run"
    planned = context.loaded.task.stages[name].path is not None
    found.warning(
        "TS422",
        f"in stage {name!r}, {place.words}, the arm is close to a singularity: {felt}, and {stops} "
        f"(singular values {number(sizes[-1], 2)} to {number(sizes[0], 2)} m)",
        context.loaded.span(key_of(FILE.stages[name].path if planned else FILE.stages[name])),
        "keep the arm bent, start elsewhere, or leave an axis to it that it need not control",
    )


def _rows(context: Context, axes: tuple[Axis, ...], place: Place) -> Vector:
    """(m, n) Jacobian of the tip on the axes of the stage's frame."""
    robot = context.robot
    assert place.q is not None
    J = tip_jacobian(robot.pin, robot.tip_joint, robot.tip, place.q)
    resolved = np.kron(np.eye(2), place.rotation.T) @ J
    return np.asarray(resolved[[AXES.index(a) for a in axes]])


def _pivot(context: Context, axes: tuple[Axis, ...], place: Place) -> float:
    """The least pivot of J H^-1 J^T [1/kg, 1/(kg m^2)]; 0 where it is singular."""
    robot = context.robot
    J = _rows(context, axes, place)
    upper = np.triu(pin.crba(robot.pin, robot.pin.createData(), place.q))
    H = upper + np.triu(upper, 1).T
    mobility = J @ np.linalg.solve(H, J.T)
    # Pivot i is what is left of row i once the rows before it are known.
    least = np.inf
    for i in range(len(J)):
        before = mobility[:i, :i]
        across = mobility[:i, i]
        known = across @ np.linalg.lstsq(before, across, rcond=None)[0] if i else 0.0
        least = min(least, float(mobility[i, i] - known))
    return max(least, 0.0)


def _singular_values(context: Context, axes: tuple[Axis, ...], place: Place) -> Vector:
    """(m,) singular values of the Jacobian, rotations times a length [m], the largest first."""
    lengths = np.array([ARM_LENGTH if a.is_rotation else 1.0 for a in axes])
    J = lengths[:, None] * _rows(context, axes, place)
    return np.asarray(np.linalg.svd(J, compute_uv=False))
