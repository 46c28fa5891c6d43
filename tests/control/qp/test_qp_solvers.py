"""DAQP and OSQP against each other, against the optimality conditions, and against bad data."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from taskspec.control.qp import SOLVERS, QuadraticProgram, Status, make_solver, residual
from taskspec.control.qp.quadratic_program import Array

N, M = 7, 20


def random_problem(rng: np.random.Generator, n: int = N, m: int = M) -> QuadraticProgram:
    """Feasible, with rows and Hessian of order one and an optimum outside some of the bounds."""
    root = rng.normal(size=(n, n))
    P = root @ root.T + 0.1 * np.eye(n)
    A = rng.normal(size=(m, n))
    inside, wish = rng.normal(size=n), rng.normal(size=n)
    lower = A @ inside - rng.random(m)
    upper = A @ inside + rng.random(m)
    lower[rng.random(m) < 0.3] = -np.inf
    upper[rng.random(m) < 0.3] = np.inf
    return QuadraticProgram(P, -P @ wish, A, lower, upper)


def degenerate_problem(rng: np.random.Generator, n: int = N, m: int = M) -> QuadraticProgram:
    """Feasible in one point or nearly: equalities, rows twice, rows of zeros, bounds that touch."""
    P, g, A, inside = (
        np.diag(10.0 ** rng.uniform(-2, 2, n)),
        rng.normal(size=n),
        rng.normal(size=(m, n)),
        rng.normal(size=n),
    )
    A[4], A[5], A[6] = A[0], -A[1], 0.0
    A[7] = A[0] + A[1]
    at = A @ inside
    lower, upper = at - rng.random(m), at + rng.random(m)
    lower[0], upper[0] = at[0], np.inf
    lower[4], upper[4] = -np.inf, at[4]
    lower[1] = upper[1] = at[1]
    lower[5] = upper[5] = at[5]
    lower[7] = upper[7] = at[7]
    return QuadraticProgram(P, g, A, lower, upper)


def copy(source: QuadraticProgram, into: QuadraticProgram) -> QuadraticProgram:
    """Rewrites `into` in place, as a tick does."""
    for name in ("P", "g", "A", "lower", "upper"):
        getattr(into, name)[...] = getattr(source, name)
    return into


def infeasible_problem(rng: np.random.Generator) -> QuadraticProgram:
    problem = random_problem(rng)
    problem.A[1] = problem.A[0]
    problem.lower[:2], problem.upper[:2] = (1.0, 3.0), (2.0, 4.0)
    return problem


@pytest.fixture(params=SOLVERS)
def solver_name(request: pytest.FixtureRequest) -> str:
    name: str = request.param
    return name


# A backward stable factorisation of order-one data leaves about n * m * eps = 3e-14. The largest
# measured over 5000 such problems are 7e-13, and 6e-12 for the degenerate ones, whose Hessians have
# condition numbers up to 1e4.
@pytest.mark.parametrize("make", [random_problem, degenerate_problem])
def test_daqp_meets_the_optimality_conditions_on_thousands_of_problems(make) -> None:
    rng = np.random.default_rng(0)
    solver = make_solver("daqp", N, M)
    problem = QuadraticProgram.empty(N, M)
    for _ in range(3000):
        found = solver.solve(copy(make(rng), problem))
        assert found.status is Status.SOLVED
        assert residual(problem, found.x, found.dual) < 1e-10


@pytest.mark.parametrize(("n", "m"), [(1, 1), (2, 8), (7, 10), (9, 30), (13, 40)])
def test_solvers_agree_to_the_tolerance_asked_of_osqp(n: int, m: int) -> None:
    rng = np.random.default_rng(n)
    exact, other = make_solver("daqp", n, m), make_solver("osqp", n, m)
    for _ in range(40):
        problem = random_problem(rng, n, m)
        a, b = exact.solve(problem), other.solve(problem)
        assert a.status is b.status is Status.SOLVED
        # OSQP stops at 1e-8 (1 + size of the data); the largest measured is 3e-8 here. The error
        # in x is that over the smallest eigenvalue of P, at least 0.1, times the condition of the
        # active rows: 1e-6 is the largest measured over 500 problems of each size.
        assert residual(problem, b.x, b.dual) < 1e-7
        np.testing.assert_allclose(b.x, a.x, rtol=0, atol=1e-5)


def test_one_unknown_by_hand(solver_name: str) -> None:
    # min x^2 - 2x with x <= 1/4: at the bound, where 2x - 2 + y = 0 gives y = 3/2.
    problem = QuadraticProgram(
        np.array([[2.0]]),
        np.array([-2.0]),
        np.array([[1.0]]),
        np.array([-np.inf]),
        np.array([0.25]),
    )
    found = make_solver(solver_name, 1, 1).solve(problem)
    np.testing.assert_allclose([found.x[0], found.dual[0]], [0.25, 1.5], atol=1e-7)
    # The same from below: x >= 2 holds x up, and y is negative.
    problem.lower[0], problem.upper[0] = 2.0, np.inf
    found = make_solver(solver_name, 1, 1).solve(problem)
    np.testing.assert_allclose([found.x[0], found.dual[0]], [2.0, -2.0], atol=1e-7)


def test_without_bounds_the_answer_is_the_linear_system(solver_name: str) -> None:
    rng = np.random.default_rng(3)
    problem = random_problem(rng)
    problem.lower[:], problem.upper[:] = -np.inf, np.inf
    found = make_solver(solver_name, N, M).solve(problem)
    np.testing.assert_allclose(found.x, -np.linalg.solve(problem.P, problem.g), atol=1e-7)
    assert not np.any(np.abs(found.dual) > 1e-8)


@pytest.mark.parametrize("array", ["P", "g", "A", "lower", "upper"])
@pytest.mark.parametrize("before", [True, False])
def test_nan_is_refused_and_leaves_nothing_behind(
    solver_name: str, array: str, before: bool
) -> None:
    rng = np.random.default_rng(4)
    good, problem = random_problem(rng), QuadraticProgram.empty(N, M)
    expected = make_solver("daqp", N, M).solve(good)
    solver = make_solver(solver_name, N, M)
    if before:
        solver.solve(copy(good, problem))
    copy(good, problem)
    getattr(problem, array).flat[0] = np.nan
    found = solver.solve(problem)
    assert found.status is Status.NOT_FINITE
    assert np.isnan(found.x).all()
    found = solver.solve(copy(good, problem))
    assert found.status is Status.SOLVED
    np.testing.assert_allclose(found.x, expected.x, atol=1e-5)


@pytest.mark.parametrize("array", ["P", "g", "A"])
def test_infinite_data_are_refused(solver_name: str, array: str) -> None:
    problem = random_problem(np.random.default_rng(5))
    getattr(problem, array).flat[0] = -np.inf
    assert make_solver(solver_name, N, M).solve(problem).status is Status.NOT_FINITE


def test_infeasible_then_good(solver_name: str) -> None:
    rng = np.random.default_rng(6)
    solver, exact = make_solver(solver_name, N, M), make_solver("daqp", N, M)
    for _ in range(20):
        assert solver.solve(infeasible_problem(rng)).status is Status.INFEASIBLE
        problem = random_problem(rng)
        found = solver.solve(problem)
        assert found.status is Status.SOLVED
        np.testing.assert_allclose(found.x, exact.solve(problem).x, atol=1e-5)


@pytest.mark.parametrize(
    ("lower", "upper"), [(1.0, 0.0), (1e-7, 0.0), (np.inf, np.inf), (-np.inf, -np.inf)]
)
def test_bounds_that_cross_are_infeasible(solver_name: str, lower: float, upper: float) -> None:
    good = random_problem(np.random.default_rng(7))
    problem = copy(good, QuadraticProgram.empty(N, M))
    solver = make_solver(solver_name, N, M)
    assert solver.solve(problem).status is Status.SOLVED
    problem.lower[2], problem.upper[2] = lower, upper
    found = solver.solve(problem)
    assert found.status is Status.INFEASIBLE
    assert np.isnan(found.x).all()
    assert solver.solve(copy(good, problem)).status is Status.SOLVED


def test_equality_opens_again(solver_name: str) -> None:
    """A row whose bounds met, or that was zero, bounds from both sides again in the next tick."""
    good = random_problem(np.random.default_rng(8))
    wish = -np.linalg.solve(good.P, good.g)
    good.lower[:], good.upper[:] = -np.inf, np.inf
    good.upper[3] = good.A[3] @ wish - 1.0
    expected = make_solver(solver_name, N, M).solve(good)
    solver, problem = make_solver(solver_name, N, M), copy(good, QuadraticProgram.empty(N, M))
    problem.lower[3] = problem.upper[3] = good.A[3] @ wish + 1.0
    at_equality = solver.solve(problem)
    assert problem.A[3] @ at_equality.x == pytest.approx(problem.upper[3], abs=1e-6)
    found = solver.solve(copy(good, problem))
    np.testing.assert_allclose(found.x, expected.x, atol=1e-6)
    problem.A[3] = 0.0
    problem.upper[3] = 1.0
    np.testing.assert_allclose(solver.solve(problem).x, wish, atol=1e-6)
    found = solver.solve(copy(good, problem))
    np.testing.assert_allclose(found.x, expected.x, atol=1e-6)


def test_indefinite_hessian_is_refused_and_leaves_nothing_behind(solver_name: str) -> None:
    good = random_problem(np.random.default_rng(9))
    problem, solver = copy(good, QuadraticProgram.empty(N, M)), make_solver(solver_name, N, M)
    solver.solve(problem)
    problem.P[0, 0] = -5.0
    assert solver.solve(problem).status is Status.NOT_CONVERGED
    found = solver.solve(copy(good, problem))
    assert found.status is Status.SOLVED
    np.testing.assert_allclose(found.x, make_solver("daqp", N, M).solve(good).x, atol=1e-5)


def test_nothing_is_printed(solver_name: str, capfd: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(10)
    solver = make_solver(solver_name, N, M)
    problem = QuadraticProgram.empty(N, M)
    for make in (random_problem, infeasible_problem, degenerate_problem):
        solver.solve(copy(make(rng), problem))
    problem.lower[2] = problem.upper[2] + 1.0
    solver.solve(problem)
    copy(random_problem(rng), problem).P[0, 0] = -5.0
    solver.solve(problem)
    problem.g[0] = np.nan
    solver.solve(problem)
    solver.solve(copy(random_problem(rng), problem))
    assert capfd.readouterr() == ("", "")


def test_same_problems_give_the_same_bits(solver_name: str) -> None:
    def answers() -> bytes:
        rng, solver = np.random.default_rng(11), make_solver(solver_name, N, M)
        problem = QuadraticProgram.empty(N, M)
        found = [solver.solve(copy(random_problem(rng), problem)) for _ in range(500)]
        return b"".join(s.x.tobytes() + s.dual.tobytes() for s in found)

    assert answers() == answers()


def test_daqp_remembers_nothing() -> None:
    rng, solver = np.random.default_rng(12), make_solver("daqp", N, M)
    for _ in range(200):
        problem = random_problem(rng)
        fresh = make_solver("daqp", N, M).solve(problem)
        found = solver.solve(problem)
        assert found.x.tobytes() == fresh.x.tobytes()


def test_rebuilt_solver_answers_as_a_new_one(solver_name: str) -> None:
    rng, solver = np.random.default_rng(13), make_solver(solver_name, N, M)
    solver.solve(random_problem(rng))
    solver.rebuild()
    problem = random_problem(rng)
    fresh = make_solver(solver_name, N, M).solve(problem)
    assert solver.solve(problem).x.tobytes() == fresh.x.tobytes()


def test_answers_are_not_overwritten_by_the_next(solver_name: str) -> None:
    rng, solver = np.random.default_rng(14), make_solver(solver_name, N, M)
    first = solver.solve(random_problem(rng))
    kept = first.x.copy(), first.dual.copy()
    solver.solve(random_problem(rng))
    np.testing.assert_array_equal(first.x, kept[0])
    np.testing.assert_array_equal(first.dual, kept[1])


def test_residual_sees_each_kind_of_error() -> None:
    rng = np.random.default_rng(15)
    problem = random_problem(rng)
    found = make_solver("daqp", N, M).solve(problem)
    x, dual = found.x, found.dual
    active = int(np.argmax(np.abs(dual)))
    free = int(np.flatnonzero(np.isinf(problem.upper))[0])
    shifted, flipped, wrong = dual.copy(), dual.copy(), dual.copy()
    shifted[active] *= 1.01
    flipped[active] *= -1
    wrong[free] = 1.0
    for other in (shifted, flipped, wrong):
        assert residual(problem, x, other) > 1e-3
    assert residual(problem, x + 1e-3, dual) > 1e-4
    assert np.isnan(residual(problem, x * np.nan, dual))
    unbounded = QuadraticProgram(problem.P, problem.g, problem.A * 0, problem.lower, problem.upper)
    assert residual(unbounded, -np.linalg.solve(problem.P, problem.g), 0 * dual) > 1e-3


def test_arrays_of_other_shapes_or_kinds_are_refused() -> None:
    def made(**changed: Array) -> QuadraticProgram:
        arrays = {
            "P": np.eye(2), "g": np.zeros(2), "A": np.zeros((3, 2)),
            "lower": np.zeros(3), "upper": np.zeros(3),
        }  # fmt: skip
        return QuadraticProgram(**(arrays | changed))

    made()
    with pytest.raises(ValueError, match="lower must be"):
        made(lower=np.zeros(2))
    with pytest.raises(ValueError, match="A must be"):
        made(A=np.zeros((2, 3)).T)
    with pytest.raises(ValueError, match="g must be"):
        made(g=np.zeros(2, dtype=np.float32))
    with pytest.raises(ValueError, match="daqp, osqp"):
        make_solver("gurobi", 2, 3)


def test_libraries_are_imported_only_when_asked_for() -> None:
    code = (
        "import sys; from taskspec.control.qp import make_solver;"
        "assert not {'daqp', 'osqp', 'scipy.sparse'} & set(sys.modules);"
        "make_solver('daqp', 2, 2); assert 'daqp' in sys.modules and 'osqp' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
