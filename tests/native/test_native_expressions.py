"""Every operation of CasADi's SX as machine code and by the interpreter, bit for bit.

Both are held against CasADi's virtual machine.
"""

from __future__ import annotations

import ctypes
import itertools
import re
from pathlib import Path

import buffers
import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskspec.native import expressions, libm
from taskspec.native.engine import Engine
from taskspec.native.expressions import (
    UnsupportedOperationError,
    Zero,
    expression_ir,
)
from taskspec.native.interpreter import INTERPRET, interpreted, interpreter_ir

NOTHING = buffers.NOTHING
X, Y = ca.SX.sym("x"), ca.SX.sym("y")

UNARY = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh"),
    *("atanh", "exp", "expm1", "log", "log1p", "erf", "sqrt", "fabs", "floor", "ceil", "sign"),
    *("erfinv", "logic_not"),
)
BINARY = (
    *("fmin", "fmax", "atan2", "fmod", "remainder", "hypot", "copysign"),
    *("logic_and", "logic_or"),
)
OPERATIONS = {
    **{name: getattr(ca, name)(X) for name in UNARY},
    **{name: getattr(ca, name)(X, Y) for name in BINARY},
    "assign": X,
    "if_else_zero": ca.if_else(X, Y, 0.0),
    "add": X + Y,
    "sub": X - Y,
    "mul": X * Y,
    "div": X / Y,
    "neg": -X,
    "sq": X * X,
    "twice": 2 * X,
    "inv": 1 / X,
    "pow": X**Y,
    "constpow": X**2.5,
    "lt": X < Y,
    "le": X <= Y,
    "eq": X == Y,
    "ne": X != Y,
}

# Zeros, infinities, NaN, denormals, the ends of the range, halves and odd numbers for rounding,
# arguments near 1, ends of exp, large angles.
SPECIAL = [
    *(0.0, 5e-324, 1e-310, 2.2250738585072014e-308, 1e-300, 1e-9, 0.3, 0.5, 0.7, 1 - 2**-53, 1.0),
    *(1 + 2**-52, 1.5, 2.0, 2.5, 3.0, np.pi, 100.0, 709.8, 745.2, 2.0**53, 1e22),
    *(1.7976931348623157e308, np.inf),
]
RNG = np.random.default_rng(0)
PAIRS = np.array(
    [
        *itertools.product([*SPECIAL, *(-x for x in SPECIAL), np.nan], repeat=2),
        *(RNG.normal(size=(1000, 2)) * 10.0 ** RNG.integers(-20, 20, (1000, 2))),
        *RNG.uniform(-1.5, 1.5, (1000, 2)),
    ]
)


def function_of(expression: ca.SX, times: int = 1) -> ca.Function:
    """Of x and y, each of so many numbers."""
    x, y = ca.SX.sym("x", times), ca.SX.sym("y", times)
    one = ca.Function("one", [X, Y], [expression])
    return ca.Function(
        "f", [x, y], [ca.vertcat(*[one(x[k], y[k]) for k in range(times)])], {"cse": False}
    )


def opcodes(function: ca.Function) -> set[int]:
    return {function.instruction_id(k) for k in range(function.n_instructions())}


@pytest.fixture(scope="module")
def code() -> Engine:
    return Engine(
        [expression_ir(function_of(e), f"op.{name}") for name, e in OPERATIONS.items()],
        store=NOTHING,
    )


@pytest.mark.parametrize("name", OPERATIONS)
def test_operation_has_the_bits_of_the_virtual_machine(name, code) -> None:
    function = function_of(OPERATIONS[name])
    buffer, evaluate = function.buffer()
    x, y, theirs, ours, interpreted_ = (np.zeros(1) for _ in range(5))
    buffer.set_arg(0, memoryview(x))
    buffer.set_arg(1, memoryview(y))
    buffer.set_res(0, memoryview(theirs))
    run = buffers.EVALUATE(code.address(f"op.{name}"))
    interpret = buffers.by_interpreter(function)
    arg, res = buffers.pointers([x, y]), buffers.pointers([ours])
    for x[0], y[0] in PAIRS:
        evaluate()
        run(arg, res, None, None, 0)
        interpret([x, y], [interpreted_])
        expected = buffers.bits(theirs)
        assert buffers.bits(ours) == expected, (x[0], y[0], ours[0], theirs[0])
        assert buffers.bits(interpreted_) == expected, (x[0], y[0], interpreted_[0], theirs[0])


def test_all_operations_of_casadi_are_held_or_refused() -> None:
    """Those are all that its virtual machine evaluates, by the header that defines it."""
    header = Path(ca.GlobalOptions.getCasadiIncludePath()) / "casadi" / "core" / "calculus.hpp"
    listed = header.read_text().split("#define CASADI_MATH_FUN_BUILTIN_GEN")[1].split("#define")[0]
    builtin = {getattr(ca, name) for name in re.findall(r"case (OP_\w+):", listed)}
    assert len(builtin) > 40
    assert builtin - {ca.OP_PRINTME} == set(expressions.OPERATIONS)
    coded = {f"operation.{k}" for k in (*expressions.OPERATIONS, ca.OP_INPUT, ca.OP_OUTPUT)}
    assert set(buffers.interpreter().names) == coded | {"operation.end", INTERPRET}
    tested = set().union(*(opcodes(function_of(e)) for e in OPERATIONS.values()))
    # ASSIGN and LIFT pass a number on, and SX makes neither; before CasADi 3.8 it made no TWICE.
    assert builtin - tested <= {ca.OP_PRINTME, ca.OP_ASSIGN, ca.OP_LIFT, ca.OP_TWICE}


