"""Outputs of a stage's functions: the tick's outputs, and what a stage start needs."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from taskspec.program import ports
from taskspec.program.limits.resolution import Resolved
from taskspec.program.ports import INTERNAL, PROBE
from taskspec.program.reference.measurement import Measurement
from taskspec.program.reference.tracked_mechanism import TrackedMechanism
from taskspec.program.stages.commanded import Commanded
from taskspec.program.world import tracked_frames
from taskspec.program.world.moving_base import BaseMotion


def probe(arguments: list[ca.SX], measurement: Measurement, commanded: Commanded) -> ca.Function:
    """The tool in the stage's frame; its last input is the tool point's velocity (3,).

    That is its velocity against what carries the frame. All are in world axes but `here`, which is
    in the coordinates of the frame's moving base.

    Its outputs are the numbers of `PROBE` and the measured reactions (equations,).
    """
    direction, at, base = ca.SX.sym("direction", 3), measurement.at, measurement.moving_base
    six = commanded.references.six
    values = {
        "frame": ca.vec(_world(at.R, base)),
        "offset": _world(measurement.point.offset, base),
        "lever": _world(measurement.tool.lever if at.foot is not None else ca.SX.zeros(3), base),
        "here": measurement.point.p if at.foot is None else at.foot,
        "rate_map": ca.vec(at.rate_map),
        "turning": at.turning(direction if base is None else base.A.T @ direction),
        "angle": _angle(measurement.tracked),
        "coordinate": six(commanded.references.coordinate),
        "measured": six(measurement.table.situation.six("force")),
    }
    found = [values[name] for name, _ in PROBE]
    return ca.Function(
        "probe", [*arguments, direction], [ca.vertcat(*found, _reactions(measurement))]
    )


def outputs(
    event: tuple[ca.SX, ca.SX],
    measurement: Measurement,
    commanded: Commanded,
    limited: Resolved | None,
    followed: int,
    more: ports.Fields,
) -> ca.SX:
    """A tick's outputs: the numbers of `ports.fields`.

    Args:
        event: its number and value.
        measurement: what is measured.
        commanded: by the law.
        limited: the stage's programs; what comes of them is filled in later. None without any.
        followed: joints that have a reference in any stage.
        more: the outputs that not every task has; those of `ESTIMATE` come after these.
    """
    inputs, references = measurement.inputs, commanded.references
    six = references.six
    # How far the closed form is beyond its limits, which pushes have been clamped, and whether the
    # force set points have to be held against what contacts return.
    violation, clamped, unsettled = limited.residuals if limited else (ca.SX(0), ca.SX(0), ca.SX(0))
    values = {
        "event": event[0],
        "event_value": event[1],
        # One number that is not finite as soon as any of these is not. Before saturation: the
        # smaller of a limit and NaN is the limit.
        "health": ca.sumsqr(commanded.torque) + ca.sumsqr(inputs.v) + ca.sumsqr(inputs.q),
        "tip": inputs.terms.p,
        "tip_rotation": ca.vec(inputs.terms.R),
        "offset": _world(measurement.point.offset, measurement.moving_base),
        "frame": ca.vec(_world(measurement.at.R, measurement.moving_base)),
        "angle": _angle(measurement.tracked),
        "track": _track(measurement),
        "tracks": ca.SX(measurement.tracks),
        "conditioning": commanded.chosen.conditioning if commanded.chosen else ca.SX(1),
        "violation": violation,
        "clamped": clamped,
        "unsettled": unsettled,
        "limits": ca.SX(0),
        "residual": ca.SX(0),
        "position_ref": six(references.position_ref),
        "velocity_ref": six(references.velocity_ref),
        "force_ref": six(references.force_ref),
        # Of this tick; the signal is that of the tick before.
        "limited": ca.SX(0),
    }
    for group in ports.groups():
        values[group] = six(measurement.table.situation.six(group))
    found = [
        values[name] if name in values else measurement.table[name]
        for name, _ in (*INTERNAL, *ports.signals())
    ]
    forces, joints = commanded.forces, commanded.case.joints
    return ca.vertcat(
        *found,
        _by_equation(measurement, forces.desired),
        _reactions(measurement),
        _by_equation(measurement, forces.gaps),
        _by_equation(measurement, forces.residuals),
        ca.SX.nan(followed) if joints is None else joints.position,
        *(
            _optional(name, size, measurement, commanded)
            for name, size in more
            if name not in dict(ports.ESTIMATE)
        ),
    )


def of_the_law(measurement: Measurement, commanded: Commanded) -> ca.SX:
    """The numbers of `LAW` and the reference of each equation."""
    situation, references = measurement.table.situation, commanded.references
    return ca.vertcat(
        references.six(situation.error),
        references.six(references.force_ref),
        _by_equation(measurement, commanded.forces.desired),
    )


def _by_equation(measurement: Measurement, values: Mapping[str, ca.SX]) -> ca.SX:
    """(equations,) values, such as set points, NaN where there is none."""
    nothing = ca.SX(np.nan)
    return ca.vertcat(ca.SX(0, 1), *(values.get(name, nothing) for name in measurement.rows))


def _gains(measurement: Measurement, commanded: Commanded) -> ca.SX:
    """(gains,) those that vary in any stage of the task, NaN where this one does not have them."""
    gains, nothing = commanded.case.gains, ca.SX(np.nan)
    return ca.vertcat(
        ca.SX(0, 1),
        *(
            ca.SX(by[on].value) if on in (by := gains.get(name, {})) else nothing
            for name, on in measurement.varying_gains
        ),
    )


def _optional(name: str, size: int, measurement: Measurement, commanded: Commanded) -> ca.SX:
    """(size,) an output that not every task has, NaN in a stage that does not have it."""
    situation, now = measurement.table.situation, measurement.inputs.now
    found: ca.SX | None = {
        "gain": _gains(measurement, commanded),
        "param": measurement.clock.live,
        "friction": commanded.friction,
        "disturbance": situation.disturbance,
        "tank": None if commanded.tank is None else commanded.tank.outputs,
        "payload": situation.payload,
        "grip": now[-2:],
    }[name]
    return ca.SX.nan(size) if found is None else found


def _reactions(measurement: Measurement) -> ca.SX:
    """(equations,) what was measured."""
    return ca.vertcat(ca.SX(0, 1), *(measurement.reactions[name] for name in measurement.rows))


def _world(local: ca.SX, base: BaseMotion | None) -> ca.SX:
    """Columns given in a moving base's axes, in the world's."""
    return local if base is None else base.A @ local


def _track(measurement: Measurement) -> ca.SX:
    """(9,) what a frame that tracks something has in its memory; zero for any other."""
    slots = (tracked_frames.FILTERED, tracked_frames.DIRECTION, tracked_frames.RATE)
    if not measurement.tracks:
        return ca.SX.zeros(9)
    return ca.vertcat(*(measurement.memory.symbol(slot) for slot in slots))


def _angle(tracked: TrackedMechanism | None) -> ca.SX:
    return ca.SX(0) if tracked is None else tracked.angle
