"""Output feedback: encoders with lines, estimated velocities, compensated friction."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.examination import examine
from taskspec.laws.friction import Compensation
from taskspec.program.velocity_estimate import VelocityEstimate
from taskspec.robot.model_terms import PinocchioTerms
from taskspec.spec import load_task, load_text
from taskspec.spec.joint_velocity import VelocitySource
from taskspec.stability.hunting import gained, passed_on
from taskspec.stability.sampled_stage import loop_of

sys.path.append(str(Path(__file__).resolve().parents[1] / "theory"))
from identify import poles

T = 1e-3
TASKS = Path(__file__).resolve().parents[2] / "tasks"
TASK = """\
taskspec: 1
name: feedback
robot:
  model: panda
  tool: {{shape: sphere, radius: 10 mm, length: 100 mm, mass: 300 g}}
  start: {{xyz: [500 mm, {side} mm, 305 mm]}}
  encoder: {{resolution: {resolution}}}
  joint_friction: {friction}
control: {{{control}}}
world: {{table: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: 5 kN/m, damping: 20 N*s/m}}}}
frames: {{task: {{surface: table}}}}
frame: task
law: {{{law}}}
stages:
  press: {{axes: {{z: {{position: -8 mm}}}}, time: 0.3 s}}
  away: {{axes: {{z: {{move: 15 mm}}, x: {{move: {far} mm}}}}, time: 0.4 s}}
expect: []
"""
PD = "kind: pd, stiffness: 1 kN/m, damping: 150 N*s/m"
ESTIMATES = {
    "differences": "differences",
    "filter": "{filter: 50 Hz}",
    "observer": "{observer: 40 Hz}",
}


def text_of(control: str, **others: object) -> str:
    given = {"resolution": "0.2 mrad", "friction": 0, "law": PD, "far": 30, "side": 0}
    return TASK.format(control=control, **(given | others))


def joints(run, signal: str) -> np.ndarray:
    """(ticks, n) of a signal of all joints."""
    return np.column_stack([run[f"joint.{i + 1}.{signal}"] for i in range(7)])


def estimate(source: str) -> VelocityEstimate:
    kinds = {
        "differences": VelocitySource(filter="none"),
        "filter": VelocitySource(filter=50.0),
        "observer": VelocitySource(observer=40.0),
    }
    found = VelocityEstimate.of(kinds[source], T)
    assert found is not None
    return found


def accelerations(run, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(ticks, n) H^-1 (u + J^T f - C v - g) of logged ticks, by Pinocchio."""
    terms, found = PinocchioTerms(run.program.context.robot), []
    torque, force = joints(run, "torque"), np.zeros((len(q), 6))
    for row, axis in enumerate(("x", "y", "z")):
        force[:, row] = -run[f"force.{axis}.measured"]
        force[:, 3 + row] = -run[f"torque.r{axis}.measured"]
    for at, rate, u, f in zip(q, v, torque, force, strict=True):
        terms.at(at, rate)
        pull = terms.jacobian.T @ f
        found.append(np.linalg.solve(terms.inertia, u + pull - terms.bias))
    return np.array(found)


def second(source: str, q: np.ndarray, a: np.ndarray | None) -> np.ndarray:
    """(ticks, n) velocities, by the textbook's forms and not by the code's."""
    found = np.zeros_like(q)
    if source != "observer":
        b = np.exp(-2 * np.pi * 50 * T) if source == "filter" else 0.0
        before = np.zeros(q.shape[1])
        for k in range(1, len(q)):
            before = found[k] = b * before + (1 - b) * (q[k] - q[k - 1]) / T
        return found
    assert a is not None
    z = np.exp(-2 * np.pi * 40 * T)
    A, C = np.array([[1, T], [0, 1]]), np.array([[1.0, 0.0]])
    # Ackermann's formula places both poles of A (I - L C) at z.
    shifted = np.linalg.matrix_power(A - z * np.eye(2), 2)
    L = shifted @ np.linalg.inv(np.vstack([C @ A, C @ A @ A])) @ np.array([[0.0], [1.0]])
    x = np.stack([q[0], np.zeros(q.shape[1])])
    for k in range(len(q)):
        x = x + L @ (q[k] - C @ x)
        found[k] = x[1]
        x = A @ x + np.array([[T * T / 2], [T]]) * a[k]
    return found


