"""Integrals of force errors on the way to a surface."""

from __future__ import annotations

import casadi as ca
import pytest

from taskspec.program.reference.force_references import wound
from taskspec.spec import load_text
from taskspec_runner import run

_APPROACH = """\
taskspec: 1
name: guarded
robot: {{model: planar2, tool: {{shape: sphere, radius: 1 cm}}, start: {{xyz: [0.34 m, 0, 0]}}}}
world: {{wall: {{shape: plane, xyz: [352 mm, 0, 0], rpy: [0, -90 deg, 0], stiffness: 10 kN/m}}}}
law: {law}
stages:
  approach:
    axes: {{x: {{velocity: 30 mm/s, force: 0}}}}
    until: force.x > 1 N
    within: 3 s
"""


@pytest.mark.parametrize(
    ("integral", "force", "spring", "held"),
    [
        (9.0, -4.0, 0.0, 2.0),  # at most f_d / k_I with k_I = 2 /s
        (-9.0, -4.0, 0.0, -2.0),
        (9.0, -4.0, -6.0, 5.0),  # against a spring that pulls back: its force more
        (0.0, 0.0, 6.0, 0.0),  # a spring of its own is not held by an integral of nothing
        (0.0, -4.0, 6.0, 0.0),
        (1.0, 0.0, 6.0, 0.0),
    ],
)
def test_in_free_space_an_integral_is_bounded_and_never_made(
    integral: float, force: float, spring: float, held: float
) -> None:
    at = (integral, force, 0.0, 2.0)
    made = [wound(*map(ca.DM, at[:3]), at[3], ca.DM(touch), ca.DM(spring)) for touch in (0, 1)]
    assert [float(each) for each in made] == [held, integral]


@pytest.mark.parametrize("law", ["parallel", "parallel-pid"])
def test_a_velocity_with_a_force_of_zero_comes_to_its_surface(law: str, tmp_path) -> None:
    made = run(load_text(_APPROACH.format(law=law), "guarded.yaml"), tmp_path / "run", report=False)
    assert made.passed, made.reason
