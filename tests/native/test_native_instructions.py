"""Instructions that are read all at once are those that CasADi gives one by one."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from test_native_expressions import OPERATIONS, function_of

from taskspec.native import instructions as module
from taskspec.native.instructions import instructions


def by_calls(function: ca.Function) -> list[tuple[int, list[int], list[int], float]]:
    found = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        constant = function.instruction_constant(k) if operation == ca.OP_CONST else 0.0
        read, written = function.instruction_input(k), function.instruction_output(k)
        found.append((operation, list(read), list(written), constant))
    assert found
    return found


def check(function: ca.Function) -> None:
    rows, given = instructions(function), by_calls(function)
    assert len(rows) == len(given)
    for row, (operation, read, written, constant) in zip(rows, given, strict=True):
        assert row[0] == operation
        if operation == ca.OP_CONST:
            assert row[1] == written[0]
            assert row[2:].copy().view(np.float64)[0] == constant
        elif operation == ca.OP_OUTPUT:
            assert row[1:].tolist() == [written[0], read[0], written[1]]
        else:
            assert row[1] == written[0]
            assert row[2 : 2 + len(read)].tolist() == read


@pytest.mark.parametrize("name", OPERATIONS)
def test_they_are_those_that_casadi_gives(name) -> None:
    check(function_of(OPERATIONS[name], 3))


def large() -> ca.Function:
    x, y = ca.SX.sym("x", 4, 4), ca.SX.sym("y", 4)
    return ca.Function("large", [x, y], [ca.inv(x) @ y, ca.det(x) + 1e-300, ca.SX(-0.0)])


def test_they_are_found_in_what_casadi_writes(monkeypatch: pytest.MonkeyPatch) -> None:
    """And where they are not, as with a version that writes otherwise, they are had one by one."""
    function = large()
    assert module._written(function) is not None
    check(function)
    at_once = instructions(function).tolist()
    assert len(at_once) > 100
    monkeypatch.setattr(module, "_written", lambda _function: None)
    one_by_one = instructions(large())
    check(large())
    assert one_by_one.tolist() == at_once


def test_a_function_without_results_has_none() -> None:
    assert instructions(ca.Function("nothing", [ca.SX.sym("x")], [])).shape == (0, 4)
    assert instructions(ca.Function("zeros", [], [ca.SX(3, 3)])).shape == (0, 4)


def test_an_mx_function_has_none() -> None:
    x = ca.MX.sym("x")
    with pytest.raises(TypeError, match="mx is no function of SX"):
        instructions(ca.Function("mx", [x], [x]))
