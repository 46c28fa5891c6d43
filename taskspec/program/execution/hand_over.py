"""What is handed over from stage to stage: the one reference pose, and the torque."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec.program.reference.orientation import displaced
from taskspec.program.stages.stage import CompiledStage

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class HandedOver:
    """The one reference pose that goes from stage to stage, and the torque that goes on.

    Attributes:
        p, R: (3,), (3, 3) reference pose of the tip in the world. Axes that a force set point
            has moved are where they were measured.
        twist: (6,) its velocity, world axes, at the tip.
        angle: [rad] of the mechanism that the last stage kept track of, `tracked`.
        held: (6,) wrench that the robot applied on axes with a force set point, world [N, N m].
        torque: (n,) of the last stage at the tick of the change [N m]; None where the new one
            begins with its own.
    """

    p: Vector
    R: Vector
    twist: Vector
    held: Vector = field(default_factory=lambda: np.zeros(6))
    angle: float = 0.0
    tracked: str = ""
    torque: Vector | None = None


def leave(
    stage: CompiledStage,
    outputs: Mapping[str, Vector],
    clock: float,
    torque: Vector | None,
) -> HandedOver:
    """The reference that a stage hands on; force axes hand on where they were measured.

    Args:
        stage: which.
        outputs: its last ones, by name.
        clock: when that was [s].
        torque: (n,) of that tick [N m], if the next stage is to go on from it.
    """
    R = outputs["tip_rotation"].reshape(3, 3, order="F")
    frame = outputs["frame"].reshape(3, 3, order="F")
    error, twist, held = np.zeros(6), np.zeros(6), np.zeros(6)
    for name, plan in stage.plan.plans.items():
        i = AXES.index(name)
        if plan.set_point:
            held[i] = outputs["force"][i]
        tracked = plan.motion and not plan.force and not plan.open_loop
        error[i] = outputs["error"][i] if tracked else 0.0
        twist[i] = outputs["velocity_ref" if tracked else "velocity"][i]
    offset = outputs["offset"]
    R_ref = frame @ displaced(stage.plan.law, frame.T @ R, error[3:])
    spin = frame @ twist[3:]
    own = np.concatenate([frame @ twist[:3] - np.cross(spin, offset), spin])
    if stage.plan.moving_base is not None:
        own += stage.plan.moving_base.twist(clock, outputs["tip"])
    return HandedOver(
        p=outputs["tip"] + offset + frame @ error[:3] - R_ref @ (R.T @ offset),
        R=R_ref,
        twist=own,
        angle=float(outputs["angle"][0]),
        tracked=stage.tracked,
        held=np.concatenate([frame @ held[:3], frame @ held[3:]]),
        torque=torque,
    )
