"""The program against the closed form where no limit is active, and its solvers where some are."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from random_states import States, press_text

from taskspec.control.qp import QuadraticProgram, Status, make_solver, residual
from taskspec.laws import LAWS
from taskspec.program.limits.relaxing import relax

#: Of laws that command torques: other programs are in joint velocities.
CASES = [
    (law, robot)
    for k, law in enumerate(law for law, facts in LAWS.items() if facts.commands == "torque")
    for robot in ("panda", ("ur5e", "planar3")[k % 2])
]
#: Random states of each of the 20 cases.
STATES = 75
#: What OSQP is asked for, absolute and relative (`control/qp/osqp.py`).
ASKED = 1e-8


def in_accelerations(states: States, problem: QuadraticProgram) -> QuadraticProgram:
    """The program in joint accelerations, from Pinocchio's inertia: another way to the torque.

    x = L'(q'' - q''*) in P = L (..) L'. q''* itself enters by its numbers, so a torque that comes
    back from H q'' + h has gone through inertia and bias terms that the solver never forms. Of
    velocities it is the program in these themselves.
    """
    L, wish = np.linalg.cholesky(dynamics(states)[0]), acceleration(states)
    if of_velocities(states):
        L, wish = np.eye(states.n), states.torque.copy()
    A = problem.A @ L.T
    P = L @ problem.P @ L.T
    return QuadraticProgram(
        np.ascontiguousarray((P + P.T) / 2),
        -P @ wish,
        np.ascontiguousarray(A),
        problem.lower + A @ wish,
        problem.upper + A @ wish,
    )


def dynamics(states: States) -> tuple[np.ndarray, np.ndarray]:
    """H (n, n), and what the torque carries beside H q'' (n,), by Pinocchio's own algorithms."""
    machine, robot = states.machine, states.robot
    data = robot.pin.createData()
    H = np.triu(pin.crba(robot.pin, data, machine.q))
    H = H + np.triu(H, 1).T
    bias = pin.rnea(robot.pin, data, machine.q, machine.v, np.zeros(states.n))
    pin.computeJointJacobians(robot.pin, data, machine.q)
    pin.updateFramePlacements(robot.pin, data)
    frame = robot.pin.getFrameId("tip")
    J = pin.getFrameJacobian(robot.pin, data, frame, pin.LOCAL_WORLD_ALIGNED)
    return H, bias - J.T @ machine.wrench


def of_velocities(states: States) -> bool:
    """Whether the law commands velocities."""
    return states.stage.plan.law.control_law.commands == "velocity"


def factor_of(states: States) -> np.ndarray:
    """(n, n) L of H = L L', by which x becomes a torque; x itself changes a velocity."""
    if of_velocities(states):
        return np.eye(states.n)
    return np.linalg.cholesky(dynamics(states)[0])


def acceleration(states: States) -> np.ndarray:
    """q''* (n,) of the closed form."""
    H, bias = dynamics(states)
    return np.linalg.solve(H, states.torque - bias)


def widen(problem: QuadraticProgram) -> None:
    """Moves every limit that is in the way of x = 0 beyond it."""
    np.minimum(problem.lower, -1.0, out=problem.lower)
    np.maximum(problem.upper, 1.0, out=problem.upper)


@pytest.mark.parametrize(("law", "robot"), CASES)
def test_without_an_active_limit_the_torque_is_that_of_the_closed_form(law, robot):
    """Some 3000 random states in all; the shortcut that leaves the program out is not taken.

    The closed form is that of the same task without `solve: qp`. Pushes are clamped before there is
    a program, so states in which one would be are states with an active limit, and drawn again.
    """
    seed = len(law) * 7 + len(robot)
    states, closed = (States(press_text(robot, law, solver), seed) for solver in ("daqp", ""))
    n, m = states.n, len(states.stage.resolution.rows)
    most, near = states.stage.resolution.commands.most, 0.5
    if of_velocities(states):
        near = 0.02
    solver, other = make_solver("daqp", n, m), make_solver("daqp", n, m)
    tried, kept, worst = 0, 0, np.zeros(3)
    while tried < STATES:
        # Every other state is so quiet that its own limits leave the closed form alone.
        quiet = tried % 2
        states.draw_present(**(dict(turned=0.005, fast=0.005, force=1.0) if quiet else {}))
        if states.clamped:
            continue
        states.draw_past(rate=near if quiet else 40 * near)
        closed.same_state(states)
        wish = closed.torque.copy()
        if np.any(abs(wish) >= (1 - 1e-9) * most):
            continue
        tried += 1
        problem = states.problem()
        if states.violation <= 0:
            kept += 1
        else:
            widen(problem)
        solution = solver.solve(problem)
        assert solution.status is Status.SOLVED
        torque, error = states.acceptance(solution.x, solution.dual)
        worst[[0, 2]] = np.maximum(worst[[0, 2]], [np.max(abs(torque - wish)), error])
        if tried % 5 == 0:
            again = other.solve(in_accelerations(states, problem))
            assert again.status is Status.SOLVED
            H, bias = dynamics(states)
            back = again.x if of_velocities(states) else H @ again.x + bias
            worst[1] = max(worst[1], np.max(abs(back - wish)))
    assert kept > STATES / 20 or LAWS[law].bare, "limits as they are have hardly been tried"
    assert worst[0] < 1e-9
    # In accelerations numbers of up to 1e5 rad/s^2 cancel: 1e5 * 2^-52 * cond(H) of 1e2..1e4.
    assert worst[1] < 1e-9
    assert worst[2] < 1e-8


