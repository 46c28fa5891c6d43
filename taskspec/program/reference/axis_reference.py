"""The reference of one axis against time: what its mode asks for, blended in at entry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca

from taskspec.geometry.axis import Axis
from taskspec.motion import blend, polynomial
from taskspec.program.clock import Clock
from taskspec.program.layout import Layout
from taskspec.spec import AxisEntry
from taskspec.text.expression import Expression

#: Turns an expression of the task file into CasADi.
Translate = Callable[[Expression], ca.SX]


@dataclass(frozen=True, slots=True)
class AxisReference:
    """Coordinate of one axis, r(t), with its rates.

    Attributes:
        mode: hold, position, velocity, move, follows, path or open-loop.
        value, rate, acceleration: r, r', r'' [m or rad, ...].
        own: the mode's own r(t) before blending, and its rate; for the entry.
        integral_rate: d/dt of the memory slot that a velocity fills, else None.
    """

    mode: str
    value: ca.SX
    rate: ca.SX
    acceleration: ca.SX
    own: tuple[ca.SX, ca.SX]
    integral_step: ca.SX | None = None


@dataclass(frozen=True, slots=True)
class Blending:
    """What entry adds to the reference of one axis, and how it fades.

    Attributes:
        value, rate, acceleration: of what continues the carried reference [m or rad, ...].
        released: the displacement that stands for a force that the last stage held.
    """

    value: ca.SX
    rate: ca.SX
    acceleration: ca.SX
    released: ca.SX


def mode_of(axis: AxisEntry, *, driven_by_path: bool, open_loop: bool) -> str:
    """Which kind of reference an axis has."""
    if open_loop:
        return "open-loop"
    if driven_by_path:
        return "path"
    for mode in ("position", "velocity", "move", "follows"):
        if getattr(axis, mode) is not None:
            return mode
    return "hold"


@dataclass(frozen=True, slots=True)
class ReferenceBuilder:
    """What all axes of a stage share while their references are built."""

    clock: Clock
    parameters: Layout
    memory: Layout
    translate: Translate
    period: float

    def blendings(self, names: Sequence[Axis]) -> dict[str, Blending]:
        """What entry adds to the references of the named axes, which all blend alike."""
        offset, slope, time, pressed = (
            ca.vertcat(ca.SX(0, 1), *(self.parameters.add(f"{slot}.{name}") for name in names))
            for slot in ("offset", "slope", "blend", "pressed")
        )
        s = self.clock.t / time
        value = offset * blend.offset_shape(s) + slope * time * blend.slope_shape(s)
        released = pressed * blend.offset_shape(self.clock.t / blend.BLEND_TIME)
        rate = self.clock.rate(value)
        acceleration = self.clock.rate(rate)
        return {
            name: Blending(value[i], rate[i], acceleration[i], released[i])
            for i, name in enumerate(names)
        }

    def build(
        self,
        name: Axis,
        mode: str,
        axis: AxisEntry,
        blending: Blending,
        *,
        path_value: ca.SX | None = None,
        open_loop_value: ca.SX | None = None,
        coupled: tuple[ca.SX, ca.SX, ca.SX] | None = None,
    ) -> AxisReference:
        """The reference of axis `name`.

        Args:
            name: axis name. mode: from `mode_of`. axis: its entry in the file.
            blending: what entry adds.
            path_value: its path coordinate. open_loop_value: the displacement that an open-loop
                force asks for.
            coupled: displacement, rate and acceleration that a mechanism's geometry asks for.
        """
        start = self.parameters.add(f"start.{name}")
        own, own_rate, own_acceleration, step = self._own(
            name, mode, axis, start, path_value, open_loop_value, coupled
        )
        if mode == "open-loop":
            # A displacement that stands for a force asks no motion of the damper.
            return AxisReference(
                mode, own + blending.value, own_rate, own_acceleration, (own, own_rate), step
            )
        return AxisReference(
            mode,
            own + blending.value + blending.released,
            own_rate + blending.rate,
            own_acceleration + blending.acceleration,
            (own, own_rate),
            step,
        )

    def _own(
        self,
        name: Axis,
        mode: str,
        axis: AxisEntry,
        start: ca.SX,
        path_value: ca.SX | None,
        open_loop_value: ca.SX | None,
        coupled: tuple[ca.SX, ca.SX, ca.SX] | None,
    ) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX | None]:
        """r, r' and r'' of the mode before blending, and what a velocity adds to its memory."""
        if mode == "velocity":
            assert axis.velocity is not None
            speed = self.translate(axis.velocity)
            gain = self.clock.rate(speed)
            travelled = self.memory.add(f"travelled.{name}")
            step = speed * self.period + gain * (self.period**2 / 2)
            return start + travelled, speed, gain, step
        if mode == "follows":
            assert coupled is not None
            return start + coupled[0], coupled[1], coupled[2], None
        if mode == "open-loop":
            assert open_loop_value is not None
            return start + open_loop_value, ca.SX(0), ca.SX(0), None
        if mode == "position":
            assert axis.position is not None
            own = self.translate(axis.position)
        elif mode == "move":
            segment = self.parameters.add(f"segment.{name}", polynomial.SEGMENT_SIZE)
            own = polynomial.evaluate(segment, self.clock.t)
        elif mode == "path":
            assert path_value is not None
            own = path_value
        else:
            return start, ca.SX(0), ca.SX(0), None
        rate = self.clock.rate(own)
        return own, rate, self.clock.rate(rate), None
