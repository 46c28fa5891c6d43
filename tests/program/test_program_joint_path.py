"""Stages with a path of joints: followed, handed over, guarded, and predicted."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from taskspec.compiler import compile_task
from taskspec.examination import check_task
from taskspec.laws.computed_torque import BANDWIDTH
from taskspec.planning import plan_task
from taskspec.program.drives import TORQUE_FADING as FADING
from taskspec.program.walk.joint_walk import joint_states, torques
from taskspec.robot.poses import mirrored
from taskspec.spec import load_text
from taskspec_runner import run
from taskspec_runner.loop import fixed_step
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.record.log import Log

#: The elbow is stretched on the way: J loses rank there.
TASK = """\
taskspec: 1
name: fold
robot:
  model: planar2
  start: {joints: [40 deg, 60 deg]}
law: hybrid
stages:
  fold: {path: {joints: [-20 deg, -50 deg], speed: 60 deg/s}}
  hold: {axes: {x: {move: 20 mm}}}
"""
FOLD = TASK.removesuffix("  hold: {axes: {x: {move: 20 mm}}}\n")
PANDA = """\
taskspec: 1
name: unfold
robot:
  model: panda
  tool: {shape: sphere, radius: 10 mm, length: 100 mm, mass: 300 g}
  start: {joints: [0, -1.2 rad, 0, -2.8 rad, 0, 1.6 rad, 0.7854 rad]}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 10 kN/m, damping: 30 N*s/m}}
frames: {task: {surface: table}}
frame: task
law: hybrid
stages:
  unfold: {path: {joints: [0, 0 deg, 0, -120 deg, 0, 120 deg, 45 deg], speed: 30 deg/s}}
  approach: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -2 N for 10 ms, within: 10 s}
  press: {axes: {z: {force: -20 N}}, time: 1 s}
