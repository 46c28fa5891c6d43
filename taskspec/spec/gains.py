"""Values for the six axes: gains of the laws."""

from __future__ import annotations

from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, ROTATIONS, TRANSLATIONS, Axis
from taskspec.spec.field_type import FieldType
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant
from taskspec.text.data import Map
from taskspec.text.suggest import suggestion
from taskspec.text.units import Dimension

_GROUPS = {"linear": TRANSLATIONS, "angular": ROTATIONS}


@dataclass(frozen=True, slots=True)
class AxisValues:
    """One SI value for each axis that the file names; None where a value is designed."""

    x: float | None = None
    y: float | None = None
    z: float | None = None
    rx: float | None = None
    ry: float | None = None
    rz: float | None = None

    def get(self, axis: Axis) -> float | None:
        """The value of an axis.

        Raises:
            KeyError: there is no such axis.
        """
        if axis not in AXES:
            raise KeyError(axis)
        value: float | None = getattr(self, axis)
        return value


@dataclass(frozen=True)
class GainField(FieldType):
    """A gain: one quantity for all translations, `{linear, angular}`, or one for each axis.

    Attributes:
        dimension: on a translation; a rotation has its counterpart.
        above: it has to be greater than this.
        least: it has to be at least this.
    """

    dimension: Dimension
    above: float | None = None
    least: float | None = None

    def read(self, value: object, context: ParseContext) -> AxisValues:
        """The values of all axes."""
        if not isinstance(value, Map):
            return AxisValues(**dict.fromkeys(TRANSLATIONS, self._one(value, Axis.X, context)))
        found: dict[str, float] = {}
        grouped = "linear" in value or "angular" in value
        words = tuple(_GROUPS) if grouped else AXES
        for key, entry in value.items():
            if key not in words:
                hint = suggestion(key, words if grouped else [*AXES, "linear", "angular"], "keys")
                span = value.node.key_span(key)
                if key in AXES:
                    hint = "give 'linear' and 'angular', or the axes one by one"
                    context.error("TS026", f"'{key}' beside 'linear' or 'angular'", span, hint)
                else:
                    context.error("TS020", f"unknown key '{key}' in a gain", span, hint)
                continue
            axes = _GROUPS.get(key) or (Axis(key),)
            found |= dict.fromkeys(axes, self._one(entry, axes[0], context))
        return AxisValues(**found)

    def _one(self, value: object, axis: Axis, context: ParseContext) -> float:
        number = Constant(axis.of(self.dimension), self.above, self.least).read(value, context)
        assert isinstance(number, float)
        return number

    def json(self) -> dict[str, Any]:
        """Describes the three forms."""
        linear, angular = (
            Constant(self.dimension.on(rotation=turns)).json() for turns in (False, True)
        )
        axes = dict.fromkeys(TRANSLATIONS, linear) | dict.fromkeys(ROTATIONS, angular)
        forms = {"linear": linear, "angular": angular}
        return {
            "anyOf": [
                linear,
                {"type": "object", "properties": forms, "additionalProperties": False},
                {"type": "object", "properties": axes, "additionalProperties": False},
            ]
        }
