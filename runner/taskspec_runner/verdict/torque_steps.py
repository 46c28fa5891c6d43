"""Torque steps of a run: at changes of stage, and inside of stages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from taskspec.program.drives import TORQUE_FADING
from taskspec.program.execution.transition import Transition
from taskspec_runner.record.file_array import blocks
from taskspec_runner.record.history import History

#: From here on a step at a change of stage is worth a line [N m].
NOTICED = 0.5
#: The same of a velocity that is commanded, or of that of a position: what fades in 5 ms [rad/s].
NOTICED_VELOCITY = 0.01
#: Inside of a stage one that is so many times as fast as a hand-over is. What a touch makes of a
#: force loop is below: up to 3.7 times in the shipped tasks.
SHARP = 5.0


def largest_step(transitions: Sequence[Transition], history: History) -> dict[str, Any] | None:
    """The largest step of a joint's torque; None of a run of one tick.

    At a change of stage that is what the new stage's first torque is off the last stage's at the
    same measurement, inside of a stage the change from one tick to the next: there `from` and `to`
    are the same stage, and `joint` counts from 1.
    """
    steps = (*_changes(transitions), *_inside(history))
    return max(steps, key=lambda step: step["value"], default=None)


def largest_change(transitions: Sequence[Transition]) -> dict[str, Any] | None:
    """The largest step of what a joint is commanded at a change of stage; None without a change."""
    return max(_changes(transitions), key=lambda step: step["value"], default=None)


def _changes(transitions: Sequence[Transition]) -> Iterator[dict[str, Any]]:
    for before, after in pairwise(transitions):
        yield {
            "value": before.torque_step,
            "from": before.stage,
            "to": after.stage,
            "clock": before.clock,
        }


def _inside(history: History) -> Iterator[dict[str, Any]]:
    """The largest step of each joint in each visit of a stage."""
    joint = 1
    while f"joint.{joint}.torque" in history.columns:
        torque = history.columns[f"joint.{joint}.torque"]
        for visit in history.visits():
            for part in blocks(visit.last - visit.first):
                first = visit.first + part.start
                steps = np.abs(np.diff(torque[first : visit.first + part.stop + 1]))
                # A run whose torque is not finite ends by it.
                steps = np.where(np.isfinite(steps), steps, 0.0)
                at = int(np.argmax(steps))
                yield {
                    "value": float(steps[at]),
                    "from": visit.stage,
                    "to": visit.stage,
                    "clock": float(history.columns["clock"][first + at + 1]),
                    "joint": joint,
                }
        joint += 1


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """The largest step in words; nothing where there is none to speak of."""
    change = summary.get("velocity_step")
    if change and change["value"] >= NOTICED_VELOCITY:
        yield (
            f"{change['to']}: its first velocity of a joint is {change['value']:.3g} rad/s off the "
            f"last of {change['from']!r}, at {change['clock']:.3f} s"
        )
    step = summary.get("torque_step")
    if not step:
        return
    if step["from"] == step["to"] and "joint" in step:
        if step["value"] > SHARP * TORQUE_FADING * summary["period"]:
            yield (
                f"{step['to']}: the torque of joint {step['joint']} steps by "
                f"{step['value']:.3g} N*m from one tick to the next, at {step['clock']:.3f} s"
            )
    elif step["value"] >= NOTICED:
        yield (
            f"{step['to']}: its first torque is {step['value']:.3g} N*m off the last of "
            f"{step['from']!r}, at {step['clock']:.3f} s"
        )
