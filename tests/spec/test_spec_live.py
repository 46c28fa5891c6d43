"""Params that may be set while a stage runs: how they are declared, and where they may stand."""

from __future__ import annotations

import json

import jsonschema
import pytest
import yaml

from taskspec.examination import check_task
from taskspec.expression import FloatAlgebra
from taskspec.program.interval import Interval, IntervalAlgebra
from taskspec.schema import schema_text
from taskspec.spec import load_text
from taskspec.spec.params import FollowingParam, LiveParam, slots_of, with_values, worths
from taskspec.text.diagnostic import Diagnostic, SpecError
from taskspec.text.units import FORCE, LENGTH, STIFFNESS

TASK = """taskspec: 1
robot: {{model: panda, start: {{xyz: [500 mm, 0, 302 mm]}}}}
world: {{table: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m, friction: 0.2}}}}
params:
  press: {{value: 12 N, live: 5..20 N, rate: 10 N/s}}
  half: press / 2 + margin
  margin: 1 N
  {param}
stages:
  approach: {{axes: {{z: {{velocity: -20 mm/s}}}}, until: force.z < -half, within: {{time: 2 s}}}}
  press: {{axes: {{z: {{force: -press}}}}, time: 1 s}}
  {stage}
{more}
"""


def text(param: str = "", stage: str = "", more: str = "") -> str:
    return TASK.format(param=param, stage=stage, more=more)


def live(param: str) -> LiveParam:
    """The param `p` of a task that reads."""
    found = load_text(text(f"p: {param}"), "t").task.params["p"]
    assert isinstance(found, LiveParam)
    return found


def errors(written: str) -> list[tuple[str, int, int]]:
    """Code, line and column of what keeps a text from reading."""
    with pytest.raises(SpecError) as raised:
        load_text(written, "t")
    found = raised.value.diagnostics
    assert found
    return [(d.code, d.span.line, d.span.column) for d in found if d.span is not None]


@pytest.mark.parametrize(
    ("param", "value", "low", "high", "rate", "dimension"),
    [
        ("{value: 12 N, live: 5..20 N, rate: 10 N/s}", 12, 5, 20, 10, FORCE),
        ("{value: 12 N, live: [5 N, 0.02 kN]}", 12, 5, 20, 0, FORCE),
        ("{value: 12 N, live: +- 4 N}", 12, 8, 16, 0, FORCE),
        ("{value: 12 N, live: +- 25 %}", 12, 9, 15, 0, FORCE),
        ("{value: 800 N/m, live: 800 N/m +- 50 %}", 800, 400, 1200, 0, STIFFNESS),
        ("{value: 0, live: -20..20 mm, rate: 20 mm/s}", 0, -0.02, 0.02, 0.02, LENGTH),
        ("{value: 2 * margin, live: 0..margin * 3, rate: margin/(2 s)}", 2, 0, 3, 0.5, FORCE),
    ],
)
def test_a_live_param_has_value_interval_and_rate(param, value, low, high, rate, dimension):
    found = live(param)
    assert found.dimension == dimension
    assert found.live
    numbers = (found.value, found.low, found.high, found.rate)
    assert numbers == pytest.approx((value, low, high, rate), rel=1e-15)


def test_an_interval_that_is_a_point_is_not_said_to_end_before_it_begins():
    with pytest.raises(SpecError) as raised:
        load_text(text("p: {value: 12 N, live: 12 N..12 N}"), "t")
    assert [d.message for d in raised.value.diagnostics] == ["this interval has no width"]


def test_a_param_that_uses_a_live_one_follows_it():
    task = load_text(text(), "t").task
    half = task.params["half"]
    assert isinstance(half, FollowingParam)
    assert (half.value, half.live) == (7.0, True)
    assert list(task.live) == ["press"]
    assert slots_of(task.params, half.tree) == {"press"}
    assert not task.params["margin"].live
    found = worths(task.params, FloatAlgebra(), {"press": 20.0}.__getitem__)
    assert found["half"] == 11.0
    bounds = worths(task.params, IntervalAlgebra(), lambda _: Interval(5.0, 20.0))
    assert bounds["half"] == Interval(3.5, 11.0)
    other = with_values(task.params, {"press": 8.0})
    assert (other["press"].value, other["half"].value, other["margin"].value) == (8.0, 5.0, 1.0)


@pytest.mark.parametrize(
    ("param", "code", "column"),
    [
        ("{value: 3 N, live: 5..20 N}", "TS118", 14),
        ("{value: 3 N, live: 20..1 N}", "TS711", 25),
        ("{value: 3 N, live: 3..3 N}", "TS711", 25),
        ("{value: 3 N, live: 5 N}", "TS023", 25),
        ("{value: 3 N, live: [1 N, 2 N, 3 N]}", "TS023", 25),
        ("{value: 3 N, live: 1..5 mm}", "TS112", 25),
        ("{value: 3 N, live: 1..5 N, rate: 1 N}", "TS112", 39),
        ("{value: 3 N, live: 1..5 N, rate: 0}", "TS118", 39),
        ("{value: 3 N, live: 1..5 N, rate: -1 N/s}", "TS118", 39),
        ("{value: 3 N, live: 1..5 N, speed: 1 N/s}", "TS020", 33),
        ("{value: 3 N}", "TS021", 3),
        ("{live: 1..5 N}", "TS021", 3),
        ("{value: 3 N, live: 1 N..press}", "TS150", 30),
        ("{value: press, live: 1..30 N}", "TS150", 14),
        ("{value: 3 N, live: 1..5 N, rate: press/(1 s)}", "TS150", 39),
    ],
)
def test_a_slip_in_a_live_param_is_found_where_it_is(param, code, column):
    assert errors(text(f"p: {param}")) == [(code, 8, column)]


