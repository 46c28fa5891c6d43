"""Functions of CasADi's as C: the bits of CasADi's own virtual machine."""

from __future__ import annotations

import ctypes
import shutil
import subprocess

import buffers
import casadi as ca
import numpy as np
import pytest

from taskspec.native.expressions import OPERATIONS, has_bits_of_casadi, operands_of
from taskspec.native.expressions_c import PRELUDE, expression_c
from taskspec.native.kernel_c import INCLUDES

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function", "-pedantic")
VALUES = np.array(
    [
        0.0,
        -0.0,
        0.3,
        -0.3,
        0.7,
        1.0,
        -1.0,
        2.5,
        -7.25,
        1e-300,
        5e-324,
        3.5e8,
        np.inf,
        -np.inf,
        np.nan,
    ]
)


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_all_operations_have_the_bits_of_the_virtual_machine(compiler, tmp_path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"there is no {compiler}")
    pairs = np.array([(x, y) for x in VALUES for y in VALUES])
    x, y = ca.SX.sym("x", len(pairs)), ca.SX.sym("y", len(pairs))
    functions = {}
    for code in OPERATIONS:
        # What CasADi simplifies as it is written does not come as this operation.
        if not has_bits_of_casadi(code) or code in (ca.OP_ASSIGN, ca.OP_LIFT):
            continue
        given = (x, y)[: operands_of(code)]
        result = ca.SX.unary(code, x) if len(given) == 1 else ca.SX.binary(code, x, y)
        functions[f"f{code}"] = ca.Function(f"f{code}", [x, y], [ca.densify(result)])
    assert len(functions) > 30
    text = [INCLUDES, PRELUDE]
    for name, function in functions.items():
        text.append(expression_c(function, f"{name}_"))
        text.append(
            f"void {name}(const double *const *a, double *const *r);\n"
            f"void {name}(const double *const *a, double *const *r) {{ {name}_(a, r); }}"
        )
    (tmp_path / "f.c").write_text("\n".join([*text, ""]))
    done = subprocess.run(
        [compiler, *STRICT, "-O2", "-fno-builtin", "-shared", "-fPIC", "f.c", "-o", "f.so", "-lm"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    library = ctypes.CDLL(str(tmp_path / "f.so"))
    columns = [np.ascontiguousarray(column) for column in pairs.T]
    for name, function in functions.items():
        found = np.zeros(len(pairs))
        arguments = (ctypes.c_void_p * 2)(*(column.ctypes.data for column in columns))
        results = (ctypes.c_void_p * 1)(found.ctypes.data)
        getattr(library, name)(arguments, results)
        wanted = np.array(function(*columns)).ravel()
        numbers = ~np.isnan(wanted)
        assert np.array_equal(np.isnan(found), ~numbers), name
        assert buffers.bits(found[numbers]) == buffers.bits(wanted[numbers]), name
