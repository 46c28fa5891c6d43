"""Kernels: the same bits by CPython and as machine code, and refusals of all that would differ."""

from __future__ import annotations

import ctypes
import importlib.util
import linecache
import math
import re
import sys
from pathlib import Path

import buffers
import numpy as np
import pytest
import samples
from hypothesis import given, settings
from hypothesis import strategies as st

from taskspec.native import kernel
from taskspec.native.engine import Engine
from taskspec.native.kernel import KernelError, Record, vector
from taskspec.native.kernel_ir import kernel_ir
from taskspec.store import Store

NOTHING = Store(None)
ARGUMENTS = (ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int64, ctypes.c_int64)


@pytest.fixture(scope="module", params=[0, 2])
def code(request) -> Engine:
    return Engine([kernel_ir(*samples.ALL, samples.drive)], level=request.param, store=NOTHING)


@pytest.mark.parametrize("function", samples.ALL, ids=lambda f: f.__name__)
def test_constructs_mean_the_same(function, code) -> None:
    run = code.function(function.__name__, None, *ARGUMENTS)
    samples.mean_the_same(function, run)


INTS = st.integers(-(2**20), 2**20)


@settings(max_examples=200, deadline=None)
@given(x=st.floats(), y=st.floats(), i=INTS, j=INTS)
def test_numbers_mean_the_same(code, x, y, i, j) -> None:
    for function in (samples.arithmetic, samples.comparisons, samples.truth, samples.functions):
        ours, theirs = np.full(30, 0.125), np.full(30, 0.125)
        code.function(function.__name__, None, *ARGUMENTS)(ours.ctypes.data, x, y, i, j)
        function(vector(theirs), x, y, i, j)
        assert buffers.bits(ours) == buffers.bits(theirs)


STEPPED = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_double)


@STEPPED
def step(state: int, n: int, gain: float) -> None:
    doubles = (ctypes.c_double * 4).from_address(state)
    doubles[3] = 2.0 * doubles[3] + n + gain


def plant() -> samples.Plant:
    return samples.Plant(
        n=9,
        gain=0.125,
        state=np.arange(4.0),
        places=np.array([1, 2, 0], dtype=np.int32),
        motor=samples.Motor(turns=2, heat=0.5),
        words=np.array([-(2**62), 5, 2**61 + 1]),
    )


@pytest.mark.parametrize("native", [True, False])
def test_records_and_native_functions(native, code) -> None:
    address = ctypes.cast(step, ctypes.c_void_p).value if native else 0
    run = code.function("drive", ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)
    ours, theirs = plant(), plant()
    # 0.125 * 1.5**9 is below 100, and goes beyond it in the second round.
    for further, end in ((0, 9), (20, -1)):
        ours.n, theirs.n = ours.n + further, theirs.n + further
        assert run(ours.address, address) == samples.drive(theirs, address) == end
        assert ours.state.tolist() == theirs.state.tolist()
        assert ours.places.tolist() == theirs.places.tolist()
        assert (ours.motor.turns, ours.motor.heat) == (theirs.motor.turns, theirs.motor.heat)
        assert ours.words.tolist() == theirs.words.tolist()
        assert (ours.gain, ours.steps, ours.n) == (theirs.gain, theirs.steps, theirs.n)


def test_record_says_what_it_does_not_hold() -> None:
    with pytest.raises(TypeError, match="Plant has no field height"):
        samples.Plant(height=1.0)
    with pytest.raises(TypeError, match="state is a Vector, not memory of 'i'"):
        samples.Plant(state=np.zeros(3, dtype=np.int32))
    with pytest.raises(TypeError, match=r"places is a Counts, not memory of '[lq]'"):
        samples.Plant(places=np.zeros(3, dtype=np.int64))
    with pytest.raises(TypeError, match="one piece"):
        samples.Plant(state=np.zeros((3, 4))[:, 0])
    with pytest.raises(TypeError, match="motor is a Motor, not <samples"):
        samples.Plant(motor=plant())
    with pytest.raises(KernelError, match=r"Bad.text is str; a field is int, float"):

        class Bad(Record):
            text: str


def test_vector_is_flat_and_shared() -> None:
    array = np.zeros((2, 3))
    vector(array)[4] = 2.5
    assert array[1, 1] == 2.5
    assert len(vector(np.zeros(0))) == len(vector(np.zeros((0, 2)))) == 0


