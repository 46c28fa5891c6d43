"""A run as a notebook shows it: verdict, expectations, picture."""

from __future__ import annotations

from pathlib import Path

from markupsafe import Markup

from taskspec_runner.record.folder import REPORT
from taskspec_runner.report.data import Run
from taskspec_runner.report.overview import overview_svg
from taskspec_runner.report.template import template
from taskspec_runner.report.verdict import so_far, verdict


def notebook_html(run: Run, folder: Path) -> str:
    """A fragment of a page; its styles are its own.

    Args:
        run: to show. folder: that it is in.
    """
    return template("notebook.html.j2").render(
        title=str(run.summary.get("task") or run.manifest.get("task") or "run"),
        verdict=verdict(run),
        whole=not so_far(run) and verdict(run).kind in ("passed", "missed"),
        expectations=run.expectations,
        picture=Markup(overview_svg(run)) if len(run.clock) else "",
        folder=str(folder),
        report=(folder / REPORT).is_file(),
    )
