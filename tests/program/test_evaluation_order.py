"""Instructions in groups of one operation: the same bits, and fewer changes of operation."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from taskspec.compiler import compile_task
from taskspec.program.bound import BoundFunction
from taskspec.program.evaluation_order import grouped, is_grouped
from taskspec.robot.rigid_body import rigid_body
from taskspec.spec import load_task

TASKS = Path(__file__).resolve().parents[2] / "tasks"
#: What instructions on paper are not: zeros of either sign, none at all, no numbers.
_ODD = np.array([0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 5e-324, 1e308])


def functions(name: str) -> Iterator[ca.Function]:
    """What ticks of a task evaluate."""
    program = compile_task(load_task(TASKS / f"{name}.yaml"))
    yield rigid_body(program.context.robot).function
    for stage in program.stages:
        yield stage.tick
        if stage.resolution is not None:
            yield stage.resolution.assemble
            yield stage.resolution.accept


def values(function: ca.Function, given: list[NDArray[np.float64]], *, group: bool) -> bytes:
    """The bits of all results."""
    results = [np.full(function.nnz_out(i), 7.0) for i in range(function.n_out())]
    bound = BoundFunction(function, given, results)
    if group:
        bound.group()
    bound.evaluate()
    # One bit pattern for all that is not a number: IEEE 754 leaves open which one comes out.
    together = np.concatenate([*results, np.zeros(1)])
    together[np.isnan(together)] = np.nan
    return together.tobytes()


@pytest.mark.parametrize("name", ["wipe-table", "press-saturated", "crank", "linkage"])
def test_the_bits_are_the_same(name: str) -> None:
    random = np.random.default_rng(3)
    for function in functions(name):
        sizes = [function.nnz_in(i) for i in range(function.n_in())]
        for odd in (0.0, 0.02, 0.5):
            given = [random.normal(size=size) for size in sizes]
            for array in given:
                where = random.random(array.size) < odd
                array[where] = random.choice(_ODD, where.sum())
            plain = values(function, given, group=False)
            assert values(function, given, group=True) == plain, function.name()
        assert is_grouped(function)


def changes(function: ca.Function) -> int:
    """How often one instruction is of another operation than the one before."""
    ids = [function.instruction_id(k) for k in range(function.n_instructions())]
    return sum(a != b for a, b in itertools.pairwise(ids))


def test_operations_change_seldom() -> None:
    for function in functions("press-saturated"):
        found = grouped(function)
        # Its own instructions, what they all are operands of, and that one's result.
        assert found.n_instructions() == function.n_instructions() + 2
        assert changes(found) < changes(function) / 4, function.name()


def test_results_that_are_arguments_constants_empty_or_sparse() -> None:
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y", ca.Sparsity.diag(2))
    sparse = ca.SX(ca.Sparsity.lower(2), ca.vertcat(x[0] * y[1, 1], 3, x[1]))
    function = ca.Function("f", [x, y], [x[1], ca.SX(2.5), ca.SX(0, 1), sparse, x[1] + x[1]])
    given = [np.array([2.0, 5.0]), np.array([7.0, 11.0])]
    assert values(function, given, group=True) == values(function, given, group=False)


def test_what_is_not_of_instructions_stays_as_it_is() -> None:
    x = ca.SX.sym("x")
    rows = ca.Function("f", [x], [x * x + 1]).map(4)
    given, results = [np.arange(4.0)], [np.zeros(4)]
    bound = BoundFunction(rows, given, results)
    bound.group()
    bound.evaluate()
    assert results[0].tolist() == [1, 2, 5, 10]
