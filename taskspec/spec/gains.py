"""Values for the six axes: gains of the laws."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from types import MappingProxyType
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, ExpressionError, ScopeKind, parse
from taskspec.expression.scope import CONSTANTS
from taskspec.expression.tree import Name, walk
from taskspec.geometry.axis import (
    AXES,
    PAIRS,
    ROTATIONS,
    TRANSLATIONS,
    Axis,
    entry_dimension,
    is_mixed,
)
from taskspec.spec.field_type import FieldType
from taskspec.spec.parse_context import ParseContext, span_of
from taskspec.spec.quantities import NOTHING, Constant, ForJoints, Formula
from taskspec.text.codes import register
from taskspec.text.data import Items, Map, Text
from taskspec.text.suggest import suggestion
from taskspec.text.units import Dimension

register({"TS215": "an entry that a symmetric matrix of gains does not have"})

_GROUPS = {"linear": TRANSLATIONS, "angular": ROTATIONS}
_REVERSED = {b + a: pair for pair, (a, b) in PAIRS.items()}


@dataclass(frozen=True, slots=True)
class AxisValues:
    """One SI value, or expression, for each axis that the file names; None where it is designed.

    Attributes:
        x, y, z, rx, ry, rz: on the axes, the diagonal of a matrix.
        pairs: entries off the diagonal, by the names of their two axes.
    """

    x: float | Expression | None = None
    y: float | Expression | None = None
    z: float | Expression | None = None
    rx: float | Expression | None = None
    ry: float | Expression | None = None
    rz: float | Expression | None = None
    pairs: Mapping[str, float | Expression] = field(default_factory=lambda: MappingProxyType({}))

    @classmethod
    def of(
        cls, found: Mapping[Axis, float | Expression], pairs: Mapping[str, float | Expression]
    ) -> AxisValues:
        """Those on some axes, and entries off the diagonal."""
        x, y, z, rx, ry, rz = (found.get(axis) for axis in AXES)
        return cls(x, y, z, rx, ry, rz, MappingProxyType({**pairs}))

    def get(self, axis: Axis) -> float | Expression | None:
        """The value of an axis.

        Raises:
            KeyError: there is no such axis.
        """
        if axis not in AXES:
            raise KeyError(axis)
        value: float | Expression | None = getattr(self, axis)
        return value

    @property
    def entries(self) -> dict[str, float | Expression]:
        """All entries that the file gives, those of the axes first."""
        given = {str(axis): value for axis in AXES if (value := self.get(axis)) is not None}
        return given | dict(self.pairs)


@dataclass(frozen=True)
class GainField(FieldType):
    """A gain: one quantity for all translations, `{linear, angular}`, or one for each axis.

    Attributes:
        dimension: on a translation; a rotation has its counterpart.
        above: it has to be greater than this.
        least: it has to be at least this.
        matrix: whether it is a symmetric matrix on the axes, whose entries may be expressions of
            time and signals.
        of_joints: some laws take it for joints, which are other fields; for editors.
    """

    dimension: Dimension
    above: float | None = None
    least: float | None = None
    matrix: bool = False
    of_joints: bool = False

    def read(self, value: object, context: ParseContext) -> AxisValues:
        """The values of all axes."""
        if self.matrix and isinstance(value, Items):
            message = "a matrix of gains is given by its entries, not by rows"
            hint = "name them: {x: 2 kN/m, z: 1 kN/m, xz: 200 N/m}; it is symmetric"
            context.error("TS215", message, span_of(value), hint)
            return AxisValues()
        if not isinstance(value, Map):
            return AxisValues.of(dict.fromkeys(TRANSLATIONS, self._one(value, "x", context)), {})
        found: dict[Axis, float | Expression] = {}
        pairs: dict[str, float | Expression] = {}
        grouped = "linear" in value or "angular" in value
        words = tuple(_GROUPS) if grouped else AXES
        for key, entry in value.items():
            span = value.node.key_span(key)
            if self.matrix and key in PAIRS and is_mixed(key) and not self._mixes:
                message = f"'{key}' would act on a force and on a moment, each in other units"
                hint = "these gains couple forces with forces and moments with moments"
                context.error("TS215", message, span, hint)
            elif self.matrix and key in PAIRS:
                pairs[key] = self._one(entry, key, context)
            elif self.matrix and key in _REVERSED:
                own = _REVERSED[key]
                message = f"the matrix is symmetric: '{key}' is its entry '{own}'"
                if own in value:
                    message += ", which is given, too"
                context.error("TS215", message, span, f"give '{own}' alone")
            elif key not in words:
                hint = suggestion(key, words if grouped else [*AXES, "linear", "angular"], "keys")
                if key in AXES:
                    hint = "give 'linear' and 'angular', or the axes one by one"
                    context.error("TS026", f"'{key}' beside 'linear' or 'angular'", span, hint)
                elif key in PAIRS:
                    message = f"this gain is one of each axis: it has no entry '{key}'"
                    hint = "matrices are mass, stiffness, damping and the gains of 'force'"
                    context.error("TS215", message, span, hint)
                else:
                    context.error("TS020", f"unknown key '{key}' in a gain", span, hint)
            else:
                axes = _GROUPS.get(key) or (Axis(key),)
                found |= dict.fromkeys(axes, self._one(entry, axes[0], context))
        return AxisValues.of(found, pairs)

    @property
    def _mixes(self) -> bool:
        """Whether it has one dimension between a translation and a rotation, both ways."""
        return self.dimension.mixed != self.dimension

    def _one(self, value: object, entry: str, context: ParseContext) -> float | Expression:
        dimension = entry_dimension(self.dimension, entry)
        if self.matrix and _varies(value, context):
            expression = Formula(dimension, ScopeKind.REFERENCE).read(value, context)
            return 0.0 if expression is NOTHING else expression
        bounds = (None, None) if entry in PAIRS else (self.above, self.least)
        number = Constant(dimension, *bounds).read(value, context)
        assert isinstance(number, float)
        return number

    def json(self) -> dict[str, Any]:
        """Describes the forms."""
        linear, angular = (
            Constant(self.dimension.on(rotation=turns)).json() for turns in (False, True)
        )
        axes = dict.fromkeys(TRANSLATIONS, linear) | dict.fromkeys(ROTATIONS, angular)
        pairs = {
            pair: _between(Constant(entry_dimension(self.dimension, pair)).json())
            for pair in (PAIRS if self.matrix else ())
            if self._mixes or not is_mixed(pair)
        }
        forms = {"linear": linear, "angular": angular}
        joints = ForJoints(self.dimension.on(rotation=True)).json()["anyOf"]
        return {
            "anyOf": [
                linear,
                *(joints if self.of_joints else ()),
                {"type": "object", "properties": forms | pairs, "additionalProperties": False},
                {"type": "object", "properties": axes | pairs, "additionalProperties": False},
            ]
        }


def _varies(value: object, context: ParseContext) -> bool:
    """Whether a datum uses more than params and constants."""
    if not isinstance(value, Text):
        return False
    try:
        names = [n.path[0] for n in walk(parse(value, "sum")) if isinstance(n, Name)]
    except ExpressionError:
        return False
    known = (*context.still_params, *context.broken, *CONSTANTS)
    return any(name not in known for name in names)


def _between(entry: dict[str, Any]) -> dict[str, Any]:
    """The entry of two axes, described as one."""
    return entry | {"description": f"Between two axes. {entry['description']}"}
