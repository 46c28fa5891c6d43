"""What names mean: the scope of an expression and the resolution of a dotted name in it."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import field, replace
from enum import StrEnum
from types import MappingProxyType
from typing import Literal

from taskspec import signals
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, TRANSLATIONS
from taskspec.signals import CLOCKS, VECTORS, Index, Signal
from taskspec.signals.table import REFERENCE
from taskspec.text.units import ANGLE, LENGTH, NUMBER, Dimension, Quantity

Kind = Literal["param", "constant", "clock", "signal", "condition", "vector", "joint", "object",
               "visits", "coordinate", "link", "gain", "energy", "grip", "tank",
               "estimate"]  # fmt: skip

COORDINATES: dict[str, Dimension] = {axis: ANGLE if axis.is_rotation else LENGTH for axis in AXES}
"""Coordinates of the tool tip, for equations; joints are q1, q2 and so on."""

AXIS_COORDINATES: dict[str, Dimension] = {a: LENGTH.on(rotation=a.is_rotation) for a in AXES}
"""Coordinates of the axes of a stage's frame, for couplings."""

CONSTANTS: dict[str, tuple[float, Dimension]] = {"pi": (3.141592653589793, NUMBER)}


class ScopeKind(StrEnum):
    """Where an expression stands, which decides what it may use."""

    CONSTANT = "constant"
    """A fixed value: params and pi."""
    WORLD = "world"
    """The world's own motion: also `clock`."""
    EQUATION = "equation"
    """A constraint: `clock`, and the tip's x, y, z, rx, ry, rz or the joints q1, q2 and so on."""
    COUPLING = "coupling"
    """What an axis follows: the coordinates of the other axes, x, y, z, rx, ry, rz."""
    PLANNED = "planned"
    """A planned position: also `t` and `clock`."""
    REFERENCE = "reference"
    """A velocity or force reference: also measured signals."""
    GUARD = "guard"
    """`until` and `fail_if`: also reducers over the stage so far, `for` a time, and visits."""
    EXPECT = "expect"
    """An expectation: also signals of one stage, and `for` a share of all ticks."""
    REWARD = "reward"
    """A reward: true signals of a tick and their references, each in the frame of its stage."""


_COORDINATES = {ScopeKind.EQUATION: COORDINATES, ScopeKind.COUPLING: AXIS_COORDINATES}
_WORLDLY = (ScopeKind.WORLD, ScopeKind.EQUATION)


@dataclass(frozen=True, slots=True)
class Scope:
    """The names that an expression may use.

    `objects` maps the name of an object to its kind in `signals.OBJECT`. `broken` holds names whose
    own definition is wrong: using them is no further mistake.
    """

    kind: ScopeKind
    params: Mapping[str, Quantity] = field(default_factory=lambda: MappingProxyType({}))
    stages: Set[str] = frozenset()
    objects: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    frames: Set[str] = frozenset()
    broken: Set[str] = frozenset()

    @property
    def measures(self) -> bool:
        """Whether measured signals exist here."""
        return self.judges or self.kind in (ScopeKind.REFERENCE, ScopeKind.GUARD)

    @property
    def judges(self) -> bool:
        """Whether signals are true here, and have references."""
        return self.kind in (ScopeKind.EXPECT, ScopeKind.REWARD)

    @property
    def clocks(self) -> tuple[str, ...]:
        """The clocks that exist here."""
        if self.kind in (ScopeKind.CONSTANT, ScopeKind.COUPLING):
            return ()
        return ("clock",) if self.kind in _WORLDLY else tuple(CLOCKS)

    @property
    def coordinates(self) -> Mapping[str, Dimension]:
        """The coordinates that exist here, joints aside."""
        return _COORDINATES.get(self.kind, {})

    def coordinate(self, name: str) -> Dimension | None:
        """The dimension of a coordinate that exists here, None for any other name."""
        return coordinate(name) if self.kind is ScopeKind.EQUATION else self.coordinates.get(name)


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a dotted name stands for.

    Attributes:
        kind: which of the families; the other attributes depend on it.
        name: the param, constant, clock or signal (for a joint, an object or a gain: its signal).
        dimension: of the value; plain for conditions.
        axis: of a signal with axes.
        stage: the stage that prefixes the name, or whose visits are meant.
        subject: the object's name, the joint's number, or the entry of a gain.
        signal: its entry in the table of signals.
        beside: `ref` where the reference of the signal is meant.
    """

    kind: Kind
    name: str
    dimension: Dimension = NUMBER
    axis: str | None = None
    stage: str | None = None
    subject: str | None = None
    signal: Signal | None = None
    beside: str = ""


def resolve(path: tuple[str, ...], scope: Scope) -> Meaning | None:
    """What a dotted name means in a scope, or None if it means nothing there.

    A first word that is a stage wins over everything else that it could be.
    """
    head, rest = path[0], path[1:]
    if rest and head in scope.stages and scope.measures:
        if rest == ("visits",) and scope.kind is not ScopeKind.REWARD:
            return Meaning("visits", "visits", stage=head, signal=signals.STAGE["visits"])
        inner = _resolve_signal(rest, scope) if scope.kind is ScopeKind.EXPECT else None
        return replace(inner, stage=head) if inner else None
    if not rest:
        if (dimension := scope.coordinate(head)) is not None:
            return Meaning("coordinate", head, dimension)
        if head in scope.params:
            return Meaning("param", head, scope.params[head].dimension)
        if head in CONSTANTS:
            return Meaning("constant", head, CONSTANTS[head][1])
        if head in scope.clocks:
            return Meaning("clock", head, CLOCKS[head].dimension, signal=CLOCKS[head])
    return _resolve_signal(path, scope) if scope.measures else None


def is_axis(path: tuple[str, ...], scope: Scope) -> bool:
    """Whether a dotted name is an axis of a frame, such as `tool.z`."""
    return len(path) == 2 and path[0] in scope.frames and path[1] in TRANSLATIONS


def coordinate(name: str) -> Dimension | None:
    """The dimension of a coordinate that an equation may use, None for any other name."""
    if name[:1] == "q" and name[1:].isdigit() and not name.startswith("q0"):
        return ANGLE
    return COORDINATES.get(name)


def _resolve_signal(path: tuple[str, ...], scope: Scope) -> Meaning | None:
    vector, beside = VECTORS.get(path[0]), path[1] if len(path) == 2 else ""
    expected = scope.judges
    if vector is not None and (
        len(path) == 1 or (beside == REFERENCE and beside in vector.beside and expected)
    ):
        dimension = vector.dimensions[vector.bare[0]]
        return Meaning("vector", path[0], dimension, signal=vector, beside=beside)
    found = signals.find(path, scope.objects)
    if found is None or (found.beside and not expected):
        return None
    entry, member = found.signal, found.member
    kind = "condition" if entry.condition else _KINDS.get(entry.index, "signal")
    axis, subject = (member, None) if entry.axes else (None, member or None)
    return Meaning(kind, entry.name, found.dimension, axis, None, subject, entry, found.beside)


_KINDS: dict[Index, Kind] = {
    Index.CLOCK: "clock",
    Index.JOINT: "joint",
    Index.LINK: "link",
    Index.GAIN: "gain",
    Index.ENERGY: "energy",
    Index.GRIP: "grip",
    Index.TANK: "tank",
    Index.ESTIMATE: "estimate",
    Index.OBJECT: "object",
}
