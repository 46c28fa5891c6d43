"""The page of a sweep: one HTML file that needs nothing beside it."""

from taskspec_runner.sweep.page.content import render

__all__ = ["render"]
