"""Where limits collide, which of them is kept; and what happens where there is no answer at all."""

from __future__ import annotations

from contextlib import closing
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from random_states import States, press_text
from scipy.optimize import linprog

from taskspec.compiler import compile_unchecked
from taskspec.control.qp import QuadraticProgram, Solution, Status
from taskspec.control.qp.quadratic_program import unsolved
from taskspec.program.execution.stage_solver import HELD_TICKS
from taskspec.program.limits.bounds import PRECEDENCE
from taskspec.program.limits.relaxing import relax
from taskspec.spec import load_text
from taskspec_runner.loop import fixed_step as loop
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.record.log import Log

T = 1e-3
#: What bounds are widened by beyond what it takes, and rounding of rows of up to 1e3.
SPARE = 1e-4


def collide(
    *rows: tuple[str, float, float], slope: float = 1.0
) -> tuple[QuadraticProgram, list[str]]:
    """A program in two unknowns with rows on the first: (kind, lower, upper)."""
    A = np.array([[slope, 0.0] for _ in rows])
    low, high = (np.array([row[i] for row in rows]) for i in (1, 2))
    problem = QuadraticProgram(
        np.eye(2), np.zeros(2), np.ascontiguousarray(A), low.copy(), high.copy()
    )
    return problem, [kind for kind, _, _ in rows]


@pytest.mark.parametrize(("stronger", "weaker"), list(pairwise(PRECEDENCE)))
def test_of_two_neighbours_the_weaker_is_widened_by_what_is_missing(stronger, weaker):
    """2 <= x <= 3 against -1 <= x <= 0.5: the second becomes -2.5 <= x <= 2."""
    for rows in (
        ((stronger, 2.0, 3.0), (weaker, -1.0, 0.5)),
        ((weaker, -1.0, 0.5), (stronger, 2.0, 3.0)),
    ):
        problem, kinds = collide(*rows)
        assert relax(problem, kinds)
        first, second = kinds.index(stronger), kinds.index(weaker)
        assert (problem.lower[first], problem.upper[first]) == pytest.approx((2.0, 3.0), abs=SPARE)
        assert (problem.lower[second], problem.upper[second]) == pytest.approx(
            (-2.5, 2.0), abs=SPARE
        )


def test_a_limit_that_collides_with_nothing_is_left_as_it_is():
    """Only speed is in the way here, though it is the torque that it collides with."""
    problem, kinds = collide(
        ("command", 2.0, 3.0), ("joint", 0.0, 4.0), ("force", 1.0, 5.0), ("speed", -1.0, 1.0)
    )
    assert relax(problem, kinds)
    np.testing.assert_allclose(problem.lower, [2.0, 0.0, 1.0, -2.0], atol=SPARE)
    np.testing.assert_allclose(problem.upper, [3.0, 4.0, 5.0, 2.0], atol=SPARE)


def test_each_limit_gives_way_to_all_before_it():
    """All four collide: joints give way to torque, force to both, speed to all three."""
    problem, kinds = collide(
        ("speed", -9.0, -8.0), ("force", -5.0, -4.0), ("joint", 0.0, 1.0), ("command", 2.0, 3.0)
    )
    assert relax(problem, kinds)
    np.testing.assert_allclose(problem.upper, [2.0, 2.0, 2.0, 3.0], atol=SPARE)


def test_nothing_gives_way_to_torque_limits_that_contradict_each_other():
    """There is no answer, and no bound has been touched to get one."""
    problem, kinds = collide(("command", 2.0, 3.0), ("command", -1.0, 0.0), ("joint", 0.0, 1.0))
    assert not relax(problem, kinds)
    np.testing.assert_array_equal(problem.lower, [2.0, -1.0, 0.0])


# ---- on an arm


def stage(limits, **extra) -> States:
    return States(press_text("panda", "hybrid", limits=limits, **extra))


def solved(states: States, last=None) -> np.ndarray:
    """Torque (n,) of one tick at the state that is set; `last` (n,) the one before."""
    states.machine.update_terms()
    if last is not None:
        states.machine.torque[:] = last
    states.runner.remember(states.torque, states.torque)
    states.evaluate()
    assert states.solver.resolve()
    return states.torque.copy()


def test_torque_beats_torque_rate():
    """The torque before is beyond its limit: it comes back in one period, whatever the rate."""
    states = stage("torque_rate: 500 N*m/s")
    limit = states.robot.torque_limit
    gravity = states.context.start_gravity
    last = gravity.copy()
    last[1] = -limit[1] - 20.0
    torque = solved(states, last)
    assert torque[1] == pytest.approx(-limit[1], abs=1e-6)
    others = np.arange(7) != 1
    assert np.max(abs(torque - last)[others]) <= 0.5 + 1e-6


