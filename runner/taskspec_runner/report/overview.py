"""A picture of a run."""

from __future__ import annotations

from pathlib import Path

from taskspec_runner.report.data import Run, read_run


def write_overview_svg(folder: Path, path: Path) -> Path:
    """Writes the picture."""
    path.write_text(overview_svg(read_run(folder)), encoding="utf-8")
    return path


def overview_svg(run: Run) -> str:
    """SVG."""
    return "<svg></svg>"
