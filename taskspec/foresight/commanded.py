"""How fast the references of a stage change: speeds, accelerations and jerks of tip and joints.

They are got as an arm's controller gets those of what it is sent: by differences of the references
from one control period to the next.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec.program.passage import Instant
from taskspec.program.plan import StagePlan
from taskspec.program.walk.reference_motion import reference_motion, start_coordinates
from taskspec.robot.model_terms import PinocchioTerms

Vector = NDArray[np.float64]

#: Samples of a stage that are looked at at most: from its begin, its end, and evenly between.
_MOST = 60_000
#: What an arm feels less than so much of its mobility by is taken for singular there.
_SINGULAR = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceCourse:
    """References of a stage at each control period, from the second one on.

    Attributes:
        times: (k,) since the stage began [s].
        rates: (k, 6) in the frame's axes [m/s, rad/s].
        accelerations: (k, 6) [m/s^2, rad/s^2].
        jerks: (k, 6) [m/s^3, rad/s^3].
    """

    times: Vector
    rates: Vector
    accelerations: Vector
    jerks: Vector


@dataclass(frozen=True, slots=True, eq=False)
class JointCourse:
    """What the references of a stage make of the joints about an instant.

    Attributes:
        time: of the greatest of each [s]: (3, n), for speed, acceleration and jerk.
        most: (3, n) their greatest sizes [rad/s, rad/s^2, rad/s^3].
    """

    time: Vector
    most: Vector


def commanded(stage: StagePlan) -> ReferenceCourse | None:
    """The references of a stage; None where the text does not tell them.

    They go on from the rates that the stage before hands over, which are taken as steady till
    then, or from rest where these are not known. A stage that may end at any time is looked at as
    far as its passage is known.
    """
    passage = stage.nominal.passage
    if passage is None or len(passage.instants) < 2:
        return None
    first, last = passage.instants[0], passage.last
    carried = stage.nominal.carried
    motion = reference_motion(stage, start_coordinates(stage, first.p, first.R), carried)
    if motion is None or not motion.ways or not math.isfinite(last.time):
        return None
    period = stage.context.period
    count = math.ceil(last.time / period) + 4
    if count > _MOST:
        return None
    times: Vector = period * np.arange(-3.0, count)
    at = np.zeros((len(times), 6))
    for axis, way in motion.ways.items():
        rate = carried.get(axis, 0.0)
        at[:, axis.row] = [float(way(max(t, 0.0))) + rate * min(t, 0.0) for t in times.tolist()]
    if not np.isfinite(at).all():
        return None
    rates: Vector = np.diff(at, axis=0) / period
    accelerations: Vector = np.diff(rates, axis=0) / period
    jerks: Vector = np.diff(accelerations, axis=0) / period
    return ReferenceCourse(times[3:], rates[2:], accelerations[1:], jerks)


def commanded_joints(stage: StagePlan, course: ReferenceCourse) -> Iterator[JointCourse]:
    """What the arm makes of a course, piece by piece of its passage.

    With J^ = H^-1 J^T (J H^-1 J^T)^-1, as laws resolve it,

    q' = J^ x',    q'' = J^ (x'' - J' q'),    q''' = J^ x'''

    J^ goes linearly from one instant to the next. In the last one J is taken as steady: it is for
    the steps of accelerations that it is asked.
    """
    passage = stage.nominal.passage
    assert passage is not None
    rows = [axis.row for axis in AXES if axis in stage.context.robot.axes]
    terms = PinocchioTerms(stage.context.robot)
    resolved = [_resolved(terms, here, rows) for here in passage.instants]
    ends = zip(
        passage.instants[:-1], passage.instants[1:], resolved[:-1], resolved[1:], strict=True
    )
    for before, here, begins, ended in ends:
        mine = (course.times > before.time - 1e-9) & (course.times <= here.time + 1e-9)
        if not mine.any() or begins is None or ended is None:
            continue
        when = course.times[mine]
        share = ((when - before.time) / max(here.time - before.time, 1e-12))[:, None, None]
        inverse = (1 - share) * begins[0] + share * ended[0]
        drift = ended[1]
        parts = (
            course.rates[mine][:, rows],
            course.accelerations[mine][:, rows] - drift,
            course.jerks[mine][:, rows],
        )
        sizes = [np.abs(np.einsum("tnr,tr->tn", inverse, part)) for part in parts]
        yield JointCourse(
            np.array([when[size.argmax(axis=0)] for size in sizes]),
            np.array([size.max(axis=0) for size in sizes]),
        )


def _resolved(
    terms: PinocchioTerms, here: Instant, rows: list[int]
) -> tuple[Vector, Vector] | None:
    """(n, r) J^ in the frame's axes and (r,) J' q'; None at a singularity."""
    terms.q[:], terms.v[:] = here.q, here.v
    terms.update()
    turned = np.kron(np.eye(2), here.frame.T)
    J = (turned @ terms.jacobian)[rows]
    mobility = J @ np.linalg.solve(terms.inertia, J.T)
    drift = (turned @ terms.arrays[-1])[rows]
    if float(np.linalg.eigvalsh(mobility)[0]) < _SINGULAR:
        return None
    return np.linalg.solve(terms.inertia, J.T) @ np.linalg.inv(mobility), drift
