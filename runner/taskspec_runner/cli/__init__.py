"""The command `taskspec`."""

from taskspec_runner.cli.app import app, main

__all__ = ["app", "main"]
