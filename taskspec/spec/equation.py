"""`world`: constraint equations on the tool tip, its rotation included, or on the joints."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, Problem, ScopeKind, infer, parse
from taskspec.expression.problem import ExpressionError
from taskspec.expression.scope import coordinate
from taskspec.expression.tree import Binary, Call, Equation, Name, walk
from taskspec.geometry.axis import ROTATIONS, TRANSLATIONS
from taskspec.spec import values
from taskspec.spec.field_type import FieldType
from taskspec.spec.fields import EXACT, FrameName
from taskspec.spec.model import Model
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.quantities import Constant
from taskspec.text.codes import register
from taskspec.text.data import Map, Text
from taskspec.text.units import (
    ANGULAR_DAMPING,
    ANGULAR_STIFFNESS,
    DAMPING,
    NUMBER,
    STIFFNESS,
)

register(
    {
        "TS310": "an equation that is no constraint",
        "TS340": "an equation that cannot be exact",
    }
)

Relation = Literal["=", "<=", ">="]


@dataclass(frozen=True, slots=True)
class Constraint:
    """Two sides and how they relate.

    Attributes:
        residual: left minus right; zero on the constraint.
        relation: `=` holds in both directions; under `<=` and `>=` the tool may leave to one side.
        joints: it is on joints, not on the tool tip.
        moves: the place of the tip is among what it is on.
        turns: the rotation of the tip is.
    """

    residual: Expression
    relation: Relation
    joints: bool = False
    moves: bool = False
    turns: bool = False

    @property
    def angular(self) -> bool:
        """Whether its distance is an angle and its force a moment."""
        return self.joints or not self.moves

    def __str__(self) -> str:
        return str(self.residual)


@dataclass(frozen=True)
class Sides(FieldType):
    """The text of an equation."""

    def read(self, value: object, context: ParseContext) -> Constraint:
        """The constraint of the text."""
        nothing = Constraint(Expression("", Name(("x",)), NUMBER), "=", moves=True)
        if not isinstance(value, Text):
            message = f"an equation is needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), "such as x^2 + y^2 = (300 mm)^2")
            return nothing
        node = values.parsed(value, "equation", context, "an equation")
        if node is None:
            return nothing
        assert isinstance(node, Equation)
        residual = Binary("-", node.left, node.right, start=node.start, end=node.end)
        kind, problems = infer(residual, context.scope(ScopeKind.EQUATION))
        context.problems(value, problems or _coordinates(residual))
        if problems or not values.still(value, residual, context):
            return nothing
        expression = Expression(value, residual, kind.dimension or NUMBER, value.node.origin)
        moves, turns = on_place(residual), on_rotation(residual)
        return Constraint(expression, node.op, on_joints(residual), moves, turns)

    def json(self) -> dict[str, Any]:
        """Describes the equation."""
        return {
            "type": "string",
            "description": "Two sides, related by =, <= or >=",
            "examples": [
                "x^2 + y^2 = (300 mm)^2",
                "z >= 300 mm + 2 mm * sin(2*pi*clock*1 Hz)",
                "q1 + 2*q2 = 90 deg",
                "rz + 2 rad/m * x = 1 rad",
                "angle(tool.z, world.z) >= 170 deg",
            ],
        }


def on_joints(residual: Binary) -> bool:
    """Whether an equation is one of joints."""
    return any(name.startswith("q") for name in _used(residual))


def on_place(residual: Binary) -> bool:
    """Whether the place of the tip is among what an equation is on."""
    return any(name in TRANSLATIONS for name in _used(residual))


def on_rotation(residual: Binary) -> bool:
    """Whether the rotation of the tip is."""
    angles = (n for n in walk(residual) if isinstance(n, Call) and n.function == "angle")
    of_tool = any(n.path[0] == "tool" for a in angles for n in walk(a) if isinstance(n, Name))
    return of_tool or any(name in ROTATIONS for name in _used(residual))


def _used(residual: Binary) -> dict[str, Name]:
    """The coordinates in a residual."""
    names = (n for n in walk(residual) if isinstance(n, Name) and len(n.path) == 1)
    return {n.path[0]: n for n in names if coordinate(n.path[0]) is not None}


def _coordinates(residual: Binary) -> tuple[Problem, ...]:
    """Reports an equation on nothing, or on the tip and on joints at once."""
    mine, turns = _used(residual), on_rotation(residual)
    if not (mine or turns):
        message = "this equation constrains nothing"
        hint = "use x, y, z, rx, ry, rz of the tool tip, or joints q1, q2, ..."
        return (Problem("TS310", message, residual.start, residual.end, hint),)
    joints = [node for name, node in mine.items() if name.startswith("q")]
    if joints and (turns or len(joints) < len(mine)):
        message = "an equation is on the tool tip or on joints, not on both"
        hint = "state them as two objects, or write the tip's place by the joints"
        return (Problem("TS310", message, joints[0].start, joints[0].end, hint),)
    return ()


class EquationObject(Model):
    """A constraint on the tool tip, in the world or in `frame`, or on joints `q1 q2 ...`.

    Attributes:
        equation: its two sides.
        frame: in which x, y, z, rx, ry and rz count; None for the world.
        stiffness: along the unit gradient [N/m], of an equation on joints [N*m/rad]; `rigid`: the
            stiffest spring that a step of the plant resolves; `exact`: no spring, but a multiplier.
        damping: along the unit gradient [N*s/m]; of an equation on joints [N*m*s/rad]. None for
            0.1 * 2 * sqrt(stiffness * 1 kg), or with 0.05 kg*m^2 on joints.
    """

    noun = "an equation"
    example = 'rim: {equation: "x^2 + y^2 = (300 mm)^2"}'
    advice: ClassVar = dict.fromkeys(
        ("rigid", "exact"), "write stiffness: exact, or stiffness: rigid for the stiffest spring"
    )

    equation: Annotated[Constraint, Sides()] = Field(title="Equation")
    frame: FrameName | None = Field(None, title="Frame in which the coordinates count")
    stiffness: Annotated[
        float | Literal["rigid", "exact"], Constant(STIFFNESS, above=0, words=("rigid", "exact"))
    ] = Field(20e3, title="Stiffness along the unit gradient")
    damping: Annotated[float, Constant(DAMPING, least=0)] | None = Field(
        None, title="Damping along the unit gradient"
    )

    @property
    def exact(self) -> bool:
        """Whether it holds exactly, by a multiplier, and not by a spring."""
        return self.stiffness == "exact"

    @property
    def kind(self) -> str:
        """The kind of its signals."""
        kind = _KINDS[self.equation.joints, self.equation.angular]
        return EXACT + kind if self.exact else kind

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Reports what an exact equation does not have: a side to leave to, damping."""
        if data.get("stiffness") != "exact":
            return
        relation = _relation(data.get("equation"))
        if relation not in ("", "="):
            message = f"an equation with {relation!r} lets go on one side: it cannot be exact"
            hint = "write = for what holds both ways, or stiffness: rigid for a surface"
            context.error("TS340", message, span_of(data["equation"]), hint)
        if "damping" in data:
            message = "an exact equation has no damping: nothing moves along its gradient"
            hint = "leave it out, or write stiffness: rigid"
            context.error("TS340", message, data.node.key_span("damping"), hint)


