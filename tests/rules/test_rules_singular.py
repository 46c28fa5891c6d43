"""Places close to a singularity, by the measure that stops a run."""

from __future__ import annotations

import re

import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text

TASK = """
taskspec: 1
name: reaches
robot: {model: MODEL, start: {START}}
stages: {go: {path: {to: [TO], time: 2 s}}, stay: {time: 0.1 s}}
"""


def findings(model, start, to):
    text = TASK.replace("MODEL", model).replace("START", start).replace("TO", to)
    return [d for d in check_task(load_text(text, "t")) if d.code == "TS422"]


BENT = "xyz: [400 mm, 200 mm, 0]"


@pytest.mark.parametrize(
    ("model", "start", "to", "expected"),
    [
        ("planar2", BENT, "300 mm, 300 mm", 0),
        ("planar2", BENT, "599.9 mm, 0", 2),
        # Both stages begin there; the first stage leaves it again.
        ("planar2", "joints: [0, 1 deg]", "300 mm, 300 mm", 1),
        ("panda", "xyz: [500 mm, 0, 340 mm]", "450 mm, 0, 300 mm", 0),
    ],
)
def test_near(model, start, to, expected):
    assert len(findings(model, start, to)) == expected


def test_the_singular_values_are_those_of_two_links():
    """det J = l1 l2 sin(q2) with links of 300 mm, the product of its two singular values."""
    (found, *_) = findings("planar2", BENT, "599.9 mm, 0")
    least, most = map(float, re.search(r"values ([\d.]+) to ([\d.]+) m", found.message).groups())
    cosine = (0.5999**2 - 2 * 0.3**2) / (2 * 0.3**2)
    # Two digits of each in the message.
    assert least * most == pytest.approx(0.09 * (1 - cosine**2) ** 0.5, rel=0.03)


def test_the_mass_is_what_a_run_stops_at(simulate):
    """Stretched so far that an axis feels more than the limit, the run stops where it is said."""
    (found, *_) = findings("planar2", BENT, "599.999 mm, 0")
    assert "stops the run" in found.message
    text = TASK.replace("MODEL", "planar2").replace("START", BENT).replace("TO", "599.999 mm, 0")
    assert simulate(text).outcome.status == "stopped"
