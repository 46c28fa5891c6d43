"""The six axes of a frame."""

from __future__ import annotations

from enum import StrEnum

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
