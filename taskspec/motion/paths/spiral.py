"""A flat spiral outwards from where the stage begins."""

from __future__ import annotations

import math
from collections.abc import Sequence

from taskspec.deferred import np
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.motion.paths.key import PathKey, WrongPath
from taskspec.motion.paths.laid import LaidPath, Route
from taskspec.motion.paths.polyline import hermite
from taskspec.motion.profile import PathSection
from taskspec.text.units import LENGTH, show

#: More turns are a mistake of units.
MOST_TURNS = 500
#: Angle of a piece [rad]; half of it up to the first radian, where it bends most.
_PIECE = math.radians(5.0)


@dataclass(frozen=True, slots=True)
class Spiral(LaidPath):
    """Archimedes' spiral in the frame's xy plane, outwards from where the stage begins.

    r = b theta, b = pitch/(2 pi); it leaves along +x and turns from x to y.

    Attributes:
        pitch: distance of two turns [m].
        radius: at which it ends [m].
    """

    pitch: float
    radius: float

    name = "spiral"
    keys = (
        PathKey(
            "pitch",
            "Distance of the turns",
            "Distance of two turns.",
            LENGTH,
            above=0.0,
            examples=("0.5 mm",),
        ),
        PathKey(
            "radius",
            "Radius",
            "Distance from where the stage begins at which it ends.",
            LENGTH,
            above=0.0,
            examples=("4 mm",),
        ),
    )
    noun = "a spiral"
    title = "A flat spiral outwards"
    meaning = "A flat spiral outwards from where the stage begins."
    examples = ({"pitch": "0.5 mm", "radius": "4 mm"},)

    @property
    def own(self) -> tuple[Axis, ...]:
        """x and y."""
        return Axis.X, Axis.Y

    @property
    def turns(self) -> float:
        """How many there are."""
        return self.radius / self.pitch

    def unfit(self, axes: Sequence[Axis]) -> WrongPath | None:  # noqa: ARG002
        """With very many turns, or hardly any."""
        if self.turns > MOST_TURNS:
            message = f"a spiral of {self.turns:.3g} turns"
            hint = f"up to {MOST_TURNS} are laid; mind the units of pitch and radius"
            return WrongPath("TS235", "pitch", message, hint)
        if self.turns < 0.25:
            message = f"a spiral of {self.turns:.2g} turns: it ends before it has turned"
            hint = f"a pitch of at most {show(4 * self.radius, LENGTH)} turns a quarter"
            return WrongPath("TS235", "pitch", message, hint)
        return None

    def lay(self) -> Route:
        """Cubics through places and tangents over the length, s = b/2 (theta c + asinh theta)."""
        from taskspec.motion.polynomial import PiecewiseCubic

        b, last = self.pitch / (2 * math.pi), 2 * math.pi * self.turns
        knots = np.concatenate([np.arange(0.0, 1.0, _PIECE / 2), np.arange(1.0, last, _PIECE)])
        knots = np.concatenate([knots[knots < last - _PIECE / 8], [last]])
        root = np.sqrt(1 + knots**2)
        distances = b / 2 * (knots * root + np.arcsinh(knots))
        c, s = np.cos(knots), np.sin(knots)
        places = b * knots[:, None] * np.column_stack([c, s])
        tangents = np.column_stack([c - knots * s, s + knots * c]) / root[:, None]
        whole = float(distances[-1])
        rows = np.array(
            [
                hermite(
                    places[i], tangents[i], places[i + 1], tangents[i + 1],
                    float(distances[i + 1] - distances[i]), whole,
                )
                for i in range(len(knots) - 1)
            ]
        )  # fmt: skip
        shares = distances / whole
        splines = {a: PiecewiseCubic(shares, rows[:, :, i]) for i, a in enumerate(self.own)}
        return Route(splines, self._sections(b, last))

    def _sections(self, b: float, last: float) -> tuple[PathSection, ...]:
        """Half turns, each as much bent as where it begins: the curvature falls throughout."""
        ends = [*np.arange(0.0, last - 0.5, math.pi).tolist(), last]
        distances = [b / 2 * (t * math.hypot(1, t) + math.asinh(t)) for t in ends]
        bends = [(2 + t**2) / (b * (1 + t**2) ** 1.5) for t in ends]
        return tuple(
            PathSection(distances[i + 1] - distances[i], bends[i]) for i in range(len(ends) - 1)
        )

    def of_axis(self, axis: Axis) -> str:  # noqa: ARG002
        """How far out."""
        return f"spiral to {show(self.radius, LENGTH)}"
