"""`disturbance_observer` of a law: what pushes the arm is estimated, and taken off."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from taskspec.spec.model import Model, short_form
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant, ForJoints
from taskspec.text.units import FREQUENCY, MOMENT


class DisturbanceObserver(Model):
    """A disturbance observer; see `laws.disturbance`.

    Attributes:
        bandwidth: of its low-pass [Hz].
        torque: the most that it takes off, of each joint or one for all [N m, N]; None for a
            quarter of what each can exert.
    """

    noun = "a disturbance observer"
    example: ClassVar = "disturbance_observer: {bandwidth: 20 Hz, torque: 10 N*m}"
    short: ClassVar = Constant(FREQUENCY, above=0).json()

    bandwidth: Annotated[float, Constant(FREQUENCY, above=0)] = Field(title="Bandwidth")
    torque: Annotated[tuple[float, ...], ForJoints(MOMENT, above=0)] | None = Field(
        None, title="Most torque that it takes off"
    )

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """Reads a bare frequency."""
        return short_form(data, "bandwidth")
