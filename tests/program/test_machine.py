"""Stages, guards, transitions and stops, on small arms that simulate fast."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taskspec.spec import load_task
from taskspec_runner.session import execute

TASKS = Path(__file__).resolve().parents[2] / "tasks"
PLANAR = """
taskspec: 1
name: small
robot: {{model: planar2, start: {{xyz: [350 mm, 150 mm, 0]}}}}
{extra}
stages:
{stages}
"""
WALL = "world: {wall: {shape: plane, xyz: [380 mm, 0, 0], rpy: [0, -90 deg, 0]}}"


def planar(stages: str, extra: str = "") -> str:
    return PLANAR.format(stages=stages.strip("\n"), extra=extra)


def kinds(run):
    return [(t.stage, t.kind, t.name, t.to) for t in run.transitions]


def test_stages_follow_each_other(simulate):
    run = simulate(
        planar("""
  go: {axes: {x: {move: 20 mm}}}
  wait: {time: 0.1 s}
  back: {axes: {x: {move: -20 mm}}}
""")
    )
    assert run.outcome.status == "done"
    assert kinds(run) == [
        ("go", "done", "done", "wait"),
        ("wait", "done", "done", "back"),
        ("back", "done", "done", "end"),
    ]
    assert run["position.x"][-1] == pytest.approx(0.35, abs=1e-4)


def test_next_and_on_fail_lead_elsewhere(simulate):
    run = simulate(
        planar("""
  a: {axes: {x: {velocity: 20 mm/s}}, until: position.x > 360 mm, within: {time: 2 s}, next: c}
  b: {time: 1 s}
  c: {axes: {x: {velocity: 20 mm/s}}, until: position.x > 2 m, within: {travel: 5 mm}, on_fail: end}
""")
    )
    assert [(t.stage, t.kind, t.name, t.to) for t in run.transitions] == [
        ("a", "until", "until", "c"),
        ("c", "within", "travel", "end"),
    ]
    assert run.outcome.status == "done"


def test_attempts_bound_a_cycle(simulate):
    run = simulate(
        planar("""
  try:
    axes: {x: {move: 2 mm}}
    until: position.x > 2 m
    within: {time: 50 ms}
    on_fail: rest
    attempts: 3
  rest: {time: 20 ms, next: try}
""")
    )
    assert run.outcome.status == "failed"
    assert run.outcome.reason == "attempts"
    assert sum(t.stage == "try" for t in run.transitions) == 3


def test_visits_are_counted_for_guards(simulate):
    run = simulate(
        planar("""
  a: {time: 10 ms, attempts: 10, next: b}
  b: {until: a.visits >= 3, within: {time: 20 ms}, on_fail: a}
""")
    )
    assert run.outcome.status == "done"
    assert sum(t.stage == "a" for t in run.transitions) == 3


@pytest.mark.parametrize(
    ("limits", "guards", "kind"),
    [
        ("{speed: 1 um/s}", "fail_if: t > 5 ms, until: t > 5 ms, within: {time: 6 ms}", "limit"),
        ("{}", "fail_if: t > 5 ms, until: t > 5 ms, within: {time: 6 ms}", "fail_if"),
        ("{}", "until: t > 5 ms, within: {time: 6 ms}", "until"),
        ("{}", "until: position.y > 5 m, within: {time: 6 ms}", "within"),
    ],
)
def test_precedence_in_one_tick(simulate, limits, guards, kind):
    stage = f"  a: {{axes: {{x: {{velocity: 50 mm/s}}}}, limits: {limits}, {guards}}}"
    run = simulate(planar(stage))
    assert run.transitions[0].kind == kind
    # The robot starts at rest, so that all of them become true later than the first tick.
    assert run.transitions[0].clock > 0


def test_for_asks_for_an_unbroken_time(simulate):
    run = simulate(
        planar("""
  a: {until: sin(2*pi*t/(40 ms)) > 0 for 15 ms, within: {time: 1 s}}
  b: {until: sin(2*pi*t/(40 ms)) > 0 for 25 ms, within: {time: 200 ms}, on_fail: end}
""")
    )
    assert kinds(run)[0][1] == "until"
    assert run.transitions[0].clock == pytest.approx(0.016, abs=2e-3)
    assert kinds(run)[1][1:3] == ("within", "time")


def test_reducers_in_guards_look_back_over_the_stage(simulate):
    run = simulate(
        planar("""
  rise:
    axes: {x: {position: 350 mm + 10 mm * sin(2*pi*t/(1 s))}}
    until: max(position.x) - position.x > 4 mm
    within: {time: 2 s}
  steady: {axes: {x: {velocity: 20 mm/s}}, until: mean(velocity.x) > 15 mm/s, within: {time: 2 s}}
