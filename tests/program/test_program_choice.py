"""The coordinates that constraints decide: a minor that no exchange makes larger."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from taskspec.native.kernel import vector
from taskspec.program.execution.pivots import select


def choose(matrix):
    m, c = matrix.shape
    selection, rows = np.full((2, m, c), np.nan)
    chosen, left = np.zeros((2, m), dtype=np.int64)
    given = matrix.ravel(order="F"), selection, rows, chosen, left
    select(*map(vector, given), m, c)
    assert np.array_equal(selection, np.eye(c)[chosen])
    return chosen.tolist()


def minor(matrix, columns):
    return abs(np.linalg.det(matrix[:, columns]))


@pytest.mark.parametrize(("m", "c"), [(1, 6), (2, 3), (3, 6), (6, 13)])
def test_no_exchange_of_one_coordinate_makes_the_minor_larger(m, c):
    rng = np.random.default_rng(m)
    for _ in range(50):
        gradient, weights = rng.normal(size=(m, c)), rng.choice([1.0, 10.0, 100.0], size=c)
        scaled = gradient * weights
        chosen = choose(scaled)
        assert len(set(chosen)) == m
        own = minor(scaled, chosen)
        for i, j in itertools.product(range(m), range(c)):
            other = [*chosen[:i], j, *chosen[i + 1 :]]
            assert minor(scaled, other) <= own * (1 + 2e-6)


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_constraints_that_decide_nothing_have_a_choice_all_the_same(value):
    """What the tick makes of it is told by its conditioning, and not finite."""
    assert choose(np.full((2, 3), value)) == [0, 0]