@pytest.mark.parametrize("zero", Zero)
@pytest.mark.parametrize("name", ["fmin", "fmax"])
def test_extreme_of_zeros_is_what_a_libm_makes_of_them(name, zero, monkeypatch) -> None:
    """Other platforms take another zero than this one; the rest is the same everywhere."""
    theirs = function_of(OPERATIONS[name])
    monkeypatch.setattr(expressions, "_zero_taken", lambda _name: zero)
    evaluate = buffers.own_code(theirs)
    result, expected = np.zeros(1), np.zeros(1)
    for a, b in itertools.product([0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan], repeat=2):
        x, y = np.array([a]), np.array([b])
        evaluate([x, y], [result])
        buffers.virtual(theirs, [x, y], [expected])
        if a == 0.0 == b and np.signbit(a) != np.signbit(b):
            assert result[0] == 0.0
            assert bool(np.signbit(result[0])) == zero.value[0 if np.signbit(b) else 1]
        else:
            assert buffers.bits(result) == buffers.bits(expected), (a, b)


def several() -> ca.Function:
    x, y, nothing = ca.SX.sym("x", 3), ca.SX.sym("y", 2), ca.SX.sym("n", 0)
    first = ca.vertcat(x[1] * x[1] + 1.0, ca.sin(x[0]))
    sparse = ca.SX(ca.Sparsity(2, 2, [0, 1, 2], [0, 1]))
    sparse[0, 0], sparse[1, 1] = x[2] - y[0], y[1]
    return ca.Function("several", [x, nothing, y], [first, ca.SX(0, 1), sparse, ca.SX(3.5)])


@pytest.mark.parametrize("tier", buffers.TIERS)
def test_arguments_and_results_may_be_missing(tier) -> None:
    """Zeros for NULL arguments, NULL results left out, as CasADi's convention has it."""
    function = several()
    evaluate = buffers.TIERS[tier](function)
    x, y = np.array([0.3, -2.0, 5.0]), np.array([1.5, -0.25])
    for present in itertools.product([True, False], repeat=5):
        given = [x if present[0] else None, None, y if present[1] else None]
        ours, theirs = (buffers.outputs_of(function) for _ in range(2))
        kept = [True, True, *present[2:]]
        wanted = [present[2], present[3], present[4], kept[0]]
        evaluate(given, [o if w else None for o, w in zip(ours, wanted, strict=True)])
        buffers.virtual(
            function, given, [o if w else None for o, w in zip(theirs, wanted, strict=True)]
        )
        for mine, other in zip(ours, theirs, strict=True):
            assert buffers.bits(mine) == buffers.bits(other)


@pytest.mark.parametrize("tier", buffers.TIERS)
def test_a_result_may_lie_where_an_argument_does(tier) -> None:
    x = ca.SX.sym("x", 3)
    turned = ca.Function("turned", [x], [ca.vertcat(x[1], x[2], x[0] + x[1])])
    memory = np.array([1.0, 2.0, 4.0])
    buffers.TIERS[tier](turned)([memory], [memory])
    assert memory.tolist() == [2.0, 4.0, 3.0]


def leaves() -> st.SearchStrategy[ca.SX]:
    numbers = st.floats(allow_nan=True, allow_infinity=True).map(ca.SX)
    return st.one_of(st.sampled_from([X, Y]), numbers)


def grown(parts: st.SearchStrategy[ca.SX]) -> st.SearchStrategy[ca.SX]:
    # The sign of NaN is nobody's promise, and copysign shows it.
    names = [name for name in BINARY if name != "copysign"]
    unary = st.builds(lambda name, a: getattr(ca, name)(a), st.sampled_from(UNARY), parts)
    binary = st.builds(
        lambda name, a, b: getattr(ca, name)(a, b),
        st.sampled_from([*names, "plus", "minus", "times", "rdivide", "power", "lt", "le", "eq"]),
        parts,
        parts,
    )
    return st.one_of(unary, binary)


