"""Labels that do not overlap: each in the first free place about what it names."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass

Vector = NDArray[np.float64]

#: Width of a letter, as a share of its height.
_LETTER = 0.58
#: Directions and distances, in heights of its letters, in which a label may stand.
_TURNS, _AWAY = np.radians([0, 45, -45, 90, -90, 135, -135, 180]), (0.75, 1.3, 2.0, 3.0)


def width_of(text: str, size: float) -> float:
    """About how wide a text is, in the unit of the size of its letters."""
    return _LETTER * size * len(text)


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A rectangle: left, top, right, bottom."""

    left: float
    top: float
    right: float
    bottom: float

    @classmethod
    def about(cls, middle: Vector, width: float, height: float) -> Rectangle:
        """A rectangle about a place (2,)."""
        x, y = middle.tolist()
        return cls(x - width / 2, y - height / 2, x + width / 2, y + height / 2)

    def meets(self, other: Rectangle) -> bool:
        """Whether they overlap."""
        return (
            self.left < other.right
            and other.left < self.right
            and self.top < other.bottom
            and other.top < self.bottom
        )

    def within(self, other: Rectangle) -> bool:
        """Whether it lies in the other."""
        return (
            self.left >= other.left
            and self.right <= other.right
            and self.top >= other.top
            and self.bottom <= other.bottom
        )


class Labels:
    """The places that are taken in a panel."""

    def __init__(self, panel: Rectangle) -> None:
        self._panel = panel
        self.taken: list[Rectangle] = []

    def keep(self, box: Rectangle) -> None:
        """Keeps a place free of labels."""
        self.taken.append(box)

    def place(
        self, at: Vector, text: str, size: float, towards: Vector | None = None
    ) -> Vector | None:
        """The middle (2,) of a label about a place (2,), which is taken by it; None without room.

        Args:
            at: what it names.
            text: of it.
            size: of its letters.
            towards: (2,) where it should rather stand.
        """
        width, height = width_of(text, size), 1.15 * size
        turn = 0.0 if towards is None else float(np.arctan2(towards[1], towards[0]))
        for away, extra in product(_AWAY, _TURNS):
            way = np.array([np.cos(turn + extra), np.sin(turn + extra)])
            middle = at + way * (away * size + abs(way[0]) * (width - size) / 2)
            box = Rectangle.about(middle, width, height)
            if box.within(self._panel) and not any(box.meets(other) for other in self.taken):
                self.taken.append(box)
                return np.asarray(middle)
        return None
