"""Quick operators make the nodes that CasADi's own make, and are gone afterwards."""

import threading

import casadi as ca
import numpy as np
import pytest

from taskspec.program.bound import evaluated
from taskspec.program.operators import quick_operators

S, V = ca.SX.sym("s"), ca.SX.sym("v", 3)
SPARSE = ca.diag(V)
OTHERS = [
    S, V, SPARSE, ca.SX.sym("w", 2),
    ca.SX(0), ca.SX(1), ca.SX(2.5), ca.SX(3, 1), ca.DM([1, 0, 2.5]), ca.DM(0.5),
    0, 1, -1, 2, 0.0, 1.0, 2.5, np.pi, np.float64(0.5), float("inf"), True,
]  # fmt: skip


def results() -> list[str]:
    found = []
    for x in (S, V, SPARSE, S * 0, 2 * V):
        for y in OTHERS:
            for operation in (
                lambda a, b: a + b,
                lambda a, b: a - b,
                lambda a, b: a * b,
                lambda a, b: a / b,
            ):
                for pair in ((x, y), (y, x)):
                    try:
                        made = operation(*pair)
                    except RuntimeError as error:
                        found.append(type(error).__name__)
                    else:
                        found.append(f"{type(made).__name__} {made.dim()} {made}")
    return found


def test_nodes_are_the_same():
    usual = results()
    with quick_operators():
        assert results() == usual
    assert any("RuntimeError" in each for each in usual)


def test_operators_are_put_back():
    own = ca.SX.__add__

    def fails() -> None:
        with quick_operators():
            assert ca.SX.__add__ is not own
            raise ValueError

    with pytest.raises(ValueError):  # noqa: PT011
        fails()
    assert ca.SX.__add__ is own


def test_the_last_of_several_puts_operators_back():
    own = ca.SX.__add__
    begin, end = threading.Event(), threading.Event()

    def other() -> None:
        with quick_operators():
            begin.set()
            end.wait()

    thread = threading.Thread(target=other)
    with quick_operators():
        quick = ca.SX.__add__
        thread.start()
        begin.wait()
        with quick_operators():
            pass
        assert ca.SX.__add__ is quick
    assert ca.SX.__add__ is quick
    end.set()
    thread.join()
    assert ca.SX.__add__ is own


def test_results_of_a_function_are_those_of_a_call():
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    sparse = ca.SX(2, 2)
    sparse[1, 0] = x[1] * y
    function = ca.Function("f", [x, y], [ca.vertcat(x, y), sparse, ca.SX(0, 1)])
    given = np.array([1.5, -2.0]), np.array([3.0])
    for ours, theirs in zip(evaluated(function, *given), function(*given), strict=True):
        np.testing.assert_array_equal(ours, np.array(theirs).ravel(order="F"))
