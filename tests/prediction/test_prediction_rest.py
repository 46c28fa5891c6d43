"""Predicted forces and depths at rest, held against runs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.prediction import predict
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


def predicted(task):
    return predict(compile_unchecked(load_text(task, "t.yaml")))["press"]


def predicted_and_run(simulate, task):
    """What is predicted of a task, and its run: it is compiled once for both."""
    run = simulate(task)
    return predict(run.program)["press"], run


def left_over(stage, lasts):
    """Share of what its slowest axis begins with that is left after a stage, ramp and blend aside.

    Twice: axes that depend on each other begin with more than their own.
    """
    slowest = max(s.time_constant for axis, s in stage.settling.items() if axis != "null space")
    return 2 * math.exp(-(lasts - 0.4) / slowest)


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
def test_forces_and_depth_at_rest(simulate, changes):
    task = text(**changes)
    stage, run = predicted_and_run(simulate, task)
    force, depth = stage.equilibrium["force.z"], stage.depths["table"]
    assert force.steady
    within = (_CONTACT + left_over(stage, 3.0)) * abs(force.value)
    assert run["force.z"][-1] == pytest.approx(force.value, abs=within)
    deep = (_CONTACT + left_over(stage, 3.0)) * depth.depth
    assert -run["table.gap"][-1] == pytest.approx(depth.depth, abs=deep)


@pytest.mark.xdist_group("shipped")
def test_two_contacts_bear_their_own(simulate):
    """The lines and the bound are those of the press; the wall adds no more than its own lag."""
    run = simulate("corner")
    stage = predict(run.program)["press"]
    for signal, name in (("force.z", "floor"), ("force.x", "wall")):
        within = _CONTACT + left_over(stage, 2.0)
        force, depth = stage.equilibrium[signal].value, stage.depths[name].depth
        assert run.during("press", signal)[-1] == pytest.approx(force, rel=within)
        assert -run.during("press", f"{name}.gap")[-1] == pytest.approx(depth, rel=within)


def test_what_nothing_returns_drives_the_tool_along(simulate):
    """(4.47)-(4.49): f_E = a a^T f_d, and a drift of (k_I / k_m) |(I - a a^T) f_d|."""
    run = simulate("tilted-force")
    stage = predict(run.program)["press"]
    within = _CONTACT + left_over(stage, 4.0)
    for axis in ("x", "z"):
        said = stage.equilibrium[f"force.{axis}"].value
        assert run[f"force.{axis}"][-1] == pytest.approx(said, rel=within)
    assert run["speed"][-1] == pytest.approx(stage.drift, rel=within)
    assert stage.drift == pytest.approx(6 / 1000 * math.sin(math.radians(10)) * 20)


def test_a_parallel_set_point_that_moves_along_the_normal_is_off():
    """a.(f - f_d) = -(k_m / k_I) a.x'_d: 20 mm/s at 1 kN/m and 4 1/s add 5 N."""
    law = "{kind: parallel, stiffness: 1 kN/m, force: {integral: 4 /s}}"
    stage = predicted(text(LAW=law, AXES="z: {velocity: -20 mm/s, force: -10 N}"))
    assert stage.equilibrium["force.z"].value == pytest.approx(-15.0)


def test_limits_take_from_a_set_point(simulate):
    """The force at which a joint's torque limit holds: to what the posture moves until then."""
    run = simulate("press-saturated")
    stage = predict(run.program)["press"]
    force = stage.equilibrium["force.z"].value
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
    said = predict(run.program, {})[stage].equilibrium[signal].value
    assert run.during(stage, signal)[-1] == pytest.approx(said, rel=0.01)


def test_a_set_point_that_moves_says_between_what():
    stage = predicted(text(AXES="z: {force: -(10 N + 3 N * sin(2*pi*t/(1 s)))}"))
    force = stage.equilibrium["force.z"]
    assert not force.steady
    # Looked at 199 times in three periods: 1 - cos(pi 3/199) of the amplitude is missed at most.
    assert (force.low, force.high) == pytest.approx((-13.0, -7.0), abs=3 * 1.2e-3)


def test_a_set_point_by_signals_is_left_open():
    stage = predicted(text(AXES="z: {force: -10 N - 100 N/m * position.x}"))
    assert "force.z" not in stage.equilibrium


def test_the_worst_surface_is_named(simulate):
    """The spring's force on the stiffest, lowest or highest table; the run is on that table."""
    law = f"{{kind: pd, {SPRINGS}, damping: 150 N*s/m}}"
    vary = "vary: {world.table.stiffness: 5..20 kN/m}\n"
    task = text(LAW=law, AXES=DEEP) + vary
    stage = predicted(task)
    force, depth = stage.equilibrium["force.z"], stage.depths["table"]
    assert force.worst.values == {("world.table.stiffness", None): 5e3}
    assert depth.worst.values == {("world.table.stiffness", None): 5e3}
    run = simulate(task, {"world.table.stiffness": "5 kN/m"})
    assert run["force.z"][-1] == pytest.approx(force.worst.value, rel=_CONTACT)
    assert -run["table.gap"][-1] == pytest.approx(depth.worst.value, rel=_CONTACT)


def test_what_makes_no_difference_is_not_named():
    vary = "vary: {world.table.stiffness: 5..20 kN/m, world.table.xyz: [+- 5 mm, 0, +- 2 mm]}\n"
    law = f"{{kind: pd, {SPRINGS}, damping: 150 N*s/m}}"
    force = predicted(text(LAW=law, AXES=DEEP) + vary).equilibrium["force.z"]
    # 14 mm deep on 20 kN/m: 14 mm / (1/2 + 1/20) mm/N = 25.5 N; 10 mm on 5 kN/m: 14.3 N.
    assert force.worst.value == pytest.approx(-0.010 / (1 / 2e3 + 1 / 5e3))
    assert set(force.worst.values) == {("world.table.stiffness", None), ("world.table.xyz", 2)}


def test_a_loop_reaches_its_set_point_on_every_surface():
    task = text() + "vary: {world.table.stiffness: 5..20 kN/m}\n"
    stage = predicted(task)
    assert stage.equilibrium["force.z"].worst is None
    assert stage.depths["table"].worst.value == pytest.approx(20 / 5e3)


def test_a_stage_in_the_air_rests_on_nothing():
    stage = predicted(text(AXES="z: {move: 10 mm}"))
    assert not stage.equilibrium
    assert not stage.depths
    assert np.isfinite([s.time_constant for s in stage.settling.values()]).all()


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
    stage = predicted(text(**changes))
    assert "force.z" not in stage.equilibrium
    assert "table" not in stage.depths