def test_torque_rate_beats_a_joint_limit():
    """A joint that flies at its limit is braked as fast as the rate allows, and no faster."""
    states = stage("torque_rate: 200 N*m/s")
    machine = states.machine
    machine.q[3] = states.robot.upper[3] - 0.02
    machine.v[3] = 1.5
    last = states.context.start_gravity.copy()
    torque = solved(states, last)
    assert states.solver.counts.relaxed == 1
    assert np.max(abs(torque - last)) <= 0.2 + 1e-6
    # Braking takes all there is.
    assert torque[3] == pytest.approx(last[3] - 0.2, abs=1e-3)


def widened(states: States) -> dict[str, float]:
    """What every kind of limit is widened by, and by linear programs the least that does it.

    Asserts that the rows hold as they are then.
    """
    states.machine.update_terms()
    states.runner.remember(states.torque, states.torque)
    states.evaluate()
    problem, counts = states.solver._problem, states.solver.counts
    low, high, collisions = problem.lower.copy(), problem.upper.copy(), counts.relaxed
    assert states.solver.resolve()
    assert counts.relaxed == collisions + 1
    at = problem.A @ states.solver._x
    assert np.all(at <= problem.upper + 1e-6 * (1 + abs(at)))
    assert np.all(at >= problem.lower - 1e-6 * (1 + abs(at)))
    kinds = np.array([row.kind for row in states.stage.resolution.rows])
    found = {}
    for level, kind in enumerate(PRECEDENCE):
        rows = kinds == kind
        if rows.any():
            found[kind] = float(np.max((problem.upper - high)[rows & np.isfinite(high)]))
            counted = np.isin(kinds, PRECEDENCE[: level + 1])
            least = fewest(problem.A[counted], low[counted], high[counted], rows[counted])
            assert least - 1e-6 <= found[kind] <= least * (1 + SPARE) + SPARE
            low[rows] -= found[kind]
            high[rows] += found[kind]
    return found


def fewest(A, low, high, rows) -> float:
    """The least t with low - t <= A x <= high + t on `rows` and t = 0 elsewhere, by HiGHS."""
    t = rows.astype(float)[:, None]
    above, below = np.isfinite(high), np.isfinite(low)
    found = linprog(
        np.r_[np.zeros(A.shape[1]), 1.0],
        A_ub=np.r_[np.c_[A, -t][above], np.c_[-A, -t][below]],
        b_ub=np.r_[high[above], -low[below]],
        bounds=[*[(None, None)] * A.shape[1], (0, None)],
    )
    assert found.status == 0
    return float(found.x[-1])


def test_torque_beats_a_joint_limit_and_both_beat_a_force_cap():
    """Joint 4 flies at its limit at 0.6 rad/s, 2 mrad away, while the tool presses at its cap."""
    states = stage("force: 5 N")
    states.machine.q[3] = states.robot.lower[3] + 2e-3
    states.machine.v[3] = -0.6
    states.machine.wrench[2] = 4.8
    found = widened(states)
    assert found["command"] == 0.0
    assert 1 < found["joint"] < 10
    assert found["force"] > 100


def test_a_joint_limit_beats_a_force_cap():
    """Both joints come to their limits, and braking them presses on what is in the way."""
    text = press_text("planar2", "hybrid", limits="force: 10 N", friction="0")
    states = States(text)
    machine, robot = states.machine, states.robot
    rng, collisions = np.random.default_rng(5), 0
    for _ in range(300):
        side = np.where(rng.random(2) < 0.5, -1.0, 1.0)
        room = rng.uniform(1.1e-3, 4e-3, 2)
        machine.q[:] = np.where(side > 0, robot.upper - room, robot.lower + room)
        machine.v[:] = side * rng.uniform(0.05, 0.3, 2)
        machine.wrench[0] = -9.8
        machine.update_terms()
        states.evaluate()
        before = states.solver.counts.relaxed
        if states.violation <= 1e-12 or not states.solver.resolve():
            continue
        if states.solver.counts.relaxed == before:
            continue
        found = widened(states)
        assert found["command"] == 0.0
        if found["joint"] <= SPARE:
            collisions += 1
            assert found["force"] > SPARE
    assert collisions > 5


