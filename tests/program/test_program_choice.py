"""The coordinates that constraints decide: a minor that no exchange makes larger."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from taskspec.program.execution.choice import choose


def minor(matrix, columns):
    return abs(np.linalg.det(matrix[:, columns]))


@pytest.mark.parametrize(("m", "c"), [(1, 6), (2, 3), (3, 6), (6, 13)])
def test_no_exchange_of_one_coordinate_makes_the_minor_larger(m, c):
    rng = np.random.default_rng(m)
    for _ in range(50):
        gradient, weights = rng.normal(size=(m, c)), rng.choice([1.0, 10.0, 100.0], size=c)
        selection = choose(gradient, weights)
        assert selection.sum(axis=0).tolist() == [1.0] * m
        scaled, chosen = gradient * weights, selection.argmax(axis=0).tolist()
        assert len(set(chosen)) == m
        own = minor(scaled, chosen)
        for i, j in itertools.product(range(m), range(c)):
            other = [*chosen[:i], j, *chosen[i + 1 :]]
            assert minor(scaled, other) <= own * (1 + 2e-6)


def test_a_coordinate_gives_way_by_its_weight():
    """Of two that the constraint depends on alike, the heavier one is eliminated."""
    for heavy in range(2):
        weights = np.array([1.0, 1.0])
        weights[heavy] = 2.0
        assert choose(np.array([[0.7, 0.7]]), weights).ravel().argmax() == heavy


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_constraints_that_decide_nothing_have_a_selection_all_the_same(value):
    """What the tick makes of it is told by its conditioning, and not finite."""
    selection = choose(np.full((2, 3), value), np.ones(3))
    assert selection.sum(axis=0).tolist() == [1.0, 1.0]
