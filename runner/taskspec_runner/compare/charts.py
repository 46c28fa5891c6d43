"""The charts of a comparison: force and motion, one line a law."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
from markupsafe import Markup
from numpy.lib.stride_tricks import sliding_window_view

from taskspec.geometry.axis import Axis
from taskspec.text.units import FORCE, LENGTH
from taskspec_runner.compare.overlay import Overlay, overlay_data, role
from taskspec_runner.pages.chart import Chart, Trace, bands, size
from taskspec_runner.pages.document import bar, figure, note, patience, section
from taskspec_runner.pages.html import joined
from taskspec_runner.pages.numbers import plain_scale, scale
from taskspec_runner.record.folder import Json
from taskspec_runner.record.history import Vector
from taskspec_runner.report.figures import ANGULAR, LINEAR, wrench_name
from taskspec_runner.runs import Run

REFERENCE = "reference"
#: A size that oscillates is drawn by the largest value within this time [s].
ENVELOPE = 0.05
#: Sizes below this are rounding [m, rad, N, N m].
_LEAST = 1e-9
#: A reference that changes by less than this stays where it is [m].
_STILL = 1e-4


def charts(laid: Overlay) -> list[Chart]:
    """Every chart that has something to show, force first."""
    found = [*_contact(laid), *_motion(laid)]
    return [chart for chart in found if chart.traces]


def charted(
    laid: Overlay | None,
    ends: Iterable[tuple[str, str, str]],
    heading: str,
    about: str,
    picture: Callable[[], str] | None = None,
) -> tuple[Json | None, tuple[Markup, ...]]:
    """What the script of a page draws of runs, and where; nothing where there is no chart.

    Args:
        laid: the runs, if there are any.
        ends: run, outcome and reason of each that was cut short.
        heading: of the charts.
        about: whose runs, for the sentence below them.
        picture: stands for the charts where no script runs.
    """
    shown = charts(laid) if laid is not None else []
    if laid is None or not shown:
        return None, ()
    text = (
        f"Stages are those {laid.under}. {about} shows it alone in all charts; with Shift it takes "
        "one away."
    )
    places = section(heading, joined(*map(figure, shown)), note(text), look="charts")
    still = Markup(picture()) if picture else None
    return overlay_data(laid, shown, ends), (
        bar(laid.stages(), "Whole runs"), patience(still), places,
    )  # fmt: skip


def main_charts(laid: Overlay) -> list[Chart]:
    """The force of one axis, its error, and the motion error."""
    found = {chart.key: chart for chart in charts(laid)}
    name = next((key.removesuffix(".ref") for key in found if key.endswith(".ref")), "")
    keys = (f"{name}.ref", f"{name}.error", "motion error") if name else ("force", "motion error")
    return [found[key] for key in keys if key in found]


def _contact(laid: Overlay) -> Iterator[Chart]:
    axes = laid.force_axes()
    for axis in axes:
        yield _against_reference(laid, axis)
        yield _force_error(laid, axis)
    if not axes:
        yield _force_size(laid)


def _against_reference(laid: Overlay, axis: str) -> Chart:
    name, what = wrench_name(axis), "Moment" if axis in ANGULAR else "Force"
    factor, unit = _scaled(laid, name, lambda run: run.column(name))
    curves = _curves(laid, factor, lambda run: run.column(name))
    reference = _reference(laid, name, factor)
    begin = laid.begins[laid.lead]
    # Whether an expectation was met differs between the runs.
    wanted = tuple(
        replace(band, start=band.start + begin, end=band.end + begin, passed=None)
        for band in bands(laid.leading, [name], factor)
    )
    note = f"dashed: the reference {laid.under}" if reference else ""
    title = f"{what} {axis} against its reference"
    return Chart(f"{name}.ref", title, unit, (*curves, *reference), note, wanted)


def _force_error(laid: Overlay, axis: str) -> Chart:
    name, what = wrench_name(axis), "Moment" if axis in ANGULAR else "Force"

    def error(run: Run) -> Vector | None:
        reference, truth = run.column(f"{name}.ref"), run.column(name)
        return None if reference is None or truth is None else np.abs(reference - truth)

    unit = scale(FORCE.on(rotation=axis in ANGULAR), 1.0)
    return _sizes(laid, f"{name}.error", f"{what} {axis} error", unit, error, "")


def _force_size(laid: Overlay) -> Chart:
    def total(run: Run) -> Vector | None:
        found = [c for axis in LINEAR if (c := run.column(f"force.{axis}")) is not None]
        return np.sqrt(np.sum([c**2 for c in found], axis=0)) if found else None

    factor, unit = _scaled(laid, "force.x", total)
    curves = _curves(laid, factor, total)
    touched = any(np.nanmax(c.values) > 0 for c in curves)
    return Chart("force", "Contact force", unit, curves if touched else ())


def _motion(laid: Overlay) -> Iterator[Chart]:
    for axes, key, title in (
        (LINEAR, "motion error", "Motion error"),
        (ANGULAR, "orientation error", "Orientation error"),
    ):
        yield _error_size(laid, axes, key, title)
        if axes is LINEAR:
            for axis in LINEAR:
                yield _position(laid, axis)


def _error_size(laid: Overlay, axes: tuple[Axis, ...], key: str, title: str) -> Chart:
    # One unit for all orders, so that the marks of the axis can be read off.
    unit = plain_scale(LENGTH.on(rotation=axes is ANGULAR), 1.0)
    over = ", over the axes without a force"
    return _sizes(laid, key, title, unit, lambda run: laid.motion_error(run, axes), over)


def _sizes(
    laid: Overlay,
    key: str,
    title: str,
    unit: tuple[float, str],
    of: Callable[[Run], Vector | None],
    over: str,
) -> Chart:
    """A chart of sizes over several orders; without curves where all of them are rounding."""

    def envelope(run: Run) -> Vector | None:
        values = of(run)
        if values is None or not np.nanmax(values, initial=0.0) > _LEAST:
            return None
        known = np.isfinite(values)
        width = max(round(ENVELOPE / run.period), 1)
        before = width // 2
        padded = np.pad(np.where(known, values, 0.0), (before, width - 1 - before))
        largest = sliding_window_view(padded, width).max(axis=1)
        return np.where(known, np.maximum(largest, _LEAST), np.nan)

    curves = _curves(laid, unit[0], envelope)
    note = f"the largest within {1e3 * ENVELOPE:g} ms{over}"
    return Chart(key, title, unit[1], curves, note, log=True)


def _position(laid: Overlay, axis: str) -> Chart:
    name = f"position.{axis}"
    wanted = laid.leading.column(f"{name}.ref")
    if wanted is None or float(np.nanmax(wanted) - np.nanmin(wanted)) < _STILL:
        return Chart(name, "", "", ())
    factor, unit = plain_scale(LENGTH, 1.0)
    curves = _curves(laid, factor, lambda run: run.column(name))
    note = f"counted in the frame of each stage; dashed: the reference {laid.under}"
    reference = _reference(laid, name, factor)
    return Chart(name, f"Position {axis}", unit, (*curves, *reference), note)


def _curves(laid: Overlay, factor: float, of: Callable[[Run], Vector | None]) -> tuple[Trace, ...]:
    """One curve a law; those without a force loop are dashed and come last, to be seen on top."""
    found = (
        Trace(name, factor * values, role(name), "loopless" if name in laid.dashed else "line",
              run=name)
        for name, run in laid.runs.items()
        if (values := of(run)) is not None
    )  # fmt: skip
    return tuple(sorted(found, key=lambda trace: trace.style == "loopless"))


def _reference(laid: Overlay, name: str, factor: float) -> tuple[Trace, ...]:
    values = laid.leading.column(f"{name}.ref")
    if values is None:
        return ()
    return (Trace(REFERENCE, factor * values, "ink", "reference", run=laid.lead),)


def _scaled(laid: Overlay, name: str, of: Callable[[Run], Vector | None]) -> tuple[float, str]:
    """Factor and shown unit that suit a quantity in all runs; `name` is a column in its unit."""
    columns = [values for run in laid.runs.values() if (values := of(run)) is not None]
    units = [run.units[name] for run in laid.runs.values() if name in run.units]
    return scale(units[0] if units else FORCE, size(columns) if columns else 0.0)