@pytest.mark.parametrize("source", ESTIMATES)
def test_velocities_are_those_of_a_second_implementation(source, simulate) -> None:
    run = simulate(text_of(f"velocity: {ESTIMATES[source]}"))
    q, v = joints(run, "position.measured"), joints(run, "velocity.measured")
    lines = 2e-4 * np.floor(joints(run, "position") / 2e-4 + 0.5)
    np.testing.assert_allclose(q, lines, atol=1e-15)
    assert np.ptp(q, axis=0).max() > 0.01
    a = accelerations(run, q, v) if source == "observer" else None
    np.testing.assert_allclose(v, second(source, q, a), atol=1e-10)


@pytest.mark.parametrize("source", ESTIMATES)
@pytest.mark.parametrize("seed", range(4))
def test_lines_move_velocities_by_no_more_than_the_bound(source, seed, simulate) -> None:
    """Whatever the law does: the same estimate of exact positions is nowhere further away."""
    random = np.random.default_rng(seed)
    r = float(np.exp(random.uniform(np.log(2e-5), np.log(5e-4))))
    given = {"resolution": f"{r!r} rad", "far": random.uniform(-60, 60), "side": 30 * seed}
    run = simulate(text_of(f"velocity: {ESTIMATES[source]}", **given))
    q, v = joints(run, "position.measured"), joints(run, "velocity.measured")
    a = accelerations(run, q, v) if source == "observer" else None
    exact = second(source, joints(run, "position"), a)
    # The first tick takes the shown position for one at rest.
    off = np.abs(v - exact)[200:].max()
    bound = r / 2 * estimate(source).of_position
    assert 0.3 * bound < off <= bound * (1 + 1e-9)


@pytest.mark.parametrize("source", ESTIMATES)
def test_closed_forms_are_those_of_the_recursion(source) -> None:
    e = estimate(source)
    error = np.array([[1 - e.position, (1 - e.position) * T], [-e.rate / T, 1 - e.rate]])
    h, x = [], np.array([e.position, e.rate / T])
    for _ in range(2000):
        h.append(x[1])
        x = error @ x
    assert e.of_position == pytest.approx(np.abs(h).sum(), rel=1e-9)
    assert e.of_noise == pytest.approx(np.linalg.norm(h), rel=1e-9)
    push = np.array([(1 - e.position) * T**2 / 2, (1 - e.rate / 2) * T])
    lag = np.linalg.solve(np.eye(2) - error, push)[1]
    assert e.of_acceleration == pytest.approx(lag, rel=1e-9)
    # No response to an acceleration changes its sign: what it comes to in the end is the most.
    k, x = [], push
    for _ in range(2000):
        k.append(x[1])
        x = error @ x
    assert np.abs(k).sum() == pytest.approx(e.of_acceleration, rel=1e-9)
    z = np.exp(-2 * np.pi * {"differences": np.inf, "filter": 50, "observer": 40}[source] * T)
    wanted = sorted([z, z] if source == "observer" else [0, z])
    np.testing.assert_allclose(sorted(np.linalg.eigvals(error).real), wanted, atol=1e-7)


STEP = """\
taskspec: 1
robot: {{model: {model}, start: {{xyz: [{start}]}}}}
control: {{velocity: {velocity}}}
law: {{kind: impedance, stiffness: {stiffness}, damping: {damping}}}
stages:
  step: {{axes: {{x: {{position: 2 mm}}}}, time: 2 s}}
expect: []
"""


