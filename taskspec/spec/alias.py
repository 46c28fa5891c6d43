"""Other forms of a value: a diameter for a radius, a direction for an orientation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Protocol

from taskspec.spec import values
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant, Entries
from taskspec.text.data import Items, Real, Text, Whole, text_of
from taskspec.text.nodes import Scalar
from taskspec.text.origin import Origin
from taskspec.text.spliced import joined
from taskspec.text.units import LENGTH, NUMBER


class Alias(Protocol):
    """Another key for a value that a model has.

    Attributes:
        key: the model's own key.
    """

    key: str

    def read(self, value: object, context: ParseContext) -> object | None:
        """The datum of the model's own key; None after reporting why there is none."""

    def json(self) -> dict[str, Any]:
        """The JSON Schema of the other key."""


class Diameter:
    """`diameter: 10 mm` is `radius: 5 mm`."""

    key = "radius"

    def read(self, value: object, context: ParseContext) -> object:
        """Half of what is written; a stand-in after reporting what is wrong with it."""
        if values.constant(value, LENGTH, context) is None or not isinstance(
            value, Text | Whole | Real
        ):
            return text_of(Scalar("1 m", True, Origin(context.data.node.span, "", "")))
        return text_of(joined(("(", value.node, ")/2"), value.node.span))

    def json(self) -> dict[str, Any]:
        """Describes the length."""
        about = "Twice the radius, in place of it"
        return Constant(LENGTH).json() | {
            "title": "Diameter",
            "description": about,
            "examples": ["10 mm"],
        }


class Direction:
    """`normal: [-1, 0, 0]` or `axis: y`: where the z of an object's own axes points in the world.

    R(rpy) turns the world's z into it by the smallest angle; the opposite of z is reached about x.
    """

    key = "rpy"

    def read(self, value: object, context: ParseContext) -> object | None:
        """Roll, pitch and yaw as texts."""
        if isinstance(value, Text) and value in _WORDS:
            n: Sequence[float] = _WORDS[str(value)]
        else:
            before = len(context.diagnostics)
            n = Entries((NUMBER,) * 3, nonzero=True).read(value, context)
            if len(context.diagnostics) > before or not isinstance(value, Items) or len(n) != 3:
                return None
        rpy = Items()
        rpy.node = value.node  # type: ignore[assignment]
        origin = _origin(value)
        rpy.extend(text_of(Scalar(f"{angle!r} rad", True, origin)) for angle in turned_to(n))
        return rpy

    def json(self) -> dict[str, Any]:
        """Describes the direction."""
        listed = {
            "type": "array",
            "minItems": 3,
            "maxItems": 3,
            "items": Constant(NUMBER).json(),
        }
        return {
            "title": "Direction",
            "description": "Where z of its own axes points in the world, in place of rpy",
            "anyOf": [{"enum": list(_WORDS)}, listed],
            "examples": [[-1, 0, 0]],
        }


SAME = {key: {"diameter", "radius"} - {key} for key in ("diameter", "radius")} | {
    key: {"rpy", "normal", "axis"} - {key} for key in ("rpy", "normal", "axis")
}
"""By key the others that say the same."""

_WORDS: dict[str, tuple[float, float, float]] = {
    f"{sign}{axis}": tuple(float(f"{sign}1") * (axis == other) for other in "xyz")  # type: ignore[misc]
    for sign in ("", "-")
    for axis in "xyz"
}
"""Directions along an axis of the world."""


def turned_to(direction: Sequence[float]) -> tuple[float, float, float]:
    """Roll, pitch, yaw [rad] of the smallest rotation that takes z to a direction (3,).

    With n the direction at unit length, R = I + [v] + [v]^2/(1 + n_z), v = z x n (Rodrigues).
    """
    length = math.hypot(*direction)
    x, y, z = (component / length for component in direction)
    across = x * x + y * y
    if z < 0 and across < _STRAIGHT:
        return math.pi, 0.0, 0.0
    # 1/(1 + z), without the loss of digits near z = -1.
    factor = 1 / (1 + z) if z >= 0 else (1 - z) / across
    r00, r10, r20 = 1 - x * x * factor, -x * y * factor, -x
    level = math.hypot(r00, r10)
    if level < _STRAIGHT:
        return 0.0, math.atan2(-r20, level), 0.0
    # + 0.0 makes 0 of -0.
    return math.atan2(-y, z) + 0.0, math.atan2(-r20, level), math.atan2(r10, r00) + 0.0


#: Up to here a squared sine counts as none.
_STRAIGHT = 1e-24


def _origin(value: Text | Items) -> Origin:
    """The place of what a direction is written as."""
    if isinstance(value, Text):
        return value.node.origin
    return Origin(value.node.span, "", "")
