"""`limits`: what stops a run or leads to another stage, and what a quadratic program keeps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar

from pydantic import Field

from taskspec.deferred_methods import dataclass
from taskspec.spec.model import Model
from taskspec.spec.parse_context import ParseContext, span_of
from taskspec.spec.quantities import Constant
from taskspec.spec.words import ENDS, NameReference
from taskspec.text.data import Map
from taskspec.text.suggest import suggestion
from taskspec.text.units import FORCE, LENGTH, MOMENT, POWER, VELOCITY

REACTING = ("force", "torque", "speed", "deviation")
"""Limits that may lead to a stage instead of stopping the run."""
_TARGET = NameReference(lambda r: r.targets, "stage", "TS124", always=ENDS)


class Bound(float):
    """The number of a limit, and the stage that crossing it leads to; empty where it stops."""

    then: str

    def __new__(cls, value: float, then: str = "") -> Bound:
        """Makes one from its number."""
        bound = super().__new__(cls, value)
        bound.then = then
        return bound

    def __reduce__(self) -> tuple[type[Bound], tuple[float, str]]:
        """What a copy is made of."""
        return Bound, (float(self), self.then)


#: What other words for the keys of a limit mean.
_INSTEAD = dict.fromkeys(("to", "goto", "next", "stage"), "the stage stands under 'then'")


@dataclass(frozen=True)
class ConstantLimit(Constant):
    """A quantity, or one with the stage that crossing it leads to: `{max: 40 N, then: lift}`."""

    def read(self, value: object, context: ParseContext) -> Bound:
        """The bound in SI units."""
        if not isinstance(value, Map):
            return Bound(float(super().read(value, context)))
        for key in value:
            if key not in ("max", "then"):
                hint = _INSTEAD.get(key) or suggestion(key, ("max", "then"), "keys")
                message = f"unknown key '{key}' in a limit"
                context.error("TS020", message, value.node.key_span(key), hint)
        for key, example in (("max", "max: 40 N"), ("then", "then: retreat")):
            if key not in value and value.keys() <= {"max", "then"} and not value.node.broken:
                message = f"a limit that leads to a stage needs the key '{key}'"
                context.error("TS021", message, span_of(value), f"such as {example}")
        bound = float(super().read(value["max"], context)) if "max" in value else 0.0
        then = str(_TARGET.read(value["then"], context)) if "then" in value else ""
        return Bound(bound, then)

    def json(self) -> dict[str, Any]:
        """Describes both forms."""
        most: dict[str, Any] = super().json()
        most |= {"title": "The limit", "description": f"Where it lies: {most['description']}"}
        then = _TARGET.json() | {"title": "Where it leads"}
        then |= {"description": "The stage that follows, end or fail"}
        keys = {"max": most, "then": then}
        full = {"type": "object", "properties": keys, "required": ["max", "then"]}
        return {"anyOf": [super().json(), {**full, "additionalProperties": False}]}


class Limits(Model):
    """Limits on what is measured; reaching one stops the run. None means no limit.

    A `Bound` with a stage ends the stage instead, and leads there. Under `solve: qp` they are
    constraints as well.

    Attributes:
        force: of the contact force [N].
        torque: of the contact moment [N*m].
        speed: of the control point [m/s].
        deviation: of the control point from the reference of the motion axes [m].
        torque_rate: of every joint's torque [N*m/s], kept under `solve: qp` alone.
    """

    noun = "'limits'"
    example = "limits: {force: 60 N}"
    advice: ClassVar = dict.fromkeys(
        ("max", "then"), "it stands under a limit: force: {max: 40 N, then: retreat}"
    )

    force: Annotated[float, ConstantLimit(FORCE, above=0)] | None = Field(
        None, title="Contact force"
    )
    torque: Annotated[float, ConstantLimit(MOMENT, above=0)] | None = Field(
        None, title="Contact moment"
    )
    speed: Annotated[float, ConstantLimit(VELOCITY, above=0)] | None = Field(None, title="Speed")
    deviation: Annotated[float, ConstantLimit(LENGTH, above=0)] | None = Field(
        None, title="Deviation of motion axes from their reference"
    )
    torque_rate: Annotated[float, Constant(POWER, above=0)] | None = Field(
        None, title="Rate of the joint torques"
    )

    def then(self, name: str) -> str:
        """The stage that crossing a limit leads to; empty where it stops the run or there is none.

        Args:
            name: of the limit.
        """
        return getattr(getattr(self, name), "then", "")

    def targets(self) -> Iterator[str]:
        """The stages that limits lead to."""
        yield from (self.then(name) for name in REACTING if self.then(name))

    def stopping(self) -> Limits:
        """Those alone that stop a run."""
        return self.model_copy(update={name: None for name in REACTING if self.then(name)})