@settings(max_examples=60, deadline=None)
@given(expression=st.recursive(leaves(), grown, max_leaves=30))
def test_random_expressions_have_the_bits_of_the_virtual_machine(expression) -> None:
    """Whole functions, which LLVM may rearrange where single operations leave nothing to."""
    function = function_of(expression)
    tiers = buffers.own_code(function, level=2), buffers.by_interpreter(function)
    ours, theirs = np.zeros(1), np.zeros(1)
    for x, y in PAIRS[:: len(PAIRS) // 50].reshape(-1, 2, 1).copy():
        buffers.virtual(function, [x, y], [theirs])
        for evaluate in tiers:
            evaluate([x, y], [ours])
            assert buffers.bits(ours) == buffers.bits(theirs), (expression, x, y)


def test_products_are_not_contracted() -> None:
    """x y + z in one rounding differs here from two: (1 + e)(1 - e) - 1 is -e^2, or 0."""
    z = ca.SX.sym("z")
    function = ca.Function("f", [X, Y, z], [X * Y + z])
    e = 2.0**-30
    for evaluate in (buffers.own_code(function, level=3), buffers.by_interpreter(function)):
        result = np.ones(1)
        evaluate([np.array([v]) for v in (1 + e, 1 - e, -1.0)], [result])
        assert result[0] == 0.0


@pytest.mark.parametrize("tier", buffers.TIERS)
def test_what_cannot_be_compiled_is_named(tier) -> None:
    inner = ca.Function("inner", [X], [ca.sin(X)], {"never_inline": True})
    called = ca.Function("outer", [X], [inner(X)])
    printing = ca.Function("printing", [X, Y], [X.printme(Y)])
    for function, operation in ((called, "OP_CALL"), (printing, "OP_PRINTME")):
        with pytest.raises(
            UnsupportedOperationError, match=f"{function.name()} uses {operation}"
        ) as e:
            buffers.TIERS[tier](function)
        assert (e.value.operation, e.value.opcode) == (operation, getattr(ca, operation))
    x = ca.MX.sym("x", 2)
    with pytest.raises(TypeError, match="mx is no function of SX"):
        buffers.TIERS[tier](ca.Function("mx", [x], [ca.norm_2(x)]))


def test_a_libm_with_other_bits_is_refused(monkeypatch) -> None:
    """Where CasADi is linked with another one: here acos in the place of asin."""
    monkeypatch.setattr(libm, "address", lambda _name, true=libm.address: true("libm.acos"))
    expressions._is_casadis.cache_clear()
    try:
        with pytest.raises(UnsupportedOperationError, match="OP_ASIN, which this libm has with"):
            expression_ir(ca.Function("f", [X], [ca.asin(X)]), "f")
        expression_ir(ca.Function("f", [X], [ca.acos(X)]), "f")
        engine = Engine([interpreter_ir()], store=NOTHING)
        with pytest.raises(UnsupportedOperationError, match="OP_ASIN"):
            buffers.by_interpreter(ca.Function("f", [X], [ca.asin(X)]), engine)
        buffers.by_interpreter(ca.Function("f", [X], [ca.acos(X)]), engine)
    finally:
        expressions._is_casadis.cache_clear()


def test_calling_convention_is_that_of_casadi() -> None:
    """Called by its type in C, with work vectors that it leaves alone."""
    function = several()
    code = Engine([expression_ir(function, "several")], store=NOTHING)
    x, y = np.ones(3), np.ones(2)
    results = buffers.outputs_of(function)
    double = ctypes.POINTER(ctypes.POINTER(ctypes.c_double))
    work = np.full(function.sz_w() + 1, buffers.UNTOUCHED)
    run = code.function(
        "several", ctypes.c_int, double, double, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int
    )
    arg, res = buffers.pointers([x, None, y]), buffers.pointers(results)
    assert run(ctypes.cast(arg, double), ctypes.cast(res, double), None, work.ctypes.data, 0) == 0
    assert results[3][0] == 3.5
    assert (work == buffers.UNTOUCHED).all()


def test_functions_are_evaluated_in_turns_by_one_interpreter() -> None:
    """Each has its work vector, and leaves nothing in it that a later call would read."""
    functions = [several(), function_of(ca.sin(X) / Y + 2.5, 3)]
    evaluates = [buffers.by_interpreter(function) for function in functions]
    rng = np.random.default_rng(1)
    for _ in range(20):
        for function, evaluate in zip(functions, evaluates, strict=True):
            given = [rng.normal(size=max(1, function.nnz_in(k))) for k in range(function.n_in())]
            ours, theirs = buffers.outputs_of(function), buffers.outputs_of(function)
            evaluate(given, ours)
            buffers.virtual(function, given, theirs)
            for mine, other in zip(ours, theirs, strict=True):
                assert buffers.bits(mine) == buffers.bits(other)


def test_a_function_is_prepared_once_for_its_interpreter() -> None:
    function = several()
    prepared = interpreted(function, buffers.interpreter())
    assert interpreted(function, buffers.interpreter()) is prepared
    other = Engine([interpreter_ir()], store=NOTHING)
    assert interpreted(function, other).engine is other


def test_instructions_with_one_operation_follow_on_each_other() -> None:
    """A processor guesses the operation that comes next; a hundred products come in one piece."""
    function = function_of(ca.sin(X) * Y + X, 100)
    runs = interpreted(function, buffers.interpreter()).runs.tolist()
    lengths = []
    while len(runs) > 1:
        length = 2 + runs[1] * (2 if len(lengths) == 4 else 1)
        lengths.append(runs[1])
        runs = runs[length:]
    # Arguments, sines, products, sums, results.
    assert lengths == [200, 100, 100, 100, 100]
