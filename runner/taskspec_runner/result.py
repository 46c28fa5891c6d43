"""A run as Python and notebooks have it: with its pictures, its exports, a fragment of a page.

What draws and writes is imported where it is asked for: a run is made without it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taskspec.text.suggest import suggestion
from taskspec_runner.errors import InputError
from taskspec_runner.runs import Run

if TYPE_CHECKING:
    from taskspec_runner.report.overview import Picture


class RunResult(Run):
    """A run with what draws it and writes it in other formats, which stand on runs themselves."""

    def plot(self, *names: str) -> Picture:
        """A picture of the run, or of some signals.

        Args:
            names: of signals; those in the same unit share a chart. None for the picture of the
                report: force against reference, motion and path.

        Raises:
            KeyError: there is no such signal, or it has no value.
        """
        from taskspec_runner.report.overview import Picture, overview_svg
        from taskspec_runner.report.selection import selected

        for name in names:
            if not np.isfinite(self.signals[name]).any():
                raise KeyError(f"signal '{name}' has no value in this run")
        return Picture(overview_svg(self, selected(self, names) if names else None))

    def export(self, form: str, path: str | Path | None = None) -> Path:
        """Writes the log as `csv`, `parquet`, `mcap` or `rerun`; see `taskspec export`.

        Raises:
            InputError: there is no such format, no tick, or a library is missing.
            OutputError: the file cannot be written.
        """
        from taskspec_runner.export import FORMATS, export_run

        if form not in FORMATS:
            raise InputError(f"there is no format '{form}'; {suggestion(form, FORMATS, 'formats')}")
        return export_run(self, form, None if path is None else Path(path)).path

    def _repr_html_(self) -> str:
        from taskspec_runner.report.notebook import notebook_html

        return notebook_html(self)