def test_a_force_cap_beats_a_limit_on_speed():
    """An arm of two joints that closes at nine tenths of its speed limit with no room to its cap.

    What the cap asks for is a pull, by which the tool is faster than it may be a tick later.
    """
    text = press_text("planar2", "hybrid", limits="force: 10 N, speed: 50 mm/s", friction="0")
    states = States(text)
    states.machine.v[:] = np.linalg.solve(states.context.start_jacobian[:2], [0.045, 0.0])
    states.machine.wrench[0] = -9.6
    found = widened(states)
    assert found["command"] == 0.0
    assert found["joint"] <= SPARE
    assert found["force"] <= SPARE
    assert found["speed"] > 5


# ---- without an answer

PRESS = """\
taskspec: 1
name: press
robot: {model: panda, start: {xyz: [500 mm, 0, 300 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 10 kN/m, damping: 30 N*s/m}}
law: {kind: hybrid, solve: qp}
limits: {force: 60 N, torque_rate: 100 N*m/s}
stages: {press: {axes: {z: {force: -30 N, ramp: 0 s}}, time: 0.3 s}}
"""


class Broken:
    """A solver that has no answer for a while."""

    def __init__(self, solver, status: Status) -> None:
        self._solver, self._status = solver, status
        self.broken, self.rebuilt = True, 0

    def rebuild(self) -> None:
        self.rebuilt += 1
        self._solver.rebuild()

    def solve(self, problem, **options):
        if self.broken:
            return Solution(*unsolved(len(problem.g), len(problem.lower)), self._status, 0)
        return self._solver.solve(problem, **options)


class Stepped:
    """A run tick by tick, whose solver or sensor fails when it is told to."""

    def __init__(self, text: str = PRESS) -> None:
        self.program = compile_unchecked(load_text(text, "press.yaml"))
        self.parts = assemble(self.program)
        self.machine, self.plant = self.parts.machine, self.parts.plant
        self.sensing = loop.Sensing(self.plant.arm, self.plant.views.equations, self.machine)
        self.sensing.read()
        self.machine.start()
        self.clock = 0.0

    @property
    def solver(self):
        return self.machine.solver

    @property
    def memory(self):
        return self.machine.runner.memory

    def breaks(self, status: Status = Status.NOT_CONVERGED) -> Broken:
        self.solver.own = None
        broken = Broken(self.solver._solver, status)
        self.solver._solver = broken
        return broken

    def tick(self, wrench=None) -> SimpleNamespace:
        self.sensing.read()
        if wrench is not None:
            self.machine.wrench[:] = wrench
        self.machine.tick(self.clock)
        gravity = self.machine.terms.gravity.copy()
        torque = self.machine.torque.copy()
        self.plant.step(self.machine.torque)
        self.clock += T
        return SimpleNamespace(torque=torque, gravity=gravity)

    def until_limited(self) -> SimpleNamespace:
        for _ in range(100):
            before = self.tick()
            if self.solver.counts.solved > 3:
                return before
        raise AssertionError("the stage never came to its limits")


def within_the_rate(wanted, before):
    """The torque nearest to `wanted` that a rate of 100 N m/s allows after `before`."""
    return np.clip(wanted, before - 100 * T, before + 100 * T)


def test_without_an_answer_the_torque_fades_to_gravity_and_the_run_stops():
    run = Stepped()
    last = run.until_limited()
    before = last.torque
    memory = run.memory.copy()
    broken = run.breaks()
    for k in range(1, HELD_TICKS + 1):
        now = run.tick()
        share = 1 - k / HELD_TICKS
        expected = now.gravity + share * (last.torque - now.gravity)
        if run.solver.counts.held < k:
            pytest.fail("the closed form kept its limits by itself")
        # `gravity` is that of each tick, from which the arm hardly moves. The torque that is held
        # comes out of a program of its own, to rounding.
        np.testing.assert_allclose(now.torque, within_the_rate(expected, before), atol=1e-9)
        before = now.torque
        np.testing.assert_array_equal(run.memory, memory)
        assert run.machine.ended == ""
    now = run.tick()
    np.testing.assert_allclose(now.torque, within_the_rate(now.gravity, before), atol=1e-9)
    assert run.machine.ended == "fail"
    assert run.machine.transitions[-1].name == "solver"
    assert "not converged" in run.machine.transitions[-1].text
    assert broken.rebuilt == HELD_TICKS + 1


def test_a_run_that_has_no_answer_is_stopped_and_says_so(monkeypatch, tmp_path):
    """Through the loop: status stopped, reason solver, every tick of it in the log."""
    program = compile_unchecked(load_text(PRESS, "press.yaml"))
    parts = assemble(program)
    solver = parts.machine.runners[0].solver
    monkeypatch.setattr(solver, "own", None)
    monkeypatch.setattr(solver, "_solver", Broken(solver._solver, Status.INFEASIBLE))
    recorder = parts.recorder(Log(tmp_path / "log.arrow"))
    with closing(recorder):
        outcome = loop.run(parts.machine, parts.plant, parts.bus, recorder, T, loop="python")
    assert (outcome.status, outcome.reason) == ("stopped", "solver")
    assert outcome.ticks >= HELD_TICKS


