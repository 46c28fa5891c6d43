"""`reward`: what a learner of a task is to make large."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, ScopeKind
from taskspec.spec.field_type import FieldType
from taskspec.spec.model import Model, complete, short_form
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant, Formula
from taskspec.text.codes import register
from taskspec.text.data import Map
from taskspec.text.nodes import pointer
from taskspec.text.suggest import suggestion
from taskspec.text.units import NUMBER

register({"TS136": "a reward that gives nothing"})

_RATE = Formula(NUMBER, ScopeKind.REWARD)


@dataclass(frozen=True)
class Rates(FieldType):
    """An expression for all stages, or a mapping of stages to theirs."""

    def read(self, value: object, context: ParseContext) -> dict[str, Expression]:
        """The expression of every stage that has one, by its name."""
        if not isinstance(value, Map):
            return dict.fromkeys(context.stages, _RATE.read(value, context))
        found = {}
        for name, rate in value.items():
            if name in context.stages:
                found[name] = _RATE.read(rate, context)
            elif context.stages:
                hint = suggestion(name, context.stages, "stages")
                span = value.node.key_span(name)
                context.error("TS124", f"unknown stage '{name}'", span, hint)
        return found

    def json(self) -> dict[str, Any]:
        """Describes both forms."""
        one = _RATE.json()
        return {"anyOf": [one, {"type": "object", "additionalProperties": one}]}


Term = Annotated[float, Constant(NUMBER)]


class Reward(Model):
    """What a learner of the task is to make large: so much in a second, and at the end.

    The words of the end are those of a sweep's table.

    Attributes:
        rate: by stage, plain numbers in a second, of true signals; 0 in the others.
        passed: at the end of a run that did what is expected.
        missed: at the end of one that did not do all of it, or no longer can.
        failed: at the end of one that came to `fail`.
        stopped: at the end of one that a limit stopped.
    """

    noun = "a reward"
    example = "reward: {rate: -abs(force.z + 12 N)/(5 N), passed: 10}"
    short: ClassVar = _RATE.json()
    advice: ClassVar = dict.fromkeys(("success", "done", "end", "goal"), "write 'passed'")

    rate: Annotated[Mapping[str, Expression], Rates()] = Field({}, title="Reward in a second")
    passed: Term = Field(0.0, title="At the end of a run that passed")
    missed: Term = Field(0.0, title="At the end of a run that missed an expectation")
    failed: Term = Field(0.0, title="At the end of a run that failed")
    stopped: Term = Field(0.0, title="At the end of a run that a limit stopped")

    @classmethod
    def expand(cls, data: object, context: ParseContext) -> object:  # noqa: ARG003
        """An expression is short for `{rate: ..}`."""
        return short_form(data, "rate")

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Require a term."""
        if not data and complete(data, context):
            message = "'reward' needs a rate or a term of the end"
            context.error("TS136", message, pointer(data.node), cls.example)

    def at_end(self, verdict: str) -> float:
        """The term of a verdict: passed, missed, failed or stopped."""
        return {
            "passed": self.passed,
            "missed": self.missed,
            "failed": self.failed,
            "stopped": self.stopped,
        }[verdict]
