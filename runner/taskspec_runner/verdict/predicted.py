"""What was predicted of a run before it began, as its summary keeps it."""

from __future__ import annotations

import logging
from typing import Any

from taskspec.prediction import StagePrediction, predict
from taskspec.program.program import Program

_LOG = logging.getLogger(__name__)

#: Of a stage: equilibria by signal, settling by axis, depths by object, impact and duration.
Predicted = dict[str, dict[str, Any]]


def predicted(program: Program) -> Predicted:
    """The prediction of each stage in SI units; empty where none can be made.

    What a run did stands whether or not it can be predicted, so that a prediction that fails
    is logged and left out.
    """
    try:
        return {stage.name: _stage(stage) for stage in predict(program).stages}
    except Exception:
        _LOG.warning("the task cannot be predicted", exc_info=True)
        return {}


def _stage(stage: StagePrediction) -> dict[str, Any]:
    met = stage.impact
    return {
        "duration": stage.duration.expected,
        "equilibrium": {
            name: {"value": at.value, "low": at.low, "high": at.high, "source": at.source}
            for name, at in stage.equilibrium.items()
        },
        "settling": {
            axis: {
                "time_constant": float(how.time_constant),
                "frequency": float(how.frequency),
                "damping_ratio": float(how.damping_ratio),
            }
            for axis, how in stage.settling.items()
        },
        "depths": {on: {"depth": float(at.depth), "push": at.push}
                   for on, at in stage.depths.items() if not at.angular},
        "impact": None if met is None else {
            "contact": met.contact, "axis": met.axis, "speed": met.speed,
            "peak": float(met.largest),
        },
    }  # fmt: skip


def axis_of(signal: str) -> str:
    """The axis, or the equation, that a force or moment belongs to: `z` of `force.z`."""
    kind, _, rest = signal.partition(".")
    return rest if kind in ("force", "torque") else kind
