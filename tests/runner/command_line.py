"""Commands as a user gives them, in the process of the tests."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner, Result

from taskspec_runner.cli.app import app


def call(*args: str | Path) -> Result:
    """The outcome of a command, which must not be an error of the program's own."""
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    assert "Traceback" not in result.output
    assert "internal error" not in result.output
    return result
