"""A plant elsewhere gives the same bits: in lock-step nothing is late, and nothing can be lost."""

from __future__ import annotations

from pathlib import Path

import pytest
from meeting import (
    POSITIONS,
    RAIL,
    SENSED,
    TOUCH,
    VELOCITIES,
    Proxy,
    Serving,
    drive,
    drive_at,
    log_bytes,
    own_columns,
    program_of,
    same_bits,
)

from taskspec_runner.link.simulated import SimulatedRobot
from taskspec_runner.session import execute_program

PROGRAM = TOUCH.replace("stages:\n", "law: {kind: hybrid, solve: qp}\nstages:\n")
EXACT = RAIL.replace("stiffness: 2 kN*m/rad, damping: 5 N*m*s/rad", "stiffness: exact")
#: A perfect and a real sensor; a program of limits; a screw that is held; equations; servos.
TASKS = {
    "touch": TOUCH, "sensed": SENSED, "qp": PROGRAM, "screw": "screw", "rail": RAIL, "exact": EXACT,
    "velocities": VELOCITIES, "positions": POSITIONS,
}  # fmt: skip


@pytest.mark.parametrize("name", TASKS)
def test_log_of_a_served_plant_has_the_same_bytes(name: str, tmp_path: Path) -> None:
    task = TASKS[name]
    plain = execute_program(program_of(task), tmp_path / "plain", report=False)
    with Serving(task, tmp_path / "served") as serving:
        driven = drive_at(task, serving.url, tmp_path / "driven")
        served = serving.run
    assert log_bytes(served) == log_bytes(plain)
    told = {k: v for k, v in served.summary.items() if k != "link"}
    assert told == plain.summary
    assert len(driven) == len(plain)
    same_bits(driven, plain, own_columns(driven))
    assert driven.manifest["seed"] is None
    assert "link.lost" not in driven.history.columns


@pytest.mark.parametrize("name", ["touch", "sensed", "velocities", "positions"])
def test_simulated_robot_gives_the_same_bits(name: str, tmp_path: Path) -> None:
    program = program_of(TASKS[name])
    plain = execute_program(program, tmp_path / "plain", report=False)
    run = drive(TASKS[name], SimulatedRobot(program), tmp_path / "robot")
    assert len(run) == len(plain)
    same_bits(run, plain, own_columns(run))


@pytest.mark.parametrize("seed", range(3))
def test_lock_step_bears_any_network(seed: int, tmp_path: Path) -> None:
    plain = execute_program(program_of(TOUCH), tmp_path / "plain", report=False)
    with (
        Serving(TOUCH, tmp_path / "served") as serving,
        Proxy(serving.port, seed, drop=0.03, twice=0.05, late=0.05, rubbish=0.05) as between,
    ):
        drive_at(TOUCH, between.url, tmp_path / "driven")
        served = serving.run
    assert log_bytes(served) == log_bytes(plain)
    assert served.summary["link"]["repeated"] > 0
