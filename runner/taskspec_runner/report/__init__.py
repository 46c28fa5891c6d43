"""The report of a run: one self-contained page, and a picture for a README."""

from __future__ import annotations

from taskspec_runner.report.overview import Picture, overview_svg
from taskspec_runner.report.page import write_report

__all__ = ["Picture", "overview_svg", "write_report"]
