"""Signals that a key of the file gives: what is said where that key is missing."""

from __future__ import annotations

import pytest

from taskspec.examination import examine
from taskspec.spec import load_text
from taskspec.spec.load import UnreadTaskError
from taskspec.text.diagnostic import Severity

_TASK = """
taskspec: 1
robot:
  model: panda
  tool: {shape: sphere, radius: 10 mm, length: 120 mm, mass: 300 g}
  start: {xyz: [450 mm, 0, 330 mm]}
world:
  table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 5 kN/m, damping: 20 N*s/m}
  block: {shape: box, size: [40 mm, 40 mm, 40 mm], free: true, mass: 200 g, xyz: [700 mm, 0, 320 mm]}
frames: {task: {surface: table}}
frame: task
law: LAW
stages:
  press: {axes: {z: {force: -5 N}}, fail_if: GUARD, time: 1 s}
expect:
  - EXPECTED
"""  # noqa: E501

#: A condition on each optional signal, what gives it, and a law that has it.
_OPTIONAL = {
    "estimate.stiffness.z > 3 kN/m": ("law: {estimate:", "{kind: hybrid, estimate: 1..200 kN/m}"),
    "joint.2.disturbance > 1 N*m": (
        "law: {disturbance_observer: 20 Hz}", "{kind: hybrid, disturbance_observer: 20 Hz}",
    ),
    "tank.energy < 1 J": ("law: {tank: 2 J}", "{kind: parallel-pid, tank: 2 J}"),
    "payload.mass > 1 kg": ("law: {adapt: payload}", "{kind: hybrid, adapt: payload}"),
    "energy.stored > 1 J": ("law that stores energy", "{kind: impedance}"),
    "grip.slip > 1 mm": ("grip: {object: NAME, force: 20 N}", ""),
}  # fmt: skip


def found(law: str, guard: str, expected: str = "max(press.speed) < 1 m/s") -> dict[str, str]:
    """Codes and remedies of the errors of a task."""
    text = _TASK.replace("LAW", law).replace("GUARD", guard).replace("EXPECTED", expected)
    findings = examine(load_text(text, "task.yaml"), stability=False).findings
    return {each.code: each.hint for each in findings if each.severity is Severity.ERROR}


@pytest.mark.parametrize("condition", _OPTIONAL)
def test_guards_and_expectations_name_the_key_that_gives_a_signal(condition: str) -> None:
    given, law = _OPTIONAL[condition]
    guard = "speed > 1 m/s"
    assert given in found("{kind: hybrid}", condition)["TS224"]
    name, rest = condition.split(" ", 1)
    assert given in found("{kind: hybrid}", f"max({name}) {rest}")["TS224"]
    assert given in found("{kind: hybrid}", guard, f"last(press.{name}) {rest}")["TS224"]
    assert given in found("{kind: hybrid}", guard, f"last({name}) {rest}")["TS721"]
    if law:
        assert found(law, condition, f"last(press.{name}) {rest}") == {}


def test_a_stiffness_is_estimated_along_axes_with_a_force_alone() -> None:
    law = "{kind: hybrid, estimate: 1..200 kN/m}"
    assert "with a force" in found(law, "estimate.stiffness.x > 3 kN/m")["TS224"]


@pytest.mark.parametrize(
    "condition",
    ["max(energy.stored) > 1", "energy.stored + 1 > 2 J", "energy.stored within 0 J..1"],
)
def test_an_energy_without_its_unit_is_to_have_joules(condition: str) -> None:
    text = _TASK.replace("LAW", "{kind: impedance}").replace("GUARD", condition)
    with pytest.raises(UnreadTaskError) as raised:
        load_text(text.replace("EXPECTED", "max(torque.rx) < 1 N*m"), "task.yaml")
    (finding,) = raised.value.diagnostics
    assert (finding.code, finding.hint) == ("TS110", "add a unit: J")
    assert "an energy" in finding.message


def test_a_body_that_is_misspelt_is_named() -> None:
    guard = "speed > 1 m/s, grip: {object: blok, force: 5 N}"
    text = _TASK.replace("LAW", "{kind: hybrid}").replace("GUARD", guard)
    with pytest.raises(UnreadTaskError) as raised:
        load_text(text.replace("EXPECTED", "max(speed) < 1 m/s"), "task.yaml")
    assert [(d.code, d.hint) for d in raised.value.diagnostics] == [
        ("TS144", "did you mean 'block'?")
    ]
