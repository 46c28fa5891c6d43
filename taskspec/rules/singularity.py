"""Places of a stage where the arm is close to a singularity in the axes that it controls."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.control.state import ARM_LENGTH
from taskspec.program.plan import StagePlan
from taskspec.program.stages.conditions import NEAR_SINGULAR, SINGULAR
from taskspec.program.trajectory import Place
from taskspec.robot.mobility import tip_jacobian
from taskspec.robot.poses import mirrored
from taskspec.rules import Finding, rule, warning
from taskspec.spec import FILE, key_of
from taskspec.text.units import number, show

Vector = NDArray[np.float64]


@rule("TS422", "a place close to a singularity")
def near_singularities(stage: StagePlan) -> Iterator[Finding]:
    """The place of a stage at which its arm is nearest to a singularity, if near.

    What counts is the measure that stops a run: the pivots of J H^-1 J^T in the frame's axes, the
    reciprocals of the masses that the axes feel.
    """
    looked = [(_pivot(stage, p), p) for p in stage.nominal.places if p.q is not None]
    if not looked:
        return
    pivot, place = min(looked, key=lambda pair: pair[0])
    if pivot >= NEAR_SINGULAR:
        return
    sizes = _singular_values(stage, place)
    effect = "nothing moves it" if pivot <= 0 else f"an axis feels {show(1 / pivot, 'kg', 2)}"
    stops = "stops the run" if pivot < SINGULAR else f"{show(1 / SINGULAR, 'kg')} stop the run"
    own = FILE.stages[stage.name]
    yield warning(
        "TS422",
        f"in stage {stage.name!r}, {place.words}, the arm is close to a singularity: {effect}, and "
        f"{stops} (singular values {number(sizes[-1], 2)} to {number(sizes[0], 2)} m)",
        key_of(own if stage.spec.path is None else own.path),
        "keep the arm bent, start elsewhere, or leave an axis to it that it need not control",
    )


def _rows(stage: StagePlan, place: Place) -> Vector:
    """(m, n) Jacobian of the tip on the axes of the stage's frame."""
    robot = stage.context.robot
    assert place.q is not None
    J = tip_jacobian(robot.pin, robot.tip_joint, robot.tip, place.q)
    resolved = np.kron(np.eye(2), place.rotation.T) @ J
    return np.asarray(resolved[[a.row for a in stage.axes]])


def _pivot(stage: StagePlan, place: Place) -> float:
    """The least pivot of J H^-1 J^T [1/kg, 1/(kg m^2)]; 0 where it is singular."""
    robot = stage.context.robot
    J = _rows(stage, place)
    H = mirrored(pin.crba(robot.pin, robot.pin.createData(), place.q))
    mobility = J @ np.linalg.solve(H, J.T)
    # Pivot i is what is left of row i once the rows before it are known.
    least = np.inf
    for i in range(len(J)):
        before = mobility[:i, :i]
        across = mobility[:i, i]
        known = across @ np.linalg.lstsq(before, across, rcond=None)[0] if i else 0.0
        least = min(least, float(mobility[i, i] - known))
    return max(least, 0.0)


def _singular_values(stage: StagePlan, place: Place) -> Vector:
    """(m,) singular values of the Jacobian, rotations times a length [m], the largest first."""
    lengths = np.array([ARM_LENGTH if a.is_rotation else 1.0 for a in stage.axes])
    J = lengths[:, None] * _rows(stage, place)
    return np.asarray(np.linalg.svd(J, compute_uv=False))
