"""What is written of runs of arms that take velocities or positions: page, summary, MCAP."""

from __future__ import annotations

import re

import numpy as np
import pytest

from controller_samples import SERVOS, program
from taskspec.program.execution.transition import Transition
from taskspec_runner.session import execute_program
from taskspec_runner.verdict.torque_steps import largest_change, sentences


@pytest.fixture(scope="module", params=SERVOS)
def command(request) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def run(command, tmp_path_factory):
    return execute_program(program(command), tmp_path_factory.mktemp("run") / command)


def test_a_report_draws_what_was_commanded_and_claims_no_torque(command, run) -> None:
    page = run.report.read_text("utf-8")
    titles = [re.sub(r"\s*<small>.*", "", each) for each in re.findall(r"<h3>(.*?)</h3>", page)]
    title = {
        "velocity": "Commanded joint velocities",
        "position": "Commanded joint positions, ahead of the joints",
    }[command]
    assert title in titles
    assert "Torques that the servo exerts, share of their limits" in titles
    assert not any(each.startswith("Joint torques") for each in titles)
    plural = {"velocity": "velocities", "position": "positions"}[command]
    assert f"joint {plural}" in page


def test_a_summary_has_steps_of_velocities(command, run) -> None:
    assert run.summary["torque_step"] is None
    step = run.summary["velocity_step"]
    assert set(step) == {"value", "from", "to", "clock"}
    assert ("command_limits" in run.summary) == (command == "velocity")
    ends = [visit["ended_by"] for visit in run.summary["stages"]]
    assert len(ends) == 3
    assert not any("torque_step" in end for end in ends)


def test_a_step_of_velocity_is_said_where_it_counts() -> None:
    ends = [
        Transition(0.5, "a", "until", "until", "", 0.0, "b", torque_step=0.25),
        Transition(0.9, "b", "done", "done", "", 0.0, "end"),
    ]
    step = largest_change(ends)
    (line,) = sentences({"velocity_step": step, "torque_step": None})
    assert line == (
        "b: its first velocity of a joint is 0.25 rad/s off the last of 'a', at 0.500 s"
    )
    assert list(sentences({"velocity_step": step | {"value": 0.009}, "torque_step": None})) == []
    assert largest_change(ends[1:]) is None


def test_mcap_carries_the_commands(command, run, tmp_path) -> None:
    reader, decoder = pytest.importorskip("mcap.reader"), pytest.importorskip("mcap_ros2.decoder")
    path = run.export("mcap", tmp_path / "log.mcap")
    with path.open("rb") as file:
        read = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        found = [each[3] for each in read.iter_decoded_messages(topics=["/joint_commands"])]
    assert len(found) == len(run)
    name = f"joint.2.{command}.command"
    assert np.array_equal([getattr(each, command)[1] for each in found], run.signals[name])
    empty = {"position", "velocity", "effort"} - {command}
    assert all(len(getattr(found[0], each)) == 0 for each in empty)
