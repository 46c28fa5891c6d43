"""The log of a run as a stream into a file of another format."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import chain

import numpy as np
import pyarrow as pa

from taskspec.program.execution.transition import END, FAIL
from taskspec_runner.export.poses import PoseStream
from taskspec_runner.export.scene import RunScene
from taskspec_runner.record.extent import Extent
from taskspec_runner.record.history import units_of
from taskspec_runner.runs import Run

#: Metadata of an export: how many ticks it has, and where they led, `end` or `fail`.
OF_TICKS, ENDED = "taskspec.ticks", "taskspec.ended"
_LED_TO = {"done": END, "failed": FAIL, "stopped": FAIL}
#: Two run times that differ by less are the same [s].
_ROUNDING = 1e-9


class LogStream:
    """The log of a run in batches, which are counted as they go by.

    Attributes:
        run: whose log it is.
        schema: of the log; None where that holds no tick.
        poses: gives those of tool and task frame; without, there are none.
        scene: of the run, for formats that are drawn; without, there is none.
        ticks: that went by.
    """

    def __init__(self, run: Run, start: float | None = None, end: float | None = None) -> None:
        """Opens the log of a run.

        Args:
            run: whose log it is.
            start, end: run times between which ticks go by, `end` left out [s]; None for all.

        Raises:
            OSError: there is none.
        """
        batches = run.batches()
        first = next(batches, None)
        self.run, self.ticks, self._ends = run, 0, list[float]()
        self._window = (start, end)
        self.schema = pa.schema([]) if first is None else first.schema
        self.poses: PoseStream | None = None
        self.scene: RunScene | None = None
        self._batches = batches if first is None else chain([first], batches)

    def __iter__(self) -> Iterator[pa.RecordBatch]:
        for whole in self._batches:
            batch = self._within(whole)
            if not batch.num_rows:
                continue
            self.ticks += batch.num_rows
            clock = batch.column("clock").slice(max(batch.num_rows - 2, 0))
            self._ends = [*self._ends, *clock.to_pylist()][-2:]
            yield batch

    def _within(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        """The ticks of a batch that lie in the window."""
        start, end = self._window
        if start is None and end is None:
            return batch
        clock = batch.column("clock").to_numpy()
        # A tick is at a multiple of the period, to within rounding.
        low = 0 if start is None else int(np.searchsorted(clock, start - _ROUNDING))
        high = len(clock) if end is None else int(np.searchsorted(clock, end - _ROUNDING))
        return batch.slice(low, max(high - low, 0))

    @property
    def units(self) -> dict[str, str]:
        """The unit of each column, empty where it has none."""
        return units_of(self.schema)

    @property
    def extent(self) -> Extent:
        """The extent of the run that has been streamed."""
        until = self._ends[-1] + float(np.sum(np.diff(self._ends))) if self._ends else 0.0
        return self.run.extent_of(self.ticks, until)

    @property
    def ended(self) -> str:
        """Where the run led at the end of what is streamed, `end` or `fail`; empty if unknown.

        A window that is over before the run is says nothing of that.
        """
        end = self._window[1]
        if end is not None and end < self.run.end - _ROUNDING:
            return ""
        return _LED_TO.get(self.extent.status, "")

    @property
    def metadata(self) -> dict[str, str]:
        """Facts about the run for a reader of the log alone, as texts."""
        manifest, extent = self.run.manifest, self.extent
        return {
            "taskspec.task": str(manifest.get("task") or ""),
            "taskspec.status": extent.status,
            "taskspec.partial": json.dumps(extent.partial),
            OF_TICKS: str(extent.ticks),
            ENDED: self.ended,
            "taskspec.seed": str(manifest.get("seed", "")),
            "taskspec.versions": json.dumps(manifest.get("versions") or {}),
        }
