"""A run in Python: its verdict, its signals as arrays, and how it looks in a notebook."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.text.suggest import suggestion
from taskspec_runner.errors import InputError
from taskspec_runner.record.folder import LOG, MANIFEST, REPORT
from taskspec_runner.record.history import History, read_history
from taskspec_runner.report.data import Run, read_run
from taskspec_runner.report.judged import Expectation
from taskspec_runner.report.verdict import verdict
from taskspec_runner.signals import Mask, Signal, Signals


class Window:
    """Some ticks of a run."""

    def __init__(self, history: History, rows: Mask) -> None:
        self._history, self._rows = history, rows

    def __len__(self) -> int:
        return int(self._rows.sum())

    @property
    def signals(self) -> Signals:
        """Every column of the log by its name, in SI."""
        return Signals(self._history.columns, self._history.units, self._rows)

    @property
    def clock(self) -> Signal:
        """(n,) time since the run began [s]."""
        return self.signals["clock"]

    @property
    def stage(self) -> NDArray[np.str_]:
        """(n,) name of the stage of each tick."""
        return np.asarray(self._history.stages[self._rows])

    def during(
        self, stage: str, start: float = 0.0, end: float = np.inf, visit: int | None = None
    ) -> Window:
        """The ticks in a stage.

        Args:
            stage: its name. start, end: into each visit of it [s]; `end` itself is left out.
            visit: 1 for the first visit, and so on; None for all of them.

        Raises:
            KeyError: the run never was in that stage, or not as often.
        """
        visits = [v for v in self._history.visits() if v.stage == stage]
        if not visits:
            hint = suggestion(stage, dict.fromkeys(self._history.stages.tolist()), "stages")
            raise KeyError(f"the run never was in a stage '{stage}'; {hint}".rstrip("; "))
        if visit is not None and not 1 <= visit <= len(visits):
            raise KeyError(f"stage '{stage}' has {len(visits)} visits, not a visit {visit}")
        wanted = visits if visit is None else [visits[visit - 1]]
        rows = np.zeros(len(self._rows), dtype=bool)
        for each in wanted:
            rows[each.rows] = True
        t = self._history.columns["t"]
        return Window(self._history, self._rows & rows & (t >= start) & (t < end))

    def __repr__(self) -> str:
        stages = ", ".join(dict.fromkeys(self.stage.tolist()))
        return f"<{len(self)} ticks in {stages or 'no stage'}>"


class Picture:
    """A drawing that notebooks show.

    Attributes:
        svg: the drawing as text.
    """

    def __init__(self, svg: str) -> None:
        self.svg = svg

    def save(self, path: str | Path) -> Path:
        """Writes it as an SVG file.

        Raises:
            ValueError: the file's name does not end in .svg.
            OSError: it cannot be written.
        """
        path = Path(path)
        if path.suffix != ".svg":
            raise ValueError(f"a picture is saved as .svg, not as {path.suffix or path.name}")
        path.write_text(self.svg, encoding="utf-8")
        return path

    def _repr_svg_(self) -> str:
        return self.svg

    def __repr__(self) -> str:
        return f"<picture of {len(self.svg)} characters of SVG>"


class Result(Window):
    """A run that was made.

    Attributes:
        folder: where everything of it is.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._run: Run = read_run(folder)
        history = read_history(folder / LOG) if (folder / LOG).is_file() else None
        history = history or History({}, np.array([], dtype=np.str_))
        super().__init__(history, np.ones(len(history), dtype=bool))

    @property
    def passed(self) -> bool:
        """Whether the run came to its end and met every expectation."""
        return self.verdict == "passed"

    @property
    def verdict(self) -> str:
        """`passed`, `missed`, `failed`, `stopped`, `unfinished` or `damaged`."""
        return verdict(self._run).kind

    @property
    def reason(self) -> str:
        """Why, in a sentence."""
        return verdict(self._run).sentence

    @property
    def summary(self) -> Mapping[str, Any]:
        """The content of `summary.json`, in SI; empty for a run that did not finish."""
        return self._run.summary

    @property
    def manifest(self) -> Mapping[str, Any]:
        """The content of `manifest.json`: versions, seed, overrides, times on the wall."""
        return self._run.manifest

    @property
    def expectations(self) -> tuple[Expectation, ...]:
        """What the task expected and what was found, in the order of the file."""
        return self._run.expectations

    @property
    def metrics(self) -> Mapping[str, Mapping[str, Mapping[str, float]]]:
        """Stage to signal to `rms_error`, `max_error`, `final_error`, `mean`, `min`, `max` [SI]."""
        found: Mapping[str, Mapping[str, Mapping[str, float]]] = self.summary.get("metrics", {})
        return found

    @property
    def report(self) -> Path | None:
        """The report, if there is one."""
        path = self.folder / REPORT
        return path if path.is_file() else None

    @cached_property
    def stages(self) -> tuple[str, ...]:
        """The visits of stages, in order."""
        return tuple(visit.stage for visit in self._history.visits())

    def plot(self, *names: str) -> Picture:
        """A picture of the run, or of some signals.

        Args:
            names: of signals; those in the same unit share a chart. None for the picture of the
                report: force against reference, motion and path.

        Raises:
            KeyError: there is no such signal, or it has no value.
        """
        from taskspec_runner.report.overview import overview_svg
        from taskspec_runner.report.selection import selected

        for name in names:
            if not np.isfinite(self.signals[name]).any():
                raise KeyError(f"signal '{name}' has no value in this run")
        return Picture(overview_svg(self._run, selected(self._run, names) if names else None))

    def export(self, form: str, path: str | Path | None = None) -> Path:
        """Writes the log as `csv`, `parquet`, `mcap` or `rerun`; see `taskspec export`.

        Raises:
            InputError: there is no such format, no tick, or a library is missing.
            OutputError: the file cannot be written.
        """
        from taskspec_runner.export import FORMATS, export_run

        if form not in FORMATS:
            raise InputError(f"there is no format '{form}'; {suggestion(form, FORMATS, 'formats')}")
        return export_run(self.folder, form, None if path is None else Path(path)).path

    def __repr__(self) -> str:
        task = self.summary.get("task") or self.manifest.get("task") or "run"
        met = sum(each.passed for each in self.expectations)
        told = f"{met} of {len(self.expectations)} expectations met, {self._run.end:.3f} s"
        return f"<{task}: {self.verdict}, {told}, in {self.folder}>"

    def _repr_html_(self) -> str:
        from taskspec_runner.report.notebook import notebook_html

        return notebook_html(self._run, self.folder)


def read_result(folder: Path) -> Result:
    """Reads the folder of a run.

    Raises:
        InputError: it is not the folder of a run.
    """
    if not any((folder / name).is_file() for name in (LOG, MANIFEST)):
        raise InputError(f"cannot read {folder}: it is not the folder of a run")
    return Result(folder)
