"""The hand-over of a stage: the reference pose, and the forces."""

from __future__ import annotations

import casadi as ca

from taskspec.geometry.axis import AXES
from taskspec.program.plan import StagePlan
from taskspec.program.ports import HANDED, fields, slices
from taskspec.program.reference.orientation import displaced

#: Outputs that a stage is left by, in addition to those that are handed on as they are.
_LEFT = (
    *("tip", "tip_rotation", "offset", "frame", "error"),
    *("velocity", "velocity_ref", "force", "force_ref"),
)
#: Numbers of what is handed over.
SIZE = sum(length for _, length in HANDED)


def leaving(plan: StagePlan) -> ca.Function:
    """The hand-over of a stage: its outputs, the run time [s] -> the numbers of `HANDED`.

    Axes with a force set point hand on where they were measured. Whether the next stage keeps track
    of the same mechanism is left to whoever knows it.
    """
    size = sum(length for _, length in fields(len(plan.context.equations)))
    outputs, clock = ca.SX.sym("outputs", size), ca.SX.sym("clock")
    places = slices(fields(0))
    names = (*(name for name, _ in HANDED if name in places), *_LEFT)
    at = {name: outputs[places[name]] for name in names}
    R, frame = (ca.reshape(at[name], 3, 3) for name in ("tip_rotation", "frame"))
    error, twist, held, commanded = (ca.SX.zeros(6) for _ in range(4))
    for name, axis in plan.plans.items():
        i = AXES.index(name)
        if axis.set_point:
            held[i], commanded[i] = at["force"][i], at["force_ref"][i]
        tracked = axis.motion and not axis.force and not axis.open_loop
        error[i] = at["error"][i] if tracked else 0.0
        twist[i] = at["velocity_ref" if tracked else "velocity"][i]
    offset = at["offset"]
    R_ref = frame @ displaced(plan.law, frame.T @ R, error[3:])
    spin = frame @ twist[3:]
    own = ca.vertcat(frame @ twist[:3] - ca.cross(spin, offset), spin)
    if plan.moving_base is not None:
        own += plan.moving_base.at(clock).twist(at["tip"])
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
    found = ca.vertcat(*(values[name] for name, _ in HANDED))
    return ca.Function("leaving", [outputs, clock], [ca.densify(found)])
