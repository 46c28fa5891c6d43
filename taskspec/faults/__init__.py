"""Faults of what a robot measures and exerts: each kind one class, which says all that it does.

Reading a file needs no numerical library, so this package imports none.
"""

from taskspec.faults.kind import DEVICES, ENCODER, KINDS, SENSOR, TORQUE, FaultKind, Shown, kinds_of
from taskspec.faults.kinds import (
    Amplifies,
    Bias,
    Clips,
    Drifts,
    Drops,
    Flips,
    Late,
    Lost,
    Rustles,
    Spikes,
    Sticks,
    Swaps,
)

__all__ = [
    "DEVICES",
    "ENCODER",
    "KINDS",
    "SENSOR",
    "TORQUE",
    "Amplifies",
    "Bias",
    "Clips",
    "Drifts",
    "Drops",
    "FaultKind",
    "Flips",
    "Late",
    "Lost",
    "Rustles",
    "Shown",
    "Spikes",
    "Sticks",
    "Swaps",
    "kinds_of",
]
