"""What limits took from each stage: how often each of them was in the way, and what it cost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from taskspec.program.stage import CompiledStage
from taskspec_runner.history import History


def given_up(history: History, stages: Sequence[CompiledStage]) -> dict[str, dict[str, Any]]:
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
