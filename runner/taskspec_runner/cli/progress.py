"""The lines that show a run as it goes on, and how much of something is done."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import field
from typing import TypeVar

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.text.units import FORCE, si_unit
from taskspec_runner.cli.console import console
from taskspec_runner.session import Glimpse, Progress

Glanced = TypeVar("Glanced")

#: Seconds between two samples of a run, and of a search or a sweep.
_PAUSE, _LONGER_PAUSE = 0.1, 0.2
_BLOCKS = "▁▂▃▄▅▆▇█"
#: Simulated time between two blocks, and that of all of them [s].
_STEP, _SPAN = 0.1, 3.0
#: A line with less room than this has no blocks at all [columns].
_NARROWEST_BAR = 8


@dataclass(slots=True)
class Trail:
    """The force on the axis with a set point over the last seconds of simulated time."""

    axis: str = ""
    _values: deque[float] = field(default_factory=lambda: deque(maxlen=round(_SPAN / _STEP)))
    _next: float = 0.0

    def add(self, glimpse: Glimpse) -> None:
        """Takes a glimpse; what is not on the same axis as before begins anew."""
        if glimpse.axis != self.axis:
            self.axis = glimpse.axis
            self._values.clear()
            self._next = glimpse.clock
        if glimpse.axis and glimpse.clock >= self._next - 1e-9:
            # Upwards is the direction of the commanded force.
            self._values.append(math.copysign(1.0, glimpse.reference) * glimpse.force)
            self._next += _STEP

    def drawn(self, glimpse: Glimpse, room: int) -> str:
        """The newest blocks that there is room for, against the larger of force and reference."""
        if room < _NARROWEST_BAR:
            return ""
        top = max([abs(glimpse.reference), *self._values])
        return sparkline(list(self._values)[-room:], top)


def sparkline(values: Sequence[float], top: float) -> str:
    """Numbers as blocks: the lowest at or below 0, the highest at `top`."""
    highest = len(_BLOCKS) - 1
    shares = (value / top if top > 0 else 0.0 for value in values)
    return "".join(_BLOCKS[min(max(round(highest * s), 0), highest)] for s in shares)


@contextmanager
def progress_line(*, shown: bool, before: str = "") -> Iterator[Progress | None]:
    """Shows a run's progress on standard error while it lasts, behind a text that names the run."""
    if not shown:
        yield None
        return
    from rich.live import Live
    from rich.text import Text

    last, trail, screen = 0.0, Trail(), console(err=True)
    blocks = screen.encoding.startswith("utf")
    with Live(console=screen, auto_refresh=False, transient=True) as live:

        def progress(look: Callable[[], Glimpse]) -> None:
            nonlocal last
            now, glimpse = time.monotonic(), look()
            trail.add(glimpse)
            if now - last >= _PAUSE:
                last = now
                line = before + describe(glimpse)
                if blocks:
                    line += f"  {trail.drawn(glimpse, screen.width - len(line) - 2)}"
                live.update(Text(line.rstrip(), no_wrap=True), refresh=True)

        yield progress


def describe(glimpse: Glimpse) -> str:
    """A glimpse in one line: time, stage, force against reference, real-time factor."""
    parts = [f"{glimpse.clock:7.2f} s", f"{glimpse.stage:<12}"]
    if glimpse.axis:
        axis = Axis(glimpse.axis)
        unit = si_unit(axis.of(FORCE))
        numbers = f"{glimpse.force:8.2f} of {glimpse.reference:.2f} {unit}"
        parts.append(f"{axis.effort}.{axis} {numbers:<22}")
    return "  ".join([*parts, f"{glimpse.real_time_factor:.0f} x real time"])


@contextmanager
def described_line(
    text_of: Callable[[Glanced], str], *, shown: bool
) -> Iterator[Callable[[Glanced], None] | None]:
    """Shows on standard error the text of what was reached last, as it comes."""
    if not shown:
        yield None
        return
    from rich.live import Live
    from rich.text import Text

    last = 0.0
    with Live(console=console(err=True), auto_refresh=False, transient=True) as live:

        def watch(glimpse: Glanced) -> None:
            nonlocal last
            if time.monotonic() - last >= _LONGER_PAUSE:
                last = time.monotonic()
                live.update(Text(text_of(glimpse), no_wrap=True), refresh=True)

        yield watch


@contextmanager
def counted_line(what: str, *, shown: bool) -> Iterator[Callable[[int, int], None] | None]:
    """Shows on standard error how many of something are done, and of how many."""
    if not shown:
        yield None
        return
    from rich.live import Live
    from rich.text import Text

    with Live(console=console(err=True), transient=True) as live:

        def progress(done: int, of: int) -> None:
            share = 100 * done // of
            live.update(Text(f"{what} {done} of {of}, {share} %", no_wrap=True))

        yield progress
