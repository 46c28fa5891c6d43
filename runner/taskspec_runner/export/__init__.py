"""The log of a run in formats that other tools read: CSV, Parquet, MCAP and Rerun."""

from __future__ import annotations

from taskspec_runner.export.export import FORMATS, Exported, export_run
from taskspec_runner.export.missing import MissingLibraryError

__all__ = ["FORMATS", "Exported", "MissingLibraryError", "export_run"]
