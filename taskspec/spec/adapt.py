"""`adapt`: what a law finds out about the arm while it moves."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field
from pydantic_core import PydanticCustomError

from taskspec.spec.model import REPORTED, Model, complete
from taskspec.spec.parse_context import ParseContext, span_of
from taskspec.spec.quantities import Constant, QuantityInterval
from taskspec.text.codes import register
from taskspec.text.data import Map, Text
from taskspec.text.nodes import Mapping as MappingNode
from taskspec.text.nodes import Scalar, pointer
from taskspec.text.suggest import suggestion
from taskspec.text.units import FORCE, FREQUENCY, LENGTH, MASS

register({"TS138": "an adaptation that means nothing"})

KINDS = ("payload", "gravity")


class PayloadAdaptation(Model):
    """Adaptation to a payload that the model of the arm does not have; see `laws.adaptation`.

    Attributes:
        mass: bounds of its mass [kg]; the estimate begins at the lower one.
        reach: how far its centre of mass is from the tip at most, along each axis [m].
        bandwidth: how fast errors of the estimate vanish [Hz]: as exp(-2 pi bandwidth t).
        dead_zone: a force that the payload does not explain, below which nothing adapts [N].
    """

    noun = "an adaptation to a payload"
    example = "adapt: {payload: {mass: 0..2 kg, bandwidth: 0.5 Hz}}"
    advice: ClassVar = {
        "rate": "how fast it adapts is 'bandwidth', in Hz",
        "dead_band": "the force below which nothing adapts is 'dead_zone'",
        "deadzone": "the force below which nothing adapts is 'dead_zone'",
        "center": "how far its centre of mass may be from the tip is 'reach'",
        "xyz": "how far its centre of mass may be from the tip is 'reach'",
    }

    mass: Annotated[tuple[float, float], QuantityInterval(MASS, least=0.0)] = Field(
        (0.0, 1.0), title="Least and greatest mass"
    )
    reach: Annotated[float, Constant(LENGTH, above=0)] = Field(
        0.2, title="Greatest distance of its centre of mass from the tip"
    )
    bandwidth: Annotated[float, Constant(FREQUENCY, above=0)] = Field(
        0.5, title="Bandwidth of the estimate"
    )
    dead_zone: Annotated[float, Constant(FORCE, least=0)] = Field(
        0.1, title="Dead zone of the force"
    )


class Adapt(Model):
    """What a law adapts to: a payload, or its weight alone.

    Attributes:
        payload: its weight and its inertia join the model of the arm.
        gravity: its weight alone does.
    """

    noun = "an adaptation"
    example = "adapt: payload"
    short: ClassVar[dict[str, Any]] = {"enum": list(KINDS)}
    advice: ClassVar = dict.fromkeys(
        ("mass", "load", "weight", "inertia"), "write 'payload', or 'gravity' for its weight alone"
    )

    payload: PayloadAdaptation | None = Field(None, title="To a payload")
    gravity: PayloadAdaptation | None = Field(None, title="To the weight of a payload")

    @property
    def to(self) -> PayloadAdaptation:
        """Its numbers."""
        return self.payload or self.gravity or PayloadAdaptation()

    @property
    def moves(self) -> bool:
        """Whether the inertia of the payload counts too."""
        return self.payload is not None

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:
        """Reads a bare word."""
        if not isinstance(data, Text):
            return data
        if data not in KINDS:
            hint = suggestion(str(data), KINDS, "it adapts to")
            context.error("TS138", f"nothing adapts to {str(data)!r}", span_of(data), hint)
            raise PydanticCustomError(REPORTED, "reported")
        node = data.node
        assert isinstance(node, Scalar)
        empty = Map()
        empty.node = MappingNode(node.span, flow=True, entries={})
        full = Map({str(data): empty})
        full.node = MappingNode(node.span, flow=True, entries={str(data): (node, node)})
        return full

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Requires one of the two."""
        if len(data) == len(KINDS):
            message = "a law adapts to a payload, or to its weight alone"
            context.error("TS026", message, data.node.key_span("gravity"), "keep one of the two")
        elif not data and complete(data, context):
            message = "'adapt' does not say to what"
            context.error("TS138", message, pointer(data.node), cls.example)
