"""Findings about the force sensor and its zero."""

from __future__ import annotations

import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text

TASK = """
taskspec: 1
name: sensed
robot: {model: planar2, start: {xyz: [START, 100 mm, 0]}, sensor: {SENSOR}}
world: {wall: {shape: plane, xyz: [370 mm, 0, 0], rpy: [0, -90 deg, 0]}, WORLD}
frames: {felt: {estimate: press, heading: [0, 1, 0]}, skin: {surface: wall}}
stages:
  BEFORE
  zero: {tare: true, AXES time: 1 s}
  press: {axes: {x: {force: 5 N}}, time: 1 s}
"""
GOOD = {"START": "350 mm", "SENSOR": "delay: 0", "WORLD": "", "BEFORE": "", "AXES": ""}


def found(**changes):
    text = TASK
    for key, value in (GOOD | changes).items():
        text = text.replace(key, value)
    # Its presses begin off the wall and its frames are not always used: no matter of the sensor's.
    other = ("TS615", "TS130")
    return tuple(d for d in check_task(load_text(text, "task.yaml")) if d.code not in other)


def test_a_tare_of_any_sensor_is_fine():
    assert found() == ()
    assert found(SENSOR="at: wrist, bias: [1 N, 0, 0, 0, 0, 0], rate: 250 Hz, delay: 2.5 ms") == ()


@pytest.mark.parametrize(
    ("code", "changes"),
    [
        ("TS430", {"SENSOR": "delay: 80 ms"}),
        ("TS430", {"SENSOR": "filter: 1 Hz"}),
        ("TS431", {"SENSOR": "rate: 400 Hz"}),
        ("TS620", {"AXES": "axes: {x: {force: 5 N}},"}),
        ("TS620", {"START": "371 mm"}),
        ("TS620", {"BEFORE": "hit: {axes: {x: {force: 1 N}}, time: 1 s}"}),
        (
            "TS620",
            {"BEFORE": "hit: {axes: {x: {velocity: 9 mm/s}}, until: force.x > 1 N, "
             "within: {time: 3 s}}"},
        ),
        ("TS247", {"WORLD": 'bar: {equation: "y = 0", frame: felt}'}),
        ("TS247", {"WORLD": 'bar: {equation: "y = 0", frame: skin}'}),
    ],
)  # fmt: skip
def test_what_misleads_is_reported(code, changes):
    assert code in [d.code for d in found(**changes)]


def test_the_message_says_what_the_rate_becomes():
    (finding,) = found(SENSOR="rate: 400 Hz")
    assert "333.3" in finding.message


def test_just_fast_enough_is_no_finding():
    """The force loop's time constant is 1/(2 pi 2 Hz) = 79.6 ms; one tick is always there."""
    assert found(SENSOR="delay: 78 ms") == ()


def test_moving_away_before_a_tare_is_no_finding():
    away = "away: {axes: {x: {move: -20 mm}}}"
    assert found(BEFORE=f"hit: {{axes: {{x: {{force: 1 N}}}}, time: 1 s}}\n  {away}") == ()
