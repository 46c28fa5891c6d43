"""The line that shows a run as it goes on."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from taskspec_runner.cli.console import console
from taskspec_runner.session import Glimpse, Progress

#: Seconds between two looks at a run.
_PAUSE = 0.1


@contextmanager
def progress_line(*, shown: bool, before: str = "") -> Iterator[Progress | None]:
    """Shows a run's progress on standard error while it lasts, behind a text that names the run."""
    if not shown:
        yield None
        return
    from rich.live import Live
    from rich.text import Text

    last = 0.0
    with Live(console=console(err=True), auto_refresh=False, transient=True) as live:

        def progress(look: Callable[[], Glimpse]) -> None:
            nonlocal last
            now = time.monotonic()
            if now - last >= _PAUSE:
                last = now
                live.update(Text(before + describe(look()), no_wrap=True), refresh=True)

        yield progress


def describe(glimpse: Glimpse) -> str:
    """A glimpse in one line: time, stage, force against reference, real-time factor."""
    parts = [f"{glimpse.clock:7.2f} s", f"{glimpse.stage:<12}"]
    if glimpse.axis:
        kind, unit = ("torque", "N*m") if glimpse.axis.startswith("r") else ("force", "N")
        numbers = f"{glimpse.force:8.2f} of {glimpse.reference:.2f} {unit}"
        parts.append(f"{kind}.{glimpse.axis} {numbers:<22}")
    return "  ".join([*parts, f"{glimpse.real_time_factor:.0f} x real time"])
