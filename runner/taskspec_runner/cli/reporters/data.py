"""Diagnostics as JSON, all that is known of them."""

from __future__ import annotations

import json

from taskspec.text.diagnostic import Severity
from taskspec_runner.cli.diagnostics import record
from taskspec_runner.cli.validation import Validation


def report(found: Validation) -> str:
    """One object; lines and columns count from 1, ends are exclusive."""
    diagnostics = [record(d) for path in found.diagnostics for d in found.diagnostics[path]]
    data = {
        "files": len(found.files),
        "errors": found.count(Severity.ERROR),
        "warnings": found.count(Severity.WARNING),
        "unreadable": [failure.message for failure in found.unreadable],
        "internal_errors": [failure.message for failure in found.broken],
        "unchecked": found.unchecked,
        "exit_code": found.exit_code,
        "diagnostics": diagnostics,
    }
    return json.dumps(data, indent=2, ensure_ascii=False)
