"""What limits took from each stage: how often each of them was active, and what it cost."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from taskspec.program.stages.stage import CompiledStage
from taskspec_runner.record.history import History

#: Limits that are named in a line.
_MOST_NAMED_LIMITS = 3
#: Share of a stage that is no more than a moment.
_MOMENT = 0.05
#: Columns that it is computed from.
_LIMIT_COLUMNS = ("limits", "limited", "force_inconsistent", "residual")
_JOINT = re.compile(r"position and velocity of joint (\d+)\Z")


def limit_effects(history: History, stages: Sequence[CompiledStage]) -> dict[str, dict[str, Any]]:
    """Of every visited stage that keeps its limits by a program.

    Returns:
        Stage to `limited`, the share of ticks on which limits changed the torque; `limits`, the
        share by the limit's name, the most frequent first; `force_inconsistent`, the most of its
        force set points that its contacts could not return [N]; `residual`, the worst of the
        solver's answers.
    """
    found = {}
    for stage in stages:
        window = history.window(stage.name)
        if stage.resolution is None or not window.any():
            continue
        if not history.unrecorded.isdisjoint(_LIMIT_COLUMNS):
            # A log that was recorded elsewhere seldom says what the solver did.
            continue
        codes = history.columns["limits"][window].astype(np.int64)
        shares = {
            row.text: float(np.mean((codes >> i) & 1))
            for i, row in enumerate(stage.resolution.rows)
        }
        frequent = sorted(shares, key=lambda text: -shares[text])
        found[stage.name] = {
            "limited": float(np.mean(history.columns["limited"][window])),
            "limits": {text: shares[text] for text in frequent if shares[text]},
            "force_inconsistent": float(np.max(history.columns["force_inconsistent"][window])),
            "residual": float(np.max(history.columns["residual"][window])),
        }
    return found


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """What limits and contacts took from each stage, a line each; nothing where it is nothing."""
    yield from _unanswered(summary)
    for stage, found in summary.get("given_up", {}).items():
        if found["force_inconsistent"]:
            left = f"{found['force_inconsistent']:.3g} N"
            yield (
                f"{stage}: {left} of its set points cannot be returned, and the nearest force "
                "that can was applied"
            )
        if found["limited"]:
            most = list(found["limits"].items())
            named = ", ".join(
                f"{name} {percent(share)}" for name, share in most[:_MOST_NAMED_LIMITS]
            )
            more = (
                f" and {len(most) - _MOST_NAMED_LIMITS} more"
                if len(most) > _MOST_NAMED_LIMITS
                else ""
            )
            yield f"{stage}: limits changed {percent(found['limited'])} of the ticks: {named}{more}"


def _unanswered(summary: Mapping[str, Any]) -> Iterator[str]:
    for stage, counts in summary.get("solver", {}).items():
        if counts.get("held"):
            yield (
                f"{stage}: the solver had no answer on {counts['held']:.0f} of {counts['ticks']} "
                "ticks, and a torque within the limits was held"
            )


def percent(share: float) -> str:
    """A share, never rounded to nothing or to everything."""
    return "< 1 %" if share < 0.01 else f"{min(100 * share, 99 if share < 1 else 100):.0f} %"


def held_joints(found: Mapping[str, Any]) -> list[int]:
    """Joints that a stage has held at their limits for more than a moment, counted from 1."""
    limits = found.get("limits", {}).items()
    held = (_JOINT.match(name) for name, share in limits if share > _MOMENT)
    return [int(joint[1]) for joint in held if joint is not None]
