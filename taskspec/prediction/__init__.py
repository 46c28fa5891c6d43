"""What a compiled task is expected to do, stage by stage, before anything has run."""

from taskspec.prediction.predict import Looked, look, predict
from taskspec.prediction.types import (
    Depth,
    Duration,
    Equilibrium,
    Extreme,
    Impact,
    Natural,
    Selection,
    Settling,
    StagePrediction,
    State,
    TaskPrediction,
)

__all__ = [
    "Depth",
    "Duration",
    "Equilibrium",
    "Extreme",
    "Impact",
    "Looked",
    "Natural",
    "Selection",
    "Settling",
    "StagePrediction",
    "State",
    "TaskPrediction",
    "look",
    "predict",
]