def limited_states(count: int, seed: int, colliding: bool = True):
    """States where limits change the torque, of all laws and robots in turn."""
    for k, (law, robot) in enumerate(CASES):
        states = States(press_text(robot, law), seed=seed + k)
        n, m = states.n, len(states.stage.resolution.rows)
        kinds = [row.kind for row in states.stage.resolution.rows]
        solver, found = make_solver("daqp", n, m), 0
        for _ in range(30 * count):
            states.draw(rate=0.9)
            if states.violation <= 1e-12:
                continue
            problem = states.copy()
            solution = solver.solve(problem)
            if solution.status is Status.INFEASIBLE:
                if not colliding:
                    continue
                assert relax(problem, kinds)
                solution = solver.solve(problem)
            found += 1
            yield states, problem, solution
            if found == count:
                break
        assert found == count or not colliding, (law, robot)


def test_every_answer_under_active_limits_is_optimal():
    """The residual of all answers is below 1e-8, by the solver's measure and the solvers' own."""
    worst, active, together = 0.0, 0, 0
    for states, problem, solution in limited_states(50, seed=100):
        assert solution.status is Status.SOLVED
        worst = max(worst, residual(problem, solution.x, solution.dual))
        active += int(np.count_nonzero(solution.dual))
        together += np.count_nonzero(solution.dual) > 1
        states.solver._problem.lower[:] = problem.lower
        states.solver._problem.upper[:] = problem.upper
        torque, error = states.acceptance(solution.x, solution.dual)
        np.testing.assert_allclose(
            torque, states.torque + factor_of(states) @ solution.x, atol=1e-9
        )
        worst = max(worst, error)
    assert active > 1200
    assert together > 300
    assert worst < 1e-8


def apart(problem: QuadraticProgram, exact, found) -> float:
    """How far x may be from the exact one, as a norm, when OSQP is as good as it was asked to be.

    With residuals r_d of stationarity and r_p of the rows, z = A x - r_p in the bounds and y in
    their normal cone, which OSQP's iterates fulfil by construction, subtracting both solutions'
    stationarity and using (z - z*)'(y - y*) >= 0 gives for e = x - x*

        e'P e <= e'r_d - r_p'(y - y*),   so   |e| <= (a + sqrt(a^2 + 4 mu b)) / (2 mu)

    with a = |r_d|, b = |r_p|_inf |y - y*|_1 and mu the least eigenvalue of P. Residuals are at most
    what was asked: ASKED (1 + the largest term), each as OSQP scales it.
    """
    x, y = found.x, found.dual
    Px, Aty, Ax = problem.P @ x, problem.A.T @ y, problem.A @ x
    rows = ASKED * (1 + np.max(abs(Ax)))
    a = np.sqrt(len(x)) * ASKED * (1 + max(np.max(abs(Px)), np.max(abs(Aty))))
    b = rows * np.sum(abs(y - exact.dual))
    mu = np.linalg.eigvalsh(problem.P)[0]
    return float((a + np.sqrt(a * a + 4 * mu * b)) / (2 * mu))


def test_osqp_agrees_to_the_tolerance_that_it_was_asked_for():
    """Torque differs by no more than |L| |e|, with e from the tolerance; see `apart`."""
    share, differences, tried = 0.0, [], 0
    for states, problem, exact in limited_states(12, seed=300, colliding=False):
        n, m = problem.A.shape[1], problem.A.shape[0]
        found = make_solver("osqp", n, m).solve(problem)
        tried += 1
        if found.status is not Status.SOLVED:
            continue
        difference = np.linalg.norm(factor_of(states) @ (found.x - exact.x))
        allowed = np.linalg.norm(factor_of(states), 2) * apart(problem, exact, found)
        differences.append(difference)
        share = max(share, difference / allowed)
    assert tried > 100
    assert len(differences) > 0.8 * tried
    assert share < 1
    # Measured: 1e-8 N m at the median, 1e-6 at most. Its default of 1e-3 would make it 1e-2.
    assert max(differences) < 1e-4
