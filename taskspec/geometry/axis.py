"""The six axes of a frame."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from itertools import combinations

from taskspec.text.units import Dimension


class Axis(StrEnum):
    """An axis of a frame, by the name that task files give it.

    A member is a string, so that it serves as a key beside plain names.
    """

    X = "x"
    Y = "y"
    Z = "z"
    RX = "rx"
    RY = "ry"
    RZ = "rz"

    @property
    def is_rotation(self) -> bool:
        """Whether it is a rotation about a direction, not a translation along one."""
        return len(self) == 2

    @property
    def row(self) -> int:
        """Its row in a (6,) twist or wrench."""
        return _ROWS[self]

    @property
    def column(self) -> int:
        """Its direction's column in a (3, 3) rotation matrix."""
        return _ROWS[self] % 3

    @property
    def letter(self) -> str:
        """Its direction: x, y or z."""
        return self[-1]

    @property
    def effort(self) -> str:
        """The kind of effort on it: `force` or `torque`."""
        return "torque" if self.is_rotation else "force"

    def of(self, dimension: Dimension) -> Dimension:
        """The dimension that it has here: a rotation has moments and angles."""
        return dimension.on(rotation=self.is_rotation)

    def __repr__(self) -> str:
        return repr(self.value)


AXES = tuple(Axis)
_ROWS = {axis: i for i, axis in enumerate(AXES)}
TRANSLATIONS, ROTATIONS = AXES[:3], AXES[3:]


def as_axis(name: str) -> Axis | None:
    """The axis of that name; None where it is the name of something else."""
    return Axis(name) if name in _ROWS else None


#: Entries of a symmetric matrix on the axes that are not on its diagonal, each under the names of
#: its two axes in their order: `xz`, `zrx`, `rxry`.
PAIRS: dict[str, tuple[Axis, Axis]] = {a + b: (a, b) for a, b in combinations(AXES, 2)}


def axes_of(entry: str) -> tuple[Axis, ...]:
    """The axes of an entry of a matrix: one on its diagonal, two off it, none of anything else."""
    return PAIRS.get(entry) or ((Axis(entry),) if entry in _ROWS else ())


def is_mixed(entry: str) -> bool:
    """Whether an entry of a matrix couples a translation and a rotation."""
    return len({axis.is_rotation for axis in axes_of(entry)}) > 1


def entry_dimension(dimension: Dimension, entry: str) -> Dimension:
    """The dimension of an entry of a matrix that has `dimension` on a translation."""
    if is_mixed(entry):
        return dimension.mixed
    return dimension.on(rotation=entry.startswith("r"))


def coupled(entries: Sequence[str]) -> list[tuple[Axis, ...]]:
    """The axes that entries off the diagonal couple, directly or by others, group by group."""
    groups: list[set[Axis]] = []
    for entry in entries:
        joined = {*axes_of(entry)}
        for group in [g for g in groups if g & joined]:
            groups.remove(group)
            joined |= group
        groups.append(joined)
    return [tuple(a for a in AXES if a in group) for group in groups if len(group) > 1]
