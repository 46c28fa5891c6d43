"""Functions of a row as machine code, at many rows, against CasADi's virtual machine."""

from __future__ import annotations

import time

import casadi as ca
import numpy as np
import pytest

from taskspec.native import rows
from taskspec.native.engine import available
from taskspec.native.rows import RowCode, RowMemory, evaluate
from taskspec.program.bound import RowFunction

pytestmark = pytest.mark.skipif(not available(), reason="without llvmlite")

X = ca.SX.sym("x", 5)
VALUES = ca.vertcat(ca.sin(X[0]) * X[1], ca.if_else(X[2] > 0, X[3], -X[4]), X[0] / X[1])


@pytest.fixture(autouse=True)
def _nobody_has_asked(monkeypatch):
    monkeypatch.setattr(rows, "_ASKED", rows.Counter())


def some(n):
    found = np.random.default_rng(0).normal(size=(n, 5))
    found[0] = 0.0, -0.0, 0.0, np.inf, np.nan
    return found


def patient(code, given):
    """What a function gives once its code is there."""
    until = time.monotonic() + 30
    while (found := code(given)) is None and time.monotonic() < until:
        time.sleep(0.01)
    return found


@pytest.mark.parametrize("n", [2, 1000, 4321])
def test_rows_are_those_of_the_virtual_machine_bit_by_bit(n, monkeypatch):
    monkeypatch.setattr(rows, "_WORTH", 1)
    function = ca.Function("f", [X], [VALUES])
    given = some(n)
    found = patient(RowCode(function), given)
    (expected,) = RowFunction(function)(given)
    assert found.tobytes() == expected.tobytes()


def test_rows_that_lie_apart_are_taken_as_they_are(monkeypatch):
    monkeypatch.setattr(rows, "_WORTH", 1)
    function, wide = ca.Function("f", [X], [VALUES]), np.hstack([some(50), some(50)])
    found = patient(RowCode(function), wide[:, 5:])
    assert found.tobytes() == RowFunction(function)(some(50))[0].tobytes()


def test_code_is_made_once_enough_rows_have_asked_for_functions_that_are_alike(monkeypatch):
    """A function of its own for each world, none of which is worth it alone."""
    monkeypatch.setattr(rows, "_WORTH", 300)
    values = VALUES + np.random.default_rng().normal()  # No code of it is kept.
    first, second, third = (RowCode(ca.Function("f", [X], [values])) for _ in range(3))
    assert first(some(100)) is None
    assert second(some(100)) is None
    assert patient(third, some(100)) is not None
    assert RowCode(ca.Function("f", [X], [values]))(some(2)) is not None
    other = RowCode(ca.Function("f", [X], [values + 1]))
    assert other(some(100)) is None


def test_what_machine_code_lacks_is_left_to_the_virtual_machine(monkeypatch):
    def refuses(*_):
        raise rows.EngineError("none of it")

    monkeypatch.setattr(rows, "expression_engine", refuses)
    code = RowCode(ca.Function("f", [X], [VALUES]))
    assert code(some(10)) is None
    assert code(some(10)) is None


def test_the_kernel_goes_from_row_to_row_under_python_too(monkeypatch):
    """The same source, with a function that doubles what it finds at its address."""
    given, made = np.arange(6.0), np.zeros(3)
    at, to = np.array([given.ctypes.data]), np.array([made.ctypes.data])

    def doubles(_, arguments, results, *rest):
        del arguments, results, rest
        here, there = ((int(p[0]) - a.ctypes.data) // 8 for p, a in ((at, given), (to, made)))
        made[there] = given[here] + given[here + 1]

    monkeypatch.setattr(rows, "call", doubles)
    c = RowMemory(given=at, made=to, given_step=16, made_step=8)
    evaluate(c, 3)
    assert made.tolist() == [1.0, 5.0, 9.0]
