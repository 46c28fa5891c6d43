"""What a run says of the velocities that its controller has estimated, and of its friction."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.spec import load_text
from taskspec_runner import run
from taskspec_runner.report import figures
from taskspec_runner.verdict import velocity

TASK = """\
taskspec: 1
name: report
robot: {{model: planar2, start: {{xyz: [400 mm, 200 mm, 0]}}, joint_friction: 0.1 N*m{more}}}
{control}law: pd
stages: {{go: {{axes: {{x: {{move: 20 mm}}}}, time: 0.4 s}}}}
"""


@pytest.fixture
def made(tmp_path):
    """A run of the task with `control`, and more of `robot`."""

    def by(control: str = "", more: str = ""):
        text = TASK.format(control=control and f"control: {{{control}}}\n", more=more)
        return run(load_text(text, "task.yaml"), tmp_path / "run", report=False)

    return by


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("differences", "velocity of joints from differences of positions: off by at most "),
        ("{filter: 50 Hz}", "velocity of joints from filtered differences of 50 Hz: off by "),
        ("{observer: 30 Hz}", "velocity of joints from an observer of 30 Hz: off by at most "),
    ],
)
def test_a_run_says_which_estimate_it_used_and_how_far_it_was_off(made, source, said):
    found = made(f"velocity: {source}", ", encoder: 0.2 mrad")
    data = found.summary["velocity"]
    pairs = [(f"joint.{i}.velocity.measured", f"joint.{i}.velocity") for i in (1, 2)]
    off = [np.abs(found.column(own) - found.column(true)).max() for own, true in pairs]
    assert data["off"] == max(off) > 0
    assert off[data["joint"] - 1] == max(off)
    [text] = velocity.sentences(found.summary)
    assert text.startswith(said)
    assert text.endswith(f"mrad/s (joint {data['joint']})")
    charts = {chart.key: chart for part in figures.sections(found) for chart in part.charts}
    assert len(charts["estimated velocities"].traces) == 4
    error = charts["velocity errors"]
    shown = max(np.abs(trace.values).max() for trace in error.traces)
    assert shown / error.factor == pytest.approx(max(off))
    assert error.note == text


def test_compensated_friction_has_a_chart(made):
    found = made("friction: 80 %")
    [chart] = [c for p in figures.sections(found) for c in p.charts if "friction" in c.key]
    assert [trace.signal for trace in chart.traces] == [
        "joint.1.torque.friction",
        "joint.2.torque.friction",
    ]
    assert max(np.abs(trace.values).max() for trace in chart.traces) > 0


def test_a_run_with_measured_velocities_says_nothing(made):
    found = made("", ", encoder: 0.2 mrad")
    assert "velocity" not in found.summary
    assert list(velocity.sentences(found.summary)) == []
    keys = {chart.key for part in figures.sections(found) for chart in part.charts}
    assert keys
    assert not keys & {"estimated velocities", "velocity errors", "compensated friction"}
