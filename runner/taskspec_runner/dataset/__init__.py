"""Runs as data to learn from: a LeRobot dataset, an episode a run."""

from __future__ import annotations

from taskspec_runner.dataset.export import ExportedDataset, export_dataset
from taskspec_runner.dataset.source import RunSource, source_of

__all__ = ["ExportedDataset", "RunSource", "export_dataset", "source_of"]