"""


def ticks(result, visit):
    """The rows of a visit, as a slice."""
    rows = np.flatnonzero(result.rows(result.visits[visit]))
    return slice(int(rows[0]), int(rows[-1]) + 1)


def columns(result, name, of):
    return np.array([result.column(f"joint.{i + 1}.{name}") for i in range(of)]).T


def test_the_joints_follow_through_a_singularity():
    """The arm of the model is the plant's: what is left is that both go in steps.

    A torque that is held for the period T is T/2 late, which is an acceleration of H^-1 u' T/2.
    MuJoCo's semi-implicit steps h have q' = v + q'' h/2, which K_D takes for an error of the rate.
    Both together, of e'' + K_D e' + K_P e = 0, critically damped, that does not overshoot:
    |e| < (|H^-1 u'| T/2 + K_D |q''| h/2) / K_P.
    """
    loaded = load_text(TASK, "task.yaml")
    result = run(loaded)
    assert result.summary["status"] == "done", result.reason
    w = 2 * np.pi * BANDWIDTH
    period, step = 1 / loaded.task.control.rate, 1 / loaded.task.control.plant_rate
    program = compile_task(loaded)
    robot = program.context.robot
    states = joint_states(program.stages[0].plan.joint_path, program.context.start)
    between = states[1].time - states[0].time
    rates = np.diff([torques(robot, state) for state in states], axis=0) / between
    late = max(
        np.abs(np.linalg.solve(mirrored(pin.crba(robot.pin, robot.pin.createData(), s.q)), r)).max()
        for s, r in zip(states[1:], rates, strict=True)
    )
    bend = max(np.abs(state.a).max() for state in states)
    bound = (late * period / 2 + 2 * w * bend * step / 2) / w**2
    assert 0.3 * bound < result.column("joint_error").max() < bound


def test_a_singular_way_stops_axes_and_not_joints():
    straight = FOLD.replace("[-20 deg, -50 deg]", "[40 deg, 0.001 deg]")
    assert run(load_text(straight, "task.yaml")).summary["status"] == "done"
    beyond = straight + "  hold: {axes: {x: {move: 20 mm}}}\n"
    stopped = run(load_text(beyond, "task.yaml"), force=True)
    assert stopped.summary["status"] == "stopped"
    assert stopped.visits[-1].stage == "hold"


def test_the_torque_goes_on_without_a_step():
    """At each change of stage it changes as fast as what is carried fades, and the law moves."""
    result = run(load_text(PANDA, "task.yaml"))
    assert result.summary["status"] == "done", result.reason
    torque = columns(result, "torque", 7)
    steps = np.abs(np.diff(torque, axis=0)).max(axis=1)
    starts = [ticks(result, i).start for i in range(1, len(result.visits))]
    usual = np.median(steps)
    for row in starts:
        assert steps[row - 1] < FADING * 1e-3 + 20 * usual + 0.05


def test_the_torque_is_that_of_pinocchio():
    """Against recursive Newton-Euler of the same accelerations: another way to the same numbers."""
    loaded = load_text(PANDA, "task.yaml")
    program = compile_task(loaded)
    stage = program.stages[0]
    path = stage.plan.joint_path
    result = run(loaded)
    q, v, u = (columns(result, name, 7) for name in ("position", "velocity", "torque"))
    start = program.context.start
    timing = path.timing(start)
    model = program.context.robot.pin
    data = model.createData()
    gains = stage.plan.gains
    K_P = gains["K_P"]["joint.1"].value
    K_D = gains["K_D"]["joint.1"].value
    t = result.column("t")
    for row in range(300, ticks(result, 0).stop, 400):
        i = timing.index(t[row])
        c0, c1, c2, c3 = timing.coefficients[i]
        x = t[row] - timing.knots[i]
        s = c0 + x * (c1 + x * (c2 + x * c3))
        way = np.array(path.targets[-1]) - start
        wanted = way * (2 * c2 + 6 * c3 * x)
        wanted += K_D * (way * (c1 + x * (2 * c2 + 3 * c3 * x)) - v[row])
        wanted += K_P * (start + s * way - q[row])
        assert u[row] == pytest.approx(pin.rnea(model, data, q[row], v[row], wanted), abs=1e-6)


def test_what_is_predicted_is_what_comes():
    loaded = load_text(PANDA, "task.yaml")
    program = compile_task(loaded)
    result = run(loaded)
    rows = ticks(result, 0)
    passage = program.plan.stages["unfold"].nominal.passage
    rests = program.stages[0].plan.joint_path.timing(passage.instants[0].q).rests
    assert rests == pytest.approx((rows.stop - rows.start) * 1e-3, abs=2e-3)
    q = columns(result, "position", 7)
    for here in passage.instants[::10]:
        row = min(rows.start + round(here.time / 1e-3), rows.stop - 1)
        # One period at full speed.
        assert here.q == pytest.approx(q[row], abs=np.deg2rad(30) * 1e-3 + 1e-4)
    # The torques too, but for what the error adds.
    states = joint_states(program.stages[0].plan.joint_path, passage.instants[0].q)
    u = columns(result, "torque", 7)
    for state in states[10:50:10]:
        row = rows.start + round(state.time / 1e-3)
        assert torques(program.context.robot, state) == pytest.approx(u[row], abs=0.5)


def test_what_follows_is_designed_where_the_path_leads():
    plan = plan_task(load_text(PANDA, "task.yaml"))
    there = plan.stages["press"].context.start
    assert there == pytest.approx(plan.stages["unfold"].joint_path.targets[-1])
    assert plan.stages["unfold"].context.start == pytest.approx(plan.context.start)
    assert plan.follow("unfold").nominal.passage.last.q == pytest.approx(there)
    approach = plan.follow("approach")
    assert approach.kinematics.tool[0] == pytest.approx(approach.context.start_p)
    moved = plan.context.start_p - approach.context.start_p
    assert np.linalg.norm(moved) > 0.1


@pytest.mark.parametrize(
    ("text", "status"),
    [
        ("until: joint.1.position < 0 deg, within: 5 s", "done"),
        ("until: joint.1.position < -90 deg, within: 5 s", "failed"),
        ("until: joint.1.position < -90 deg, within: 300 ms", "failed"),
        ("fail_if: joint.2.position < 0 deg", "failed"),
        ("limits: {speed: 100 mm/s}", "stopped"),
    ],
)
def test_it_is_guarded_as_any_stage(text, status):
    changed = FOLD.replace("speed: 60 deg/s}}", f"speed: 60 deg/s}}, {text}}}")
    assert run(load_text(changed, "task.yaml"), force=True).summary["status"] == status


def test_the_loops_write_the_same_bytes(tmp_path: Path):
    program = compile_task(load_text(PANDA, "task.yaml"))
    found = {}
    for loop in ("native", "python"):
        parts = assemble(program)
        (tmp_path / loop).mkdir()
        path = tmp_path / loop / "log.arrow"
        with closing(parts.recorder(Log(path))) as recorder:
            outcome = fixed_step.run(
                parts.machine, parts.plant, parts.bus, recorder, program.context.period, loop=loop
            )
        found[loop] = path.read_bytes(), outcome.loop
    assert found["native"][1] == "native"
    assert found["native"][0] == found["python"][0]


def test_nothing_speaks_against_a_way_that_works():
    for text in (TASK, PANDA):
        assert [d.code for d in check_task(load_text(text, "task.yaml"))] == []