@pytest.mark.parametrize(
    ("velocity", "stiffness", "damping"),
    [
        ("{filter: 5 Hz}", "1 kN/m", "40 N*s/m"),
        ("{filter: 2 Hz}", "2 kN/m", "150 N*s/m"),
        ("{observer: 3 Hz}", "1 kN/m", "15 N*s/m"),
    ],
)
def test_rates_of_runs_are_those_of_the_sampled_loop(velocity, stiffness, damping, simulate):
    """Of the mode that a motion of 2 mm along x leaves, beside others that are fitted as well."""
    given = {"model": "planar2", "start": "400 mm, 200 mm, 0"}
    given |= {"velocity": velocity, "stiffness": stiffness, "damping": damping}
    run = simulate(STEP.format(**given))
    sampled = loop_of(run.program.plan, "step")
    assert sampled is not None
    predicted = next(mode.s for mode in sampled.modes() if mode.s.imag > 1)
    fitted = poles(run.during("step", "error.x", 0.22, 0.92), 6, T, 10)
    off = np.abs(fitted - predicted).min()
    # Rates, as they are less than the frequencies of these modes, to 2 %.
    assert off < 0.02 * abs(predicted.real)


RUBS = """\
taskspec: 1
robot: {{model: panda, start: {{xyz: [500 mm, {side} mm, 310 mm]}}, joint_friction: {declared} N*m,
        joint_damping: 0.5 N*m*s/rad}}
control: {{friction: {{share: 80 %, width: {width} mrad/s}}}}
law: {{kind: impedance, stiffness: {k} kN/m}}
stages:
  go: {{axes: {{x: {{move: {x} mm}}, y: {{move: {y} mm}}}}, time: 1.2 s}}
truth: {{robot.joint_friction: {true} N*m}}
expect: []
"""


def rubbing(seed: int, **others: float) -> dict[str, float]:
    random = np.random.default_rng(seed)
    x, y = random.uniform(-40, 40, 2)
    given = {"side": random.uniform(-100, 100), "declared": random.uniform(0.2, 2), "x": x, "y": y}
    given |= {"k": random.uniform(0.5, 2), "width": random.uniform(5, 20)}
    return given | {"true": given["declared"] * random.uniform(0.8, 1.2)} | others


@pytest.mark.parametrize("seed", range(5))
def test_what_is_compensated_is_the_equation_and_never_gives_energy(seed, simulate) -> None:
    """With friction as large as what is compensated, both together take energy at every tick."""
    given = rubbing(seed)
    run = simulate(RUBS.format(**given))
    u, v = joints(run, "torque.friction"), joints(run, "velocity")
    terms = PinocchioTerms(run.program.context.robot)
    error = np.column_stack([run[f"error.{a}"] for a in ("x", "y", "z", "rx", "ry", "rz")])
    rate = np.column_stack([run[f"velocity.{a}.ref"] for a in ("x", "y", "z", "rx", "ry", "rz")])
    q, gained = joints(run, "position"), []
    for k in range(0, len(q), 7):
        terms.at(q[k], v[k])
        H, J = terms.inertia, terms.jacobian
        back = np.linalg.solve(H, J.T) @ np.linalg.inv(J @ np.linalg.solve(H, J.T))
        moved = back @ rate[k]
        wanted = (moved + back @ error[k] / 0.1) / (1e-3 * given["width"])
        sign = np.sin(np.arctan(wanted))
        own = 0.8 * (given["declared"] * sign + 0.5 * moved)
        np.testing.assert_allclose(u[k], own, atol=1e-10)
        # The viscous part is the reference's, and no part of this.
        power = v[k] * (u[k] - 0.4 * moved) - given["true"] * np.abs(v[k])
        assert (power <= 0).all()
        gained.append(power.min())
    assert min(gained) < -1e-3


@pytest.mark.parametrize("seed", range(4))
def test_joints_rest_within_the_bound(seed, simulate) -> None:
    """|K e + u_f| <= tau in each joint where the arm has come to rest, nearer than without."""
    given = rubbing(seed)
    text = RUBS.format(**given).replace("time: 1.2 s", "time: 1.5 s")
    run = simulate(text)
    pull = joints(run, "torque")[-1]
    terms = PinocchioTerms(run.program.context.robot)
    terms.at(joints(run, "position")[-1], 0 * pull)
    # MuJoCo lets a joint that friction holds creep: by less than 1 % of the friction.
    assert np.abs(pull - terms.gravity).max() <= given["true"] * 1.01
    start, end = text.index("control:"), text.index("law:")
    plain = simulate(text[:start] + text[end:])
    far = [np.linalg.norm([each[f"error.{a}"][-1] for a in "xyz"]) for each in (run, plain)]
    assert far[0] < far[1]


