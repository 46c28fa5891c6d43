"""Kernels as C: the same bits as under Python, by every compiler that is here."""

from __future__ import annotations

import ctypes
import shutil
import subprocess

import buffers
import numpy as np
import pytest
import samples

from taskspec.native import quadratic
from taskspec.native.kernel import KernelError
from taskspec.native.kernel_c import INCLUDES, PRELUDE, kernel_c

ARGUMENTS = (ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int64, ctypes.c_int64)
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function", "-pedantic")


@pytest.fixture(scope="module", params=["gcc", "clang"])
def compiled(request, tmp_path_factory):
    """Compiles C into a library."""
    if shutil.which(request.param) is None:
        pytest.skip(f"there is no {request.param}")

    def build(name: str, text: str, *options: str):
        folder = tmp_path_factory.mktemp(name)
        (folder / f"{name}.c").write_text(text)
        library = folder / f"{name}.so"
        command = [request.param, *STRICT, *options, "-O2", "-shared", "-fPIC", f"{name}.c"]
        done = subprocess.run(
            [*command, "-o", library.name, "-lm"], cwd=folder, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return ctypes.CDLL(str(library))

    return build


@pytest.fixture(scope="module")
def code(compiled):
    return compiled("samples", INCLUDES + PRELUDE + kernel_c(*samples.ALL))


@pytest.mark.parametrize("function", samples.ALL, ids=lambda f: f.__name__)
def test_constructs_mean_the_same(function, code) -> None:
    run = getattr(code, function.__name__)
    run.argtypes, run.restype = ARGUMENTS, None
    samples.mean_the_same(function, run)


def test_two_calls_in_one_expression_are_refused() -> None:
    """C may call the second one first."""

    with pytest.raises(KernelError, match="C may call the second first"):
        kernel_c(samples.twice)


def test_the_dual_solver_gives_the_same_bits(compiled) -> None:
    """The kernel that solves programs, over its record."""
    library = compiled("quadratic", INCLUDES + PRELUDE + kernel_c(quadratic.solve))
    library.solve.argtypes, library.solve.restype = [ctypes.c_void_p], ctypes.c_int64
    random, states = np.random.default_rng(5), set()
    for _ in range(40):
        n, m = random.integers(2, 8), random.integers(1, 12)
        root = random.normal(size=(n, n))
        parts = {
            "P": (root @ root.T + 0.1 * np.eye(n)).ravel(),
            "g": random.normal(size=n),
            "A": random.normal(size=(m, n)).ravel(),
            "lower": random.normal(size=m) - 0.3,
        }
        parts["upper"] = parts["lower"] + random.uniform(0.0, 1.0, m)
        spaces = [quadratic.workspace(n, m) for _ in range(2)]
        for space in spaces:
            for name, values in parts.items():
                np.asarray(getattr(space, name))[:] = values
        state = library.solve(spaces[0].address)
        assert state == quadratic.solve(spaces[1])
        states.add(state)
        ours, theirs = (np.asarray(space.x) for space in spaces)
        assert buffers.bits(ours) == buffers.bits(theirs)
    assert {quadratic.SOLVED, quadratic.INFEASIBLE} <= states
