"""Forces at rest in closed form, held against runs."""

from __future__ import annotations

import pytest

from taskspec.compiler import compile_unchecked
from taskspec.explain import rest_values
from taskspec.spec import load_text

PRESS = """
taskspec: 1
name: press
robot: {model: panda, start: {xyz: [500 mm, 0, HEIGHT]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], rpy: [0, TILT, 0], stiffness: STIFF}}
frames: {task: {surface: table}, level: {rpy: [0, 0, 0]}}
frame: FRAME
law: LAW
stages:
  press: {axes: {AXES}, time: TIME}
"""
GOOD = {
    "HEIGHT": "301 mm",
    "TILT": "0",
    "STIFF": "10 kN/m",
    "FRAME": "task",
    "LAW": "hybrid",
    "AXES": "z: {force: -20 N}",
    "TIME": "3 s",
}
#: Contact stiffness is that of the file to 0.1 % (docs/conventions.md).
_CONTACT = 1e-3


def text(**changes):
    filled = PRESS
    for key, value in (GOOD | changes).items():
        filled = filled.replace(key, value)
    return filled


def closed(task):
    """The closed forms of the stage `press`."""
    program = compile_unchecked(load_text(task, "t.yaml"))
    return rest_values(program, program.stages[0])


def of_run(run, stage):
    """The closed forms of a stage of a program that ran."""
    return rest_values(run.program, next(s for s in run.program.stages if s.name == stage))


#: What loops and springs of 1 Hz and more have not settled after 3 s, and what they have after 2 s
#: that began with more than their own, as a share.
_LEFT = 2e-3


DEEP = "z: {position: -12 mm}"
SPRINGS = "stiffness: 2 kN/m"


@pytest.mark.parametrize(
    "changes",
    [
        {"LAW": "hybrid"},
        {"LAW": "parallel"},
        {"LAW": "parallel-pid"},
        {"LAW": "hybrid-multipliers"},
        {"LAW": "hybrid-reaction"},
        {"LAW": f"{{kind: impedance, {SPRINGS}}}", "AXES": DEEP},
        {"LAW": f"{{kind: impedance-natural, {SPRINGS}}}", "AXES": DEEP},
        {"LAW": f"{{kind: pd, {SPRINGS}, damping: 150 N*s/m}}", "AXES": DEEP},
        {"LAW": f"{{kind: pd-joint, {SPRINGS}}}", "AXES": DEEP},
        # The reference where the nominal stiffness makes -20 N of it.
        {"LAW": f"{{kind: impedance, {SPRINGS}}}"},
        # In a frame that the plane is askew in, the spring of x takes part.
        {"LAW": f"{{kind: impedance, {SPRINGS}}}", "FRAME": "level", "TILT": "10 deg",
         "AXES": "z: {position: 205 mm}", "HEIGHT": "215 mm"},
        {"LAW": "hybrid", "FRAME": "level", "TILT": "10 deg", "HEIGHT": "213 mm"},
    ],
)  # fmt: skip
def test_forces_at_rest(simulate, changes):
    run = simulate(text(**changes))
    force = of_run(run, "press")["force.z"]
    assert run["force.z"][-1] == pytest.approx(force.value, rel=_CONTACT + _LEFT)


@pytest.mark.xdist_group("shipped")
def test_two_contacts_bear_their_own(simulate):
    """The lines and the bound are those of the press; the wall adds no more than its own lag."""
    run = simulate("corner")
    found = of_run(run, "press")
    for signal in ("force.z", "force.x"):
        force = run.during("press", signal)[-1]
        assert force == pytest.approx(found[signal].value, rel=_CONTACT + _LEFT)


def test_what_nothing_returns_is_not_applied(simulate):
    """(4.47)-(4.48): f_E = a a^T f_d."""
    run = simulate("tilted-force")
    found = of_run(run, "press")
    assert found["force.z"].source == "(4.48)"
    for axis in ("x", "z"):
        said = found[f"force.{axis}"].value
        assert run[f"force.{axis}"][-1] == pytest.approx(said, rel=_CONTACT + _LEFT)


