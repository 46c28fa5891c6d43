"""How far inside its bounds an expectation stayed, and when it was broken."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_verdict import judged

from taskspec_runner.verdict.margin import lost_share, room


@pytest.mark.parametrize(
    ("expectation", "margins"),
    [
        # A largest value of 5 mm under 8 mm leaves 3 of 8.
        ("max(abs(down.error.x)) < 8 mm", [(3.0, "mm", 3 / 8)]),
        ("max(abs(down.error.x)) < 4 mm", [(-1.0, "mm", -1 / 4)]),
        # The tick that is nearest to a bound: -16 N in -17..-13 N, half of it 2 N.
        ("wipe.force.z within -15 N +- 2 N", [(1.0, "N", 1 / 2)]),
        ("wipe.force.z < -13 N", [(1.0, "N", 1 / 13)]),
        ("min(table.gap) > -2 mm", [(1.0, "mm", 1 / 2)]),
        # A bound of nothing has no share.
        ("last(down.force.z) >= 0", [(0.0, "N", None)]),
        # Half of the ticks are good: 30 % more than needed, of 80 % that were forgiven.
        ("wipe.force.z within -press +- 0.5 N for 20 %", [(30.0, "%", 3 / 8)]),
        ("wipe.force.z within -press +- 0.5 N for 100 %", [(-50.0, "%", None)]),
        # One for each condition.
        (
            "max(wipe.force.z) < -10 N and wipe.touching and down.force.z > -3 N",
            [(4.0, "N", 0.4), (1.0, "N", 1 / 3)],
        ),
        # What has no bound, or no tick, has no margin.
        ("wipe.touching", []),
        ("never.force.z < 0", []),
    ],
)
def test_margins(expectation: str, margins: list[tuple[float, str, float | None]]) -> None:
    found = judged(expectation).margins
    assert [m.unit for m in found] == [unit for _, unit, _ in margins]
    np.testing.assert_allclose([m.value for m in found], [v for v, _, _ in margins], rtol=1e-12)
    for each, (_, _, share) in zip(found, margins, strict=True):
        assert each.left == (None if share is None else pytest.approx(share))


@pytest.mark.parametrize(
    ("expectation", "clock", "words"),
    [
        # Every tick: the first that fails.
        ("wipe.force.z < -14.5 N", 1.0, "wipe.force.z = -14 N (needs < -14.5 N)"),
        ("down.touching", 0.0, "'down.touching' did not hold"),
        # Of four ticks at 1, 1.5, 2 and 2.5 s the first and the last are outside.
        ("wipe.force.z within -press +- 0.5 N for 51 %", 2.5, "more than 49 % of its ticks"),
        ("wipe.force.z within -press +- 0.5 N for 76 %", 1.0, "the first at 1.000 s"),
        # A largest value leaves its bound at a tick.
        ("max(norm(wipe.force.x, wipe.force.y)) < 4 N", 1.0, "passed its bound"),
        ("max(abs(error.x)) < 4 mm", 3.0, "passed its bound; max(abs(error.x)) = 5 mm"),
        ("min(wipe.force.z) > -14.5 N", 1.5, "passed its bound"),
        # 4, 8, 12 of 16 mm^2 over four ticks against 4 * 1.5^2 = 9 mm^2: lost at the third.
        ("rms(wipe.error.x) < 1.5 mm", 2.0, "could not be met any more"),
        # All others are known at their last tick.
        ("last(wipe.force.z) > -15 N", 2.5, "it was judged, last(wipe.force.z) = -16 N"),
        ("abs(last(wipe.force.z) + 15 N) < 5 mN", 2.5, "it was judged"),
        ("mean(wipe.force.z) > -14 N", 2.5, "it was judged"),
        # Of several conditions the first that is broken, wherever it stands.
        ("last(wipe.force.z) > -15 N and wipe.force.z < -14.5 N", 1.0, "wipe.force.z = -14 N"),
        # What cannot be told is broken where it has no value first.
        ("wipe.error.z < 1 mm", 1.0, "has no value"),
    ],
)
def test_breaks(expectation: str, clock: float, words: str) -> None:
    found = judged(expectation).broken
    assert found is not None
    assert found.clock == clock
    assert words in found.text


@pytest.mark.parametrize("expectation", ["wipe.force.z < -13 N", "max(force.x) < 4 N"])
def test_what_was_met_was_not_broken(expectation: str) -> None:
    assert judged(expectation).broken is None


@pytest.mark.parametrize("expectation", ["never.force.z < 0", "down.visits <= 1"])
def test_no_tick_breaks_what_is_about_none(expectation: str) -> None:
    found = judged(expectation)
    assert (found.passed, found.broken) == (False, None)


@given(st.lists(st.booleans(), min_size=1, max_size=60), st.floats(0.01, 1.0))
def test_a_share_is_lost_where_no_later_tick_can_save_it(bad: list[bool], amount: float) -> None:
    window = np.ones(len(bad), dtype=bool)
    failing = np.array(bad)
    good = np.count_nonzero(~failing)
    if good >= amount * len(bad) * (1 - 1e-12):
        return
    row = lost_share(failing, window, amount)
    # Up to and without that tick, all that is left could still be good; with it, not.
    best_before = len(bad) - np.count_nonzero(failing[:row])
    assert best_before >= amount * len(bad) * (1 - 2e-12)
    assert best_before - 1 < amount * len(bad)


def test_room_is_to_the_nearest_bound() -> None:
    value, low, high = np.array([0.0, 1.0, 4.0]), np.full(3, -1.0), np.full(3, 3.0)
    assert room(value, low, high).tolist() == [1.0, 2.0, -1.0]
    assert room(value, None, high).tolist() == [3.0, 2.0, -1.0]
