"""A run that does not come to `end`: its arm is brought to rest, which nobody judges."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from short_tasks import TAP
from typer.testing import CliRunner

from taskspec.control.stopping import DECAY
from taskspec.robot.model_terms import PinocchioTerms
from taskspec.spec import load_text
from taskspec_runner.cli import app
from taskspec_runner.plant.plant import Plant
from taskspec_runner.record.history import TO_REST
from taskspec_runner.runs import Run
from taskspec_runner.session import execute

#: The same, and it must not press.
STOPPED = TAP.replace("params:", "limits: {force: 3 N}\nparams:")
#: Swings through free space until it is too fast.
SWING = """\
taskspec: 1
name: swing
robot: {model: planar2, start: {xyz: [400 mm, 100 mm, 0]}}
limits: {speed: 0.3 m/s}
stages:
  swing:
    axes: {x: {velocity: 2 m/s^2 * t}, y: hold}
    time: 0.5 s
"""
PERIOD = 1e-3


def run(text: str, out: Path, loop: str | None = None, *, report: bool = False) -> Run:
    execute(load_text(text, "task.yaml"), out, loop=loop, report=report, force=True)
    return Run.load(out)


def call(*args: str | Path) -> str:
    result = CliRunner().invoke(app, [str(arg) for arg in args], env={"COLUMNS": "200"})
    assert "Traceback" not in result.output
    assert "internal error" not in result.output
    return result.output


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run(STOPPED, tmp_path_factory.mktemp("stopped") / "run", report=True)


def test_half_a_second_is_recorded_beside_the_run(stopped: Run) -> None:
    rest = stopped.history.rest
    assert rest is not None
    assert stopped.to_rest is not None
    assert len(stopped) == stopped.summary["ticks"]
    assert set(rest.stages) == {TO_REST}
    assert TO_REST not in stopped.history.stages
    assert TO_REST not in stopped.stages
    assert len(rest) == len(stopped.to_rest) == 500
    clock = np.concatenate([stopped.columns["clock"], rest.columns["clock"]])
    np.testing.assert_allclose(np.diff(clock), PERIOD, atol=1e-9)
    # Nobody asks for anything; what is measured goes on.
    assert np.isnan(rest.columns["force.x.ref"]).all()
    assert np.isfinite(rest.columns["position.x"]).all()
    said = stopped.summary["stopping"]
    assert said["stage"] == TO_REST
    assert said["ticks"] == 500
    assert "not_at_rest" not in said
    assert said["duration"] == pytest.approx(0.5)
    # What it pressed on is let go, and it stands.
    assert 0 < said["time_to_rest"] < 0.4
    assert rest.columns["force.x"][-1] == 0
    assert said["residual_joint_speed"] < 1e-3


def test_energy_decays_as_the_law_says(tmp_path: Path) -> None:
    swung = run(SWING, tmp_path / "run")
    rest, robot = swung.history.rest, swung.program.context.robot
    assert rest is not None
    terms = PinocchioTerms(robot)
    energy = []
    for row in (0, 50, 100):
        q, v = (
            np.array([rest.columns[f"joint.{i}.{what}"][row] for i in (1, 2)])
            for what in ("position", "velocity")
        )
        terms.at(q, v)
        energy.append(0.5 * float(v @ terms.inertia @ v))
    # Held for a period, the damper takes 1 - h / T of a velocity, a power that differs from exp by
    # h / (2 T) = 1 % of the exponent; Coriolis forces of its start are not held exactly, either.
    for number, after in enumerate(energy):
        expected = energy[0] * (1 - PERIOD / DECAY) ** (2 * 50 * number)
        assert after == pytest.approx(expected, rel=0.03)


def test_torques_keep_the_limits(stopped: Run) -> None:
    rest, most = stopped.history.rest, stopped.summary["joint_limits"]
    assert rest is not None
    for i, limit in enumerate(most, 1):
        assert np.abs(rest.columns[f"joint.{i}.torque"]).max() <= limit


def test_both_loops_give_the_same_bytes(tmp_path: Path) -> None:
    logs = [
        run(STOPPED, tmp_path / loop, loop).folder / "log.arrow" for loop in ("native", "python")
    ]
    assert logs[0].read_bytes() == logs[1].read_bytes()


def test_a_silent_joint_is_carried_alone(tmp_path: Path) -> None:
    """A planar arm bears no gravity: joint 1 is left alone, joint 2 loses its speed."""
    silent = SWING + "truth: {faults: [{encoder: drops, joint: 1, at: 0.1 s}]}\n"
    lost = run(silent.replace("0.3 m/s}", "9 m/s}"), tmp_path / "run", report=True)
    assert lost.summary["ending"]["reason"] == "encoder_lost"
    assert lost.summary["stopping"]["undamped"] == [1]
    rest = lost.history.rest
    assert rest is not None
    assert not rest.columns["joint.1.torque"].any()
    assert abs(rest.columns["joint.2.torque"][0]) > 0
    page = (tmp_path / "run" / "report.html").read_text("utf-8")
    assert "Joint 1 gave no measurement" in page


def test_the_stop_controller_keeps_the_rate_of_torques(tmp_path: Path) -> None:
    rate = 40.0
    bound = f"protection: {{source: s, joints: {{torque_rate: {rate} N*m/s}}}}, start"
    steps = []
    for text in (SWING, SWING.replace("start", bound)):
        swung = run(text, tmp_path / str(len(steps)))
        rest = swung.history.rest
        assert rest is not None
        both = [
            np.concatenate([c[f"joint.{i}.torque"] for c in (swung.columns, rest.columns)])
            for i in (1, 2)
        ]
        # From the tick before it takes over to its end.
        steps.append(np.abs(np.diff(both, axis=1)[:, len(swung) - 1 :]).max())
        assert swung.summary["stopping"]["residual_joint_speed"] < 1e-2
    assert steps[0] > 10 * rate * PERIOD
    assert steps[1] <= rate * PERIOD * (1 + 1e-9)


@pytest.fixture
def nothing_else(stopped: Run, tmp_path: Path) -> Path:
    """A folder whose log has lost all but the ticks in which the arm is brought to rest."""
    folder = tmp_path / "rest"
    shutil.copytree(stopped.folder, folder)
    with pa.OSFile(str(folder / "log.arrow")) as file:
        reader = pa.ipc.open_stream(file)
        table, options = reader.read_all(), reader.schema
    stages = np.asarray(table["stage"].cast(pa.string()).to_pylist())
    left = table.filter(pa.array(stages == TO_REST))
    with (
        pa.OSFile(str(folder / "log.arrow"), "wb") as file,
        pa.ipc.new_stream(file, options) as out,
    ):
        out.write_table(left)
    return folder


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["report"], "the report is no evidence of the run"),
        (["judge"], "cannot judge"),
        (["diff"], "There is no tick to compare"),
        (["export", "--csv"], "holds no tick"),
        (["replay", "--video"], "cannot draw"),
    ],
)
def test_a_log_of_nothing_else_is_told(
    command: list[str], words: str, nothing_else: Path, stopped: Run, tmp_path: Path
) -> None:
    more: list[str | Path] = []
    if command[0] == "diff":
        more = [stopped.folder]
    elif len(command) > 1:
        more = [command[1], tmp_path / ("log.csv" if command[0] == "export" else "film.mp4")]
    assert words in call(command[0], nothing_else, *more)


def test_stage_that_fails_is_brought_to_rest_too(tmp_path: Path) -> None:
    failed = run(TAP.replace("{time: 0.4 s}", "{time: 20 ms}"), tmp_path / "run")
    assert failed.summary["status"] == "failed"
    assert failed.to_rest is not None


def test_run_that_came_to_its_end_stays_as_it_was(tmp_path: Path) -> None:
    done = run(TAP, tmp_path / "run")
    assert done.summary["status"] == "done"
    assert done.to_rest is None
    assert "stopping" not in done.summary


def test_reference_that_is_no_number_leaves_an_arm_to_be_stopped(tmp_path: Path) -> None:
    text = TAP.replace("20 mm/s}", "20 mm/s * sqrt((50 ms - clock) / (1 s))}")
    run_of = run(text, tmp_path / "run")
    assert run_of.summary["ending"]["reason"] == "non_finite"
    rest = run_of.history.rest
    assert rest is not None
    assert all(np.isfinite(rest.columns[f"joint.{i}.torque"]).all() for i in (1, 2))


def test_nothing_follows_what_has_diverged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The native loop has an alarm of its own.
    monkeypatch.setenv("TASKSPEC_LOOP", "python")
    monkeypatch.setattr(Plant, "alarm", lambda _: ("energy_bound", "the arm holds 12 kJ"))
    lost = run(TAP, tmp_path / "run")
    assert lost.summary["ending"]["reason"] == "energy_bound"
    assert lost.to_rest is None
    assert lost.summary["stopping"]["not_at_rest"] == "the simulation had diverged"


def test_state_that_is_lost_on_the_way_ends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def alarm(self: Plant) -> tuple[str, str] | None:
        return ("clock", "the clock stands") if self.data.time > 0.3 else None

    monkeypatch.setattr(Plant, "alarm", alarm)
    cut = run(STOPPED, tmp_path / "run")
    assert cut.to_rest is not None
    assert len(cut.to_rest) < 500
    assert cut.summary["stopping"]["not_at_rest"] == "the clock stands"


def test_nobody_judges_it(stopped: Run, tmp_path: Path) -> None:
    told = call("judge", stopped.folder)
    assert "summary.json says the same" in told
    # What it pressed on the way to rest is more than any tick before.
    rest = stopped.history.rest
    assert rest is not None
    most = max(float(v["force"]) for v in stopped.summary["peaks"].values())
    assert most == pytest.approx(np.abs(stopped.columns["force.x"]).max(), rel=1e-3)
    assert TO_REST not in stopped.summary["peaks"]
    table = tmp_path / "log.csv"
    call("export", stopped.folder, "--csv", table)
    assert TO_REST in table.read_text("utf-8")
    task = stopped.folder / "task.yaml"
    judged = call("judge", task, table, "--out", tmp_path / "judged")
    assert TO_REST not in judged
    assert "is no stage" not in judged
    again = Run.load(tmp_path / "judged")
    assert len(again) == len(stopped)


def test_page_shades_it_and_says_what_it_is(stopped: Run) -> None:
    page = (stopped.folder / "report.html").read_text("utf-8")
    assert "stop controller braked the arm for 500 ms" in page
    assert f'"name": "{TO_REST}"' in page
    assert '"tint": "rest"' in page


def test_other_readers_take_it(stopped: Run, tmp_path: Path) -> None:
    saved = stopped.save(tmp_path / "saved")
    assert Run.load(saved.folder).to_rest is not None
    assert "The runs are equal" in call("diff", stopped.folder, saved.folder)
    call("export", stopped.folder, "--mcap", tmp_path / "log.mcap")
    assert (tmp_path / "log.mcap").stat().st_size
