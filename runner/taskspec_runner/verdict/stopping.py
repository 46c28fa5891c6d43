"""Entry of a summary about an arm that was brought to rest after its run."""

from __future__ import annotations

from typing import Any

import numpy as np

from taskspec_runner.loop.fixed_step import DONE, Outcome
from taskspec_runner.record.history import TO_REST, History

#: An arm whose joints are all slower than that is at rest [rad/s, m/s].
AT_REST = 0.01


def stopping(outcome: Outcome, history: History, period: float) -> dict[str, Any]:
    """The entry of a summary, `stopping`; empty for a run that came to `end`.

    The entry has how long the arm was braked [s], after what time its joints stayed slower than
    `AT_REST`, null if they did not, and how fast the tool [m/s] and the fastest joint [rad/s, m/s]
    were at last; without, only why. `undamped` are the joints that were carried alone, as their
    encoders gave nothing.

    Args:
        outcome: of the run.
        history: of its log.
        period: of control [s].
    """
    if outcome.status == DONE:
        return {}
    found: dict[str, Any] = {"stage": TO_REST}
    rest = history.rest
    if rest is not None:
        clock, columns = rest.columns["clock"], rest.columns
        speeds = [
            np.abs(values)
            for name, values in columns.items()
            if name.startswith("joint.") and name.endswith(".velocity")
        ]
        fastest = np.max(speeds, axis=0)
        moving = np.flatnonzero(~(fastest <= AT_REST))
        first = int(moving[-1]) + 1 if len(moving) else 0
        rests = first < len(rest)
        found |= {
            "duration": len(rest) * period,
            "ticks": len(rest),
            "time_to_rest": float(clock[first] - clock[0]) if rests else None,
            "residual_speed": float(columns["speed"][-1]),
            "residual_joint_speed": float(fastest[-1]),
        }
    if outcome.undamped:
        found["undamped"] = list(outcome.undamped)
    why = outcome.not_at_rest or ("" if rest is not None else "the run was broken off")
    if why:
        found["not_at_rest"] = why
    return {"stopping": found}