HEAD = """
from __future__ import annotations
import math
import os
from taskspec.native.kernel import Counts, Record, Vector, call
class D(Record):
    y: float
class C(Record):
    n: int
    inner: D
    x: Vector
WORD = "a"
def helper(v: Vector, k: int) -> float:
    return v[k]
"""

# (parameters, body, what is said)
REFUSED = [
    ("x: float", "return x ** 2", "a power is written out: x * x"),
    ("i: int", "return i / 2", "write float(a) / float(b)"),
    ("x: float", "return x // 2.0", "no FloorDiv of floats"),
    ("x: float", "return x % 2.0", "no Mod of floats"),
    ("x: float, i: int", "if x < i:\n        return 1.0\n    return x", "write float(...)"),
    ("x: float", "if 0.0 < x < 1.0:\n        return 1.0\n    return x", "`a < b and b < c`"),
    ("v: Vector", "if v:\n        return 1.0\n    return 2.0", "neither true nor false"),
    ("i: int", "b = i and 1\n    return float(b)", "write `n != 0`"),
    ("v: Vector", "return v[-1]", "write the index itself"),
    ("v: Vector", "return v[1:2][0]", "`v[k:]`"),
    ("v: Vector", "return v[::2][0]", "`v[k:]`"),
    ("v: Vector, x: float", "return v[x]", "an index is an int"),
    ("v: Vector, i: int", "v[0] = i\n    return 1.0", "write float(...) or 1.0"),
    ("v: Counts, x: float", "v[0] = x\n    return 1.0", "write int(...)"),
    ("x: float", "x = 1\n    return x", "x is a float elsewhere; here it is given an int"),
    ("x: float", "return 1", "the function returns a float, and this is an int"),
    ("x: float", "return", "the function returns a float"),
    ("x: float", "if x > 0.0:\n        return x", "its end can be reached"),
    ("x: float", "if x > 0.0:\n        y = x\n    return y", "y may have no value here"),
    ("i: int", "for k in range(i):\n        y = 1.0\n    return y", "y may have no value here"),
    ("i: int", "for k in range(i):\n        pass\n    return float(k)", "k may have no value"),
    ("i: int", "for k in range(0, i, i):\n        pass\n    return 1.0", "the step of a range"),
    ("i: int", "for k in range(0, i, 0):\n        pass\n    return 1.0", "the step of a range"),
    ("v: Vector", "for k in v:\n        pass\n    return 1.0", "`for i in range(...)`"),
    ("i: int", "for k in range(i):\n        pass\n    else:\n        pass\n    return 1.0",
     "`for i in range(...)`"),
    ("i: int", "while i:\n        pass\n    else:\n        pass\n    return 1.0", "no `else`"),
    ("x: float", "return x\n    x = 1.0", "this is never reached"),
    ("x: float", "x\n    return x", "does nothing"),
    ("x: float", "a, b = x\n    return x", "`a, b = x, y`"),
    ("x: float", "return float((1, 2))", "kernels have no `(1, 2)`"),
    ("x: float", "y = [x]\n    return x", "kernels have no `[x]`"),
    ("x: float", "assert x > 0.0\n    return x", "kernels have no `assert x > 0.0`"),
    ("x: float", "with x:\n        pass\n    return x", "kernels have no `with x:`"),
    ("x: float", "return (x := 1.0)", "kernels have no"),
    ("x: float", "return WORD", "'a' is no number"),
    ("x: float", "return nowhere", "there is no nowhere"),
    ("x: float", "return math.gamma(x)", "kernels do not call `math.gamma`"),
    ("x: float", "return os.urandom(1)", "kernels do not call `os.urandom`"),
    ("x: float", "return round(x)", "kernels do not call `round`"),
    ("x: float", "return x.real", "kernels do not know"),
    ("x: float", "return helper(x, 1)", "v of helper is a Vector, not a float"),
    ("v: Vector", "return helper(v)", "helper takes 2 arguments"),
    ("v: Vector", "return helper(v, k=1)", "by their places"),
    ("x: float", "return max(x, 1)", "takes ints, or floats"),
    ("x: float", "return x + (x > 0.0)", "write int(...)"),
    ("x: float", "call(x)\n    return x", "takes an address, which is an int"),
    ("i: int", "return float(call(i))", "`call(i)` has no value"),
    ("i: int", "x = call(i)\n    return 1.0", "`call(i)` has no value"),
    ("c: C", "return c.y", "`c.y` is no field of a record"),
    ("c: C", "c.x = c.x\n    return 1.0", "of a record stay"),
    ("c: C", "return c.inner.z", "`c.inner.z` is no field of a record"),
    ("c: C", "c.inner = c.inner\n    return 1.0", "of a record stay"),
    ("c: C", "return helper(c.inner, 1)", "v of helper is a Vector"),
    ("c: C", "d = c\n    return 1.0", "a name holds a number or a vector"),
    ("i: int", "return float(i + 99999999999999999999)", "more than 64 bits"),
    ("x: float, i: int", "return x if i else i", "one part is a float, the other an int"),
    ("x: float", "return ~x", "kernels have no `~x` of a float"),
    ("x: str", "return 1.0", "annotations are int, float, bool"),
    ("x", "return 1.0", "annotations are int, float, bool"),
    ("x: float = 1.0", "return x", "plain names without defaults"),
    ("*x: float", "return 1.0", "plain names without defaults"),
    ("x: float", "y: int = x\n    return x", "x is a float"),
    ("x: float", "def g() -> None:\n        pass\n    return x", "kernels have no `def g()"),
    ("x: float", "global y\n    return x", "kernels have no `global y`"),
    ("x: float", "del x\n    return 1.0", "kernels have no `del x`"),
    ("v: Vector, i: int", "v[i] += i\n    return 1.0", None),
    ("v: Vector", "v += 1.0\n    return 1.0", "is no number"),
    ("i: int", "if i is None:\n        return 1.0\n    return 2.0", "kernels have no"),
]  # fmt: skip


