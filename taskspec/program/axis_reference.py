"""The reference of one axis against time: what its mode asks for, blended in at entry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from taskspec.motion import blend, polynomial
from taskspec.program.clock import Clock
from taskspec.program.layout import Layout
from taskspec.spec import Axis
from taskspec.text.expression import Expression

#: Turns an expression of the task file into CasADi.
Translate = Callable[[Expression], ca.SX]


@dataclass(frozen=True, slots=True)
class AxisReference:
    """Coordinate of one axis, r(t), with its rates.

    Attributes:
        mode: hold, position, velocity, move, path or open-loop.
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


def mode_of(axis: Axis, *, driven_by_path: bool, open_loop: bool) -> str:
    """Which kind of reference an axis has."""
    if open_loop:
        return "open-loop"
    if driven_by_path:
        return "path"
    for mode in ("position", "velocity", "move"):
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

    def build(
        self,
        name: str,
        mode: str,
        axis: Axis,
        *,
        path_value: ca.SX | None = None,
        open_loop_value: ca.SX | None = None,
    ) -> AxisReference:
        """The reference of axis `name`.

        Args:
            name: axis name. mode: from `mode_of`. axis: its entry in the file.
            path_value: its path coordinate. open_loop_value: the displacement that an open-loop
                force asks for.
        """
        t = self.clock.t
        start = self.parameters.add(f"start.{name}")
        offset = self.parameters.add(f"offset.{name}")
        slope = self.parameters.add(f"slope.{name}")
        time = self.parameters.add(f"blend.{name}")
        step = None
        if mode == "velocity":
            assert axis.velocity is not None
            speed = self.translate(axis.velocity)
            gain = self.clock.rate(speed)
            travelled = self.memory.add(f"travelled.{name}")
            step = speed * self.period + gain * (self.period**2 / 2)
            own, own_rate, own_acceleration = start + travelled, speed, gain
        else:
            if mode == "position":
                assert axis.position is not None
                own = self.translate(axis.position)
            elif mode == "move":
                segment = self.parameters.add(f"segment.{name}", polynomial.SEGMENT_SIZE)
                own = polynomial.evaluate(segment, t)
            elif mode == "path":
                assert path_value is not None
                own = path_value
            elif mode == "open-loop":
                assert open_loop_value is not None
                own = start + open_loop_value
            else:
                own = start
            own_rate = self.clock.rate(own)
            own_acceleration = self.clock.rate(own_rate)
        if mode == "open-loop":
            # The displacement stands for a force: no motion of that speed is asked of the damper.
            own_rate, own_acceleration = ca.SX(0), ca.SX(0)
        s = t / time
        blending = offset * blend.offset_shape(s) + slope * time * blend.slope_shape(s)
        blending_rate = self.clock.rate(blending) if mode != "open-loop" else ca.SX(0)
        return AxisReference(
            mode,
            own + blending,
            own_rate + blending_rate,
            own_acceleration + self.clock.rate(blending_rate),
            (own, own_rate),
            step,
        )
