"""The log of a run in formats that other tools read: CSV, Parquet, MCAP and Rerun."""

from __future__ import annotations

from taskspec.missing import MissingLibraryError
from taskspec_runner.export.export import FORMATS, Exported, export_run

__all__ = ["FORMATS", "Exported", "MissingLibraryError", "export_run"]
