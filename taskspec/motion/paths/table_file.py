"""A path from a table of points, through which a spline is laid."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

from taskspec.deferred import np
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.motion.paths.form import Number, PathForm
from taskspec.motion.paths.key import PathKey

if TYPE_CHECKING:
    from taskspec.deferred import ca
    from taskspec.motion.polynomial import PiecewiseCubic
    from taskspec.motion.table import Table


@dataclass(frozen=True)  # not slots: its splines are kept
class TableFile(PathForm):
    """A path from a CSV file; its parameter is time where the file has a t column.

    Attributes:
        file: relative to the task file.
        table: its contents, once they have been read.
    """

    file: str
    table: Table | None = None

    name = "file"
    keys = (
        PathKey(
            "file",
            "A CSV file of points",
            "A table of points through which a spline is laid; CSV with units in its header.",
            text=True,
            description="A CSV file, relative to the task file",
            examples=("leaf.csv",),
        ),
    )
    bare = True
    noun = "a CSV file of points"
    title = "A CSV file of points"
    meaning = keys[0].meaning
    examples = keys[0].examples
    relative = False

    @property
    def points(self) -> Table:
        """The rows of the file as points, read once."""
        assert self.table is not None
        return self.table

    @property
    def own(self) -> tuple[Axis, ...]:
        """The axes of its columns."""
        return tuple(Axis(a) for a in self.points.points)

    def moves(self, axis: Axis) -> bool:
        """Whether the column of the axis changes."""
        return bool(np.ptp(self.points.points[axis]) > 0)

    def needs(self, axes: Sequence[Axis]) -> tuple[Axis, ...]:  # noqa: ARG002
        """It has a place of its own."""
        return ()

    def curve(
        self,
        s: ca.SX,
        start: Mapping[Axis, Number],  # noqa: ARG002
        segments: Mapping[Axis, ca.SX],
        axis: Axis,
    ) -> Number:
        """The coordinate [m, rad] of the current cubic of its spline."""
        from taskspec.motion.polynomial import evaluate

        return evaluate(segments[axis], s)

    def place(self, s: float, start: Mapping[Axis, float], axis: Axis) -> float:  # noqa: ARG002
        """On its spline, as it is run: what a polygon does at its corners, no arm is sent."""
        return float(self._laid[axis](s))

    @cached_property
    def _laid(self) -> dict[Axis, PiecewiseCubic]:
        return {Axis(a): p for a, p in self.points.splines().items()}

    @property
    def in_splines(self) -> bool:
        """True: its curve follows from the file alone."""
        return True

    def splines(self, axes: Sequence[Axis]) -> dict[Axis, PiecewiseCubic]:
        """Cubic splines through its points."""
        return {Axis(a): p for a, p in self.points.splines().items() if Axis(a) in axes}

    def length(self, start: Mapping[Axis, Number], axes: Sequence[Axis]) -> Number:  # noqa: ARG002
        """Length [m, rad] of the polygon through its points."""
        return self.points.length

    def timing(
        self,
        start: Mapping[Axis, Number],
        axes: Sequence[Axis],
        speed: float | None,
        time: float | None,
    ) -> PiecewiseCubic:
        """By its own time where it has one."""
        if self.points.time is None:
            return PathForm.timing(self, start, axes, speed, time)
        return self.points.clock()