class RotationEquation(EquationObject):
    """A constraint on the rotation of the tool tip alone, `rx ry rz` or an angle between axes."""

    stiffness: Annotated[
        float | Literal["rigid", "exact"],
        Constant(ANGULAR_STIFFNESS, above=0, words=("rigid", "exact")),
    ] = Field(2e3, title="Stiffness along the unit gradient")
    damping: Annotated[float, Constant(ANGULAR_DAMPING, least=0)] | None = Field(
        None, title="Damping along the unit gradient"
    )


class JointEquation(RotationEquation):
    """A constraint on joints."""

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Reports a frame, which joints do not have, and what an exact equation does not."""
        super().rules(data, context)
        if "frame" in data and not _mixed(data.get("equation")):
            message = "an equation on joints has no 'frame'"
            context.error("TS310", message, data.node.key_span("frame"), "leave it out")


def kind_of_text(text: object) -> str:
    """The kind of the equation that a raw text states, `equation` where that is unclear."""
    residual = _residual(text)
    if residual is None:
        return "equation"
    turns = on_rotation(residual) and not on_place(residual)
    joints = on_joints(residual)
    return _KINDS[joints, joints or turns]


#: By whether it is on joints, and whether its force is a moment.
_KINDS = {
    (False, False): "equation",
    (False, True): "rotation equation",
    (True, True): "joint equation",
}


def _mixed(text: object) -> bool:
    """Whether a raw text has coordinates of the tip among those of joints."""
    residual = _residual(text)
    return residual is not None and bool(_coordinates(residual))


def _relation(text: object) -> str:
    """The relation of a raw text; empty where it is no equation."""
    sides = _sides(text)
    return "" if sides is None else sides.op


def _residual(text: object) -> Binary | None:
    """Left minus right of a raw text; None where it is no equation."""
    sides = _sides(text)
    return None if sides is None else Binary("-", sides.left, sides.right)


def _sides(text: object) -> Equation | None:
    """Both sides of a raw text; None where it is no equation."""
    if not isinstance(text, Text):
        return None
    try:
        node = parse(text, "equation")
    except ExpressionError:
        return None
    assert isinstance(node, Equation)
    return node
