"""`constraints`: set points of the world's equations during a stage."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, ScopeKind
from taskspec.spec.axis import Ramp
from taskspec.spec.field_type import FieldType
from taskspec.spec.fields import EQUATIONS, EXACT
from taskspec.spec.joint_expressions import JointExpressions
from taskspec.spec.linear_ramp import RampedFormula
from taskspec.spec.model import Model, complete, field_types
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.text.data import Map
from taskspec.text.nodes import pointer
from taskspec.text.suggest import suggestion
from taskspec.text.units import FORCE, MOMENT, fitting


class SetPoint(Model):
    """What the robot applies along the unit gradient of an equation's left minus right side.

    Attributes:
        force: of an equation on the tool tip [N].
        torque: of an equation on joints, or on the tip's rotation alone [N*m].
        generalised: instead of either, the joint torques u_phi,d that stand for it, one for each
            joint [N*m; N of a slide], (4.101).
        ramp: time in which it is reached [s]; None for the default.
    """

    noun = "a set point"
    example = "such as {force: 20 N}"

    force: Annotated[Expression, RampedFormula(FORCE, ScopeKind.REFERENCE)] | None = Field(
        None, title="Force", description="Along the unit gradient, as the robot applies it"
    )
    torque: Annotated[Expression, RampedFormula(MOMENT, ScopeKind.REFERENCE)] | None = Field(
        None, title="Moment", description="Along the unit gradient of angles"
    )
    generalised: (
        Annotated[tuple[Expression, ...], JointExpressions(MOMENT, FORCE, ScopeKind.REFERENCE)]
        | None
    ) = Field(
        None,
        title="Joint torques",
        description="One for each joint, as the robot applies them through the constraint",
    )
    ramp: Ramp | None = Field(None, title="Time in which it is reached")

    @property
    def wanted(self) -> Expression | None:
        """The set point along the unit gradient; None where it is given as joint torques."""
        return self.force if self.force is not None else self.torque

    @property
    def expressions(self) -> tuple[Expression, ...]:
        """What it is made of, whichever form it has."""
        wanted = self.wanted
        return self.generalised or () if wanted is None else (wanted,)


#: The key of a set point in joint torques.
_JOINTS = "generalised"
#: What an equation is on, by its kind.
_PLACES = {
    "equation": "the tool tip",
    "rotation equation": "the tip's rotation",
    "joint equation": "joints",
}
_AXIS = "to press on it, give an axis of the stage's frame a force: axes: {z: {force: -10 N}}"


@dataclass(frozen=True)
class SetPoints(FieldType):
    """A mapping of equations to their set points."""

    def read(self, value: object, context: ParseContext) -> dict[str, SetPoint]:
        """The set points by the name of the equation."""
        if not isinstance(value, Map):
            message = f"'constraints' is a mapping of equations, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), "such as {rim: {force: 20 N}}")
            return {}
        found = {}
        known = context.of_kind(*EQUATIONS)
        for name, entry in value.items():
            if name not in known:
                span = value.node.key_span(name)
                hint = _AXIS if name in context.objects else suggestion(name, known, "equations")
                if name in SetPoint.model_fields:
                    hint = f"it stands under its equation, such as {{rim: {{{name}: ..}}}}"
                context.error("TS123", f"'{name}' is no equation", span, hint)
                continue
            self._check(name, entry, context)
            found[name] = SetPoint.model_validate(entry, context=context)
        return found

    def _check(self, name: str, entry: object, context: ParseContext) -> None:
        """Requires the one quantity that fits the equation."""
        if not isinstance(entry, Map):
            return
        kind = context.objects[name].removeprefix(EXACT)
        angular = kind != "equation"
        right, wrong = ("torque", "force") if angular else ("force", "torque")
        if wrong in entry:
            where = _PLACES[kind]
            message = f"a {wrong} on an equation of {where}"
            context.error("TS205", message, entry.node.key_span(wrong), f"write '{right}'")
        elif right in entry and _JOINTS in entry:
            message = f"a '{right}' beside '{_JOINTS}', which says what it is"
            context.error("TS026", message, entry.node.key_span(_JOINTS), "keep one of the two")
        elif entry.keys() <= {"ramp"} and complete(entry, context):
            message = f"a set point needs a '{right}'"
            unit = fitting(FORCE.on(rotation=angular))[0]
            hint = f"such as {{{right}: 20 {unit}}}, or joint torques: {{{_JOINTS}: [1 N*m, 0]}}"
            context.error("TS021", message, pointer(entry.node), hint)

    def json(self) -> dict[str, Any]:
        """Describes the mapping."""
        entry = {
            "type": "object",
            "title": "Set point",
            "description": "A force of an equation on the tip, a torque of one on angles alone, or "
            "the joint torques of either",
            "additionalProperties": False,
            "properties": {
                key: next(each.json() for each in field_types(field) if isinstance(each, FieldType))
                | {
                    "title": field.title,
                    "description": field.description or "A time (s), such as '0.5 s'",
                }
                for key, field in SetPoint.model_fields.items()
            },
            "examples": [
                {"force": "20 N"},
                {"torque": "2 N*m", "ramp": "0.5 s"},
                {"generalised": ["1 N*m", "1 N*m"]},
            ],
        }
        return {"type": "object", "additionalProperties": entry}
