"""Sines on several axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.motion.paths.form import Number, PathForm, coordinates
from taskspec.motion.paths.key import PathKey, WrongPath
from taskspec.text.units import LENGTH


@dataclass(frozen=True, slots=True)
class Lissajous(PathForm):
    """Sines on several axes about where the stage begins, x first.

    Attributes:
        amplitude: on each axis [m].
        turns: periods on each axis.
    """

    amplitude: tuple[float, ...]
    turns: tuple[float, ...]

    name = "lissajous"
    keys = (
        PathKey(
            "amplitude",
            "Amplitudes",
            "Of the sine on each axis.",
            entries=(LENGTH,) * 3,
            fewest=1,
            description="[x, y, z], from the left",
            examples=(["30 mm", "20 mm"],),
        ),
        PathKey(
            "turns",
            "Turns",
            "Periods on each axis over the whole path.",
            listed=True,
            description="Periods on each axis",
            examples=([1, 2],),
        ),
    )
    noun = "a Lissajous figure"
    title = "Sines on several axes"
    meaning = "A figure of sines about where the stage begins."
    examples = ({"amplitude": ["30 mm", "20 mm"], "turns": [1, 2]},)

    @classmethod
    def wrong(cls, data: Mapping[str, Any]) -> WrongPath | None:
        """One number of turns for each amplitude."""
        amplitude, turns = data["amplitude"], data["turns"]
        if len(amplitude) == len(turns):
            return None
        message = f"{len(amplitude)} amplitudes, but {len(turns)} turns"
        return WrongPath("TS023", "turns", message)

    @property
    def own(self) -> tuple[Axis, ...]:
        """The axes of its amplitudes."""
        return tuple(coordinates(self.amplitude))

    def moves(self, axis: Axis) -> bool:
        """Whether the amplitude of the axis is not 0."""
        return coordinates(self.amplitude)[axis] != 0.0

    def curve(
        self,
        s: ca.SX,
        start: Mapping[Axis, Number],
        segments: Mapping[Axis, ca.SX],  # noqa: ARG002
        axis: Axis,
    ) -> Number:
        """The coordinate [m]: the start plus the sine of the axis at s."""
        size, turns = coordinates(self.amplitude)[axis], coordinates(self.turns)[axis]
        return start[axis] + size * ca.sin(2 * ca.pi * turns * s)

    def length(self, start: Mapping[Axis, Number], axes: Sequence[Axis]) -> Number:  # noqa: ARG002
        """Of a polygon of 2000 chords."""
        if not axes:
            return 0.0
        s = np.linspace(0.0, 1.0, 2001)
        size, turns = coordinates(self.amplitude), coordinates(self.turns)
        points = [size[a] * np.sin(2 * np.pi * turns[a] * s) for a in axes]
        return float(np.linalg.norm(np.diff(np.array(points), axis=1), axis=0).sum())
