"""The reference of one axis against time: what its mode commands, blended in at entry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.modes import AxisMode, Blending, ReferenceInputs
from taskspec.motion import blend
from taskspec.program.clock import Clock
from taskspec.program.slots import Slots


@dataclass(frozen=True, slots=True)
class AxisReference:
    """Coordinate of one axis, r(t), with its rates.

    Attributes:
        mode: of the axis.
        value: r [m, rad].
        rate: r' [m/s, rad/s].
        acceleration: r'' [m/s^2, rad/s^2].
        released: the part of r that stands for a force which the last stage held [m, rad].
        own: the mode's own r(t) before blending, and its rate; for the hand-over.
        memory: what the mode memorises of this tick, by slot.
    """

    mode: AxisMode
    value: ca.SX
    rate: ca.SX
    acceleration: ca.SX
    released: ca.SX
    own: tuple[ca.SX, ca.SX]
    memory: Mapping[str, ca.SX] = field(default_factory=dict)


def blendings(names: Sequence[Axis], clock: Clock, parameters: Slots) -> dict[Axis, Blending]:
    """The blending of the references of the named axes after a stage start."""
    offset, slope, time, pressed = (
        ca.vertcat(ca.SX(0, 1), *(parameters.add(f"{slot}.{name}") for name in names))
        for slot in ("offset", "slope", "blend", "pressed")
    )
    value = blend.added(clock.t, offset, slope, time)
    released = pressed * blend.offset_shape(clock.t / blend.BLEND_TIME)
    rate = clock.rate(value)
    acceleration = clock.rate(rate)
    return {
        name: Blending(value[i], rate[i], acceleration[i], released[i])
        for i, name in enumerate(names)
    }


def axis_reference(mode: AxisMode, at: ReferenceInputs, added: Blending) -> AxisReference:
    """The reference of an axis.

    Args:
        mode: of the axis.
        at: what it may depend on.
        added: at the stage start.
    """
    own = mode.reference(at)
    blended = mode.blended(own, added)
    return AxisReference(mode, *blended, added.released, (own.value, own.rate), own.memory)
