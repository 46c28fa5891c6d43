"""How much may still be looked at, so that no file takes long."""

from __future__ import annotations


class Budget:
    """A number of things that may still be looked at.

    Attributes:
        left: how many.
    """

    def __init__(self, left: int) -> None:
        self.left = left

    def take(self, count: int = 1) -> bool:
        """Whether there were so many left; they are taken then."""
        if count > self.left:
            return False
        self.left -= count
        return True
