"""`world`: a spring and damper in six directions between the tool tip and the world."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec.spec.field_type import FieldType
from taskspec.spec.fields import RPY, XYZ
from taskspec.spec.model import Model
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.quantities import Constant, EitherQuantity, quantity_schema
from taskspec.spec.words import Word
from taskspec.text.codes import register
from taskspec.text.data import Items, Map
from taskspec.text.units import ANGLE, DAMPING, FORCE, STIFFNESS, TIME, Dimension, fitting

register(
    {
        "TS334": "a matrix that is not symmetric",
        "TS335": "a matrix that is not positive semidefinite",
    }
)

Matrix = tuple[tuple[float, ...], ...]
"""(6, 6) [SI units]."""

#: Entries that differ by less than this part of the geometric mean of their diagonal are one.
_ALIKE = 1e-9
#: As far below zero as this part of the largest pivot is rounding.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class SixBySix(FieldType):
    """A symmetric positive-semidefinite matrix on x, y, z, rx, ry, rz: its diagonal, or six rows.

    Attributes:
        linear: dimension of what couples translations.
        coupling: of what couples a translation with a rotation: of a force per angle, which is
            also that of a moment per length, an angle being a number.
    """

    linear: Dimension
    coupling: Dimension

    def read(self, value: object, context: ParseContext) -> Matrix:
        """The matrix in SI units, zero where it cannot be read."""
        nothing: Matrix = ((0.0,) * 6,) * 6
        if not isinstance(value, Items):
            message = f"6 values or a 6x6 matrix are needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), self._example())
            return nothing
        rows = [isinstance(entry, Items) for entry in value]
        if len(value) != len(AXES) or (any(rows) and not all(rows)):
            if not value.node.broken:
                what = "rows" if any(rows) else "entries"
                message = f"6 {what} are needed here, of x y z rx ry rz, these are {len(value)}"
                message = message if len(value) != len(AXES) else "a list of values and of rows"
                context.error("TS023", message, span_of(value), self._example())
            return nothing
        before = len(context.diagnostics)
        found = [self._row(i, entry, context) for i, entry in enumerate(value)]
        if len(context.diagnostics) > before:
            return nothing
        if any(rows):
            self._check(found, value, context)
        return tuple(map(tuple, found))

    def _row(self, i: int, value: object, context: ParseContext) -> list[float]:
        """A row, or an entry of the diagonal, in SI units."""
        if not isinstance(value, Items):
            entry = Constant(self.linear.on(rotation=AXES[i].is_rotation), least=0)
            return [float(entry.read(value, context)) if i == j else 0.0 for j in range(6)]
        if len(value) != len(AXES):
            message = f"row {AXES[i]} has {len(value)} entries, 6 are needed: x y z rx ry rz"
            context.error("TS023", message, span_of(value))
            return [0.0] * 6
        return [self._entry(i, j, entry, context) for j, entry in enumerate(value)]

    def _entry(self, i: int, j: int, value: object, context: ParseContext) -> float:
        if AXES[i].is_rotation == AXES[j].is_rotation:
            turns = AXES[i].is_rotation
            least = 0.0 if i == j else None
            return float(Constant(self.linear.on(rotation=turns), least=least).read(value, context))
        return float(EitherQuantity(self.coupling / ANGLE, self.coupling).read(value, context))

    def _check(self, K: list[list[float]], value: Items, context: ParseContext) -> None:
        """Reports a matrix that is not symmetric, or along which something is pushed away."""
        for i in range(6):
            for j in range(i):
                size = math.sqrt(K[i][i] * K[j][j])
                if abs(K[i][j] - K[j][i]) > _ALIKE * max(size, abs(K[i][j]), abs(K[j][i])):
                    message = (
                        f"row {AXES[i]}, column {AXES[j]} is {K[i][j]:g} and row {AXES[j]}, column "
                        f"{AXES[i]} is {K[j][i]:g}: a spring has the same there"
                    )
                    context.error("TS334", message, span_of(value[i]), "make both the same")
                    return
        for i in range(6):
            for j in range(i):
                if (most := math.sqrt(K[i][i] * K[j][j])) * (1 + _ALIKE) < abs(K[i][j]):
                    one, other = AXES[i], AXES[j]
                    message = (
                        f"row {one}, column {other} is {K[i][j]:g}, and what couples {one} with "
                        f"{other} is at most the root of the product of both on the "
                        f"diagonal, {most:g}: along some way it would push away"
                    )
                    hint = "make it smaller, or both axes stiffer"
                    context.error("TS335", message, span_of(value[i]), hint)
                    return
        if not _semidefinite(K):
            message = "along some way that joins several axes this pushes away: it is not positive"
            context.error("TS335", message, span_of(value), "make what couples axes smaller")

    def _example(self) -> str:
        one, other = (fitting(self.linear.on(rotation=turns))[0] for turns in (False, True))
        numbers = [f"2000 {one}"] * 3 + [f"20 {other}"] * 3
        return f"such as [{', '.join(numbers)}]"

    def json(self) -> dict[str, Any]:
        """Describes both forms."""
        diagonal = [Constant(self.linear.on(rotation=a.is_rotation)).json() for a in AXES]
        row = {"type": "array", "minItems": 6, "maxItems": 6, "items": quantity_schema()}
        both = [
            {"type": "array", "minItems": 6, "maxItems": 6, "prefixItems": diagonal},
            {"type": "array", "minItems": 6, "maxItems": 6, "items": row},
        ]
        return {
            "description": "Along and about x y z rx ry rz: the diagonal, or six rows of six",
            "anyOf": both,
        }


def _semidefinite(K: list[list[float]]) -> bool:
    """Whether a symmetric matrix has no negative eigenvalue, by L D L^T with pivots.

    Scaled to ones on its diagonal, so that its units do not matter.
    """
    root = [math.sqrt(K[i][i]) or 1.0 for i in range(6)]
    left = [[K[i][j] / (root[i] * root[j]) for j in range(6)] for i in range(6)]
    for _ in range(6):
        size = len(left)
        at = max(range(size), key=lambda i: left[i][i])
        pivot = left[at][at]
        if pivot < _ALIKE:
            return pivot > -_ROUNDING and all(abs(x) < math.sqrt(_ALIKE) for r in left for x in r)
        kept = [i for i in range(size) if i != at]
        left = [[left[i][j] - left[i][at] * left[at][j] / pivot for j in kept] for i in kept]
        if not left:
            break
    return True


class Bushing(Model):
    """A spring and damper in six directions between the tool tip and a rest pose in the world.

    Its coordinates are those of the tip in its own axes: the place x, y, z, and the rotation vector
    rx, ry, rz. Its energy is half their quadratic form with the stiffness.

    Attributes:
        bushing: what it holds: the `tool`.
        xyz: the tip's place at rest, in the world [m].
        rpy: the tip's orientation at rest, in the world [rad]; by default pointing down.
        stiffness: on its coordinates [N/m, N/rad, N*m/rad].
        damping: on their rates [N*s/m, N*s/rad, N*m*s/rad]; None for a tenth of critical for 1 kg
            and 0.05 kg*m^2.
    """

    noun = "a bushing"
    example = (
        "mount: {bushing: tool, xyz: [500 mm, 0, 300 mm], stiffness: [2 kN/m, 2 kN/m, 5 kN/m, "
        "20 N*m/rad, 20 N*m/rad, 10 N*m/rad]}"
    )
    advice: ClassVar = dict.fromkeys(
        ("rest", "at", "pose", "frame", "rest_pose"),
        "the pose of the tip in which it is at rest stands in 'xyz' and 'rpy', in the world",
    ) | dict.fromkeys(("k", "K", "gain", "matrix"), "how stiff it is stands in 'stiffness'")

    bushing: Annotated[Literal["tool"], Word(("tool",), "part")] = Field(title="What it holds")
    xyz: XYZ = Field(title="Position of the tip at rest", description="[x, y, z]")
    rpy: RPY = Field(
        (math.pi, 0.0, 0.0),
        title="Orientation of the tip at rest",
        description="[roll, pitch, yaw]",
    )
    stiffness: Annotated[Matrix, SixBySix(STIFFNESS, FORCE)] = Field(
        title="Stiffness in six directions"
    )
    damping: Annotated[Matrix, SixBySix(DAMPING, FORCE * TIME)] | None = Field(
        None, title="Damping in six directions"
    )

    @property
    def kind(self) -> str:
        """The kind of its signals."""
        return "bushing"

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Reports a bushing that is of another kind too."""
        for other in ("shape", "equation", "mechanism"):
            if other in data:
                message = f"an object has a 'bushing' or a '{other}', not both"
                span = data.node.key_span(other)
                context.error("TS026", message, span, "give each an object of its own")
