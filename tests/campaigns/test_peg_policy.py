"""What a policy does to a peg, and what an action of 0 leaves as it is."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "campaigns"))

peg_policy = pytest.importorskip("peg_policy")
seatings = pytest.importorskip("seatings")


@pytest.fixture(scope="module")
def on_file():
    return peg_policy.LEARNERS[0].env()


def test_without_actions_the_peg_is_seated_as_by_the_file(on_file):
    file = peg_policy.LEARNERS[0].file
    (by_itself,) = seatings.seatings(file, {}, 3, 1)
    earned = peg_policy.episode(on_file, peg_policy.nothing(on_file), 3, 0)
    found = peg_policy.seated(on_file)
    assert found == by_itself
    assert found.in_time
    # 10 for what is expected; a second costs at most 0.2 + 2, as nothing is above 20 N.
    assert 10 - 2.2 * found.time - 5 * found.time < earned < 10


def test_actions_of_a_policy_change_when_the_peg_is_seated(on_file):
    """It falls, is pushed and stands up faster."""
    nothing = peg_policy.nothing(on_file)
    weights = nothing.weights.copy()
    names = [channel.name for channel in on_file.setup.actions.channels]
    for name, weight in {"fall": 0.3, "push": 0.5, "rise": 0.7}.items():
        weights[names.index(name), 0] = weight
    peg_policy.episode(on_file, nothing, 3, 0)
    slow = peg_policy.seated(on_file)
    peg_policy.episode(on_file, peg_policy.Policy(weights), 3, 0)
    fast = peg_policy.seated(on_file)
    assert fast.time < slow.time - 0.2


def test_a_training_is_that_of_its_seed(on_file, monkeypatch):
    monkeypatch.setattr(peg_policy, "CANDIDATES", 3)
    (one,), (same,), (other,) = (
        list(peg_policy.train(on_file, seed, generations=1)) for seed in (1, 1, 2)
    )
    assert one[0] == same[0]
    assert np.array_equal(one[1].weights, same[1].weights)
    assert not np.array_equal(one[1].weights, other[1].weights)


def test_cells_say_what_was_not_reached():
    seating, never = seatings.Seating(4.0, 12.0), seatings.Seating(np.inf, 30.0)
    found = list(seatings.cells([seating] * 6 + [never] * 4))
    assert found == ["6 of 10", "6", "4.00 s", "—", "12.0 N", "30.0 N"]
