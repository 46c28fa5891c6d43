"""How plant and controller meet where they are not one loop, as a run sees it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from taskspec.program.program import Program
from taskspec.program.worlds import World
from taskspec_runner.loop.assembly import Assembly
from taskspec_runner.loop.driven import Driven
from taskspec_runner.record.history import History

#: The column of how late what came for a tick came.
_LATENESS_COLUMN = "link.late"


class Link(Protocol):
    """A robot that a program runs on, or a plant that is served.

    Attributes:
        measured: whether the run's log is of what was measured.
    """

    measured: bool

    @property
    def lock_step(self) -> bool:
        """Whether the plant waits for each answer, so that nothing is late or lost."""

    def assemble(self, program: Program, world: World) -> Assembly[Driven]:
        """What the run is made of."""

    def finish(self, text: str) -> None:
        """Reports to the other end that the run has ended, and why. May be called twice."""

    def as_data(self) -> dict[str, Any]:
        """What a summary says of it."""


def link_summary(link: Link, history: History) -> dict[str, Any]:
    """What a summary says of a link: its counts, and how late what came for the ticks came [s]."""
    late = history.columns[_LATENESS_COLUMN] if not link.lock_step and len(history) else np.zeros(0)
    found = link.as_data() | {"ticks": len(history)}
    if len(late):
        p50, p99 = (float(x) for x in np.percentile(late, (50, 99)))
        found["lateness"] = {"p50": p50, "p99": p99, "max": float(np.max(late))}
    return found


def sentence(said: Mapping[str, Any]) -> str:
    """A link in one sentence, from what a summary says of it."""
    on_robot, ticks = said.get("end") == "controller", said.get("ticks", 0)
    what = "samples" if on_robot else "answers"
    who = f" by {said['name']}" if said.get("name") and not on_robot else ""
    if said.get("mode") == "lock-step":
        begin = "on the robot" if on_robot else f"driven{who}"
        return f"{begin} in lock-step, {ticks} ticks"
    begin = (
        f"on the robot at its own clock: {ticks} ticks"
        if on_robot
        else (f"driven{who} at the wall clock: {ticks} ticks")
    )
    lost = f"{said.get('lost', 0)} {what} lost"
    if said.get("lost"):
        lost += f" (up to {said.get('in_a_row', 0)} in a row)"
    text = f"{begin}, {lost}, {said.get('late', 0)} late"
    lateness = said.get("lateness")
    if lateness:
        p50, p99, most = (1e3 * lateness[key] for key in ("p50", "p99", "max"))
        text += (
            f"; lateness {p50:.3g} ms at the median, {p99:.3g} ms at 99 %, {most:.3g} ms at most"
        )
    return text
