"""Coupling of an axis to the others of its stage by a mechanism."""

from __future__ import annotations

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis


class UncoupledError(ValueError):
    """Why a mechanism's geometry gives no motion of an axis; `hint` says what to do."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.hint = hint


@dataclass(frozen=True, slots=True)
class Coupling:
    """The coupling of one axis: `ratio` times the reference of `leader`, else times the angle.

    The ratio is in m/rad or rad/rad; it is 0 where the frame itself turns with the handle.
    """

    ratio: float
    leader: Axis | None
