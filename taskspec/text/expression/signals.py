"""The signals of a run and their dimensions."""

from __future__ import annotations

from collections.abc import Sequence

from taskspec.geometry.axis import ROTATIONS, TRANSLATIONS, Axis
from taskspec.text.units import (
    ANGLE,
    ANGULAR_VELOCITY,
    FORCE,
    LENGTH,
    MOMENT,
    NUMBER,
    POWER,
    TIME,
    VELOCITY,
    Dimension,
)


def _of(axes: Sequence[Axis], dimension: Dimension) -> dict[str, Dimension]:
    return dict.fromkeys(axes, dimension)


VECTORS: dict[str, dict[str, Dimension]] = {
    "force": _of(TRANSLATIONS, FORCE),
    "torque": _of(ROTATIONS, MOMENT),
    "position": _of(TRANSLATIONS, LENGTH) | _of(ROTATIONS, ANGLE),
    "velocity": _of(TRANSLATIONS, VELOCITY) | _of(ROTATIONS, ANGULAR_VELOCITY),
    "error": _of(TRANSLATIONS, LENGTH) | _of(ROTATIONS, ANGLE),
}
"""Signals with axes. Without an axis they mean the translations, `torque` the moments."""

BARE_AXES: dict[str, tuple[str, ...]] = {
    name: ROTATIONS if name == "torque" else TRANSLATIONS for name in VECTORS
}

SCALARS: dict[str, Dimension] = {
    "gap": LENGTH,
    "tilt": ANGLE,
    "speed": VELOCITY,
    "travel": LENGTH,
    "power": POWER,
    "force_inconsistent": FORCE,
}
CONDITIONS = ("touching", "path_done", "limited")
"""Signals that are true or false."""

CLOCKS = ("t", "clock")

JOINT: dict[str, Dimension] = {
    "position": ANGLE,
    "velocity": ANGULAR_VELOCITY,
    "torque": MOMENT,
}
OBJECT: dict[str, dict[str, Dimension]] = {
    "shape": {"gap": LENGTH, "force": FORCE},
    "equation": {"gap": LENGTH, "force": FORCE},
    "joint equation": {"gap": ANGLE, "torque": MOMENT},
    "hinge": {"angle": ANGLE, "torque": MOMENT},
    "slide": {"travel": LENGTH, "force": FORCE},
    "screw": {"angle": ANGLE, "travel": LENGTH, "torque": MOMENT},
}
"""Signals of an object of the world, by its kind."""

COORDINATES: dict[str, Dimension] = _of(TRANSLATIONS, LENGTH)
"""Coordinates of the tool tip, for equations; joints are q1, q2 and so on."""

CONSTANTS: dict[str, tuple[float, Dimension]] = {"pi": (3.141592653589793, NUMBER)}

FRAMED = ("force", "torque", "position", "velocity", "error", "tilt")
"""Signals that another frame shows differently."""

CLOCK_DIMENSION = TIME
