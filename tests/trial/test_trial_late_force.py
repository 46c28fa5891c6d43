"""A late force on a tool that friction holds: it flips; its axis and its remedy."""

from __future__ import annotations

import pytest
from trials import found, place_of, serious

PEG = """taskspec: 1
robot:
  model: ur5e
  tool: {{shape: cylinder, radius: 9.97 mm, thickness: 40 mm, length: 140 mm, mass: 200 g}}
  start: {{xyz: [500 mm, 0, 308 mm]}}
  sensor: {{delay: {delay} ms{filter}}}
world:
  bore:
    shape: hole
    radius: 10 mm
    depth: 25 mm
    chamfer: 1 mm
    xyz: [500.8 mm, 0.3 mm, 300 mm]
    stiffness: {stiffness} kN/m
    damping: 100 N*s/m
    friction: {friction}
frame: world
law: {law}
limits: {{force: 100 N}}
stages:
  approach:
    axes: {{z: {{velocity: -20 mm/s}}}}
    until: force.z < -3 N for 3 ms
    within: {{time: 3 s, travel: 15 mm}}
  insert: {{axes: {{x: {{force: 0}}, z: {{force: -8 N}}}}, time: 3.5 s}}
"""


def peg(law, stiffness, delay=0, filter="", friction=0.6):
    return PEG.format(law=law, stiffness=stiffness, delay=delay, filter=filter, friction=friction)


@pytest.mark.parametrize(
    ("law", "stiffness", "delay", "hertz"),
    [("hybrid", 40, 0, 500), ("parallel", 150, 0, 500), ("parallel", 150, 2, 167)],
)
def test_a_late_force_flips_where_friction_holds_the_tool(law, stiffness, delay, hertz):
    """At 1/(2 (d + 1) T), of the force axis whose mass is held by the rotations.

    x has h = 0.39 kg where the tool may turn, and 9.9 kg where nothing turns: J H^-1 J^T of the
    ur5e there.
    """
    text = peg(law, stiffness, delay)
    finding = found(text, "TS508")
    assert f"oscillates at {hertz} Hz" in finding.message
    assert "'bore' holds the tool, which has 9.9 kg along 'x' there and not the 0.39 kg" in (
        finding.message
    )
    assert place_of(finding, text)[1] == "x"
    assert "filter: 100 Hz" in (finding.hint or "")


@pytest.mark.parametrize(
    ("law", "stiffness", "delay"), [("hybrid", 40, 0), ("parallel", 150, 0), ("parallel", 150, 2)]
)
def test_a_low_pass_of_the_sensor_is_the_remedy(law, stiffness, delay):
    assert serious(peg(law, stiffness, delay, ", filter: 100 Hz")) == []


def test_without_friction_nothing_flips():
    assert serious(peg("parallel", 150, friction=0)) == []