def test_a_parallel_set_point_that_moves_along_the_normal_is_off():
    """a.(f - f_d) = -(k_m / k_I) a.x'_d: 20 mm/s at 1 kN/m and 4 1/s add 5 N."""
    law = "{kind: parallel, stiffness: 1 kN/m, force: {integral: 4 /s}}"
    found = closed(text(LAW=law, AXES="z: {velocity: -20 mm/s, force: -10 N}"))
    assert found["force.z"].value == pytest.approx(-15.0)


def test_limits_take_from_a_set_point(simulate):
    """The force at which a joint's torque limit holds: to what the posture moves until then."""
    run = simulate("press-saturated")
    force = of_run(run, "press")["force.z"].value
    assert abs(force) < 200
    # 14 mm deep the arm stands otherwise than at the start: 0.2 % of its levers.
    assert run.during("press", "force.z")[-1] == pytest.approx(force, rel=2e-3)


@pytest.mark.parametrize(
    ("task", "stage", "signal"),
    [("crank", "rotate", "crank.torque"), ("door-handle", "open", "door.torque"),
     ("valve", "close", "valve.torque"), ("ring", "round", "rim.force"),
     ("linkage", "load", "bars.torque")],
)  # fmt: skip
def test_mechanisms_and_equations(simulate, task, stage, signal):
    """Within what shipped tasks promise of themselves: 1 % of the rate, 0.1 % of the contact."""
    run = simulate(task)
    said = of_run(run, stage)[signal].value
    assert run.during(stage, signal)[-1] == pytest.approx(said, rel=0.01)


HEAVING = ", motion: {z: 2 mm * sin(2*pi*clock/(1 s))}}}"
PASSING = ", motion: {x: 2 mm * sin(2*pi*clock/(1 s))}}}"
RUBS = ", friction: 0.3}}"
FLAT = "tool: {shape: cylinder, radius: 20 mm, length: 100 mm}, start:"


def test_what_moves_has_no_value_at_rest():
    swings = "z: {force: -(10 N + 3 N * sin(2*pi*t/(1 s)))}"
    assert not closed(text(AXES=swings))
    assert not closed(text(AXES="z: {force: -10 N - 100 N/m * position.x}"))
    # A surface that comes and goes below a fixed frame; one that a frame follows, and one that
    # slides along itself, stay.
    assert not closed(text(FRAME="level").replace("kN/m}}", f"kN/m{HEAVING}"))
    assert closed(text().replace("kN/m}}", f"kN/m{HEAVING}"))["force.z"].value == -20.0
    assert closed(text(FRAME="level").replace("kN/m}}", f"kN/m{PASSING}"))["force.z"].value == -20.0


@pytest.mark.parametrize("law", ["hybrid-reaction", "hybrid"])
def test_without_an_integral_friction_decides_too(law):
    found = closed(text(LAW=law).replace("kN/m}}", f"kN/m{RUBS}"))
    assert ("force.z" in found) is (law == "hybrid")


@pytest.mark.parametrize(("tilt", "rests"), [("0", True), ("5 deg", False)])
def test_springs_below_an_edge_have_no_closed_form(tilt, rests):
    task = text(LAW=f"{{kind: impedance, {SPRINGS}}}", TILT=tilt, FRAME="level", HEIGHT="306 mm",
                AXES="z: {position: 290 mm}")  # fmt: skip
    assert ("force.z" in closed(task.replace("start:", FLAT))) is rests


def test_an_arm_that_falls_rests_on_nothing():
    assert "force.z" not in closed(text(LAW=f"{{kind: stiffness, {SPRINGS}}}"))


def test_a_stage_in_the_air_rests_on_nothing():
    assert not closed(text(AXES="z: {move: 10 mm}"))


@pytest.mark.parametrize(
    "changes",
    [
        {"LAW": "{kind: parallel, force: {integral: 0}}"},
        {"LAW": "{kind: parallel, force: {integral: 0}}",
         "AXES": "x: {force: 1 N}, z: {velocity: -5 mm/s, force: -20 N}"},
        {"LAW": "{kind: impedance, stiffness: 0}", "AXES": DEEP},
        {"AXES": "z: {force: -10 N * position.z / (1 mm)}"},
    ],
)  # fmt: skip
def test_what_no_spring_or_integral_decides_is_left_open(changes):
    """(4.39) without K_I, (4.15) without K_m: where the arm stops is not told by the law alone."""
    assert "force.z" not in closed(text(**changes))
