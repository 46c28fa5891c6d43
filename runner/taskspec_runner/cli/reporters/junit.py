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
            _failed(_suite(root, path), failures[path])
        else:
            _examined(_suite(root, path), path, found)
    for element in (*root, root):
        _count(element)
    ET.indent(root)
    document: bytes = ET.tostring(root, encoding="us-ascii", xml_declaration=True)
    return document.decode("ascii")


def _suite(root: ET.Element, path: str) -> ET.Element:
    return ET.SubElement(root, "testsuite", name=_one_line(path))


def _case(suite: ET.Element, name: str) -> ET.Element:
    return ET.SubElement(suite, "testcase", name=name, classname=suite.attrib["name"], time="0")


def _failed(suite: ET.Element, failure: Failure) -> None:
    error = ET.SubElement(_case(suite, "validate"), "error", message=_one_line(failure.message))
    error.text = visible(failure.message)


def _examined(suite: ET.Element, path: str, found: Validation) -> None:
    diagnostics, sources = found.diagnostics[path], found.sources[path]
    if found.unchecked:
        ET.SubElement(_case(suite, "unchecked"), "skipped", message=_one_line(found.unchecked))
    elif not diagnostics:
        _case(suite, "validate")
    for diagnostic in diagnostics:
        rendered = render([diagnostic], sources)
        case = _case(suite, _name(diagnostic))
        if found.fails(diagnostic):
            message = _one_line(diagnostic.message)
            failure = ET.SubElement(case, "failure", type=diagnostic.code, message=message)
            failure.text = rendered
        else:
            ET.SubElement(case, "system-out").text = rendered


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


def _one_line(text: str) -> str:
    return visible(text).replace("\n", " ")
