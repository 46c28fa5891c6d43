"""Worlds under `vary`: what is skipped and shared changes nothing, and no file takes long."""

from __future__ import annotations

import itertools

import pytest

from taskspec.examination import check_task
from taskspec.program.plan import StagePlan
from taskspec.program.prepare import prepare
from taskspec.program.stages.stage import compile_stage
from taskspec.rules.stability import Plants
from taskspec.spec import load_text
from taskspec.stability.budget import Budget
from taskspec.stability.corners import corners
from taskspec.stability.family import Family
from taskspec.stability.margin import rings
from taskspec.stability.sampled_stage import analyse

TASK = """
taskspec: 1
robot: {{model: panda, start: {{xyz: [500 mm, 0, 300 mm]}}, sensor: {{delay: 4 ms}}}}
world: {{table: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: 5 kN/m, damping: 10 N*s/m}}}}
law: {law}
stages:
{stages}
vary:
  world.table.stiffness: 2..20 kN/m
  world.table.damping: 0..20 N*s/m
  world.table.rpy: [+- 3 deg, 0, 0]
  robot.sensor.delay: 0..6 ms
"""
PRESS = "  go: {axes: {z: {force: -10 N}}, time: 1 s}"
WILD = "{kind: hybrid, bandwidth: {linear: 180 Hz, angular: 200 Hz}}"


@pytest.mark.parametrize(("latest", "code"), [(6, "TS504"), (40, "TS503")])
def test_the_world_that_is_told_is_the_worst_of_all(latest, code):
    """Held against every corner's modes, each with a plant of its own."""
    law = "{kind: hybrid, force: {integral: 18 /s, damping: 100 N*s/m}}"
    text = TASK.format(law=law, stages=PRESS).replace("0..6 ms", f"0..{latest} ms")
    seen = analyse(compile_stage(StagePlan(prepare(load_text(text, "t")), "go")))
    plants, bad = Plants(), {}
    for corner in corners(seen.context, ["table"], Budget(100)):
        plain = seen.modes(corner.task)
        shared = seen.modes(corner.task, plants.under(seen, corner))
        assert shared[0].s == pytest.approx(plain[0].s, rel=1e-9, abs=1e-9)
        ringing = min((m.damping_ratio for m in plain if rings(m)), default=1.0)
        bad[tuple(corner.values.values())] = plain[0].s.real if code == "TS503" else -ringing
    assert len(bad) == 3 * 2 * 2 * 2
    stiffness, damping, *_ = max(bad, key=bad.get)
    (found,) = check_task(load_text(text, "t"))
    assert found.code == code
    assert f"world.table.stiffness = {stiffness / 1e3:.3g} kN/m" in found.message
    assert f"world.table.damping = {damping:g} N*s/m" in found.message
    if code == "TS503":
        assert f"robot.sensor.delay = {latest} ms" in found.message


def test_beyond_the_budget_one_value_varies_at_a_time():
    context = prepare(load_text(TASK.format(law="hybrid", stages=PRESS), "t"))
    budget = Budget(30)
    assert [len(list(corners(context, ["table"], budget))) for _ in range(2)] == [24, 9]
    assert budget.left == 6


def test_many_unstable_stages_are_searched_for_few_gains(monkeypatch):
    """Every stage differs from the others; the first ones are told what mends them."""
    soft = [f"{axis}: {{stiffness: 100 N/m, velocity: 0}}" for axis in "xy"]
    soft += [f"{axis}: {{stiffness: 10 N*m/rad, velocity: 0}}" for axis in ("rx", "ry")]
    chosen = itertools.chain.from_iterable(itertools.combinations(soft, k) for k in range(4))
    stages = "\n".join(
        f"  s{i}: {{axes: {{{', '.join(('z: {force: -10 N}', *axes))}}}, time: 1 s}}"
        for i, axes in enumerate(chosen)
    )
    searched = []
    of = Family.of
    monkeypatch.setattr(Family, "of", lambda *a: searched.append(a[2]) or of(*a))
    found = check_task(load_text(TASK.format(law=WILD, stages=stages), "t"))
    assert {d.code for d in found} == {"TS501"}
    assert found[0].hint == "bandwidth on all its axes up to 0.626 times what it is"
    assert 3 < len(searched) <= 12
