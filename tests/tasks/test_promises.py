"""What a run is held to: the chapter's equilibria and the accuracy that good tuning reaches."""

from __future__ import annotations

import numpy as np
import pytest

from measures import rms


@pytest.mark.parametrize("task", ["press-hybrid", "press-parallel"])
def test_force_and_motion_while_sliding(simulate, task):
    """20 N on 10 kN/m at 1 kHz while sliding 50 mm at 0.5 Hz: 2 mN RMS, 50 um RMS (design 6)."""
    run = simulate(task)
    force = run.during("slide", "force.z", 3.0) + 20.0
    assert rms(force) < 2e-3
    assert rms(run.during("slide", "error.x", 3.0)) < 50e-6
    assert np.ptp(run.during("slide", "position.x")) == pytest.approx(0.1, abs=2e-4)


def test_what_a_rising_force_does_across_itself(simulate):
    """A measured force is cancelled a tick late, so its rise shakes the axes that inertia couples.

    A = J H^-1 J^T couples x to z: h x'' + d x' + k x = h A_xz T f'. That is 0.27 mm of the 0.31 mm
    that press-parallel comes to on the ur5e, and why it expects 0.35 mm there: 0.26 mm by this
    equation, 5 % less than the run, whose inertia changes as it goes on. The rest is motion.
    """
    still = simulate("press-parallel", {"robot.model": "ur5e", "stages.slide.axes.x": "hold"})
    stage = still.program.stages[1].plan
    A = stage.context.start_jacobian @ np.linalg.solve(
        stage.context.start_inertia, stage.context.start_jacobian.T
    )
    h, d, k = (stage.gains[name]["x"].value for name in ("mass", "damping", "stiffness"))
    T, force = stage.context.period, still.during("slide", "force.z")
    x = v = 0.0
    late = []
    for push in A[0, 2] * np.diff(force):
        v += T * (push - (d * v + k * x) / h)
        x += T * v
        late.append(x)
    error = still.during("slide", "error.x")
    assert np.abs(error).max() == pytest.approx(np.abs(late).max(), rel=0.1)
    assert error[np.abs(error).argmax()] * late[int(np.abs(late).argmax())] > 0
    both = simulate("press-parallel", {"robot.model": "ur5e"}).during("slide", "error.x")
    assert np.abs(both).max() < np.abs(late).max() * 1.1 + 50e-6


def test_pd_press_settles_at_the_equilibrium(simulate):
    """(4.26), (4.27): two springs in series, to 1e-5; the rest is settling, 1e-9 after 5 s."""
    run = simulate("press-pd", {"stages.press.time": "6 s"})
    k_m, k_e, depth = 2000.0, 10_000.0, 0.012
    f_E = k_m * k_e / (k_m + k_e) * depth
    assert -run["force.z"][-1] == pytest.approx(f_E, rel=1e-7)
    assert -run["gap"][-1] == pytest.approx(f_E / k_e, rel=1e-7)


def test_impedance_press_settles_where_two_springs_do(simulate):
    run = simulate("press-impedance", {"stages.press.axes.x": "hold"})
    # (4.15): K_m (x - x_d) = f; force feedback is exact at rest.
    assert run["force.z"][-1] == pytest.approx(-20.0, rel=1e-6)


@pytest.mark.parametrize("stiffness", ["5 kN/m", "20 kN/m", "200 kN/m"])
@pytest.mark.parametrize("law", ["hybrid", "parallel"])
def test_designed_gains_wipe_on_any_table(simulate, stiffness, law):
    run = simulate("wipe-table", {"world.table.stiffness": stiffness, "law": law})
    assert run.outcome.status == "done"
    assert rms(run.during("wipe", "force.z", 2.0) + 15.0) < 0.1


