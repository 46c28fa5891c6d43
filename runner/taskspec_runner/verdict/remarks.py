"""What the parts of a run's summary have to say, in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from taskspec_runner.verdict import (
    drift,
    energy,
    estimated,
    payload,
    protected,
    slips,
    tank,
    torque_steps,
    velocity,
)

_PARTS = (torque_steps, drift, energy, tank, payload, slips, estimated, velocity, protected)


def remarks(summary: Mapping[str, Any]) -> list[str]:
    """How far torques stepped, what sensors drifted, what laws estimated, what came too near."""
    return [text for part in _PARTS for text in part.sentences(summary)]
