"""`tank` of a law: what it may put into the arm beyond what its dampers take."""

from __future__ import annotations

import math
from typing import Annotated, ClassVar

from pydantic import Field

from taskspec.laws.tank import EnergyTank
from taskspec.spec.model import Model, short_form
from taskspec.spec.parse_context import ParseContext, span_of
from taskspec.spec.quantities import Constant, quantity_schema
from taskspec.spec.values import constant, measures
from taskspec.text.data import Map
from taskspec.text.units import MOMENT, POWER, joules

Joules = Annotated[float, Constant(MOMENT, above=0)]


class Tank(Model):
    """An energy tank; see `laws.tank`.

    Attributes:
        energy: the most that it holds [J].
        start: what is in it as a stage takes it up anew, all that it holds by default [J].
        power: the most that leaves it [W].
    """

    noun = "an energy tank"
    example = "such as 2 J, or {energy: 2 J, start: 1 J, power: 5 W}"
    short: ClassVar = quantity_schema(MOMENT)
    advice: ClassVar = {
        "capacity": "what it holds at most is 'energy'",
        "max": "what it holds at most is 'energy'",
        "initial": "what is in it at first is 'start'",
        "max_power": "the most that leaves it is 'power'",
    }

    energy: Joules = Field(title="Capacity")
    start: Joules | None = Field(None, title="Energy at the start")
    power: Annotated[float, Constant(POWER, above=0)] | None = Field(None, title="Power limit")

    @property
    def first(self) -> float:
        """What is in it as a stage takes it up anew [J]."""
        return self.energy if self.start is None else self.start

    @property
    def of_law(self) -> EnergyTank:
        """The tank of the law's equation."""
        return EnergyTank(self.energy, math.inf if self.power is None else self.power)

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """Reads an energy as a tank of that capacity."""
        return short_form(data, "energy")

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Reports a tank that begins with more than it holds."""
        energy, start = data.get("energy"), data.get("start")
        if not (measures(energy, MOMENT, context) and measures(start, MOMENT, context)):
            return
        most, first = constant(energy, MOMENT, context), constant(start, MOMENT, context)
        if most is not None and first is not None and first > most:
            holds = joules(most)
            context.error(
                "TS118",
                f"this has to be at most {holds}, which the tank holds",
                span_of(start),
                "give it more 'energy', or leave 'start' out: then it begins full",
            )