def module_of(text: str, folder: Path):
    path = folder / "kernels.py"
    path.write_text(text)
    spec = importlib.util.spec_from_file_location("kernels", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules["kernels"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def kernel_module(tmp_path):
    def make(text: str):
        linecache.clearcache()
        kernel._functions.cache_clear()
        return module_of(text, tmp_path)

    yield make
    sys.modules.pop("kernels", None)
    kernel._functions.cache_clear()


@pytest.mark.parametrize(("parameters", "body", "said"), REFUSED)
def test_what_would_differ_is_refused_with_its_place(parameters, body, said, kernel_module) -> None:
    module = kernel_module(f"{HEAD}def f({parameters}) -> float:\n    {body}\n")
    if said is None:
        kernel_ir(module.f)
        return
    with pytest.raises(KernelError, match=re.escape(said)) as refused:
        kernel_ir(module.f)
    place = re.match(r"(.*):(\d+): in f: ", str(refused.value))
    assert place is not None
    assert place[1] == module.__file__
    first = HEAD.count("\n") + 1
    assert first <= int(place[2]) <= first + 1 + body.count("\n")


def test_functions_that_cannot_be_kernels_are_named(kernel_module) -> None:
    module = kernel_module(
        f"{HEAD}from functools import cache\n@cache\ndef kept() -> None:\n    pass\n"
        "def f() -> None:\n    g()\ndef g() -> None:\n    call(1.0)\n"
        "class K:\n    def method(self) -> None:\n        pass\n"
        "def result(v: Vector) -> Vector:\n    return v\n"
    )
    for function, said in (
        (module.kept, "is no function of Python"),
        (module.kept.__wrapped__, "kept is no plain function of a module"),
        (module.K.method, "method is no plain function of a module"),
        (module.f, r"kernels\.py:\d+: in g: call\(address"),
        (module.result, "write into a vector"),
        (math.sqrt, "is no function of Python"),
    ):
        with pytest.raises(KernelError, match=said):
            kernel_ir(function)
    with pytest.raises(KernelError, match="two functions are named helper"):
        kernel_ir(module.helper, kernel_module(HEAD).helper)


def test_text_is_the_same_each_time() -> None:
    """The cache finds code by it."""
    assert kernel_ir(*samples.ALL) == kernel_ir(*samples.ALL)


def test_helpers_are_not_seen(code) -> None:
    assert set(code.names) == {*(f.__name__ for f in samples.ALL), "drive"}
