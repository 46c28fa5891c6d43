"""What `explain` says of the poles and bounds of a stage."""

from __future__ import annotations

import pytest

from taskspec.compiler import compile_unchecked
from taskspec.spec import load_text
from taskspec_runner.cli.sheet.stability import stability_sheet

PRESS = """
taskspec: 1
name: press
robot: {{model: panda, start: {{xyz: [500 mm, 0, 300 mm]}}}}
world: {{table: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: {k}, damping: 0}}}}
law: {law}
control: {{rate: 1 kHz, plant_rate: {plant} kHz}}
stages:
  press: {{axes: {{z: {{force: -15 N}}}}, time: 1 s}}
"""
PARALLEL = (
    "{kind: parallel, mass: 1 kg, stiffness: 400 N/m, damping: 40 N*s/m, "
    "force: {proportional: 0.5, integral: 10 /s}}"
)


def account(law, k="10 kN/m", plant=1):
    program = compile_unchecked(load_text(PRESS.format(law=law, k=k, plant=plant), "press.yaml"))
    return stability_sheet(program, program.stages[0].name)


def bounds(found, what):
    return {b.source: b.bound for b in found.bounds if b.what == what}


def test_the_textbook_stands_beside_the_sampled_stage():
    """(4.46): 40 (400 + 0.5 10e3) / (1 10e3) = 21.6 1/s; sampled, it is less."""
    found = bounds(account(PARALLEL), "force.integral on z")
    assert found["this stage as it is sampled"] == "< 20.63 1/s"
    assert found["(4.46): d_m (k_m + k_F k_e) > h_m k_I k_e"] == "< 21.6 1/s"


def test_poles_name_their_axes():
    found = account(PARALLEL)
    ringing = next(p for p in found.poles if p.axis == "z")
    assert ringing.frequency.endswith("Hz")
    assert any(p.axis == "null space" for p in found.poles)
    assert "15 N on table" in found.where


def test_an_unstable_stage_is_called_so():
    found = account(PARALLEL.replace("10 /s", "30 /s"))
    assert found.poles[0].verdict == "unstable"
    assert any("not kept" in b.source for b in found.bounds)


def test_the_regulator_has_two_conditions():
    law = "{kind: parallel-pid, force: {proportional: 0.5, integral: 2 /s}}"
    sources = set(bounds(account(law), "force.integral on z"))
    assert any(s.startswith("(4.70), (4.71)") for s in sources)
    assert any(s.startswith("(4.61)") for s in sources)


@pytest.mark.parametrize(
    ("law", "equation", "what", "bound"),
    [
        ("{kind: hybrid, force: {proportional: 0.2, integral: 10 /s}}", "(4.123), rigid",
         "force.proportional on z", "< 1"),
        ("{kind: hybrid, force: {proportional: 0.2, integral: 10 /s}}", "(4.123), rigid",
         "force.integral on z", "< 1600 1/s"),
        ("hybrid-reaction", "(4.118)-(4.122), rigid", "force.proportional on z", "< 1"),
    ],
)  # fmt: skip
def test_on_a_rigid_contact_one_tick_decides(law, equation, what, bound):
    found = bounds(account(law, k="rigid", plant=20), what)
    assert {s.partition(":")[0]: b for s, b in found.items()}[equation] == bound


def test_a_stage_in_free_space_has_no_table():
    text = (
        "taskspec: 1\nname: free\nrobot: {model: panda}\nstages: {go: {axes: {z: {move: 10 mm}}}}\n"
    )
    program = compile_unchecked(load_text(text, "free.yaml"))
    assert stability_sheet(program, program.stages[0].name) is None


def test_bounds_of_motion_loops_are_told_where_they_are_near():
    """132 Hz bounds the motion loop (docs/laws/hybrid.md): 80 Hz is near it, 5 Hz is not."""
    near = account("{kind: hybrid, bandwidth: 80 Hz}")
    assert list(bounds(near, "bandwidth on x y").values()) == ["< 131.8 Hz"]
    assert not bounds(near, "damping_ratio on rx ry rz")
    far = account("hybrid")
    assert not [b for b in far.bounds if b.what.startswith(("bandwidth", "damping_ratio"))]


def test_a_free_stage_near_a_bound_has_a_table():
    text = (
        "taskspec: 1\nname: free\nrobot: {model: panda}\nlaw: {kind: hybrid, bandwidth: 200 Hz}\n"
        "stages: {go: {axes: {z: {move: 10 mm}}}}\n"
    )
    program = compile_unchecked(load_text(text, "free.yaml"))
    found = stability_sheet(program, program.stages[0].name)
    assert found.where == "nothing touched, at the start pose"
    assert list(bounds(found, "bandwidth on x y z").values()) == ["< 131.8 Hz"]
