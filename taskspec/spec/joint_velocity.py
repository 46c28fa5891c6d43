"""`control.velocity`: where the controller takes the velocity of the joints from."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import Field

from taskspec.spec.model import Model
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant
from taskspec.spec.words import Word
from taskspec.text.data import Map, Text
from taskspec.text.nodes import Mapping
from taskspec.text.units import FREQUENCY

MEASURED, DIFFERENCES = "measured", "differences"
#: Of a filter that lets everything pass.
_NONE = "none"


class VelocitySource(Model):
    """How joint velocity is had: measured, of filtered differences, or of an observer.

    Attributes:
        filter: corner frequency of the low-pass on differences of positions [Hz]; `none` for plain
            differences; None where there are none.
        observer: corner frequency of the observer's two equal poles [Hz]; None for no observer.
    """

    noun = "what joint velocity is taken from"
    example = "velocity: {observer: 80 Hz}"
    short: ClassVar = Word((MEASURED, DIFFERENCES), "source").json()

    filter: Annotated[float | str, Constant(FREQUENCY, above=0, words=(_NONE,))] | None = Field(
        None,
        title="Corner frequency of the low-pass on differences of positions",
        description="Differences of positions, low-passed; none: plain differences",
    )
    observer: Annotated[float, Constant(FREQUENCY, above=0)] | None = Field(
        None,
        title="Corner frequency of an observer with the arm's model",
        description="Of its two equal poles",
    )

    @property
    def measured(self) -> bool:
        """Whether the robot measures it."""
        return self.filter is None and self.observer is None

    @property
    def corner(self) -> float | None:
        """Corner frequency of filter or observer [Hz]; None where there is none."""
        return self.filter if isinstance(self.filter, float) else self.observer

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:
        """Reads the two words."""
        if not isinstance(data, Text):
            return data
        choice = Word((MEASURED, DIFFERENCES), "source", others=("filter", "observer"))
        word, full = choice.read(data, context), Map()
        full.node = Mapping(data.node.span, flow=True)
        if word == DIFFERENCES:
            full["filter"] = nothing = Text(_NONE)
            nothing.node = data.node
            full.node.entries["filter"] = (data.node, data.node)
        return full

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Allows one source."""
        if "filter" in data and "observer" in data:
            context.error(
                "TS026",
                "joint velocity is taken from filtered differences, or from an observer",
                data.node.key_span("observer"),
                "keep one of the two",
            )
