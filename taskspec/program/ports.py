"""What goes into a stage's functions and what comes out of them, in which order."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import casadi as ca

from taskspec.control.model_terms import TermSymbols

Fields = tuple[tuple[str, int], ...]


def slices(fields: Iterable[tuple[str, int]]) -> dict[str, slice]:
    """Where each named field of a flat vector lies."""
    found, at = {}, 0
    for name, length in fields:
        found[name] = slice(at, at + length)
        at += length
    return found


#: What every stage puts out each tick, in this order: name and length.
OUTPUTS: Fields = (
    ("event", 1),
    ("event_value", 1),
    ("health", 1),
    ("tip", 3),
    ("tip_rotation", 9),
    ("offset", 3),
    ("frame", 9),
    ("position", 6),
    ("velocity", 6),
    ("error", 6),
    ("position_ref", 6),
    ("velocity_ref", 6),
    ("force_ref", 6),
    ("measured", 6),
    ("tilt", 1),
    ("speed", 1),
    ("travel", 1),
    ("path_done", 1),
    ("angle", 1),
    ("conditioning", 1),
    ("violation", 1),
    ("clamped", 1),
    ("unsettled", 1),
    ("force_inconsistent", 1),
    ("limited", 1),
    ("limits", 1),
    ("residual", 1),
)


def fields(equations: int) -> Fields:
    """The outputs of a task's stages: `OUTPUTS`, and set point and measurement of each equation."""
    return (*OUTPUTS, ("reaction_ref", equations), ("reaction", equations))


#: What a stage is asked when it is entered, in this order: name and length.
PROBE: Fields = (
    ("frame", 9),
    ("offset", 3),
    ("lever", 3),
    ("here", 3),
    ("rate_map", 9),
    ("turning", 3),
    ("angle", 1),
    ("coordinate", 6),
    ("measured", 6),
)


@dataclass(frozen=True, slots=True)
class Inputs:
    """The symbols of a tick's inputs, in the order of the function's arguments."""

    now: ca.SX
    q: ca.SX
    v: ca.SX
    terms: TermSymbols
    wrench: ca.SX
    reactions: ca.SX

    def symbols(self) -> list[ca.SX]:
        """Arguments before memory and parameters."""
        return [self.now, self.q, self.v, *self.terms.inputs, self.wrench, self.reactions]
