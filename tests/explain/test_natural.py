"""Natural constraints and selection, against the tables that textbooks have for such tasks."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.explain import State, natural, selection
from taskspec.spec import load_task, load_text


def shipped(task, stage, tasks):
    """The plan of a stage of a shipped task."""
    return plans(tasks / f"{task}.yaml")[stage]


@cache
def plans(path):
    """A shipped task is compiled once, however many tests look at its plan."""
    return {s.name: s.plan for s in compile_unchecked(load_task(path)).stages}


@pytest.fixture
def tasks(request):
    return request.config.rootpath / "tasks"


def decided(stage):
    """Axes whose velocity the world decides."""
    return [str(n.axis) for n in natural(stage) if n.decides == "velocity"]


def of(stage, axis):
    return next(n for n in natural(stage) if n.axis == axis)


@pytest.mark.parametrize(
    ("task", "stage", "velocities"),
    [
        # A point on a plane: one. A knob of a crank: what it slides and leans on. A door at its
        # hinge, a drawer: all but one. A thread and a door at its handle: all but one, with a tie.
        ("wipe-table", "wipe", ["z"]),
        ("corner", "press", ["x", "z"]),
        ("crank", "rotate", ["x", "z", "rx", "ry"]),
        ("door-hinge", "open", ["x", "y", "z", "rx", "ry"]),
        ("drawer", "pull", ["x", "y", "rx", "ry", "rz"]),
        ("screw", "screw_down", ["x", "y", "z", "rx", "ry"]),
        ("door-handle", "open", ["x", "z", "rx", "ry", "rz"]),
        ("ring", "round", ["x", "z"]),
        ("linkage", "up", ["rz"]),
        ("reach-limits", "out", []),
    ],
)
def test_what_the_world_decides(tasks, task, stage, velocities):
    assert decided(shipped(task, stage, tasks)) == velocities


def test_a_door_ties_its_turn_to_the_way_of_its_handle(tasks):
    """w_z = v_y / r and r f_y + m_z = Q, with r = 400 mm."""
    stage = shipped("door-handle", "open", tasks)
    assert of(stage, "rz").terms == (("y", pytest.approx(1 / 0.4)),)
    pull = of(stage, "y")
    assert pull.terms == (("rz", pytest.approx(-1 / 0.4)),)
    assert pull.effort == pytest.approx(1 / 0.4)


def test_a_thread_ties_its_way_to_its_turn(tasks):
    """v_z = p w_z and m_z + p f_z = Q, with p = 4 mm a turn."""
    stage, pitch = shipped("screw", "screw_down", tasks), 4e-3 / (2 * math.pi)
    assert of(stage, "z").terms == (("rz", pytest.approx(pitch)),)
    assert of(stage, "rz").terms == (("z", pytest.approx(-pitch)),)


def test_a_free_knob_bears_no_moment(tasks):
    stage = shipped("crank", "rotate", tasks)
    assert of(stage, "y").effort == pytest.approx(1 / 0.12)
    assert (of(stage, "rz").effort, of(stage, "rz").terms) == (0.0, ())


def test_a_frame_askew_shares_the_normal(tasks):
    """a.v = 0 and f along a, a = (-sin, 0, cos) of 10 deg in the frame's axes."""
    stage, slope = shipped("tilted-force", "press", tasks), math.tan(math.radians(10))
    assert of(stage, "z").terms == (("x", pytest.approx(slope)),)
    assert of(stage, "x").terms == (("z", pytest.approx(-slope)),)


def test_contacts_come_and_go(tasks):
    found = {
        name: of(shipped("wipe-table", name, tasks), "z")
        for name in ("approach", "wipe", "retreat")
    }
    assert [f.state for f in found.values()] == [State.MET, State.THERE, State.MAYBE]
    assert all(f.pushes == 1 and f.by == "table" for f in found.values())
    x = of(shipped("wipe-table", "wipe", tasks), "x")
    assert (x.friction, x.against, x.by) == (0.2, "z", "table")


def test_directions_that_change_on_the_way_say_so(tasks):
    assert of(shipped("ring", "round", tasks), "x").turns
    assert not of(shipped("ring", "round", tasks), "z").turns
    assert not of(shipped("polish-drum", "polish", tasks), "z").turns


FLAT = """
taskspec: 1
name: flat
robot:
  model: panda
  tool: {shape: cylinder, radius: 20 mm, length: 100 mm}
  start: {xyz: [500 mm, 0, 300 mm], rpy: [180 deg, LEAN, 0]}
world: {table: {shape: plane, xyz: [0, 0, 300 mm]}}
stages: {press: {axes: {z: {force: -10 N}, rx: {torque: 0}, ry: {torque: 0}}, time: 1 s}}
"""


@pytest.mark.parametrize(("lean", "axes"), [("0", ["z", "rx", "ry"]), ("3 deg", ["z"])])
def test_a_face_that_lies_flush_decides_two_turns(lean, axes):
    (stage,) = compile_unchecked(load_text(FLAT.replace("LEAN", lean), "t.yaml")).stages
    assert decided(stage.plan) == axes


@pytest.mark.parametrize(
    "task", ["wipe-table", "corner", "door-handle", "ring", "valve", "linkage"]
)
def test_what_is_selected_does_no_work(tasks, task):
    """S_f^T S_v = 0, and together they are of full rank."""
    found = [selection(plan) for plan in plans(tasks / f"{task}.yaml").values()]
    assert found
    for both in found:
        assert np.allclose(both.force.T @ both.motion, 0.0, atol=1e-9)
        assert np.linalg.matrix_rank(np.hstack([both.force, both.motion])) == len(both.axes)


def test_laws_without_a_choice_have_no_selection(tasks):
    assert selection(shipped("press-parallel", "slide", tasks)) is None


def test_reaction_and_motion_do_no_work_but_on_the_mechanism(tasks):
    """Power of any wrench that meets the constraints, on any twist that does, is Q times the rate.

    Drawn at random on the axes that are left free; a check of signs and units of all factors.
    """
    rng = np.random.default_rng(0)
    for task, name in (("door-handle", "open"), ("screw", "screw_down"), ("valve", "close")):
        imposed = natural(shipped(task, name, tasks))
        free = [n.axis for n in imposed if n.decides == "force"]
        twist = dict.fromkeys((n.axis for n in imposed), 0.0) | {
            axis: rng.normal() for axis in free
        }
        twist |= {
            n.axis: sum(c * twist[a] for a, c in n.terms)
            for n in imposed if n.decides == "velocity"
        }  # fmt: skip
        wrench = {n.axis: rng.normal() for n in imposed}
        effort = rng.normal()
        wrench |= {
            n.axis: sum(c * wrench[a] for a, c in n.terms) + n.effort * effort
            for n in imposed if n.decides == "force"
        }  # fmt: skip
        power = sum(wrench[a] * twist[a] for a in twist)
        rate = sum(n.effort * twist[n.axis] for n in imposed)
        assert power == pytest.approx(effort * rate)
