"""`control.friction`: how much of the joints' friction the controller compensates."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from taskspec.spec.model import Model, short_form
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant
from taskspec.text.units import ANGULAR_VELOCITY, NUMBER, TIME


class FrictionCompensation(Model):
    """Compensation of the friction and damping that `robot` declares of its joints.

    Attributes:
        share: of them, up to 1.
        width: speed of the reference at which 71 % of the share is reached [rad/s; of a slide the
            same number in m/s].
        time: in which the reference would take an error away [s].
    """

    noun = "a compensation of friction"
    example = "friction: {share: 80 %, width: 10 mrad/s}"
    short: ClassVar = Constant(NUMBER, above=0, most=1).json()

    share: Annotated[float, Constant(NUMBER, above=0, most=1)] = Field(
        title="Share of the declared friction",
        description="Of the friction and damping that 'robot' declares",
    )
    width: Annotated[float, Constant(ANGULAR_VELOCITY, above=0)] = Field(
        0.01, title="Speed of the reference at which most of it is reached"
    )
    time: Annotated[float, Constant(TIME, above=0)] = Field(
        0.1, title="Time in which the reference would take an error away"
    )

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """Reads a bare share."""
        return short_form(data, "share")
