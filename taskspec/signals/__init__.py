"""Signals: what a run measures, each of them one entry of one table.

An entry states the name, dimension, bounds and formula of a signal, and where it may be used. The
language, the controller's outputs, the log, the checks, the verdict and the documentation are loops
over the table.
"""

from taskspec.signals import entries as entries
from taskspec.signals.situation import MovingPose, ObjectState, Situation
from taskspec.signals.table import (
    CLOCKS,
    ENERGY,
    ESTIMATE,
    GAIN,
    GRIP,
    JOINT,
    LINK,
    OBJECT,
    PAYLOAD,
    SCALARS,
    STAGE,
    TANK,
    VECTORS,
    Entry,
    Index,
    Signal,
    condition,
    find,
    signal,
    words,
)

__all__ = [
    "CLOCKS",
    "ENERGY",
    "ESTIMATE",
    "GAIN",
    "GRIP",
    "JOINT",
    "LINK",
    "OBJECT",
    "PAYLOAD",
    "SCALARS",
    "STAGE",
    "TANK",
    "VECTORS",
    "Entry",
    "Index",
    "MovingPose",
    "ObjectState",
    "Signal",
    "Situation",
    "condition",
    "find",
    "signal",
    "words",
]
