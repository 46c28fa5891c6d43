"""Gains of a task that move, what a file says of them, and the intervals that they are held in."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from taskspec.compiler import compile_unchecked
from taskspec.program.program import Program
from taskspec.program.worlds import corner_count, corner_world, draws_of, random_world
from taskspec.spec import load_text
from taskspec.spec.patch import patched
from taskspec_runner.tune.gains import Knob, knobs_of, overrides
from taskspec_runner.tune.intervals import (
    STIFFNESS_MARGIN,
    intervals,
    narrowed,
    with_margin,
)
from tune.tasks import PRESS


def program(text: str = PRESS, sets: Mapping[str, str] | None = None) -> Program:
    return compile_unchecked(load_text(text, "press.yaml", dict(sets or {})))


def knob(found: list[Knob], stage: str, key: str) -> int:
    [at] = [i for i, each in enumerate(found) if stage in each.stages and each.key == key]
    return at


LAWS = {
    "hybrid": {"bandwidth", "damping_ratio", "force.integral", "force.damping"},
    "parallel": {"mass", "stiffness", "damping", "force.proportional", "force.integral"},
    "impedance": {"mass", "stiffness", "damping"},
    "pd-joint": {"stiffness", "damping"},
}
SERVED = {
    "admittance": {"bandwidth", "mass", "damping"},
    "force-velocity": {"bandwidth", "force.proportional", "force.integral", "force.damping"},
    "hybrid-velocity": {"bandwidth", "force.proportional", "force.integral", "force.damping"},
}


@pytest.mark.parametrize("law", [*LAWS, *SERVED])
def test_a_setting_in_the_file_gives_the_gains_that_were_meant(law: str) -> None:
    """Written as overrides and as a patched text, of every kind of law, three digits exact."""
    sets = {"law": law} | ({"robot.command": "velocity"} if law in SERVED else {})
    own = program(sets=sets)
    knobs = knobs_of(own)
    keys = {each.key for each in knobs if "press" in each.stages}
    assert keys == (LAWS | SERVED)[law]
    setting = tuple(each.times(None, 1.5) if "press" in each.stages else None for each in knobs)
    given = overrides(own, knobs, setting)
    assert given
    for changed in (
        program(sets=sets | given),
        program(patched(PRESS, sets | given)),
    ):
        gains = next(s.plan.gains for s in changed.stages if s.name == "press")
        for each, values in zip(knobs, setting, strict=True):
            for on, value in (values or {}).items():
                assert gains[each.gain.name][on].value == pytest.approx(value, rel=6e-3)
                assert gains[each.gain.name][on].origin == "file"


def test_pressing_and_moving_axes_have_knobs_of_their_own() -> None:
    found = knobs_of(program(sets={"law": "impedance"}))
    axes = [set(each.values) for each in found if "press" in each.stages and each.key == "damping"]
    assert {"z"} in axes
    assert {"x", "y", "rx", "ry", "rz"} in axes


def test_gains_of_the_file_that_do_not_move_stay_beside_those_that_do() -> None:
    text = PRESS.replace("law: hybrid", "law: {kind: hybrid, bandwidth: {x: 7 Hz, y: 3 Hz}}")
    own = program(text)
    knobs = knobs_of(own, ["force.integral"])
    assert [each.key for each in knobs] == ["force.integral"]
    changed = program(text, overrides(own, knobs, (knobs[0].times(None, 0.5),)))
    before, after = (
        next(s.plan.gains for s in each.stages if s.name == "press") for each in (own, changed)
    )
    assert after["bandwidth"]["x"].value == before["bandwidth"]["x"].value == 7.0
    integral = before["force.integral"]["z"].value
    assert after["force.integral"]["z"].value == pytest.approx(integral / 2, rel=5e-3)


def test_a_gain_that_varies_and_a_dead_band_are_none_that_move() -> None:
    text = PRESS.replace(
        "law: hybrid", "law: {kind: impedance, damping: {z: 300 N*s/m*(1 + t/(1 s))}}"
    )
    assert "damping" not in {e.key for e in knobs_of(program(text)) if "press" in e.stages}
    served = {"robot.command": "velocity", "law": "{kind: admittance, dead_band: 1 N}"}
    keys = {each.key for each in knobs_of(program(sets=served))}
    assert keys
    assert "dead_band" not in keys


def test_narrowed_ends_are_those_of_corners_and_random_worlds() -> None:
    own = program()
    stiffness, height = intervals(own.context)
    assert stiffness.name == "world.table.stiffness"
    assert stiffness.anchor == 20e3
    assert height.name == "world.table.xyz.z"
    assert height.anchor == 0.0
    assert height.text((-1e-3, 2e-3)) == "299 mm..302 mm"
    inner = narrowed(
        own.context.loaded,
        {stiffness.draw.name: (15e3, 30e3), height.draw.name: (-0.5e-3, 0.0)},
    )
    context = compile_unchecked(inner).context
    assert len(draws_of(context)) == 2
    worlds = [corner_world(context, i) for i in range(corner_count(context))]
    values = {tuple(world.values.values()) for world in worlds}
    assert values == {(k, z) for k in (15e3, 30e3) for z in (0.2995, 0.3)}
    for number in range(20):
        drawn = random_world(context, 3, number).values
        assert 15e3 <= drawn["world.table.stiffness", None] <= 30e3
        assert 0.2995 <= drawn["world.table.xyz", 2] <= 0.3


def test_loops_are_held_against_contacts_a_quarter_beyond_the_ends() -> None:
    """Those that do not vary get that margin about their one stiffness."""
    own = program()
    wide = with_margin(own.context.loaded, own.context).task.vary["world.table.stiffness"]
    assert wide[0] is not None
    assert (wide[0].low, wide[0].high) == (8e3 / STIFFNESS_MARGIN, 60e3 * STIFFNESS_MARGIN)
    fixed = program(PRESS.replace("  world.table.stiffness: 8..60 kN/m\n", ""))
    wide = with_margin(fixed.context.loaded, fixed.context).task.vary["world.table.stiffness"]
    assert wide[0] is not None
    assert (wide[0].low, wide[0].high) == (20e3 / STIFFNESS_MARGIN, 20e3 * STIFFNESS_MARGIN)