@pytest.mark.parametrize(
    "stage",
    [
        "other: {axes: {z: {move: 10 mm * press/(1 N), speed: 10 mm/s}}}",
        "other: {axes: {z: {force: -5 N, ramp: 1 s * press/(1 N)}}, time: 1 s}",
        "other: {axes: {z: {force: -5 N}}, time: press/(12 N) * 1 s}",
        "other: {axes: {z: {force: -5 N}}, time: 1 s, limits: {force: half}}",
        "other: {path: {to: [half/(1 kN/m), 0, 0], time: 3 s}}",
    ],
)
def test_what_is_settled_before_a_stage_runs_takes_no_live_param(stage):
    assert [code for code, line, _ in errors(text(stage=stage)) if line == 12] == ["TS150"]


@pytest.mark.parametrize(
    "more",
    [
        "truth: {world.table.friction: press/(60 N)}",
        "vary: {world.table.friction: 0..press/(60 N)}",
        "frames: {f: {parent: world, xyz: [half/(1 kN/m), 0, 0]}}",
        "sweep: {worlds: 10, expect: success >= press/(60 N)}",
        "limits: {force: 2 * press}",
    ],
)
def test_what_describes_the_world_takes_no_live_param(more):
    assert [code for code, *_ in errors(text(more=more))] == ["TS150"]


def test_equations_and_motions_of_the_world_take_no_live_param():
    bar = "[500 mm, 0, 250 mm]"
    moving = (
        f"  bar: {{shape: box, size: [10 mm, 10 mm, 10 mm], xyz: {bar},"
        " motion: {x: half/(1 kN/m) * sin(clock * 1 rad/s)}}\n"
    )
    round_ = "  round: {equation: x^2 + y^2 = (half/(1 kN/m))^2}\n"
    for each in (moving, round_):
        written = text().replace("world: {table", "world:\n  table", 1).replace("0.2}}", "0.2}", 1)
        written = written.replace("params:\n", each + "params:\n", 1)
        assert [code for code, *_ in errors(written)] == ["TS150"], each


def test_set_points_gains_speeds_and_conditions_take_live_params():
    stage = (
        "other: {law: {kind: impedance, stiffness: {x: press * 50 1/m}},"
        " axes: {x: {position: half/(1 kN/m)}, z: {force: -press}},"
        " until: force.z < -half for 10 ms, within: {time: 2 s}}\n"
        "  along: {path: {to: [20 mm, 0, 300 mm], speed: half/(1 kN*s/m)}, within: {time: 9 s}}"
    )
    task = load_text(text(stage=stage, more="expect: [max(norm(force)) < press + 15 N]"), "t").task
    assert task.varying_gains[:1] == (("stiffness", "x"),)
    assert task.stages["along"].path is not None
    assert task.stages["along"].path.slowed is not None


@pytest.mark.parametrize(
    ("key", "value", "found"),
    [
        ("press", "8 N", (8, 5, 20, 10)),
        ("params.press", "8 N", (8, 5, 20, 10)),
        ("params.press.value", "8 N", (8, 5, 20, 10)),
        ("press.rate", "1 N/s", (12, 5, 20, 1)),
        ("params.press.live", "10..15 N", (12, 10, 15, 10)),
        ("press", "{value: 3 N, live: 1..4 N}", (3, 1, 4, 0)),
    ],
)
def test_an_override_changes_a_live_param(key, value, found):
    param = load_text(text(), "t", {key: value}).task.live["press"]
    assert (param.value, param.low, param.high, param.rate) == found


def test_an_override_takes_the_place_of_a_plain_param():
    task = load_text(text(), "t", {"margin": "{value: 2 N, live: 1..3 N}"}).task
    assert list(task.live) == ["press", "margin"] or list(task.live) == ["margin", "press"]


def test_the_schema_takes_live_params():
    schema = json.loads(schema_text())
    data = yaml.safe_load(text("p: {value: 3 N, live: [1 N, 4 N], rate: 2 N/s}"))
    jsonschema.validate(data, schema)
    for slip in ({"value": "3 N"}, {"value": "3 N", "live": 3}, {"value": "3 N", "of": "1..2 N"}):
        data["params"]["p"] = slip
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(data, schema)


def found_at(limit: str) -> list[Diagnostic]:
    """What is said of the press under a limit of its force."""
    loaded = load_text(text(more=f"limits: {{force: {limit}}}"), "t")
    return [d for d in check_task(loaded) if d.code == "TS610"]


def test_the_rules_are_asked_about_both_ends():
    assert found_at("25 N") == []
    (at_the_end,) = found_at("18 N")
    assert at_the_end.message.startswith("at press = 20 N, which may be set, the limit on force")
    # As declared it is beyond, too: that is said once.
    (declared,) = found_at("10 N")
    assert declared.message.startswith("the limit on force")