@pytest.mark.parametrize(("law", "d", "integral"), [(None, 200.0, 15.0), ("hybrid", 544.0, 4.6)])
@pytest.mark.parametrize(("axis", "size", "rate"), [(0, 0.03, np.pi), (1, 0.06, np.pi / 2)])
def test_a_table_that_tilts_rises_under_the_tool(simulate, law, d, integral, axis, size, rate):
    """A force loop misses its set point by d s / (s + k_I) of the speed at which the table rises.

    Along the tilt the tool goes to and fro by `size`, so that speed is size rate tan(2 deg). The
    equation leaves out h s^2 + d s beside the contact's stiffness: up to 9 % of it at 544 N s/m,
    mostly across its phase; the run has 4 % more.
    """
    tilt = "[2 deg, 0, 0]" if axis == 0 else "[0, 2 deg, 0]"
    given = {"truth.world.table.rpy": tilt} | ({} if law is None else {"law": law})
    run = simulate("wipe-table", given)
    error = run.during("wipe", "force.z", 4.0) + 15.0
    time = run.program.context.period * np.arange(len(error))
    found = 2 * abs(np.mean(error * np.exp(-1j * rate * time)))
    rises = size * rate * np.tan(np.deg2rad(2.0))
    assert found == pytest.approx(d * rises * rate / np.hypot(rate, integral), rel=0.05)


@pytest.mark.parametrize("stiffness", ["5 kN/m", "80 kN/m"])
def test_the_table_is_wiped_where_it_tilts_most(simulate, stiffness):
    """At the ends of both angles; there designed gains ring, or lag, out of the band."""
    truth = {"truth.world.table.rpy": "[3 deg, 3 deg, 0]", "truth.world.table.stiffness": stiffness}
    for law, enough in ((None, True), ("hybrid", False)):
        run = simulate("wipe-table", truth | ({} if law is None else {"law": law}))
        assert run.outcome.status == "done"
        force = run.during("wipe", "force.z") + 15.0
        assert bool(np.mean(np.abs(force) < 0.5) >= 0.93) is enough


def test_the_drum_turns_frame_and_tool(simulate):
    run = simulate("polish-drum")
    force = run.during("polish", "force.z", 1.0) + 15.0
    assert rms(force) < 0.03 * 15
    reached = run.during("polish", "position.y")
    turned = np.rad2deg(reached / 0.2)
    assert turned.max() > 25
    assert turned.min() < -25
    # The tool's axis stays on the normal although the normal turns.
    assert np.max(np.abs(np.pi - run.during("polish", "tilt", 1.0) - np.pi)) < 1e-2


@pytest.mark.parametrize("law", ["impedance", "impedance-natural", "pd"])
def test_an_open_loop_force_is_reached_on_the_nominal_surface(simulate, law):
    """f (1/k_m + 1/k_e) below the surface gives f where the belief is true."""
    run = simulate(
        "wipe-table",
        {"law": law, "stages.wipe.axes.x": "hold", "stages.wipe.axes.y": "hold"},
    )
    assert run["force.z"][run.history.window("wipe")][-1] == pytest.approx(-15.0, rel=1e-3)


LAWS = ("hybrid", "parallel", "parallel-pid", "impedance", "impedance-natural", "pd")
#: Laws that damp x' where the others damp e': they lag behind what moves.
LAGGING = {"pd", "parallel-pid"}
PRESS_AND_GO = """
taskspec: 1
name: press-and-go
robot: {model: panda, start: {xyz: [500 mm, 0, 301 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 10 kN/m}}
frames: {task: {surface: table}}
frame: task
stages:
  press: {axes: {z: {force: -20 N}}, time: 1.2 s, law: FIRST}
  slide: {axes: {x: {velocity: 30 mm/s}, z: {force: -20 N}}, time: 0.5 s, law: SECOND}
  lift: {axes: {z: {move: 20 mm}}, law: FIRST}
"""


@pytest.mark.parametrize("first", LAWS)
@pytest.mark.parametrize("second", LAWS)
def test_a_stage_begins_without_a_bump(simulate, first, second):
    """From pressing into sliding into lifting, under any two laws, the torque does not jump.

    20 N at half a metre make 10 N m; what is left is a thousandth. From rest
    only where one of two laws lags behind what moves.
    """
    run = simulate(PRESS_AND_GO.replace("FIRST", first).replace("SECOND", second))
    moving = first == second or not {first, second} & LAGGING
    for stage in ("slide", "lift") if moving else ("slide",):
        begin = int(np.argmax(run.history.window(stage)))
        for i in range(7):
            torque = run[f"joint.{i + 1}.torque"]
            assert abs(torque[begin] - torque[begin - 1]) < 0.01, (stage, i)
    assert np.min(run["force.z"]) > -30
    assert run["gap"][-1] > 0.015
