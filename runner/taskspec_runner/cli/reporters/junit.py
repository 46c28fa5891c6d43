"""Diagnostics as JUnit XML: a suite for each file, in it a test for each, or one that passes."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from taskspec.text.diagnostic import Diagnostic
from taskspec.text.render import render, visible
from taskspec_runner.cli.validation import Failure, Validation


def report(found: Validation) -> str:
    """One document in plain ASCII, so that it is the same whatever the terminal's encoding."""
    root = ET.Element("testsuites", name="taskspec validate")
    failures = {f.path: f for f in (*found.unreadable, *found.broken)}
    for path in found.files:
        if path in failures:
            _failed(suite(root, path), failures[path])
        else:
            _examined(suite(root, path), path, found)
    return document(root)


def document(root: ET.Element) -> str:
    """The text of suites, with the numbers of their cases."""
    for element in (*root, root):
        _count(element)
    ET.indent(root)
    text: bytes = ET.tostring(root, encoding="us-ascii", xml_declaration=True)
    return text.decode("ascii")


def suite(root: ET.Element, path: str) -> ET.Element:
    """A new suite for a file."""
    return ET.SubElement(root, "testsuite", name=one_line(path))


def case(suite: ET.Element, name: str, seconds: float = 0.0) -> ET.Element:
    """A new case in a suite."""
    time = f"{seconds:.3f}" if seconds else "0"
    name = one_line(name)
    return ET.SubElement(suite, "testcase", name=name, classname=suite.attrib["name"], time=time)


def _failed(own: ET.Element, failure: Failure) -> None:
    error = ET.SubElement(case(own, "validate"), "error", message=one_line(failure.message))
    error.text = visible(failure.message)


def _examined(own: ET.Element, path: str, found: Validation) -> None:
    diagnostics, sources = found.diagnostics[path], found.sources[path]
    if found.unchecked:
        ET.SubElement(case(own, "unchecked"), "skipped", message=one_line(found.unchecked))
    elif not diagnostics:
        case(own, "validate")
    for diagnostic in diagnostics:
        rendered = render([diagnostic], sources)
        made = case(own, _name(diagnostic))
        if found.fails(diagnostic):
            message = one_line(diagnostic.message)
            failure = ET.SubElement(made, "failure", type=diagnostic.code, message=message)
            failure.text = rendered
        else:
            ET.SubElement(made, "system-out").text = rendered


def _name(diagnostic: Diagnostic) -> str:
    span = diagnostic.span
    return f"{diagnostic.code}:{span.line}:{span.column}" if span else diagnostic.code


def _count(element: ET.Element) -> None:
    for attribute, tag in (
        ("tests", "testcase"),
        ("failures", "failure"),
        ("errors", "error"),
        ("skipped", "skipped"),
    ):
        element.set(attribute, str(sum(1 for _ in element.iter(tag))))


def one_line(text: str) -> str:
    """A text without line ends and control characters."""
    return visible(text).replace("\n", " ")
