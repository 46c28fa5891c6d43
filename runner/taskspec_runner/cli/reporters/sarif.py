"""Diagnostics as SARIF 2.1.0, the form in which code hosts and editors exchange them."""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

from taskspec import __version__
from taskspec.text.diagnostic import Diagnostic, Severity
from taskspec.text.source import Source, Span
from taskspec_runner.cli.codes import page, severities_of, title_of
from taskspec_runner.cli.reporters.paths import uri
from taskspec_runner.cli.validation import Failure, Validation

SCHEMA = (
    "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
)
_LEVELS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.INFO: "note"}


def report(found: Validation) -> str:
    """One log with one run; only the codes that were found are listed as its rules."""
    diagnostics = [d for path in found.diagnostics for d in found.diagnostics[path]]
    codes = sorted({d.code for d in diagnostics})
    rules = {code: number for number, code in enumerate(codes)}
    counts: Counter[str] = Counter()
    results = [
        _result(diagnostic, found.sources[path], rules, counts)
        for path, of_file in found.diagnostics.items()
        for diagnostic in of_file
    ]
    driver = {
        "name": "taskspec",
        "semanticVersion": __version__,
        "rules": [_rule(code, diagnostics) for code in codes],
    }
    run = {
        "tool": {"driver": driver},
        "columnKind": "unicodeCodePoints",
        "invocations": [_invocation(found)],
        "results": results,
    }
    log = {"$schema": SCHEMA, "version": "2.1.0", "runs": [run]}
    return json.dumps(log, indent=2)


def _rule(code: str, diagnostics: list[Diagnostic]) -> dict[str, Any]:
    title = title_of(code)
    text = page(code)
    found = {d.severity for d in diagnostics if d.code == code}
    severities = severities_of(text) if text else sorted(found, key=list(_LEVELS).index)
    text_of = {"text": f"taskspec explain {code}"} | ({"markdown": text} if text else {})
    return {
        "id": code,
        "name": "".join(word.capitalize() for word in re.findall(r"[A-Za-z0-9]+", title)),
        "shortDescription": {"text": title},
        "help": text_of,
        "defaultConfiguration": {"level": _LEVELS[severities[0]]},
    }


def _result(
    diagnostic: Diagnostic,
    sources: Mapping[str, Source],
    rules: Mapping[str, int],
    counts: Counter[str],
) -> dict[str, Any]:
    message = "\n".join(filter(None, (diagnostic.message, diagnostic.hint)))
    result = {
        "ruleId": diagnostic.code,
        "ruleIndex": rules[diagnostic.code],
        "level": _LEVELS[diagnostic.severity],
        "message": {"text": message},
        "locations": [_location(diagnostic.source, diagnostic.span)],
        "partialFingerprints": {"codeAndLine/v1": _fingerprint(diagnostic, sources, counts)},
    }
    if diagnostic.notes:
        result["relatedLocations"] = [
            {**_location(note.source, note.span), "id": number, "message": {"text": note.message}}
            for number, note in enumerate(diagnostic.notes)
        ]
    return result


def _location(source: str, span: Span | None) -> dict[str, Any]:
    reference, is_relative = uri(source)
    artifact = {"uri": reference} | ({"uriBaseId": "%SRCROOT%"} if is_relative else {})
    place: dict[str, Any] = {"artifactLocation": artifact}
    if span is not None:
        place["region"] = {
            "startLine": span.line,
            "startColumn": span.column,
            "endLine": span.end_line,
            "endColumn": span.end_column,
        }
    return {"physicalLocation": place}


def _fingerprint(
    diagnostic: Diagnostic, sources: Mapping[str, Source], counts: Counter[str]
) -> str:
    """A mark that a finding keeps when lines above it come and go."""
    source, span = sources.get(diagnostic.source), diagnostic.span
    line = source.line(span.line).strip() if source and span else ""
    parts = (diagnostic.code, uri(diagnostic.source)[0], line)
    mark = hashlib.sha256("\0".join(parts).encode("utf-8", "surrogatepass")).hexdigest()[:16]
    counts[mark] += 1
    return f"{mark}:{counts[mark]}"


def _invocation(found: Validation) -> dict[str, Any]:
    failures = (*found.unreadable, *found.broken)
    notifications = [_notification(failure) for failure in failures]
    if found.unchecked:
        notifications.append({"level": "warning", "message": {"text": found.unchecked}})
    return {
        "executionSuccessful": not failures,
        "exitCode": found.exit_code,
        **({"toolExecutionNotifications": notifications} if notifications else {}),
    }


def _notification(failure: Failure) -> dict[str, Any]:
    return {
        "level": "error",
        "message": {"text": failure.message},
        "locations": [_location(failure.path, None)],
    }