def test_the_root_of_the_bound() -> None:
    c = Compensation((0.8,), (0.0,), 0.01, 0.1)
    e = c.rests_within(0, 10.0, 1.0)
    assert 10 * e + 0.8 * e / np.hypot(e, 1e-3) == pytest.approx(1.0)
    assert e == pytest.approx((1 - 0.8) / 10, rel=0.01)
    assert c.stiffness(0) == pytest.approx(800)


def test_what_the_smooth_sign_passes_on_of_a_swing() -> None:
    """1 of a small one, 4/(pi a) of a large one, and by an own quadrature between."""
    assert passed_on(1e-4) == pytest.approx(1, rel=1e-7)
    assert passed_on(100) == pytest.approx(4 / (np.pi * 100), rel=1e-3)
    t = np.linspace(0, 2 * np.pi, 10001)
    x = 3 * np.sin(t)
    first = np.trapezoid(x / np.sqrt(1 + x * x) * np.sin(t), t) / np.pi
    assert passed_on(3.0) == pytest.approx(first / 3, rel=1e-6)


@pytest.mark.parametrize(
    ("width", "true", "hunts"), [(10, 0, False), (0.3, 0, True), (0.3, 0.8, False)]
)
def test_too_much_compensation_hunts_where_its_loop_is_unstable(width, true, hunts, simulate):
    given = {"declared": 1, "true": true, "width": width, "x": 20, "y": 0, "k": 1, "side": 0}
    run = simulate(RUBS.format(**given).replace("0.5 N*m*s/rad", "0"))
    sampled, friction = loop_of(run.program.plan, "go"), run.program.context.friction
    assert sampled is not None
    gain = gained(sampled, friction, np.full(7, float(true)))
    # Where nothing rubs any swing that grows at all goes on.
    assert (gain > 1) == (width < 1 and true == 0)
    end = joints(run, "velocity")[-200:]
    assert (np.std(end, axis=0).max() > 0.05) == hunts


@pytest.mark.parametrize(
    ("width", "true", "said"),
    [
        (10, 0, None),
        (0.3, 0.8, None),
        (0.3, 0.2, "times what friction takes of it in each period, and may go on (hunt)"),
        (
            0.05,
            0.1,
            "times what friction takes of it in each period, and is likely to go on (hunt)",
        ),
        (0.3, 0, "gains energy, and no friction takes any of it in each period, and is likely to"),
    ],
)
def test_what_is_said_of_more_compensation_than_friction(width, true, said) -> None:
    given = {"declared": 1, "true": true, "width": width, "x": 20, "y": 0, "k": 1, "side": 0}
    text = RUBS.format(**given).replace("0.5 N*m*s/rad", "0")
    findings = examine(load_text(text, "task.yaml")).findings
    found = [each.message for each in findings if each.code == "TS518"]
    assert len(found) == (said is not None)
    assert said is None or said in found[0]


@pytest.mark.parametrize(
    ("task", "own", "others"),
    [
        (
            "coarse-encoders",
            "{observer: 30 Hz}",
            ["differences", *(f"{{filter: {f} Hz}}" for f in (10, 30, 50, 100))],
        ),
        ("sticking-joints", "control: {friction: 80 %}\n", [""]),
    ],
)
def test_the_plain_law_fails_where_this_one_does_not(task, own, others) -> None:
    """No corner of a filter does: it lags too far, or shakes the tool."""
    text = (TASKS / f"{task}.yaml").read_text(encoding="utf-8")
    assert own in text
    assert succeeds(text)
    assert others
    assert not any(succeeds(text.replace(own, other)) for other in others)


def succeeds(text: str) -> bool:
    """Whether a task comes to its end, and meets what it expects."""
    from taskspec_runner.trial.trial import trial

    found = trial(compile_unchecked(load_text(text, "task.yaml")))
    assert found.judged
    return found.outcome.status == "done" and all(each.passed for each in found.judged)


def test_logs_without_the_keys_have_no_column_more() -> None:
    program = compile_unchecked(load_task(TASKS / "press-hybrid.yaml"))
    assert program.machine().estimator is None
    assert program.stages[0].compensated is None
