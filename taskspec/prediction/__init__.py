"""What a compiled task is expected to do, stage by stage, before anything has run."""

from taskspec.prediction.predict import Looked, look, predict
from taskspec.prediction.types import (
    Depth,
    Duration,
    Equilibrium,
    Extreme,
    Impact,
    Settling,
    StagePrediction,
    TaskPrediction,
)

__all__ = [
    "Depth",
    "Duration",
    "Equilibrium",
    "Extreme",
    "Impact",
    "Looked",
    "Settling",
    "StagePrediction",
    "TaskPrediction",
    "look",
    "predict",
]
