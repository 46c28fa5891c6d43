"""Random payloads on random arms under random laws: what adaptation promises, held against runs."""

from __future__ import annotations

import numpy as np

from taskspec.laws.adaptation import SCALES, Adaptation
from taskspec.robot.rebuild import GRAVITY

SECTION = "4.4 Adaptation to a payload"
PERIOD = 1e-3
LAWS = ("pd", "pd-joint", "hybrid", "impedance", "impedance-natural", "parallel", "parallel-pid")
ARMS = ("panda", "ur5e")

TASK = """\
taskspec: 1
name: random
robot:
  model: {arm}
  tool: {{shape: sphere, radius: 10 mm, length: 100 mm, mass: 300 g}}
  start: {{xyz: [450 mm, 100 mm, 350 mm]}}
law:
  kind: {law}
  adapt: {{{kind}: {{mass: 0..2 kg, bandwidth: {B:.4g} Hz, dead_zone: {z:.4g} N}}}}
stages:
  hang: {{time: 300 ms}}
  go: {{axes: {{{axis}: {{move: {way:.3g} mm, speed: 50 mm/s}}}}, time: 300 ms}}
truth: {{robot.payload: {{mass: {mass:.4g} kg, xyz: [{x:.3g} mm, {y:.3g} mm, {c:.3g} mm]}}}}
"""


def test_no_estimate_goes_away_from_the_truth(simulate, request, prediction):
    """V = 1/2 |theta - theta*|^2, with first moments over l, never rises, and falls."""
    count = request.config.getoption("random_presses")
    rng, falling, bounded, near = np.random.default_rng(48033), 0, 0, []
    for _ in range(count):
        facts = {
            "arm": ARMS[rng.integers(len(ARMS))],
            "law": LAWS[rng.integers(len(LAWS))],
            "kind": ("payload", "gravity")[rng.integers(2)],
            "B": 10 ** rng.uniform(-0.5, 0.5),
            "z": rng.uniform(0.05, 0.3),
            "axis": "xyz"[rng.integers(3)],
            "way": rng.uniform(-15, 15),
            "mass": rng.uniform(0.1, 1.0),
            **{name: rng.uniform(-30, 30) for name in "xyc"},
        }
        made = simulate(TASK.format(**facts))
        assert made.outcome.status == "done", (facts, made.outcome)
        mass = made["payload.mass"]
        centre = np.column_stack([made[f"payload.{axis}"] for axis in "xyz"])
        theta = np.column_stack([mass, mass[:, None] * centre])
        true = facts["mass"] * np.array([1e3, facts["x"], facts["y"], facts["c"]]) / 1e3
        V = np.sum(((theta - true) / SCALES) ** 2, axis=1) / 2
        # Below the dead zone nothing of the discretisation counts.
        falling += np.max(np.diff(V)) <= 1e-12 and V[-1] < V[0]
        # As the arm swings under its load, that weighs a little less at times: A^T A goes by the
        # square of it. To an estimate of weights alone the payload's m a is a disturbance.
        hang = made.history.window("hang")
        swings = np.diff(made["velocity.z"][hang]) / PERIOD
        least, dead_zone = np.min(1 - swings / GRAVITY[2]) ** 2, facts["z"]
        assert 0.4 < least <= 1
        if facts["kind"] == "payload":
            dead_zone /= np.sqrt(least)
        else:
            rates = np.column_stack([made[f"velocity.r{axis}"][hang] for axis in "xyz"])
            turns = np.linalg.norm(np.diff(rates, axis=0), axis=1) / PERIOD
            reach = np.linalg.norm(true[1:]) / facts["mass"]
            least, dead_zone = (
                1.0,
                dead_zone + facts["mass"] * np.max(np.abs(swings) + turns * reach),
            )
        model = Adaptation(
            low=0.0,
            high=2.0,
            reach=0.2,
            w=2 * np.pi * facts["B"],
            dead_zone=dead_zone,
            inertia=True,
            gravity=GRAVITY,
            period=PERIOD,
        )
        # Three ticks pass before the first change: it takes the velocities of two, and counts in
        # the next.
        bound = model.bound(least * np.arange(np.sum(hang)) * PERIOD, facts["mass"])
        left = np.abs(mass[hang] - facts["mass"])
        near.append(float(np.max(left[3:] / bound[:-3])))
        # The bound is of a filter without samples: half a tick of w, 0.5 % at most.
        bounded += near[-1] <= 1.005
    # The bound says something.
    assert max(near) > 0.5
    case = f"{count} random payloads on two arms under seven laws"
    because = "a proof has no exception"
    prediction("runs whose estimate never goes away from the truth", "Slotine and Li (1989), V",
               case, count, falling, atol=0.5, because=because)  # fmt: skip
    prediction("runs whose mass is within its bound", "Slotine and Li (1989), at rest", case, count,
               bounded, atol=0.5, because=because)  # fmt: skip
