"""`control`: when controller and plant step, and what the controller makes of its readings."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from taskspec.spec.joint_friction import FrictionCompensation
from taskspec.spec.joint_velocity import VelocitySource
from taskspec.spec.model import Model
from taskspec.spec.parse_context import ParseContext, span_of
from taskspec.spec.quantities import Constant
from taskspec.text.data import Map
from taskspec.text.units import FREQUENCY, TIME

USUAL = 1000.0
SLOWEST = 20.0
FASTEST = 100e3


class Control(Model):
    """When the controller steps, and when it gives up.

    Attributes:
        rate: of the controller [Hz].
        plant_rate: of the simulated plant, a whole multiple of `rate` [Hz].
        timeout: how long it goes on with the last value of a sensor or an encoder that gives none
            [s]; then it stops.
        velocity: what it takes the velocity of the joints from.
        friction: what it compensates of the joints' friction; None for nothing.
    """

    noun = "'control'"
    example = "control: {rate: 1 kHz}"

    rate: Annotated[float, Constant(FREQUENCY, least=SLOWEST, most=FASTEST)] = Field(
        USUAL, title="Rate of the controller"
    )
    plant_rate: Annotated[float, Constant(FREQUENCY, least=SLOWEST, most=FASTEST)] = Field(
        USUAL,
        title="Rate of the plant",
        description="A whole multiple of the controller's rate; by default the first from 1 kHz on",
    )
    timeout: Annotated[float, Constant(TIME, above=0)] = Field(
        0.02,
        title="How long it goes on without a reading",
        description="With the last value of a sensor or an encoder that gives none; then it stops",
    )
    velocity: VelocitySource = Field(
        VelocitySource(),
        title="What the velocity of the joints is taken from",
        description="measured, differences of positions, their low-pass, or an observer",
    )
    friction: FrictionCompensation | None = Field(
        None, title="Compensation of the friction that 'robot' declares of its joints"
    )


def settle_rates(
    control: Control, data: Map, context: ParseContext, served: float = math.inf
) -> Control:
    """The rates with those that the file leaves out filled in; reports one that does not fit.

    Args:
        control: as the file has it.
        data: the raw mapping, empty if the file has none.
        context: the pass.
        served: rate of the joint servo that takes the controller's commands [Hz]; infinite where
            none is declared.
    """
    if "rate" not in data and SLOWEST <= served < control.rate:
        control = control.model_copy(update={"rate": served})
    if not all(SLOWEST <= rate <= FASTEST for rate in (control.rate, control.plant_rate)):
        return control
    if "plant_rate" not in data:
        multiple = max(1, math.ceil(USUAL / control.rate - 1e-9))
        return control.model_copy(update={"plant_rate": multiple * control.rate})
    ratio = control.plant_rate / control.rate
    if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-9 * ratio:
        context.error(
            "TS118",
            f"the plant's rate is a whole multiple of the controller's ({control.rate:g} Hz)",
            span_of(data["plant_rate"]),
        )
    return control
