"""A small part of `declared_faults`: a press under five faults, and a witness that notices."""

from __future__ import annotations

import numpy as np
import pytest
from declared_faults import (
    FAILED,
    FAULTS,
    MISSED,
    ROOT,
    STOPPED,
    SUCCESS,
    WRONG,
    Ended,
    Witness,
    run_task,
    table,
)

PRESS = ROOT / "tasks" / "press-impedance.yaml"
SOME = [
    "{sensor: drops, at: AT}",
    "{sensor: flips, at: AT}",
    "{torque: lost, joint: J, at: AT}",
    "{encoder: sticks, joint: J, at: AT}",
    "{encoder: noise 0.01 deg, at: AT}",
]


def test_a_press_ends_in_one_of_four_ways() -> None:
    found = run_task(PRESS, SOME)
    assert {each.kind for each in found} <= {SUCCESS, MISSED, FAILED, STOPPED}
    assert (found[0].kind, found[0].reason) == (STOPPED, "sensor_lost")


def test_a_success_that_is_none_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the witness has is what a success is held against."""
    true = Witness.add

    def more(self: Witness) -> None:
        true(self)
        self.force[-1] = self.force[-1] + np.array([0.0, 0.0, 1.0])

    monkeypatch.setattr(Witness, "add", more)
    (found,) = run_task(PRESS, ["{encoder: noise 0.001 deg, at: AT}"])
    assert found.kind == WRONG
    assert "force" in found.reason


def test_a_table_counts() -> None:
    rows = table([Ended("a", FAULTS[0], STOPPED, "force"), Ended("b", FAULTS[0], SUCCESS)])
    first = rows.splitlines()[2]
    assert first == "| `sensor: drops, for: 10 ms` | 1 | 0 | 0 | 1 | force 1 |"
    assert rows.splitlines()[-1] == "| all: 2 runs of 2 tasks | 1 | 0 | 0 | 1 | - |"
