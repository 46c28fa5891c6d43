"""The signals of a run and their dimensions."""

from __future__ import annotations

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

TRANSLATIONS = ("x", "y", "z")
ROTATIONS = ("rx", "ry", "rz")
AXES = TRANSLATIONS + ROTATIONS

VECTORS: dict[str, dict[str, Dimension]] = {
    "force": dict.fromkeys(TRANSLATIONS, FORCE),
    "torque": dict.fromkeys(ROTATIONS, MOMENT),
    "position": dict.fromkeys(TRANSLATIONS, LENGTH) | dict.fromkeys(ROTATIONS, ANGLE),
    "velocity": dict.fromkeys(TRANSLATIONS, VELOCITY) | dict.fromkeys(ROTATIONS, ANGULAR_VELOCITY),
    "error": dict.fromkeys(TRANSLATIONS, LENGTH) | dict.fromkeys(ROTATIONS, ANGLE),
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

COORDINATES: dict[str, Dimension] = dict.fromkeys(TRANSLATIONS, LENGTH)
"""Coordinates of the tool tip, for equations; joints are q1, q2 and so on."""

CONSTANTS: dict[str, tuple[float, Dimension]] = {"pi": (3.141592653589793, NUMBER)}

FRAMED = ("force", "torque", "position", "velocity", "error", "tilt")
"""Signals that another frame shows differently."""

CLOCK_DIMENSION = TIME
