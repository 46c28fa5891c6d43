"""Stages that are stable where they begin, and not where their way leads them."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.examination import check_task
from taskspec.planning import plan_task
from taskspec.spec import load_text
from taskspec.text.diagnostic import Diagnostic

#: A rail that the arm goes round without moving any joint by 0.3 rad: across its arm's length the
#: tip is five times as light as where it begins.
RAIL = """
taskspec: 1
robot: {model: ur5e, tool: {shape: sphere, radius: 9 mm, length: 142 mm},
  joint_damping: 0.33 N*m*s/rad, start: {xyz: [569 mm, 71 mm, 230 mm]}}
world:
  rim: {equation: "x^2 + y^2 = (77 mm)^2", frame: rail, stiffness: STIFF, damping: 130 N*s/m}
  level: {equation: "z = 0", frame: rail, stiffness: STIFF, damping: 130 N*s/m}
frames: {rail: {xyz: [492 mm, 71 mm, 230 mm]}}
frame: rail
law: {kind: hybrid-multipliers, bandwidth: 6.7 Hz, force: {integral: 8.6 /s}}
stages:
  press: {constraints: {rim: {force: 8.7 N, ramp: 0.4 s}}, time: 1 s}
  round:
    constraints: {rim: {force: 8.7 N}}
    path: {arc: {center: [0, 0], turns: 0.44}, time: 1.8 s}
"""


def _findings(stiffness: str, extra: str = "") -> list[Diagnostic]:
    found = check_task(load_text(RAIL.replace("STIFF", stiffness) + extra, "t.yaml"))
    return [d for d in found if d.code in ("TS307", "TS501")]


def _flips(values: np.ndarray) -> float:
    """Amplitude of what alternates from tick to tick [N]."""
    return float(np.abs(np.diff(values, 4)).max()) / 16


def test_a_contact_that_the_steps_do_not_resolve_on_the_way(simulate) -> None:
    [found] = _findings("200 kN/m")
    assert found.code == "TS307"
    assert "of stage 'round'" in found.message
    run = simulate(RAIL.replace("STIFF", "200 kN/m"))
    assert run.outcome.reason == "joint_velocity"  # no limit of the file stops it before
    assert not _findings("200 kN/m", "control: {plant_rate: 4 kHz}")


def test_a_stage_that_is_unstable_on_its_way(simulate) -> None:
    """At 60 kN/m it flips between 0.9 s and 1.2 s, and calms down behind that."""
    [found] = _findings("60 kN/m")
    assert found.code == "TS501"
    assert "stage 'round' is unstable at t =" in found.message
    run = simulate(RAIL.replace("STIFF", "60 kN/m"))
    assert _flips(run.during("round", "rim.force", 0.5, 0.8)) < 1e-6
    assert _flips(run.during("round", "rim.force", 0.8, 1.3)) > 5


def test_gains_of_a_curved_equation_are_those_of_the_lightest_direction() -> None:
    """Of all directions in the plane of the rail, its gradient comes to each."""
    stage = plan_task(load_text(RAIL.replace("STIFF", "200 kN/m"), "t.yaml")).stages["press"]
    context = stage.context
    J = context.start_jacobian[:2]
    lightest = 1 / np.linalg.eigvalsh(J @ np.linalg.solve(context.start_inertia, J.T))[-1]
    designed = stage.gains["force.damping"]["rim"].value
    assert designed == pytest.approx(lightest / (3 * context.period), rel=0.01)
