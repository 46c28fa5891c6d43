"""The referee of benchmarks/referee: its measures against closed forms, laws in a short task."""

from __future__ import annotations

import json
import sys

import numpy as np
import pinocchio as pin
import pytest
from meeting import ROOT, Serving, shipped

from taskspec_runner.link.server import ServerOptions

sys.path.insert(0, str(ROOT / "benchmarks"))
from referee.arm import Arm
from referee.impedance import Impedance
from referee.metrics import BAND, metrics
from referee.operational_space import OperationalSpace
from referee.rebuilt import model_of
from referee.session import Session

TIME = np.arange(5000) * 1e-3
#: The wipe, cut short, and without friction.
WIPE = shipped("wipe-table").read_text("utf-8").replace("time: 8 s", "time: 1 s")
WIPE = WIPE.replace(", friction: 0.2}", "}").replace("  world.table.friction: 0..0.5\n", "")


def test_a_step_that_decays_is_measured_as_its_closed_form():
    """f = F (1 - e^(-t/T)) is within b F from T ln(1/b) on."""
    found = metrics(
        TIME, -20 * (1 - np.exp(-TIME / 0.3)), np.full(5000, -20.0), np.zeros((5000, 1))
    )
    assert found.settled == pytest.approx(0.3 * np.log(1 / BAND), abs=2e-3)
    assert found.overshoot == 0
    # The integral of (F e^(-t/T))^2 over 5 s is F^2 T/2.
    assert found.force_rms == pytest.approx(20 * np.sqrt(0.3 / 2 / 5), rel=5e-3)
    # e^(-t/T) > 1 - 0.1/20 in the first T 0.1/20.
    assert found.lost == pytest.approx(0.3 * 0.1 / 20 / 5, abs=3e-4)
    assert found.path_rms == 0


def test_an_overshoot_a_ramp_and_a_force_that_never_settles():
    ringing = 10 * (1 - np.exp(-TIME) * np.cos(2 * np.pi * TIME))
    found = metrics(TIME, ringing, np.full(5000, 10.0), np.zeros((5000, 0)))
    assert found.overshoot == pytest.approx(10 * np.exp(-0.5), rel=0.03)
    ramp = np.minimum(TIME / 0.5, 1.0) * 10
    late = metrics(TIME, ramp - 2.0, ramp, np.zeros((5000, 0)))
    assert (late.settled, late.force_rms) == (float("inf"), pytest.approx(2.0))


def test_the_error_along_a_path_is_of_all_led_axes():
    off = np.column_stack([3e-3 * np.sin(2 * np.pi * TIME), 4e-3 * np.cos(2 * np.pi * TIME)])
    found = metrics(TIME, np.full(5000, 5.0), np.full(5000, 5.0), off)
    assert found.path_rms == pytest.approx(np.sqrt((3e-3**2 + 4e-3**2) / 2), rel=1e-6)


@pytest.mark.parametrize("law", ["impedance", "operational space"])
def test_a_law_of_others_comes_to_the_end_and_presses(law, tmp_path):
    """Without friction a force that is fed forward comes, but for what the motion takes.

    The impedance does not know the inertia: 0.3 m/s^2 of motion on some 4 kg are 1.2 N at most.
    """
    file = tmp_path / "wipe.yaml"
    file.write_text(WIPE, "utf-8")
    arm = Arm(file)
    made = Impedance(arm, 5.0) if law == "impedance" else OperationalSpace(arm, 987.0, coupled=True)
    with Serving(WIPE, tmp_path / "run", ServerOptions(wait=60.0, answer=30.0)) as serving:
        said = Session(serving.port, law).drive(made)
        run = serving.run
    assert "led to end" in said
    assert run.summary["link"]["name"] == law
    assert run.summary["link"]["clipped"] == 0
    force = np.asarray(run.during("wipe").signals["force.z"])
    assert np.abs(force[500:] + 15).max() < 1.2


@pytest.mark.parametrize("task", ["wipe-table", "own-robot"])
def test_an_arm_that_is_described_is_the_same_arm(task):
    """What is sent to another Pinocchio has the same inertia, bias and tip."""
    arm = Arm(shipped(task))
    said = json.loads(json.dumps(arm.described()))
    model, random = model_of(said), np.random.default_rng(3)
    data, own = model.createData(), arm.model.createData()
    for _ in range(5):
        q, v = random.uniform(-1, 1, (2, model.nv))
        M = pin.crba(model, data, q)
        assert np.triu(M) == pytest.approx(np.triu(arm.inertia(q)), abs=1e-12)
        assert pin.rnea(model, data, q, v, 0 * v) == pytest.approx(arm.bias(q, v), abs=1e-11)
        pin.forwardKinematics(model, data, q)
        pin.framesForwardKinematics(arm.model, own, q)
        tip = data.oMi[said["tip_joint"]].homogeneous @ np.array(said["tip"])
        assert tip == pytest.approx(own.oMf[arm.tip].homogeneous, abs=1e-12)
