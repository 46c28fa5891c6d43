"""Designed gains of held mechanisms are stable: the fixed part of `make designs`."""

from __future__ import annotations

import pytest
from mechanism_tasks import LAWS, MECHANISMS, PLANAR, RATES, mechanism_task, worst

#: What was hardest: hinges seen from their axis, screws held by a fixed knob, 250 Hz, late sensors.
HARD = {
    "hybrid": (18, 90, 153, 171, 216, 234, 333, 342),
    "hybrid-multipliers": (46, 100, 136, 190, 2701),
    "hybrid-reaction": (272, 317, 2486),
    "parallel": (30, 111, 246, 327),
    "parallel-pid": (13, 22, 139, 211),
    "impedance": (347, 2030, 2192),
    "pd-joint": (296,),
}


def test_the_tasks_have_every_mechanism_law_and_rate() -> None:
    tasks = "\n".join(mechanism_task(number) for number in range(len(LAWS) * len(MECHANISMS)))
    words = [f"law: {law}\n" for law in LAWS] + [f"rate: {rate} Hz" for rate in RATES]
    words += ["hinge", "slide", "screw", "knob: free", "point: origin", "panda", "ur5e", "delay"]
    assert [word for word in words if word not in tasks] == []
    plane = "\n".join(mechanism_task(PLANAR + number) for number in range(5 * len(LAWS)))
    words = [f"law: {law}\n" for law in LAWS] + [
        "model: planar2",
        "model: planar3",
        "mechanism: slide",
    ]
    assert [word for word in (*words, "knob: fixed", "knob: free") if word not in plane] == []
    assert mechanism_task(3) == mechanism_task(3) != mechanism_task(3 + len(LAWS))


@pytest.mark.parametrize(("law", "number"), [(law, n) for law, ns in HARD.items() for n in ns])
def test_designed_gains_are_stable_where_rules_alone_were_not(law: str, number: int) -> None:
    assert worst(number, law) == 0


@pytest.mark.parametrize("law", LAWS)
def test_designed_gains_in_a_plane_are_stable(law: str) -> None:
    """Two of each law; `make designs` has 360 tasks."""
    numbers = range(PLANAR + LAWS.index(law), PLANAR + 2 * len(LAWS), len(LAWS))
    assert [worst(number) for number in numbers] == [0, 0]
