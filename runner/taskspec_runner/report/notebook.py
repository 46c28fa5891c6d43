"""A run as a notebook shows it: verdict, expectations, picture."""

from __future__ import annotations

from markupsafe import Markup

from taskspec_runner.report.overview import overview_svg
from taskspec_runner.report.template import template
from taskspec_runner.runs import Run
from taskspec_runner.verdict.outcome import so_far, verdict


def notebook_html(run: Run) -> str:
    """A fragment of a page; its styles are its own."""
    return template("notebook.html.j2").render(
        title=run.name or "run",
        verdict=verdict(run),
        whole=not so_far(run) and verdict(run).kind in ("passed", "done", "missed"),
        expectations=run.expectations,
        picture=Markup(overview_svg(run)) if len(run.clock) else "",
        folder=str(run.folder),
        report=run.report is not None,
    )
