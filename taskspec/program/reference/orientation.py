"""Orientation in Euler angles, for a law that uses them: its rows, its limit, its carrying."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control.representation import REPRESENTATIONS, Representation, analytical
from taskspec.control.state import TaskState
from taskspec.geometry import rotation
from taskspec.geometry.axis import AXES
from taskspec.program import events
from taskspec.program.events import Condition, Event
from taskspec.program.reference.reference_set import ReferenceSet
from taskspec.program.signals import SignalTable
from taskspec.spec import Law

Matrix = NDArray[np.float64]

#: Closer to the singularity than this [rad], Euler angles are not used.
NEAREST = float(np.deg2rad(1.0))


def representation_of(law: Law) -> Representation | None:
    """The Euler angles that a law is to use, None for the rotation vector on SO(3)."""
    return REPRESENTATIONS.get(law.orientation)


def restate(
    law: Law, state: TaskState, references: ReferenceSet, R: ca.SX, table: SignalTable
) -> tuple[TaskState, ReferenceSet, list[Condition]]:
    """The state of the law in its own angles, and the limit that comes with them.

    `error.rx`, `error.ry` and `error.rz` become what the law controls: phi_d - phi.

    Args:
        law: of the stage.
        state, references: in frame axes.
        R: (3, 3) tool in the task frame.
        table: signals, whose `error` on rotations is renewed.
    """
    representation = representation_of(law)
    if representation is None:
        return state, references, []
    found = analytical(representation, state, references.law, R)
    error = {a: found.reference.error[state.axes.index(a)] for a in AXES[3:]}
    table.situation.error = {**table.situation.error, **error}
    text = f"the {law.orientation} angles of the tool are within 1 deg of their singularity"
    limit = Event(events.LIMIT, "representation_singularity", text)
    regular = found.regularity
    return (
        found.state,
        replace(references, law=found.reference, error={**references.error, **error}),
        [Condition(limit, regular < np.sin(NEAREST), regular)],
    )


def angles_of(representation: Representation, R: Matrix) -> Matrix:
    """phi_e (3,) [rad] of a rotation matrix (3, 3)."""
    return np.array(ca.evalf(representation.angles(ca.SX(R)))).ravel()


def rates_of(law: Law, R: Matrix) -> Matrix:
    """(3, 3) from angular velocity in frame axes to the rates of the law's rotational rows.

    Args:
        law: of the stage.
        R: (3, 3) tool in the task frame.
    """
    representation = representation_of(law)
    if representation is None:
        return np.eye(3)
    phi = ca.SX(angles_of(representation, R))
    return np.asarray(ca.evalf(representation.inverse(phi)), dtype=float)


def displaced(representation: Representation | None, R: ca.SX, error: ca.SX) -> ca.SX:
    """The orientation (3, 3) that lies an error e (3,) [rad] beyond R (3, 3), frame axes."""
    if representation is None:
        return rotation.exp(error) @ R
    return representation.matrix(representation.angles(R) + error)
