"""The registry of rules, and where what they find is said to be."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import taskspec.examination  # noqa: F401  (it registers all rules)
from taskspec.rules import (
    RULES,
    Finding,
    Phase,
    apply_rules,
    error,
    info,
    registry,
    rule,
    rule_of,
    warning,
)
from taskspec.spec import FILE, LoadedTask, key_of, load_text
from taskspec.text.codes import CODES
from taskspec.text.diagnostic import Diagnostics, Severity, SpecError

TEXT = """taskspec: 1
robot: {model: panda}
stages:
  press:
    time: 1 s
    axes: {z: {force: -10 N}}
"""


@pytest.fixture
def loaded() -> LoadedTask:
    return load_text(TEXT, "t")


@pytest.fixture
def own(monkeypatch: pytest.MonkeyPatch) -> Iterator[Diagnostics]:
    """A registry of no rules yet, and the diagnostics of a task."""
    monkeypatch.setattr("taskspec.rules.registry.RULES", [])
    before = dict(CODES)
    yield Diagnostics("t")
    CODES.clear()
    CODES.update(before)


def test_a_code_stands_beside_one_rule() -> None:
    own = [code for each in RULES for code in each.titles]
    assert len(own) == len(set(own))
    for each in RULES:
        assert each.titles.items() <= CODES.items()
        assert set(each.also) <= CODES.keys() - each.titles.keys(), each.name


def test_a_code_is_registered_once(own: Diagnostics) -> None:
    del own
    with pytest.raises(ValueError, match="TS001 is already taken"):
        rule("TS001", "another")


def test_a_rule_is_asked_in_its_phase_and_its_findings_are_reported(
    own: Diagnostics, loaded: LoadedTask
) -> None:
    @rule({"TS990": "one", "TS991": "two"}, also=("TS001",), phase=Phase.AXES)
    def both(plan: str) -> Iterator[Finding]:
        yield error("TS990", f"of {plan}", FILE.stages["press"].axes["z"].force, "a hint")
        yield warning("TS991", "two", key_of(FILE.stages["press"].time))
        yield info("TS001", "three", None, notes=(("note", FILE.robot.model),))

    assert apply_rules(Phase.PATH, "a", loaded, own)
    assert len(own) == 0
    assert apply_rules(Phase.AXES, "a", loaded, own)
    three, two, one = own.sorted()
    assert (one.code, one.message, one.hint) == ("TS990", "of a", "a hint")
    assert one.span is not None
    assert (one.span.line, one.span.column) == (6, 23)
    assert two.span is not None
    assert (two.span.line, two.span.column) == (5, 5)
    assert (two.severity, three.severity) == (Severity.WARNING, Severity.INFO)
    assert three.notes[0].span.line == 2
    (entry,) = registry.RULES
    assert rule_of("TS990") is entry
    assert (rule_of("TS001"), entry.name, entry.module) == (None, "both", __name__)
    assert entry.pages[-1] == "docs/diagnostics/TS001.md"


def test_a_rule_may_only_report_its_codes(own: Diagnostics, loaded: LoadedTask) -> None:
    @rule("TS990", "one")
    def other(_: str) -> Iterator[Finding]:
        yield error("TS001", "x", None)

    with pytest.raises(AssertionError, match="other does not declare TS001"):
        apply_rules(Phase.MOTION, "a", loaded, own)


def test_what_stops_keeps_later_rules_from_being_asked(
    own: Diagnostics, loaded: LoadedTask
) -> None:
    @rule("TS990", "one")
    def first(plan: str) -> Iterator[Finding]:
        yield error("TS990", "a", None, stops=plan == "bad")
        yield error("TS990", "b", None)
        if plan == "worse":
            raise SpecError(own.sorted())

    @rule("TS991", "two")
    def second(_: str) -> Iterator[Finding]:
        yield error("TS991", "c", None)

    assert not apply_rules(Phase.MOTION, "bad", loaded, own)
    assert not apply_rules(Phase.MOTION, "worse", loaded, own)
    assert [d.message for d in own.sorted()] == ["a", "b"]
    assert apply_rules(Phase.MOTION, "good", loaded, own)
    assert [d.message for d in own.sorted()] == ["a", "b", "c"]


def test_what_is_said_already_is_left_out(own: Diagnostics, loaded: LoadedTask) -> None:
    press = FILE.stages["press"]

    @rule({"TS990": "one", "TS991": "two"})
    def both(_: str) -> Iterator[Finding]:
        yield error("TS990", "a", press.time, notes=(("b", press.axes["z"].force),))
        yield error("TS991", "c", press.axes["z"].force, unless=("TS990",))
        yield error("TS991", "d", press.axes, unless=("TS990",), unless_at=press.time)
        yield error("TS991", "e", press.axes, unless=("TS990",))

    apply_rules(Phase.MOTION, "a", loaded, own)
    assert [d.message for d in own.sorted()] == ["a", "e"]
