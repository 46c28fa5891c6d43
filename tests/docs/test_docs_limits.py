"""Keeping limits: the numbers of the page are those of the code."""

from __future__ import annotations

from documents import ROOT, table, text_of

from taskspec.control.admissible import BRAKING
from taskspec.control.state import ARM_LENGTH
from taskspec.program.execution import stage_solver
from taskspec.program.limits import bounds, consistency, limited, pushes

PAGE = ROOT / "docs" / "laws" / "limits.md"


def test_costs_and_shares():
    costs = {row[0]: float(row[1]) for row in table(PAGE, "table: cost")}
    names = {
        "force of the contacts": "force",
        "motion on the task axes": "motion",
        "null space": "null space",
    }
    assert {names[part]: cost for part, cost in costs.items()} == limited.COST
    kept = {row[0]: row[2] for row in table(PAGE, "table: limits")}
    assert kept["`force`, of each contact"] == f"{100 * pushes.FORCE_SHARE:g} %"
    assert kept["`speed` of the tip"] == f"{100 * bounds.SPEED_SHARE:g} %"
    position = "position and velocity of a joint"
    assert kept[position].startswith(f"{100 * bounds.VELOCITY_SHARE:g} % of the velocity")
    assert f"{1e3 * bounds.POSITION_MARGIN:g} mrad" in kept[position]


def test_constants_in_the_text():
    text = " ".join(text_of(PAGE).split())
    assert BRAKING == 0.5
    assert "a is half of what its motor has" in text
    assert f"up to {consistency.FRICTION_SHARE:g} μ times" in text
    assert f"no more than {consistency.SET_POINT_SHARE:g} of `limits.force`" in text
    assert f"static torques of {consistency.STATIC_SHARE:g} of the motors' limits" in text
    assert f"moments divided by {ARM_LENGTH:g} m" in text
    assert f"within {stage_solver.HELD_TICKS} control periods" in text
    assert f"residual is below {stage_solver.WORST_RESIDUAL:.0e}".replace("e-0", "e-") in text
    order = ", ".join(("torque", "torque rate", *bounds.PRECEDENCE[1:]))
    assert f"the first of {order} is kept" in text
