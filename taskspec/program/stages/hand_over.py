"""The hand-over of a stage: the reference pose, and the forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

import casadi as ca

from taskspec.control.representation import Representation
from taskspec.laws.tank import OUTPUTS as TANK
from taskspec.program.plan import StagePlan
from taskspec.program.ports import ESTIMATE, HANDED, fields, fields_of, slices
from taskspec.program.reference.orientation import displaced, representation_of
from taskspec.program.world.moving_base import MovingBase

#: Outputs that a stage is left by, in addition to those that are handed on as they are.
_LEFT = (
    *("tip", "tip_rotation", "offset", "frame", "error"),
    *("velocity", "velocity_ref", "force", "force_ref"),
)


def leaving(plan: StagePlan) -> ca.Function:
    """The hand-over of a stage: its outputs, the run time [s] -> the numbers of `handed_of`.

    Axes with a force set point hand on where they were measured. Whether the next stage keeps track
    of the same mechanism is left to whoever knows it.
    """
    forced = tuple(name.row for name, axis in plan.plans.items() if axis.set_point)
    tracked = tuple(
        name.row
        for name, axis in plan.plans.items()
        if axis.motion and not axis.force and not axis.open_loop
    )
    axes = tuple(name.row for name in plan.plans)
    angles, context = representation_of(plan.law), plan.context
    places = slices(fields_of(context.loaded.task, context.robot.n))
    size, more = max(where.stop for where in places.values()), _more(plan, places)
    if plan.moving_base is None:
        return _leaving_still(axes, forced, tracked, angles, size, more)
    return _leaving(axes, forced, tracked, angles, size, more, plan.moving_base)


#: Numbers that are handed on and are no output.
_ZERO, _ONE = -1, -2


def _more(plan: StagePlan, places: Mapping[str, slice]) -> tuple[int, ...]:
    """Of each number after those of `HANDED` the output that it is, or which constant."""
    task, found = plan.context.loaded.task, list[int]()
    if task.observes:
        n, first = plan.context.robot.n, places["disturbance"].start
        has = plan.law.disturbance_observer is not None
        found += range(first, first + n) if has else [_ZERO] * n
    if task.tanks:
        first = places["tank"].start
        own = [first + TANK.index("energy"), first + TANK.index("stretched"), _ONE]
        found += own if plan.law.tank is not None else [_ZERO] * len(own)
    for name, _ in ESTIMATE if task.estimates else ():
        found += range(places[name].start, places[name].stop)
    return tuple(found)


def _leaving(
    axes: Sequence[int],
    forced: Sequence[int],
    tracked: Sequence[int],
    angles: Representation | None,
    size: int,
    more: Sequence[int],
    base: MovingBase | None = None,
) -> ca.Function:
    """What `leaving` gives.

    Args:
        axes: rows of the axes that are controlled, and of those `forced`, which have a force set
            point, and `tracked`, which hand on the reference of their motion.
        angles: in which the law measures orientation; None for the rotation vector.
        size: how many outputs there are.
        more: outputs that are handed on as they are, after the others; see `_more`.
        base: that carries the frame.
    """
    outputs, clock = ca.SX.sym("outputs", size), ca.SX.sym("clock")
    places = slices(fields(0))
    names = (*(name for name, _ in HANDED if name in places), *_LEFT)
    at = {name: outputs[places[name]] for name in names}
    R, frame = (ca.reshape(at[name], 3, 3) for name in ("tip_rotation", "frame"))
    error, twist, held, commanded = (ca.SX.zeros(6) for _ in range(4))
    for i in axes:
        if i in forced:
            held[i], commanded[i] = at["force"][i], at["force_ref"][i]
        error[i] = at["error"][i] if i in tracked else 0.0
        twist[i] = at["velocity_ref" if i in tracked else "velocity"][i]
    offset = at["offset"]
    R_ref = frame @ displaced(angles, frame.T @ R, error[3:])
    spin = frame @ twist[3:]
    own = ca.vertcat(frame @ twist[:3] - ca.cross(spin, offset), spin)
    if base is not None:
        own += base.at(clock).twist(at["tip"])
    values = {
        "p": at["tip"] + offset + frame @ error[:3] - R_ref @ (R.T @ offset),
        "R": ca.vec(R_ref),
        "twist": own,
        "held": ca.vertcat(frame @ held[:3], frame @ held[3:]),
        "commanded": ca.vertcat(frame @ commanded[:3], frame @ commanded[3:]),
        "angle": at["angle"],
        "same": ca.SX(0),
        "track": at["track"],
        "tracks": at["tracks"],
    }
    constants = {_ZERO: ca.SX(0), _ONE: ca.SX(1)}
    last = (constants[i] if i in constants else outputs[i] for i in more)
    found = ca.vertcat(*(values[name] for name, _ in HANDED), *last)
    return ca.Function("leaving", [outputs, clock], [ca.densify(found)])


#: Without a base it is the same for all stages with such axes.
_leaving_still = cache(_leaving)
