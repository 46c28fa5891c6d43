"""A sweep whose page fills while it goes on."""

from __future__ import annotations

import time
from typing import Self

from markupsafe import Markup

from taskspec.spec import Task
from taskspec_runner.live.channel import Channel
from taskspec_runner.live.server import PageServer
from taskspec_runner.pages.document import document, head, note
from taskspec_runner.pages.html import element
from taskspec_runner.sweep.folder import PAGE
from taskspec_runner.sweep.page import render
from taskspec_runner.sweep.progress import describe
from taskspec_runner.sweep.result import SweepResult
from taskspec_runner.sweep.session import SweepGlimpse
from taskspec_runner.sweep.summary import summarise

#: Seconds between two messages.
_PAUSE = 0.2


class WatchedSweep:
    """A sweep with a page of the worlds that there are, made when somebody loads it.

    Attributes:
        server: of the page.
    """

    def __init__(self, task: Task, port: int = 0) -> None:
        """Begins to serve the page of a sweep that is to start.

        Args:
            task: that is swept.
            port: of the page; 0 for any that is free.

        Raises:
            InputError: the port cannot be had.
        """
        self._task, self._channel = task, Channel(1)
        self._glimpse: SweepGlimpse | None = None
        self._over, self._sent = False, 0.0
        self.server = PageServer({"": self._page}, self._channel, port=port)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.server.close()

    def watch(self, glimpse: SweepGlimpse) -> None:
        """Learns how far the sweep is."""
        self._glimpse, self.server.folder = glimpse, glimpse.folder.path
        if time.monotonic() - self._sent >= _PAUSE or glimpse.done == glimpse.of:
            self._send(glimpse)

    def _send(self, glimpse: SweepGlimpse) -> None:
        self._sent = time.monotonic()
        self._channel.send("far", {"done": glimpse.done, "text": describe(glimpse)})

    def end(self) -> None:
        """Learns that it is over, and its page written."""
        self._over = True
        self._channel.send("over", True)

    def _page(self) -> str:
        glimpse = self._glimpse
        if glimpse is None or not glimpse.folder.rows:
            return self._empty(glimpse)
        folder = glimpse.folder
        written = folder.path / PAGE
        if self._over and written.is_file():
            return written.read_text(encoding="utf-8")
        if not self._over:
            # What a page is sent is no older than what it has.
            self._send(glimpse)
        rows = folder.rows.copy()
        ordered = tuple(rows[index] for index in sorted(rows))
        summary = summarise(self._task, ordered, folder.said["worlds"]["kind"])
        result = SweepResult(self._task, folder.path, ordered, summary)
        return render(result, folder.said, None if self._over else _far(len(ordered), glimpse))

    def _empty(self, glimpse: SweepGlimpse | None) -> str:
        """The page before the first world."""
        text = "Its worlds appear here as they are run."
        return document(
            f"{self._task.name}: sweep",
            head("taskspec sweep", self._task.name, self._task.about or "", _far(0, glimpse)),
            note(text),
            data={"worlds": []},
            scripts=("filling",),
            facts=Markup(""),
        )


def _far(done: int, glimpse: SweepGlimpse | None) -> Markup:
    """How far a sweep is, of which the page has some worlds."""
    of = glimpse.of if glimpse is not None else 1
    return element(
        "div",
        element("progress", value=done, max=of, aria_label="worlds that are there"),
        element("output", "starting" if glimpse is None else describe(glimpse)),
        class_="filling",
    )
