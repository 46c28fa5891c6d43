"""Contradictions made by hand, and random ones hidden among rows that can be met."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.control.qp.certificate import Certificate, contradiction
from taskspec.control.qp.quadratic_program import Array

INF = np.inf


def rows(*given: tuple[list[float], float, float]) -> tuple[Array, Array, Array]:
    return (
        np.array([row[0] for row in given]),
        np.array([row[1] for row in given]),
        np.array([row[2] for row in given]),
    )


def check(A: Array, lower: Array, upper: Array, found: Certificate) -> None:
    """The certificate proves what it says, with nothing but its definition."""
    y = np.zeros(len(A))
    y[list(found.rows)] = found.multipliers
    assert np.max(np.abs(A.T @ y)) < 1e-9 * np.max(np.abs(A))
    reach = np.where(y > 0, upper, np.where(y < 0, lower, 0.0)) @ y
    assert reach < 0
    assert found.gap == pytest.approx(-reach)


def test_two_wishes_for_one_number() -> None:
    A, lower, upper = rows(([0.0, 1.0], -1, 1), ([1.0, 0.0], 5, 5), ([1.0, 0.0], -INF, 3))
    found = contradiction(A, lower, upper)
    assert found is not None
    assert found.rows == (1, 2)
    # x >= 5 and x <= 3 miss each other by 2.
    np.testing.assert_allclose(found.multipliers, (-1.0, 1.0))
    assert found.gap == pytest.approx(2.0)
    check(A, lower, upper, found)


def test_three_rows_of_which_each_pair_can_be_met() -> None:
    A, lower, upper = rows(
        ([1.0, 1.0], -INF, 1), ([1.0, 0.0], 1, INF), ([0.0, 1.0], 1, INF), ([1.0, -1.0], -9, 9)
    )
    found = contradiction(A, lower, upper)
    assert found is not None
    assert found.rows == (0, 1, 2)
    np.testing.assert_allclose(found.multipliers, (1.0, -1.0, -1.0))
    assert found.gap == pytest.approx(1.0)
    check(A, lower, upper, found)


def test_row_that_contradicts_itself() -> None:
    found = contradiction(*rows(([1.0], -1, 1), ([1.0], 2, 1.5)))
    assert found == Certificate((1,), (1.0,), 0.5)


def test_row_of_zeros_that_cannot_be_met() -> None:
    found = contradiction(*rows(([0.0, 0.0], 1, 2), ([1.0, 0.0], 0, 1)))
    assert found is not None
    assert found.rows == (0,)


def test_rows_that_just_touch_do_not_contradict_each_other() -> None:
    assert contradiction(*rows(([1.0, 0.0], 3, INF), ([1.0, 0.0], -INF, 3))) is None
    assert contradiction(*rows(([1.0, 0.0], -INF, INF), ([0.0, 0.0], 0, 0))) is None


def test_rows_in_units_far_apart() -> None:
    A, lower, upper = rows(([1e-4, 0.0], 5e-4, INF), ([1e4, 0.0], -INF, 3e4), ([0.0, 1e-4], 0, 1))
    found = contradiction(A, lower, upper)
    assert found is not None
    assert found.rows == (0, 1)
    check(A, lower, upper, found)


def test_not_finite() -> None:
    with pytest.raises(ValueError, match="not finite"):
        contradiction(*rows(([np.nan], 0, 1)))


def test_hidden_contradictions_are_found_and_minimal() -> None:
    rng = np.random.default_rng(0)
    sizes = set()
    for _ in range(150):
        n, m, k = int(rng.integers(2, 10)), 25, int(rng.integers(2, 5))
        A, inside = rng.normal(size=(m, n)), rng.normal(size=n)
        lower, upper = A @ inside - rng.random(m) - 3, A @ inside + rng.random(m) + 3
        # The last row is a combination of k others, and asks for more than they allow.
        chosen = rng.choice(m - 1, min(k, n), replace=False)
        weights = rng.uniform(0.5, 2, len(chosen))
        A[-1] = weights @ A[chosen]
        lower[-1], upper[-1] = weights @ upper[chosen] + 1.0, INF
        found = contradiction(A, lower, upper)
        assert found is not None
        check(A, lower, upper, found)
        sizes.add(len(found.rows))
        for row in found.rows:
            rest = [r for r in found.rows if r != row]
            assert contradiction(A[rest], lower[rest], upper[rest]) is None
    assert {3, 4} <= sizes


def test_feasible_sets_have_no_certificate() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        A, inside = rng.normal(size=(20, 6)), rng.normal(size=6)
        at = A @ inside
        assert contradiction(A, at - rng.random(20), at + rng.random(20)) is None


def test_nothing_is_printed(capfd: pytest.CaptureFixture[str]) -> None:
    contradiction(*rows(([1.0], 5, 6), ([1.0], -INF, 3)))
    contradiction(*rows(([1.0], 5, 4)))
    assert capfd.readouterr() == ("", "")


def test_what_is_given_stays_when_others_can_go() -> None:
    # x >= 5 is against x <= 3 as well as against x <= 4: one of the two is named.
    A, lower, upper = rows(([1.0], 5, INF), ([1.0], -INF, 3), ([1.0], -INF, 4))
    for given, named in (((1,), (0, 1)), ((2,), (0, 2)), ((2, 1), (0, 1))):
        found = contradiction(A, lower, upper, given)
        assert found is not None
        assert found.rows == named
        check(A, lower, upper, found)
