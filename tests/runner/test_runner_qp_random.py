"""Random tasks with random limits: what a run under `solve: qp` never does.

40 of them in the suite; `make proof` runs 1000 and prints what they did.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from random_limits import (
    RefusedError,
    Traces,
    force_excess,
    joint_excess,
    program_of,
    run_program,
    speed_excess,
)

#: Rounding of a relative comparison.
ROUNDING = 1e-6


class Tally:
    """What many runs did, the worst of everything with the task that it was in, and what failed."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()
        self.ended: Counter[str] = Counter()
        self.account: Counter[str] = Counter()
        self.worst: dict[str, tuple[float, int]] = {}
        self.wrong: list[tuple[int, str, object]] = []

    def see(self, what: str, value: float, number: int, most: float = math.inf) -> None:
        if value > self.worst.get(what, (-math.inf, 0))[0]:
            self.worst[what] = (value, number)
        if not value <= most:
            self.wrong.append((number, what, value))

    def add(self, number: int, traces: Traces) -> None:
        self.ended[f"{traces.outcome.status}: {traces.outcome.reason}"] += 1
        self.account += Counter({**traces.counts, "runs": 1, "ticks": traces.outcome.ticks})
        self.see("KKT residual", float(np.max(traces.fields["residual"])), number, 1e-8)
        self.see("ticks without an answer", traces.counts["held"], number, 0.0)
        for what, beyond in joint_excess(traces).items():
            self.see(what, beyond, number, ROUNDING)
        for what, found in (("force", force_excess(traces)), ("speed", speed_excess(traces))):
            for excess in found:
                kind = "collided" if excess.collided else "late"
                self.see(f"{what}, {kind}", excess.beyond, number)
                left = excess.beyond - excess.explained
                most = math.inf if excess.collided else ROUNDING
                self.see(f"{what}, {kind}, not explained", left, number, most)
            for kind, collided in (("collided", True), ("late", False)):
                self.account[f"{what}, {kind}"] += any(e.collided == collided for e in found)

    def lines(self) -> list[str]:
        """A report."""
        found = [f"{name:32s} {count:8.0f}" for name, count in sorted(self.account.items())]
        found += [f"refused: {why:23s} {count:8d}" for why, count in self.refused.items()]
        found += [f"{how:32s} {count:8d}" for how, count in self.ended.items()]
        return found + [
            f"{what:32s} {value: .2e}  in task {number}"
            for what, (value, number) in sorted(self.worst.items())
        ]


def test_random_tasks_keep_random_limits(
    request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every law, four arms; k 1..100 kN/m, friction 0..0.5, set points up to twice the cap.

    Torques, their rate, joint positions and velocities hold on every tick. Force caps and the speed
    hold but for what the control could not know (`force_excess`, `speed_excess`), unless limits
    before them in the order of precedence were in the way.
    """
    wanted = request.config.getoption("random_tasks", default=None)
    tasks, tally = wanted or 16, Tally()
    for number in range(tasks):
        try:
            program = program_of(number)
        except RefusedError as error:
            tally.refused[str(error)] += 1
        else:
            tally.add(number, run_program(program))
    if wanted:
        reporter = request.config.pluginmanager.get_plugin("terminalreporter")
        with capsys.disabled():
            for line in ("", *tally.lines()):
                reporter.write_line(line)
    assert tally.wrong == []
    assert tally.account["runs"] > 0.8 * tasks
    # Tasks that come nowhere near their limits would prove nothing.
    assert tally.account["limited"] > 0.1 * tally.account["ticks"]
