"""Estimates by touch for later stages: the sensor's zero, and frames."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.program.execution.sensor_zero import SensorZero
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.world.estimated_frames import Estimates
from taskspec.robot.model_terms import ModelTerms

Vector = NDArray[np.float64]


class Estimation:
    """The sensor's zero and the estimated frames of a run, of which it may have neither.

    Attributes:
        on: whether the current stage estimates anything.
        estimates: the frames; None where none is estimated.
    """

    def __init__(self, sensor: SensorZero | None, estimates: Estimates | None) -> None:
        self.on = False
        self._sensor, self.estimates = sensor, estimates

    @property
    def poses(self) -> Mapping[str, Vector]:
        """(12,) of the estimated frames, by stage parameter."""
        if self.estimates is None:
            return {}
        return {name: self.estimates.pose(name) for name in self.estimates.names}

    def missing(self, stage: CompiledStage) -> str:
        """Why a stage cannot be entered, as a sentence; empty if it can."""
        return "" if self.estimates is None else self.estimates.missing(stage.entry.poses)

    def begin(self, stage: CompiledStage) -> None:
        """Forgets what the last stage was measured by."""
        self.on = stage.plan.spec.tare
        if self._sensor is not None:
            self._sensor.begin()
        if self.estimates is not None:
            self.on |= stage.name in self.estimates.ends
            self.estimates.begin()

    def collect(self, wrench: Vector) -> None:
        """Keeps what a tick of the stage measured (6,), for its end."""
        if self._sensor is not None:
            self._sensor.collect()
        if self.estimates is not None:
            self.estimates.collect(wrench[:3])

    def end(self, stage: CompiledStage, terms: ModelTerms, wrench: Vector, *, summed: bool) -> None:
        """Takes what a stage has estimated, and corrects the measured `wrench` (6,) by it.

        Args:
            stage: that ends.
            terms: of now.
            wrench: of now.
            summed: whether the forces that were collected have been added up.
        """
        if self.estimates is not None:
            self.estimates.end(stage.name, terms.position, summed=summed)
        if self._sensor is not None and stage.plan.spec.tare:
            self._sensor.tare()
            self._sensor.correct(terms.tip()[1], wrench)
