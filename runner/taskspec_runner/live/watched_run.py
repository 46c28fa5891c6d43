"""A run that pages show while it goes on."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.program import Program
from taskspec.program.worlds import World
from taskspec_runner.live.arm import LiveArm
from taskspec_runner.live.channel import Channel
from taskspec_runner.live.page import LAST, at_end, judging, live_charts, live_page, so_far
from taskspec_runner.live.server import PageServer
from taskspec_runner.live.sliders import SET, Sliders
from taskspec_runner.loop.assembly import Assembly
from taskspec_runner.loop.driven import Driven
from taskspec_runner.loop.tap import ticks_between
from taskspec_runner.record.bus import Bus
from taskspec_runner.record.layout import LogLayout, stage_names
from taskspec_runner.record.named import param_column
from taskspec_runner.record.recorder import Recorder
from taskspec_runner.runs import Run
from taskspec_runner.verdict.judge import judge_run

Vector = NDArray[np.float64]

#: Rows in a second of simulated time, and messages in a second [Hz].
RATE, MESSAGES = 50.0, 30.0
#: Figures of a number in a page.
_DIGITS = 6
#: The speed of a run is that of its last so many seconds of the wall clock.
_SPEED_OVER = 1.0
#: It takes a browser so long to open a page [s].
_OPENING = 5.0
#: A run that is watched may fall behind the wall clock so far before that is forgiven [s].
_BEHIND = 0.1
#: A verdict on what there is is made no more often [s], and takes no more of the time than a share.
_JUDGED_EVERY, _JUDGED_SHARE = 0.5, 0.1


@dataclass(frozen=True, slots=True)
class _Look:
    """One tick: all numbers of the bus, and when it was [s of the wall clock]."""

    row: Vector
    wall: float


class WatchedRun:
    """A run with a page that shows it while it goes on: a `Spectator` of the loop.

    The loop leaves a copy of a tick now and then; another thread makes messages of them, and only
    if a page is open. Then the run also keeps to the wall clock, so that it can be watched.

    Attributes:
        rate: rows in a second of simulated time [Hz].
        server: of the page.
        sliders: that set the live params of the task; None where it has none.
    """

    rate = RATE

    def __init__(self, program: Program, world: World, port: int = 0) -> None:
        """Begins to serve the page of a run that is to start.

        Args:
            program: that runs.
            world: that the plant is.
            port: of the page; 0 for any that is free.

        Raises:
            InputError: the port cannot be had.
        """
        self._program = program
        self._true, self._slices = world.task, Bus(program.context.robot.n, world.task).slices
        self._layout = LogLayout.of(program, world.task)
        self._charts = live_charts(self._layout.units)
        self._traces = [trace for chart in self._charts for trace in chart.traces]
        self._looks: deque[_Look] = deque(maxlen=round(LAST * RATE))
        self._channel = Channel(round(LAST * MESSAGES))
        self._sending = threading.Lock()
        self._over, self._runs = threading.Event(), True
        self._feeder: threading.Thread | None = None
        self._recorder: Recorder | None = None
        self._every = ticks_between(RATE, program.context.period)
        #: The next tick that is taken, and where a tick has its time.
        self._due = self._clock_at = 0
        self._folder = Path()
        #: Wall clock at the run's zero, while it keeps to that.
        self._zero = math.inf
        self._expected_until = self._judged_next = 0.0
        #: Wall clock and simulated time of the ticks that were sent last.
        self._recent: deque[tuple[float, float]] = deque()
        live = program.context.loaded.task.live
        self.sliders = Sliders(live, program.context.period) if live else None
        takes = {} if self.sliders is None else {SET: self.sliders.request}
        self.server = PageServer({"": self._page}, self._channel, takes=takes, port=port)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        if self._feeder is not None:
            self._feeder.join()
        self.server.close()

    @property
    def looks(self) -> bool:
        """Whether anybody has the page open, or is about to."""
        return self._channel.read or time.monotonic() < self._expected_until

    def expect(self) -> None:
        """Learns that somebody is about to open the page."""
        self._expected_until = time.monotonic() + _OPENING

    def begin(self, parts: Assembly[Driven], recorder: Recorder, folder: Path) -> None:
        """Takes the parts of a run that starts now, what has its newest ticks, and its folder."""
        self._clock_at = parts.bus.slices["clock"].start
        self._recorder, self._folder = recorder, folder
        self._feeder = threading.Thread(target=self._feed, name="page of the run", daemon=True)
        self._feeder.start()

    def look(self) -> None:
        """Takes the ticks since the last time; holds the run back to the wall clock if watched."""
        assert self._recorder is not None
        assert self._recorder.block is not None
        ring = self._recorder.block.rows
        now, due = time.perf_counter(), range(self._due, self._recorder.ticks, self._every)
        self._looks.extend(_Look(ring[tick % len(ring)].copy(), now) for tick in due)
        self._due += self._every * len(due)
        if not self.looks:
            self._zero = math.inf
            return
        zero = now - self._recorder.ticks * self._program.context.period
        if abs(zero - self._zero) > _BEHIND:
            self._zero = zero
        time.sleep(max(self._zero - zero, 0.0))

    def finish(self) -> None:
        """Learns that no more ticks will come."""
        self._runs = False
        if self.sliders is not None:
            self.sliders.finish()
            self._channel.send("closed", {})
        self._channel.send("verdict", judging())

    def end(self, run: Run) -> None:
        """Shows the verdict on the run, and serves its report."""
        self.server.folder = run.folder
        if self._channel.read:
            self._send_rows()
        self._channel.send("verdict", at_end(run))

    def _page(self) -> str:
        self.expect()
        names = stage_names(self._program.stages)
        context = self._program.context
        with self._sending:
            arm = None if self._arm is None else self._arm.figure()
        return live_page(context.loaded.task, self._charts, names, context.period, arm)

    @cached_property
    def _arm(self) -> LiveArm | None:
        """The arm; None where it cannot be drawn."""
        try:
            return LiveArm(self._program, self._true, self._slices)
        # Whatever the reason is: a page without a picture is still a page.
        except Exception:
            return None

    def _feed(self) -> None:
        """Makes messages of the ticks that the loop leaves."""
        while not self._over.wait(1 / MESSAGES):
            if self._channel.read and self._send_rows() and self._runs:
                self._judge()

    def _send_rows(self) -> bool:
        """Sends the ticks that there are; whether there were any."""
        with self._sending:
            return self._sent(list(self._taken()))

    def _sent(self, looks: list[_Look]) -> bool:
        if not looks:
            return False
        rows = [self._row(look) for look in looks]
        last = looks[-1].wall, self._clock(looks[-1])
        self._recent.append(last)
        while last[0] - self._recent[0][0] > _SPEED_OVER and len(self._recent) > 2:
            self._recent.popleft()
        wall, clock = (b - a for a, b in zip(self._recent[0], last, strict=True))
        speed = f"{clock / wall:.2g} × real time" if wall > 0 else "–"
        message: dict[str, Any] = {"rows": rows, "speed": speed}
        if self.sliders is not None:
            message["live"] = self._live(looks[-1], self.sliders)
        self._channel.send("rows", message, passes=True)
        return True

    def _live(self, look: _Look, sliders: Sliders) -> dict[str, tuple[float, float]]:
        """Value of each live param in a tick, and what it goes to [SI]."""
        columns = self._layout.columns(look.row[np.newaxis])
        return {
            name: (float(columns[param_column(name)][0][0]), target)
            for name, target in sliders.targets.items()
        }

    def _taken(self) -> Iterator[_Look]:
        while self._looks:
            yield self._looks.popleft()

    def _clock(self, look: _Look) -> float:
        return float(look.row[self._clock_at])

    def _row(self, look: _Look) -> dict[str, Any]:
        """Time, number of the stage, values of all traces in their charts' units, and the arm."""
        # One by one: functions of other numbers of rows are the recorder's.
        columns = {
            name: float(values[0])
            for name, (values, _) in self._layout.columns(look.row[np.newaxis]).items()
        }
        row = {
            "time": columns["clock"],
            "stage": min(int(columns["stage"]), len(self._program.stages)),
            "values": _numbers(t.factor * columns[t.column] for t in self._traces),
        }
        if self._arm is not None:
            row["arm"] = _numbers(self._arm.values(look.row, columns).tolist())
        return row

    def _judge(self) -> None:
        """Judges the ticks that are on the disk."""
        began = time.perf_counter()
        if began < self._judged_next:
            return
        history = Run(self._folder, program=self._program).history
        judged = judge_run(self._program, history) if len(history) else ()
        if len(history) and self._runs:
            self._channel.send("verdict", so_far(judged, str(history.stages[-1])))
        spent = time.perf_counter() - began
        self._judged_next = began + max(_JUDGED_EVERY, spent / _JUDGED_SHARE)


def _numbers(values: Iterable[float]) -> list[float | None]:
    """Numbers for a page, None for one that is not finite."""
    return [float(f"{v:.{_DIGITS}g}") if math.isfinite(v) else None for v in values]
