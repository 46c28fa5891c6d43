"""Predicted durations, impacts and time constants, held against runs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.prediction import predict
from taskspec.spec import load_text

#: A guard is looked at once a tick, on a force that is measured one tick late. What is left is how
#: the force rises to the guard's 1 to 3 N, for which the contact's damper is left out (2 ms), and a
#: move that begins before the last stage has come to rest (2 ms).
CLOSE = 4e-3


@pytest.mark.xdist_group("shipped")
@pytest.mark.parametrize(
    "task",
    ["wipe-table", "conveyor", "vibrating-table", "guarded-approach", "press-parallel-pid",
     "trace-points", "own-robot", "crank", "screw", "reach-limits"],
)  # fmt: skip
def test_durations_of_shipped_tasks(simulate, task):
    """A stage lasts as long as told where it is told, and never longer than at most."""
    run = simulate(task)
    found, seen = predict(run.program, {}), set()
    for visit in run.history.visits():
        duration = found[visit.stage].duration
        lasted = (visit.last - visit.first + 1) * run.program.context.period
        assert lasted <= duration.most + CLOSE
        if duration.expected is not None and visit.stage not in seen:
            assert lasted == pytest.approx(duration.expected, abs=CLOSE)
        seen.add(visit.stage)
    if found.duration.expected is not None:
        within = CLOSE * len(found.stages)
        assert run["clock"][-1] == pytest.approx(found.duration.expected, abs=within)


APPROACH = """
taskspec: 1
name: meets
robot: {model: panda, start: {xyz: [500 mm, 0, 320 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: STIFF, damping: 30 N*s/m}}
frame: table
law: LAW
stages:
  go:
    axes: {z: {velocity: SPEED}}
    until: GUARD
    within: {WITHIN}
  press: {axes: {z: {force: -3 N}}, time: 0.1 s}
"""
GOOD = {
    "LAW": "hybrid",
    "SPEED": "-30 mm/s",
    "STIFF": "20 kN/m",
    "GUARD": "force.z < -2 N for 10 ms",
    "WITHIN": "time: 3 s",
}


def text(**changes):
    filled = APPROACH
    for key, value in (GOOD | changes).items():
        filled = filled.replace(key, value)
    return filled


def predicted(task, stage="go"):
    return predict(compile_unchecked(load_text(task, "t.yaml")), {})[stage]


def predicted_and_run(simulate, task, stage="go"):
    """What is predicted of a stage, and the run: the task is compiled once for both."""
    run = simulate(task)
    return predict(run.program, {})[stage], run


@pytest.mark.parametrize("law", ["hybrid", "parallel", "impedance", "pd", "parallel-pid"])
@pytest.mark.parametrize("speed", ["-30 mm/s", "-150 mm/s"])
def test_impact_and_arrival(simulate, law, speed):
    """Damping leaves at least 1/e of the undamped peak, and the stage goes on pressing after it.

    What it goes on for, and how fast its spring is stretched, is at most 5 % in this stage.
    """
    task = text(LAW=law, SPEED=speed)
    said, run = predicted_and_run(simulate, task)
    peak = float(np.max(-run.during("go", "force.z")))
    assert said.impact.peak / math.e < peak < 1.05 * said.impact.peak
    late = CLOSE
    if said.impact.drag:
        # The lag d/k of designed springs, 1.4 / w, is there but for e^(-0.7 w t), w = 2 pi 2 Hz.
        w = 2 * math.pi * 2
        late += 2 * (1.4 / w) * math.exp(-0.7 * w * said.duration.expected)
    assert len(run.during("go", "t")) * 1e-3 == pytest.approx(said.duration.expected, abs=late)


def test_the_stiffest_surface_strikes_hardest():
    vary = "vary: {world.table.stiffness: 5..80 kN/m, world.table.rpy: [+- 3 deg, 0, 0]}\n"
    said = predicted(text() + vary).impact
    assert said.worst.values == {("world.table.stiffness", None): 80e3}
    assert said.worst.value == pytest.approx(2 * said.peak)


@pytest.mark.parametrize(
    ("changes", "expected", "most"),
    [
        # Joint damping makes the arm lag by what is not one number on the axis.
        ({"LAW": "pd-joint"}, None, 3.0),
        # What a reducer has seen is not told.
        ({"GUARD": "max(force.z) > 1 N"}, None, 3.0),
        ({"WITHIN": "travel: 30 mm"}, 0.780, None),
        ({"GUARD": "t > 0.5 s or force.z < -2 N"}, 0.5, 3.0),
        ({"SPEED": "-30 mm/s * exp(-t/(1 s))"}, None, 3.0),
    ],
)
def test_what_nothing_tells_stays_open(changes, expected, most):
    duration = predicted(text(**changes)).duration
    assert duration.most == most
    if expected is None:
        assert duration.expected is None
    else:
        # 20 mm at 30 mm/s, 0.1 s of blending, the dwell and what the force takes to rise: 3 ms.
        assert duration.expected == pytest.approx(expected, abs=2e-3)


def test_a_task_that_comes_back_has_no_duration():
    program = compile_unchecked(
        load_text(
            text()
            .replace("time: 0.1 s}", "time: 0.1 s, next: go}")
            .replace("    until", "    attempts: 2\n    until"),
            "t",
        )
    )
    assert predict(program, {}).duration.expected is None


def test_time_constants_are_those_of_the_poles(simulate):
    """10 mm of a force step, 20 kN/m: what is left after one time constant, two and three."""
    law = "{kind: hybrid, force: {integral: 5 /s, damping: 500 N*s/m}}"
    task = text(LAW=law).replace("time: 0.1 s", "time: 2 s").replace("-3 N}", "-10 N, ramp: 0}")
    run = simulate(task)
    tau = predict(run.program)["press"].settling["z"].time_constant
    left = 10 + run.during("press", "force.z")
    at = [round((0.4 + i * tau) * 1000) for i in range(3)]
    shares = left[at[1:]] / left[at[:-1]]
    # The faster modes of the axis are gone after 0.4 s but for 1 %.
    assert shares == pytest.approx(math.exp(-1), rel=0.02)


def test_an_unknown_stage_is_told_with_those_that_exist():
    with pytest.raises(KeyError, match=r"no stage 'gone'; the stages are \['go', 'press'\]"):
        predict(compile_unchecked(load_text(text(), "t")), {})["gone"]