def test_an_answer_that_comes_back_in_time_goes_on():
    run = Stepped()
    run.until_limited()
    broken = run.breaks()
    for _ in range(HELD_TICKS):
        run.tick()
    broken.broken = False
    for _ in range(50):
        run.tick()
    assert run.machine.ended == ""
    assert run.solver.counts.held == HELD_TICKS
    # The count begins anew.
    broken.broken = True
    run.tick()
    assert run.machine.ended == ""


@pytest.mark.parametrize("when", ["from the start", "later"])
def test_three_ticks_of_nan_from_the_sensor_are_survived(when):
    run = Stepped()
    if when == "later":
        run.until_limited()
    for _ in range(3):
        now = run.tick(np.full(6, np.nan))
        assert np.all(np.isfinite(now.torque))
    assert run.solver.counts.held == 3
    assert run.solver.status is Status.NOT_FINITE
    for _ in range(100):
        now = run.tick()
        assert np.all(np.isfinite(now.torque))
        assert np.all(np.isfinite(run.memory))
    assert run.machine.ended == ""
    assert run.solver.counts.held == 3
    force = -run.plant.arm.wrench[2]
    assert abs(force) < 60


def test_more_nan_than_that_stops_the_run():
    run = Stepped()
    run.until_limited()
    for _ in range(HELD_TICKS + 1):
        run.tick(np.full(6, np.nan))
    assert run.machine.ended == "fail"
    assert run.machine.transitions[-1].name == "solver"
    assert "not finite" in run.machine.transitions[-1].text


def test_a_limit_that_stops_the_run_while_there_is_no_answer_lets_no_raw_torque_through():
    """The tick that breaks a limit is in the log with a torque that was held, not asked for."""
    text = PRESS.replace("force: 60 N", "force: 20 N")
    run = Stepped(text)
    last = run.until_limited()
    run.breaks()
    now = run.tick(np.array([0.0, 0.0, 25.0, 0.0, 0.0, 0.0]))
    assert run.machine.transitions[-1].name == "force"
    share = 1 - 1 / HELD_TICKS
    expected = now.gravity + share * (last.torque - now.gravity)
    np.testing.assert_allclose(now.torque, within_the_rate(expected, last.torque), atol=1e-9)


def test_without_an_answer_a_joint_does_not_pass_its_velocity_limit():
    """Half of the ticks have no answer while joints are driven to their velocity: they keep it.

    What fades alone would not: the same run with the torque that fades as it is goes beyond.
    """
    text = (
        "taskspec: 1\nname: run\nrobot: {model: planar2, start: {joints: [0.4 rad, 1 rad]}}\n"
        "law: {kind: hybrid, solve: qp}\nlimits: {torque_rate: 20000 N*m/s}\n"
        "stages: {go: {axes: {x: {velocity: -4 m/s}}, time: 0.4 s}}\n"
    )

    def fastest(held: bool) -> float:
        run, most = Stepped(text), 0.0
        broken = run.breaks()
        limit = run.program.context.robot.velocity_limit
        if not held:
            run.solver.hold = lambda torque: run.machine.torque.__setitem__(slice(None), torque)
        while not run.machine.ended:
            broken.broken = run.machine.transitions == [] and round(run.clock / T) % 4 < 2
            run.tick()
            most = max(most, float(np.max(np.abs(run.machine.v) / limit)))
        return most

    assert fastest(True) <= 1.0 < fastest(False)


def test_a_new_stage_keeps_the_rate_from_what_was_applied():
    """The torque that the last stage worked out on the tick on which it ended was never applied."""
    text = PRESS.replace(
        "stages: {press: {axes: {z: {force: -30 N, ramp: 0 s}}, time: 0.3 s}}",
        "stages: {press: {axes: {z: {force: -30 N, ramp: 0 s}}, time: 20 ms}, "
        "off: {axes: {z: {velocity: 200 mm/s}}, time: 20 ms}}",
    )
    run = Stepped(text)
    before, most = run.program.context.start_gravity, 0.0
    while not run.machine.ended:
        now = run.tick()
        if not run.machine.ended:
            most = max(most, np.max(abs(now.torque - before)))
        before = now.torque
    assert len(run.machine.transitions) == 2
    assert most <= 0.1 * (1 + 1e-6)
    assert most > 0.099
