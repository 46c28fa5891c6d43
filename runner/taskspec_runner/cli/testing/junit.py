"""Outcomes of task files as JUnit XML: a suite for each file, a case for each expectation."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from taskspec.text.render import visible
from taskspec_runner.cli.reporters.junit import case, document, one_line, suite
from taskspec_runner.cli.testing.outcome import ENDS_WELL, CaseOutcome, FileOutcome


def report(outcomes: Sequence[FileOutcome]) -> str:
    """One document in plain ASCII."""
    seconds = sum(each.seconds for each in outcomes)
    root = ET.Element("testsuites", name="taskspec test", time=f"{seconds:.3f}")
    for each in outcomes:
        own = suite(root, each.path)
        own.set("time", f"{each.seconds:.3f}")
        for number, found in enumerate(each.cases):
            _case(own, each, found, each.seconds if number == 0 else 0.0)
    return document(root)


def _case(own: ET.Element, of: FileOutcome, found: CaseOutcome, seconds: float) -> None:
    made = case(own, found.name, seconds)
    message = one_line(found.message)
    if found.passed is None:
        ET.SubElement(made, "skipped", message=message)
    elif not found.passed:
        # What no run comes of is an error; what a run misses is a failure.
        broken = found.name == ENDS_WELL and bool(of.problem) and not of.diagnostics
        kind = "stopped" if found.name == ENDS_WELL else "missed"
        if broken:
            failure = ET.SubElement(made, "error", message=message)
        else:
            kind = of.diagnostics[0].code if of.problem and of.diagnostics else kind
            failure = ET.SubElement(made, "failure", type=kind, message=message)
        failure.text = visible(of.problem or _told(of, found))


def _told(of: FileOutcome, found: CaseOutcome) -> str:
    place = f"{of.path}:{found.line}: " if found.line is not None else f"{of.path}: "
    lines = [f"{place}{found.title}", found.message]
    return "\n".join([*lines, *([f"report: {of.report}"] if of.report else [])])
