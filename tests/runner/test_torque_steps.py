"""The largest step of a joint's torque: at a change of stage, or inside of one."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.program.execution.transition import Transition
from taskspec_runner.record.history import History
from taskspec_runner.verdict.torque_steps import largest_step, sentences


def history(torques):
    """Five ticks in `a` and five in `b`, 1 ms each, with the torques (2, 10) of two joints."""
    columns = {"clock": 1e-3 * np.arange(10), "t": 1e-3 * np.tile(np.arange(5), 2)}
    columns |= {f"joint.{i + 1}.torque": row for i, row in enumerate(torques)}
    return History(columns=columns, stages=np.repeat(["a", "b"], 5), units={})


def left(step):
    """That `a` was left for `b` with a step of so many N m, and `b` for the end."""
    return [
        Transition(0.005, "a", "until", "until", "", 0.0, "b", torque_step=step),
        Transition(0.010, "b", "done", "end", "", 0.0, "end"),
    ]


def test_a_step_inside_of_a_stage_is_the_largest():
    torques = np.zeros((2, 10))
    torques[1, 7:] = 22.0
    step = largest_step(left(0.3), history(torques))
    assert step == {"value": 22.0, "from": "b", "to": "b", "clock": 0.007, "joint": 2}
    (line,) = sentences({"torque_step": step, "period": 1e-3})
    assert line == (
        "b: the torque of joint 2 steps by 22 N*m from one tick to the next, at 0.007 s"
    )


def test_what_changes_from_stage_to_stage_is_that_of_the_change():
    """From the last tick of `a` to the first of `b` the measurement has changed too."""
    torques = np.zeros((2, 10))
    torques[0, 5:] = 22.0
    step = largest_step(left(0.7), history(torques))
    assert step == {"value": 0.7, "from": "a", "to": "b", "clock": 0.005}
    (line,) = sentences({"torque_step": step, "period": 1e-3})
    assert line.startswith("b: its first torque is 0.7 N*m off the last of 'a'")


@pytest.mark.parametrize("size", [0.0, 3.0])
def test_what_a_touch_makes_of_a_force_loop_is_no_line(size):
    torques = np.zeros((2, 10))
    torques[1, 3:] = size
    step = largest_step(left(0.0), history(torques))
    assert step["value"] == size
    assert list(sentences({"torque_step": step, "period": 1e-3})) == []
    assert largest_step([], history(np.full((2, 10), np.nan)))["value"] == 0.0
