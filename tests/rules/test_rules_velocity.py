"""Stability of loops over a servo as findings: bounds are true, and remedies work as written."""

from __future__ import annotations

import re

import pytest

from taskspec.examination import check_task
from taskspec.laws import LAWS
from taskspec.planning import plan_task
from taskspec.program.plan import StagePlan
from taskspec.program.prepare import prepare
from taskspec.program.stages.stage import compile_stage
from taskspec.spec import load_text
from taskspec.stability.margin import BANDWIDTH, DELAY, FILTER, Search
from taskspec.stability.sampled_stage import analyse

PRESS = """
taskspec: 1
name: press
robot:
  model: ur5e
  command: {command}
  servo: {{bandwidth: {bandwidth}, delay: {delay}}}
  sensor: {{filter: {filter}}}
  tool: {{shape: sphere, radius: 15 mm, length: 120 mm, mass: 300 g}}
  start: {{xyz: [450 mm, 100 mm, 315 mm]}}
world: {{bench: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: {stiffness}, friction: 0.2}}}}
law: {law}
stages:
  approach: {{axes: {{z: {{velocity: -10 mm/s}}}}, until: force.z < -2 N, within: 3 s}}
  press: {{axes: {{z: {{force: -15 N}}}}, time: 2 s}}
"""
USUAL = {
    "command": "velocity",
    "bandwidth": "20 Hz",
    "delay": "4 ms",
    "filter": "500 Hz",
    "stiffness": "20 kN/m",
}
ADMITTANCE = "{{kind: admittance, damping: {damping}}}"
PI = "{{kind: force-velocity, force: {{proportional: {proportional}, damping: {damping}}}}}"
INTEGRAL = "{{kind: force-velocity, force: {{integral: {integral}, damping: {damping}}}}}"
_D = {"damping": "250 N*s/m"}


def written(law, **values):
    gains = {key: value for key, value in values.items() if f"{{{key}}}" in law}
    rest = {key: value for key, value in values.items() if key not in gains}
    return PRESS.format(law=law.format(**gains), **(USUAL | rest))


def found(text):
    return [d for d in check_task(load_text(text, "t")) if d.code.startswith("TS50")]


def grows(text):
    """Whether the press of a file is unstable, compiled anew."""
    stage = analyse(compile_stage(StagePlan(prepare(load_text(text, "t")), "press")))
    assert stage is not None
    return stage.modes()[0].s.real > 0


def remedies(hint):
    """(key, value) of each change that a hint proposes, the pad as the stiffness that it makes."""
    for part in hint.split("; or "):
        stated = re.fullmatch(r"(.+?) (?:up to|from) (.+?)(?:, as a pad of (.+) on it .*)?", part)
        assert stated is not None, part
        what, value, pad = stated.groups()
        key = "stiffness" if what == "a contact of" else what.rpartition(".")[2]
        yield key, value
        if pad is not None:
            yield key, f"{_in_series(pad)} kN/m"


def _in_series(pad):
    under, over = (float(text.split()[0]) for text in (USUAL["stiffness"], pad))
    return 1 / (1 / under + 1 / over)


@pytest.mark.parametrize(
    ("law", "given", "keys"),
    [
        (ADMITTANCE, {"damping": "60 N*s/m"}, {"damping", "stiffness"}),
        (
            "{{kind: force-velocity, force: {{proportional: {proportional}}}}}",
            {"proportional": "6", "command": "position"},
            {"proportional"},
        ),
        (INTEGRAL, _D | {"integral": "120 1/s"}, {"integral", "stiffness", "delay"}),
        (PI, _D | {"proportional": "5", "delay": "8 ms"}, {"proportional", "stiffness"}),
    ],
)
def test_each_remedy_makes_the_stage_quiet_as_it_is_written(law, given, keys):
    first, *_ = found(written(law, **given))
    assert first.code in ("TS501", "TS502")
    tried = list(remedies(first.hint))
    assert {key for key, _ in tried} >= keys
    for key, value in tried:
        after = found(written(law, **(given | {key: value})))
        assert after == [], (key, value)


BOUNDS = [
    ("damping", ADMITTANCE, "400 N*s/m"),
    ("force.proportional", PI, "1"),
    ("force.integral", INTEGRAL, "8 1/s"),
]


@pytest.mark.parametrize(("what", "law", "now"), BOUNDS)
def test_a_bound_of_a_gain_is_that_of_the_file_with_it(what, law, now):
    """Gains stand in denominators there: no polynomial through three values tells."""
    key, unit = what.rpartition(".")[2], now.partition(" ")[2]
    context = prepare(load_text(written(law, **(_D | {key: now})), "t"))
    stage = analyse(compile_stage(StagePlan(context, "press")))
    limits = {limit.what: limit for limit in Search(context, stage).gains(["z"])}
    bound = limits[what]
    for factor in (0.99, 1.01):
        unstable = grows(written(law, **(_D | {key: f"{factor * bound.value} {unit}"})))
        assert unstable == ((factor > 1) == bound.upper), (what, bound.value)


def test_a_dead_band_hides_no_instability():
    """A loop that is linear about its set point is open there, and closed beyond the band."""
    law = "{{kind: admittance, damping: {damping}, dead_band: 1 N}}"
    assert [d.code for d in found(written(law, damping="60 N*s/m"))] == ["TS501"]


def test_bounds_of_servo_and_sensor_are_those_of_the_file_with_them():
    given = {"damping": "130 N*s/m", "filter": "60 Hz"}
    context = prepare(load_text(written(ADMITTANCE, **given), "t"))
    stage = analyse(compile_stage(StagePlan(context, "press")))
    limits = {limit.what: limit for limit in Search(context, stage).robot()}
    assert limits.keys() >= {BANDWIDTH, DELAY}
    for path, key, unit in ((BANDWIDTH, "bandwidth", "Hz"), (FILTER, "filter", "Hz")):
        if path in limits:
            bound = limits[path]
            for factor in (0.99, 1.01):
                text = written(ADMITTANCE, **(given | {key: f"{factor * bound.value} {unit}"}))
                assert grows(text) == ((factor > 1) == bound.upper), path
    ticks = round(limits[DELAY].value * 1e3)
    assert ticks >= 4
    assert not grows(written(ADMITTANCE, **(given | {"delay": f"{ticks} ms"})))
    assert grows(written(ADMITTANCE, **(given | {"delay": f"{ticks + 1} ms"})))


def test_a_designed_loop_is_far_from_its_boundary_and_goes_as_fast_in_the_air_as_is_said():
    """TS615 has the speed that the run comes to: f_d/D, without an integral not twice that."""
    text = written("admittance").replace(
        "  approach:", "  air: {axes: {z: {force: -15 N}}, time: 2 s}\n  approach:"
    )
    [speed] = [d for d in check_task(load_text(text, "t")) if d.code == "TS615"]
    damping = plan_task(load_text(text, "t")).stages["air"].gains["damping"]["z"].value
    said = float(re.search(r"up to ([\d.]+) mm/s", speed.message)[1])
    assert said == pytest.approx(1e3 * 15 / damping, rel=0.06)
    assert found(written("admittance")) == []


@pytest.mark.parametrize("kind", [kind for kind, law in LAWS.items() if law.commands == "torque"])
def test_the_law_that_is_named_instead_fits_the_arm(kind):
    text = written(kind)
    with pytest.raises(Exception, match="TS140") as caught:
        load_text(text, "t")
    [finding] = caught.value.diagnostics
    instead = re.match(r"law: ([a-z-]+);", finding.hint)[1]
    load_text(written(instead), "t")
