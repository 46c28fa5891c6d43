"""A sampled loop that is driven: all ticks at once are what one tick after the other gives."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.stability.loop import DrivenStep, _followed


def one_by_one(steps, hold, start, pushes):
    x, seen = start, []
    for k, push in enumerate(pushes):
        step = steps[min(k % hold, len(steps) - 1)]
        seen.append(step.C @ x)
        x = step.F @ x + push
    return np.array(seen).reshape(-1, 6)


@pytest.mark.parametrize("ticks", [0, 1, 5, 64, 1000, 1811])
@pytest.mark.parametrize("hold", [1, 2, 7])
@pytest.mark.parametrize("size", [3, 40])
def test_blocks_of_ticks_are_ticks(ticks, hold, size):
    rng = np.random.default_rng(ticks + hold + size)

    def step():
        F = rng.normal(size=(size, size))
        # Modes that last: the largest eigenvalue is at most 1 in any product of two such steps.
        F /= np.linalg.norm(F, 2)
        return DrivenStep(F, np.zeros((size, 0)), rng.normal(size=(6, size)), np.zeros((6, 0)))

    steps = [step() for _ in range(min(hold, 2))]
    start, pushes = rng.normal(size=size), rng.normal(size=(ticks, size))
    usual = one_by_one(steps, hold, start, pushes)
    found = _followed(steps, hold, start, pushes)
    assert found.shape == (ticks, 6)
    # Rounding of sums of `size` terms in each of as many ticks as a mode lasts, here below 50.
    assert np.allclose(
        found, usual, rtol=0, atol=50 * size * 2.3e-16 * np.abs(usual).max(initial=1)
    )


def test_what_grows_without_bounds_is_not_finite():
    step = DrivenStep(1e3 * np.eye(2), np.zeros((2, 0)), np.ones((6, 2)), np.zeros((6, 0)))
    with np.errstate(over="ignore", invalid="ignore"):
        found = _followed([step], 1, np.ones(2), np.zeros((1000, 2)))
    assert not np.abs(found).max() <= 1e6
