"""Functions of the expression language as they are worked out."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from taskspec.program.algebra import length

X = ca.SX.sym("x", 3)
LENGTH = ca.Function("length", [X], [length(X), ca.gradient(length(X), X)])


@pytest.mark.parametrize("at", [(3.0, 4.0, 0.0), (1e-9, 0.0, -2e-9), (-7.0, 1.0, 2.0)])
def test_a_length_is_the_root_of_squares(at):
    value, slope = (np.array(each).ravel() for each in LENGTH(at))
    assert value[0] == float(ca.norm_2(ca.DM(at)))
    np.testing.assert_allclose(slope, np.array(at) / np.linalg.norm(at), rtol=1e-12)


def test_nothing_has_no_length_and_no_slope():
    value, slope = LENGTH((0.0, 0.0, 0.0))
    assert float(value) == 0
    np.testing.assert_array_equal(np.array(slope).ravel(), np.zeros(3))


def test_what_is_no_number_has_a_length_that_is_none():
    value, _ = LENGTH((np.nan, 1.0, 0.0))
    assert np.isnan(float(value))
