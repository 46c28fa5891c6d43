"""The command `taskspec`."""

from taskspec_runner.cli.app import app
from taskspec_runner.cli.entry import main

__all__ = ["app", "main"]
