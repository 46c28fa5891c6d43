"""An axis that the stage's path drives."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.deferred_methods import dataclass
from taskspec.modes.mode import (
    AxisMode,
    HandOver,
    OwnReference,
    ReferenceInputs,
    StageStart,
    to_coordinate,
)

if TYPE_CHECKING:
    from taskspec.geometry.axis import Axis
    from taskspec.motion.path import PathShape


@dataclass(frozen=True, slots=True)
class OnPath(AxisMode):
    """An axis that a file does not name and the stage's path drives.

    Attributes:
        path: of the stage.
    """

    path: PathShape

    name = "path"

    def reference(self, at: ReferenceInputs) -> OwnReference:
        """The path's coordinate, differentiated by time."""
        return at.in_time(at.on_path[at.axis])

    def hand_over(self, at: StageStart) -> HandOver:
        """Hand-over to the coordinate of the path."""
        return to_coordinate(at)

    def constraint(self, axis: Axis, rate: str, *, turns: bool) -> str:  # noqa: ARG002
        """The artificial constraint in words: the path."""
        return f"{axis} by path: {self.path.form.of_axis(axis)}"
