"""Matrices of gains, and gains that vary: what stages log of them, and what is wrong in files."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError
from taskspec_runner.trial.check import check

TASK = """
taskspec: 1
name: gains
robot:
  model: ur5e
  tool: {shape: sphere, radius: 10 mm, length: 120 mm, mass: 300 g}
  start: {xyz: [450 mm, 100 mm, 230 mm]}
world:
  table: {shape: plane, xyz: [0, 0, 200 mm], stiffness: 10 kN/m, damping: 60 N*s/m}
law:
  kind: LAW
  GAINS
limits: {force: 80 N, speed: 250 mm/s}
stages:
  press: {axes: {z: {move: -45 mm, speed: 100 mm/s}}, time: 2 s}
"""
SPRINGS = """stiffness:
    x: 900 N/m + 200 N/m * sin(2*pi*t/(0.7 s))
    z: "max(600 N/m + 20 kN/m^2 * table.gap, 200 N/m)"
    xz: 150 N/m + 20 N/m * cos(2*pi*clock/(1 s))
    zrx: 5 N/rad
    rx: 40 N*m/rad"""
MASS = "mass: {x: 4 kg, z: 3 kg, xz: 800 g}"
LAWS = {
    "impedance": f"{MASS}\n  {SPRINGS}",
    "impedance-natural": SPRINGS,
    "pd": SPRINGS,
}


def _matrix(run, name, rows, stage=0):
    """(rows, 6, 6) a gain: what varies from the log, what does not from the plan."""
    axes = ("x", "y", "z", "rx", "ry", "rz")
    found = np.zeros((len(rows), 6, 6))
    for on, gain in run.program.stages[stage].plan.gains[name].items():
        column = f"gain.{name}.{on}"
        values = run[column][rows] if column in run.history.columns else gain.value
        i, j = (axes.index(a) for a in _split(on))
        found[:, i, j] = found[:, j, i] = values
    return found


def _split(on):
    axes = [a for a in ("rx", "ry", "rz", "x", "y", "z") if on == a]
    if axes:
        return on, on
    cut = 2 if on.startswith("r") else 1
    return on[:cut], on[cut:]


@pytest.mark.parametrize("law", LAWS)
def test_the_torque_follows_from_the_log(simulate, law):
    """(4.16), (4.18), (4.21) once more, by NumPy and Pinocchio, from the logged gains and signals.

    The reference rests after its move, and nothing is left of the torque that was handed over.
    """
    run = simulate(TASK.replace("LAW", law).replace("GAINS", LAWS[law]))
    robot = run.program.context.robot
    t = run["t"]
    rows = np.flatnonzero((t > 1.2) & (t < 1.9))[::50]
    assert len(rows) > 10
    at = [f"{a}" for a in ("x", "y", "z", "rx", "ry", "rz")]
    e = np.column_stack([run[f"error.{a}"][rows] for a in at])
    K, D = _matrix(run, "stiffness", rows), _matrix(run, "damping", rows)
    M = _matrix(run, "mass", rows)
    assert np.ptp(K[:, 0, 0]) > 50
    assert np.ptp(K[:, 0, 2]) > 10
    assert np.ptp(D[:, 0, 2]) > 0
    data, frame = robot.pin.createData(), robot.pin.getFrameId("tip")
    for k, row in enumerate(rows):
        q, v = (
            np.array([run[f"joint.{i + 1}.{what}"][row] for i in range(6)])
            for what in ("position", "velocity")
        )
        pin.computeJointJacobians(robot.pin, data, q)
        pin.forwardKinematics(robot.pin, data, q, v, np.zeros(6))
        pin.updateFramePlacements(robot.pin, data)
        J = pin.getFrameJacobian(robot.pin, data, frame, pin.LOCAL_WORLD_ALIGNED)
        drift = pin.getFrameClassicalAcceleration(
            robot.pin, data, frame, pin.LOCAL_WORLD_ALIGNED
        ).vector
        H = pin.crba(robot.pin, data, q)
        H = np.triu(H) + np.triu(H, 1).T
        bias = pin.rnea(robot.pin, data, q, v, np.zeros(6))
        gravity = pin.rnea(robot.pin, data, q, np.zeros(6), np.zeros(6))
        twist = J @ v
        applied = np.array(
            [run[f"{'torque' if 'r' in a else 'force'}.{a}.measured"][row] for a in at]
        )
        pull = K[k] @ e[k] - D[k] @ twist
        if law == "pd":
            u = J.T @ pull + gravity
        elif law == "impedance-natural":
            u = H @ np.linalg.solve(J, -drift) + bias + J.T @ pull
        else:
            wanted = np.linalg.solve(M[k], pull - applied)
            u = H @ np.linalg.solve(J, wanted - drift) + bias + J.T @ applied
        logged = np.array([run[f"joint.{i + 1}.torque"][row] for i in range(6)])
        np.testing.assert_allclose(logged, u, rtol=1e-10, atol=1e-10 * np.max(np.abs(u)))


def test_the_designed_damping_follows(simulate):
    """D of the log is that of the logged M and K: each mode is damped by 0.7."""
    run = simulate(TASK.replace("LAW", "impedance").replace("GAINS", LAWS["impedance"]))
    rows = np.flatnonzero(run["t"] > 0.1)[::100]
    assert len(rows) > 10
    on = np.ix_([0, 2, 3], [0, 2, 3])
    for M, D, K in zip(
        *(_matrix(run, name, rows) for name in ("mass", "damping", "stiffness")), strict=True
    ):
        L = np.linalg.cholesky(M[on])
        K, D = (np.linalg.solve(L, np.linalg.solve(L, X[on]).T) for X in (K, D))
        values, V = np.linalg.eigh(K)
        np.testing.assert_allclose(
            V.T @ D @ V, np.diag(1.4 * np.sqrt(values)), atol=1e-10 * np.max(D)
        )


def test_constants_stay_parameters():
    """A gain without an expression is a number that an entry fills, beside those that vary."""
    text = TASK.replace("LAW", "impedance").replace("GAINS", LAWS["impedance"])
    program = compile_unchecked(load_text(text, "task.yaml"))
    stage = program.stages[0]
    assert stage.plan.law.varying
    assert "gain.mass.xz" in stage.parameters
    assert program.context.loaded.task.varying_gains == stage.plan.law.varying
    plain = compile_unchecked(load_text(text.replace(SPRINGS, "stiffness: 900 N/m"), "task.yaml"))
    assert "frozen" not in plain.stages[0].parameters
    assert not plain.context.loaded.task.varying_gains


FALLING = "stiffness: {z: 1 kN/m - 30 kN/m^2 * table.gap}"


def test_a_run_stops_where_a_gain_is_not_positive(simulate):
    """At 33 mm above the table this stiffness is zero; the arm goes up."""
    text = TASK.replace("LAW", "impedance").replace("GAINS", FALLING).replace("-45 mm", "30 mm")
    run = simulate(text)
    assert (run.outcome.status, run.outcome.reason) == ("stopped", "gain")
    assert run["gain.stiffness.z"][-1] < 0 < run["gain.stiffness.z"][-2]
    assert [d.code for d in findings(text)] == ["TS219"]


MISTAKES = {
    # reversed, and given twice
    "stiffness: {x: 1 kN/m, z: 1 kN/m, zx: 100 N/m}": ("TS215", "its entry 'xz'"),
    "stiffness: {x: 1 kN/m, z: 1 kN/m, xz: 1 N/m, zx: 2 N/m}": ("TS215", "is given, too"),
    "stiffness: [[1 kN/m, 0], [0, 1 kN/m]]": ("TS215", "by its entries, not by rows"),
    # indefinite
    "stiffness: {x: 1 kN/m, z: 2 kN/m, xz: 2 kN/m}": (
        "TS216", "its least eigenvalue is -561.6 N/m, along 0.79 x - 0.62 z"
    ),
    # units of a mixed block
    "stiffness: {x: 1 kN/m, xry: 20 N/m}": ("TS112", "a force per angle"),
    "mass: {x: 4 kg, ry: 0.1 kg*m^2, xry: 0.1 kg}": ("TS112", "a mass times a length (kg*m)"),
    # no signal of a law
    "stiffness: {z: 1 kN/m - 1 kN/m^2 * error.z}": ("TS224", "cannot depend on the error"),
    "stiffness: {z: 1 kN/m * gain.stiffness.x/(1 N/m)}": ("TS224", "makes its gains"),
    "stiffness: {z: 1 kN/m * wall.gap/(1 m)}": ("TS120", "wall"),
    # never positive
    "stiffness: {z: 100 N/m * (sin(t * 1 rad/s) - 2)}": ("TS218", "is never positive"),
    "stiffness: {z: 500 N/m - 300 N/m * t/(1 s)}": ("TS218", "may come to -100.3 N/m"),
    "stiffness: {z: 1 kN/m - 50 kN/m^2 * table.gap}": ("TS218", "is -500 N/m at the start"),
}  # fmt: skip


#: Laws that have no such gains, and stages without the axes: the law and what is wrong with it.
ELSEWHERE = {
    "{kind: hybrid, bandwidth: {x: 5 Hz, xz: 1 Hz}}": ("TS215", "it has no entry 'xz'"),
    "{kind: hybrid, bandwidth: 5 Hz + 1 Hz * t/(1 s)}": ("TS116", "'t'"),
    "{kind: hybrid, force: {integral: {x: 1 Hz, z: 1 Hz, xz: 0.1 Hz}}}": ("TS217", "axis by axis"),
    "{kind: hybrid, force: {integral: 1 Hz + 1 Hz * t/(1 s)}}": ("TS257", "are constants"),
    "{kind: parallel, force: {integral: {x: 1 Hz, z: 1 Hz, xz: 0.1 Hz}}}": (
        "TS217", "no force loop is on 'x'"
    ),
    "{kind: parallel, force: {integral: {z: 1 Hz, zrx: 1 Hz}}}": ("TS215", "in other units"),
}  # fmt: skip


@pytest.mark.parametrize("law", ELSEWHERE)
def test_what_a_law_does_not_have(law):
    code, words = ELSEWHERE[law]
    text = TASK.replace("law:\n  kind: LAW\n  GAINS", f"law: {law}")
    found = findings(text.replace("move: -45 mm, speed: 100 mm/s", "force: -5 N"))
    assert any(d.code == code and words in d.message for d in found), [
        (d.code, d.message) for d in found
    ]


def test_an_axis_that_the_arm_does_not_have():
    text = """
taskspec: 1
robot: {model: planar3}
law: {kind: impedance, stiffness: {x: 1 kN/m, z: 1 kN/m, xz: 10 N/m}}
stages:
  wait: {time: 1 s}
"""
    [found] = findings(text)
    assert (found.code, found.message) == (
        "TS217",
        "'xz' couples nothing: stage 'wait' has no axis 'z'",
    )


@pytest.mark.parametrize("gains", MISTAKES)
def test_mistakes(gains):
    code, words = MISTAKES[gains]
    found = findings(TASK.replace("LAW", "impedance").replace("GAINS", gains))
    assert any(d.code == code and words in d.message for d in found), [
        (d.code, d.message) for d in found
    ]


def findings(text):
    try:
        return check(load_text(text, "task.yaml")).findings
    except SpecError as error:
        return error.diagnostics