""")
    )
    x = run.during("rise", "position.x")
    assert x.max() - x[-1] == pytest.approx(0.004, abs=1e-4)
    assert np.mean(run.during("steady", "velocity.x")) == pytest.approx(0.015, rel=0.01)


def test_limits_stop_with_their_name(simulate):
    move = "  a: {axes: {x: {move: 60 mm, speed: 200 mm/s}}}"
    speed = simulate(planar(move, "limits: {speed: 100 mm/s}"))
    assert (speed.outcome.status, speed.outcome.reason) == ("stopped", "speed")
    assert speed["speed"][-2] <= 0.1 < speed["speed"][-1]
    press = "  a: {axes: {x: {velocity: 50 mm/s}}, until: t > 2 s, within: {time: 3 s}}"
    force = simulate(planar(press, WALL + "\nlimits: {force: 10 N}"))
    assert (force.outcome.status, force.outcome.reason) == ("stopped", "force")
    # Measured one tick late: the log's last row but one broke the limit.
    assert -force["force.x"][-3] < 10 or force["force.x"][-3] < 10
    assert np.abs(force["force.x"][-2]) > 10
    deviation = simulate(
        planar(press, WALL + "\nlaw: {kind: pd, stiffness: 50 N/m}\nlimits: {deviation: 20 mm}")
    )
    assert (deviation.outcome.status, deviation.outcome.reason) == ("stopped", "deviation")


def test_joint_limits_always_stop(simulate):
    text = planar("  a: {axes: {x: {move: 1 m, speed: 400 mm/s}}}")
    run = simulate(text)
    assert run.outcome.status == "stopped"
    assert run.outcome.reason in ("singularity", "joint_position", "joint_velocity")


def test_a_law_that_diverges_ends_in_a_named_stop(simulate):
    text = """
taskspec: 1
name: unstable
robot: {model: panda, start: {xyz: [500 mm, 0, 302 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 80 kN/m}}
law: {kind: parallel, mass: {linear: 1 kg}, force: {proportional: 30, integral: 500 /s}}
stages: {press: {axes: {z: {force: -10 N}}, time: 5 s}}
"""
    run = simulate(text)
    assert run.outcome.status == "stopped"
    assert run.outcome.reason in (
        "joint_velocity", "joint_position", "force_bound", "energy_bound", "non_finite",
        "simulator_warning", "singularity",
    )  # fmt: skip
    assert len(run.history) == run.outcome.ticks or len(run.history) == run.outcome.ticks + 1


def test_numbers_that_are_not_finite_stop(simulate):
    """`validate` cannot tell: what the clock shows when a later stage begins is up to the run."""
    root = "(1 - clock/(0.15 s)) * sqrt(1 - clock/(0.15 s))"
    later = f"a: {{axes: {{x: {{velocity: 5 mm/s * {root}}}}}, time: 1 s}}"
    run = simulate(planar(f"  wait: {{time: 50 ms}}\n  {later}"))
    assert (run.outcome.status, run.outcome.reason) == ("stopped", "non_finite")
    assert run.outcome.ticks == pytest.approx(150, abs=1)
    assert np.isfinite(run["joint.1.position"]).all()


def test_leaving_a_box_face_stops(simulate):
    text = """
taskspec: 1
name: edge
robot: {model: panda, start: {xyz: [500 mm, 0, 302 mm]}}
world: {block: {shape: box, xyz: [500 mm, 0, 250 mm], size: [60 mm, 60 mm, 100 mm]}}
frames: {face: {surface: block}}
frame: face
stages:
  press: {axes: {z: {force: -5 N}}, time: 1 s}
  slide: {axes: {x: {velocity: 40 mm/s}, z: {force: -5 N}}, time: 3 s}
"""
    run = simulate(text)
    assert (run.outcome.status, run.outcome.reason) == ("stopped", "frame_left")
    assert run.during("slide", "position.x").max() == pytest.approx(0.03, abs=2e-4)


def test_same_task_gives_the_same_bytes(tmp_path):
    logs = []
    for name in ("first", "second"):
        execute(load_task(TASKS / "guarded-approach.yaml"), tmp_path / name, report=False)
        logs.append((tmp_path / name / "log.arrow").read_bytes())
    assert logs[0] == logs[1]


def test_a_reference_that_is_no_number_is_named(simulate):
    """In a stage after the first; in that `validate` finds the time itself."""
    later = "a: {axes: {x: {position: 350 mm + 1 mm * log((0.1 s - clock)/(1 s))}}, time: 1 s}"
    run = simulate(planar(f"  wait: {{time: 50 ms}}\n  {later}"))
    assert (run.outcome.status, run.outcome.reason) == ("stopped", "non_finite")
    assert "position.x" in run.outcome.text


def test_the_first_tick_of_a_stage_heeds_limits_only(simulate):
    """Also that of the run: a stage lasts a tick at least, and t = 0 is logged once."""
    run = simulate(planar("  a: {until: t >= 0 s, within: {time: 1 s}}\n  b: {time: 10 ms}"))
    assert run.transitions[0].clock == pytest.approx(0.001)
    t = run["t"][run.history.window("b")]
    np.testing.assert_allclose(t, np.arange(len(t)) * 1e-3, atol=1e-12)


def test_a_singular_start_stops_the_run(simulate):
    """Stretched out, the arm cannot be moved along itself; its gains are designed all the same."""
    text = """
taskspec: 1
robot: {model: planar2, start: {joints: [0, 0]}}
stages: {wait: {time: 10 ms}}
"""
    run = simulate(text)
    assert run.outcome.status == "stopped"
    assert run.outcome.ticks == 0
