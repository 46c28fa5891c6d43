"""`control`: how often the controller and the plant step."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from taskspec.spec.model import Model
from taskspec.spec.quantities import Constant
from taskspec.text.units import FREQUENCY


class Control(Model):
    """Rates [Hz].

    Attributes:
        rate: of the controller.
        plant_rate: of the simulated plant.
    """

    noun = "'control'"
    example = "control: {rate: 1 kHz}"

    rate: Annotated[float, Constant(FREQUENCY, above=0)] = Field(
        1000.0, title="Rate of the controller"
    )
    plant_rate: Annotated[float, Constant(FREQUENCY, above=0)] = Field(
        1000.0, title="Rate of the plant"
    )
