"""The boundary layers of a stage: their gains at rest at the start, and what they promise."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np

from taskspec.control.state import task_state
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.laws import sliding
from taskspec.laws.gains import SLIDING_GAIN, SLIDING_LAYER, value_of
from taskspec.program.plan import StagePlan
from taskspec.text.units import LENGTH, number, scaled


@dataclass(frozen=True, slots=True)
class SlidingLayer:
    """The layer of one axis, at rest at the start.

    Attributes:
        axis: that slides.
        layer: phi [m/s, rad/s].
        gain: K, of the file or what the bounds need [m/s^2, rad/s^2].
        least: K that the bounds need [m/s^2, rad/s^2].
        left: what is left of 1 for the gain; where it is not positive, none is enough.
        taken: (M + K/phi) T (1 + L T), the share of s that a tick takes off.
        bound: phi / L, what the error does not exceed [m, rad].
    """

    axis: Axis
    layer: float
    gain: float
    least: float
    left: float
    taken: float
    bound: float

    def rows(self) -> Iterator[tuple[str, str]]:
        """What the axis is held within, and by what."""
        turns = self.axis.is_rotation
        bound = scaled(self.bound, LENGTH.on(rotation=turns), 3)
        layer = SLIDING_LAYER.text(self.layer, angular=turns)
        gain = SLIDING_GAIN.text(self.gain, angular=turns)
        yield (
            f"slides along {self.axis}",
            f"an error of at most {bound}, by a layer of {layer}; gain {gain} at the start, a tick "
            f"takes off {number(self.taken, 2)} of s",
        )


def sliding_layers(stage: StagePlan) -> list[SlidingLayer]:
    """The layers of a stage; none without a sliding term, or on a path of joints."""
    context, slides, n = stage.context, stage.law.sliding, stage.context.robot.n
    axes = sliding.sliding_axes(stage.gains)
    if slides is None or stage.joint_path is not None or not axes:
        return []
    state = task_state(
        axes=stage.axes,
        H=ca.SX(context.start_inertia),
        J=ca.SX(stage.kinematics.jacobian),
        drift=ca.SX.zeros(6),
        twist=ca.SX.zeros(6),
        wrench=ca.SX.zeros(6),
        R=ca.SX.eye(3),
        R_rate=ca.SX.zeros(3, 3),
    )
    found = sliding.reach(
        state,
        slides.bounds,
        axes,
        acceleration=ca.SX.zeros(len(stage.axes)),
        bias=ca.SX(context.start_gravity),
        posture=ca.SX.zeros(n),
    )
    least = np.array(ca.evalf(found.gains(state))).ravel()
    left, gains, layers = float(ca.evalf(found.left)), stage.gains, []
    for axis in axes:
        needed = float(least[stage.axes.index(axis)])
        K = value_of(gains, SLIDING_GAIN.name, axis) or needed
        layers.append(
            SlidingLayer(
                axis,
                value_of(gains, SLIDING_LAYER.name, axis),
                K,
                needed,
                left,
                sliding.steps(gains, axis, K, context.period),
                sliding.error_bound(gains, axis),
            )
        )
    return layers
