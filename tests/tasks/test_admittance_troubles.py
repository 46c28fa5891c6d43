"""The troubles of docs/how-to/admittance.md: there in the bad run, and not in the good one."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from taskspec.examination import examine
from taskspec.laws.admittance import beyond
from taskspec.laws.case import Case
from taskspec.laws.gains import Gain
from taskspec.program import drives
from taskspec.spec import load_text

DOCS = Path(__file__).resolve().parents[2] / "docs" / "how-to"
#: The damping of the page's soft pad, on steel.
SOFT = {"law": "{kind: admittance, damping: {z: 300 N*s/m}}"}


def text(trouble: str) -> str:
    return (DOCS / f"admittance-{trouble}.yaml").read_text(encoding="utf-8")


def codes(trouble: str, rest: str = "", **overrides: str) -> set[str]:
    loaded = load_text(text(trouble) + rest, "task.yaml", overrides)
    return {each.code for each in examine(loaded).findings}


def losses(force: np.ndarray) -> int:
    """How often a contact is lost."""
    return int(np.sum((force[:-1] < 0) & (force[1:] == 0)))


def test_a_soft_contacts_damping_bounces_on_steel(simulate):
    assert "TS501" in codes("bounce", **SOFT)
    force = simulate(text("bounce"), SOFT).during("press", "force.z")
    assert losses(force) > 10
    assert force[len(force) // 2 :].min() < -40

    assert not codes("bounce")
    force = simulate(text("bounce")).during("press", "force.z")
    assert losses(force) == 0
    assert force[len(force) // 2 :].std() < 0.1


def test_a_bias_drifts_and_a_tare_with_a_dead_band_does_not(simulate):
    """The tool goes with what the sensor shows, less the dead band, over the damping."""

    def drift(**overrides: str) -> float:
        return simulate(text("drift"), overrides).during("lead", "travel").max()

    damping, led = 500.0, 1.9  # as designed [N s/m], and the stage without its ramp [s]
    bias = np.hypot(2.0, 3.0)
    untared = drift(**{"law": "admittance", "stages.zero.tare": "false"})
    # The undeclared weight is there, too.
    assert untared == pytest.approx(bias * led / damping, rel=0.3)
    weight = 2 * 0.1 * 9.81 * np.sin(np.radians(45 / 2))
    assert drift(law="admittance") == pytest.approx(weight * led / damping, rel=0.05)
    assert drift() < 1e-5
    # The dead band's size is in the file, and a tool that is declared needs none.
    assert drift(**{"law": "admittance", "robot.tool.mass": "500 g"}) < 2e-4


def test_forces_within_a_dead_band_move_nothing_and_others_by_the_rest():
    forces = np.array([-3.0, -2.0, -1.0, 0.0, 1.9, 2.5])
    moved = [float(beyond(force, Gain(2.0, "file"))) for force in forces]
    assert moved == pytest.approx([-1.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    assert [beyond(force, None) for force in forces] == list(forces)


def test_a_dead_band_hides_no_instability():
    law = "{kind: admittance, damping: {z: 300 N*s/m}, dead_band: 1 N}"
    assert "TS501" in codes("bounce", law=law)


def test_a_command_that_is_not_carried_jumps(simulate):
    """The greatest change of a joint's command and of its torque from tick to tick."""

    def jumps(name: str) -> tuple[float, float]:
        run = simulate(text("switch") + f"# {name}\n")
        begins = int(np.argmax(run.history.window("press")))
        near = slice(begins - 1, begins + 5)
        command = [run[f"joint.{j}.velocity.command"][near] for j in range(1, 7)]
        torque = [run[f"joint.{j}.torque"][near] for j in range(1, 7)]
        return np.abs(np.diff(command)).max(), np.abs(np.diff(torque)).max()

    carried, shock = jumps("as it is")
    assert shock < 2.0
    with patch.object(drives, "VELOCITY_FADING", 1e-9):
        step, shock = jumps("not carried")
    assert carried < 0.2 * step
    assert shock > 10.0


def test_a_memory_that_goes_on_at_a_limit_keeps_the_arm_there(simulate):
    def leaves(name: str) -> float:
        """When joint 6 is a degree off its limit for good, after the push has turned [s]."""
        run = simulate(text("windup") + f"# {name}\n")
        q, clock = np.degrees(run["joint.6.position"]), run["clock"]
        assert 359 < q.max() < 360
        return float(clock[np.flatnonzero(q > 359)[-1]]) - 1.5

    mass_by_damping = 1.0
    assert leaves("as it is") < 0.25 * mass_by_damping
    with patch.object(Case, "kept", lambda *given: given[-1]):
        assert leaves("memory goes on") > np.log(2) * mass_by_damping
    stopped = simulate(text("windup"), {"law.solve": "closed-form"})
    assert stopped.outcome.reason == "joint_position"


def test_an_oscillation_begins_as_the_delay_grows(simulate):
    def amplitude(delay: str, **overrides: str) -> float:
        run = simulate(text("delay"), {"robot.servo.delay": delay, **overrides})
        return float(np.ptp(run.during("press", "force.z", start=0.8)) / 2)

    assert not codes("delay")
    assert amplitude("2 ms") < 0.1
    assert "TS502" in codes("delay", **{"robot.servo.delay": "4 ms"})
    assert "TS501" in codes("delay", **{"robot.servo.delay": "10 ms"})
    assert amplitude("10 ms") > 15
    assert not codes("delay", **{"robot.servo.delay": "10 ms"}, law="admittance")
    assert amplitude("10 ms", law="admittance") < 0.2


@pytest.mark.parametrize(
    "section", ["vary: {robot.servo.delay: 2..10 ms}", "truth: {robot.servo.delay: 10 ms}"]
)
def test_a_delay_that_may_grow_is_reported(section):
    assert "TS503" in codes("delay", section)
    assert not codes("delay", section, law="admittance", **{"robot.servo.delay": "10 ms"})
