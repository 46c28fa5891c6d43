"""What sampling does: stability boundaries of the held torque and the force that comes late."""

from __future__ import annotations

import arm as plant
import pytest
import sampled
from identify import grows, poles
from presses import ARMS, SQUARE

SECTION = "What sampling does, on a spring"

T = 1e-3
BISECTED = "bisected to 0.2 %; within another 0.2 % of the boundary growth does not show in the run"

# ---- (4.36): the integral gain

#: arm, h_m [kg], d_m [N s/m], k_m [N/m], k_F, k_e [kN/m], k_I that settles [1/s], seconds
INTEGRALS = {
    "soft": ("panda", 1, 40, 400, 0.5, 10, 8, 3),
    "stiff": ("planar2", 1, 90, 500, 1.0, 80, 2, 1.5),
}


class Press:
    """One press under (4.36), whose integral gain is in question."""

    def __init__(self, simulate, name, h, d, k, k_F, k_e, settles, seconds):
        self.simulate, self.arm, self.seconds = simulate, ARMS[name], seconds
        self.gains, self.settles = (h, d, k, k_F), settles
        self.contact = f"stiffness: {k_e} kN/m, damping: 0"
        self.routh = d * (k + k_F * 1e3 * k_e) / (h * 1e3 * k_e)
        self.loop = plant.loop(self.run(settles, 0.01), self.arm.axes, self.arm.normal, -1).core()
        self.case = f"parallel, {name}, {h} kg, {d} N·s/m, {k} N/m, k_F {k_F} on {k_e} kN/m"

    def law(self, k_I):
        h, d, k, k_F = self.gains
        return (
            f"{{kind: parallel, mass: {h} kg, damping: {d} N*s/m, stiffness: {k} N/m, "
            f"force: {{proportional: {k_F}, integral: {k_I:.9g} /s}}}}"
        )

    def run(self, k_I, seconds):
        """15 N with gains that settle, then 0.2 N more with those in question."""
        return self.simulate(
            self.arm.task(
                self.law(self.settles),
                "press: {axes: {N: {force: +15 N}}, time: 1 s}",
                f"step: {{law: {self.law(k_I)}, axes: {{N: {{force: +15.2 N, ramp: 0}}}}, "
                f"time: {seconds} s}}",
                contact=self.contact,
            )
        )

    def model(self, loop, k_I):
        return sampled.parallel(loop, *self.gains, k_I)

    def critical(self):
        return sampled.critical(
            lambda i: self.loop.radius(self.model(self.loop, i)) < 1,
            0.01 * self.routh, 2 * self.routh, 1e-6,
        )  # fmt: skip


@pytest.mark.parametrize("kind", INTEGRALS)
def test_largest_integral_gain(simulate, prediction, kind):
    """(4.46) and its sampled form: Routh alone would allow what rings."""
    press = Press(simulate, *INTEGRALS[kind])
    predicted = press.critical()

    def settles(k_I):
        run = press.run(k_I, press.seconds)
        return not grows(run.during("step", f"force.{press.arm.normal}", 0.1))

    prediction(
        "largest stable k_I [1/s]", "(4.36), sampled", press.case,
        predicted, sampled.bisected(settles, predicted),
        rtol=5e-3, because=BISECTED,
    )  # fmt: skip
    limit = press.loop.towards_continuous(1e-7)
    prediction(
        "limit T → 0: largest stable k_I [1/s]", "(4.46), Routh", press.case, press.routh,
        sampled.critical(
            lambda i: max(limit.poles(press.model(limit, i)).real) < 0,
            0.5 * press.routh, 2 * press.routh, 1e-6,
        ),
        rtol=1e-3, because="first order in T = 0.1 us: (1 - h_m/Λ) k_e T of d_m",
    )  # fmt: skip


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_decay_and_growth(simulate, prediction, factor):
    """On either side of the boundary, at the rate that the sampled model says."""
    press = Press(simulate, *INTEGRALS["soft"])
    k_I = factor * press.critical()
    run = press.run(k_I, 0.8)
    model = press.loop.poles(press.model(press.loop, k_I))
    predicted = next(p for p in model if p.imag > 0)
    seen = poles(run.during("step", f"position.{press.arm.normal}", 0.01), 3, T, 8)
    measured = next(p for p in seen if p.imag > 0)
    prediction(
        "growth of the ringing [1/s]", "(4.36), sampled",
        f"{press.case}, k_I at {factor:g} of the largest stable",
        predicted.real, measured.real, rtol=2e-2,
        because="1e-4 of ω = 73 rad/s, for the arm's curvature",
    )  # fmt: skip
    assert (measured.real > 0) == (factor > 1)


# ---- (4.17): the damping


def ring(simulate, h, d_m, k_m, plant_rate):
    """planar2 at rest in a wall, kicked by a reference that jumps 10 um within one tick."""
    jump = '"305 mm + clamp((t - 300.5 ms) * 10 mm/s, 0, 10 um)"'
    law = (
        f"{{kind: impedance, mass: {h} kg, stiffness: {k_m} N/m, "
        f"damping: {{x: {DAMPING}, y: 40 N*s/m}}}}"
    )
    settle = law.replace(DAMPING, "60 N*s/m")
    return simulate(
        SQUARE.task(
            settle,
            "press: {axes: {x: {position: 305 mm}}, time: 1 s}",
            f"ring: {{law: {law.replace(DAMPING, f'{d_m:.9g} N*s/m')}, "
            f"axes: {{x: {{position: {jump}}}}}, time: 1.5 s}}",
            rest=f"control: {{rate: 1 kHz, plant_rate: {plant_rate} kHz}}\n",
        )
    )


DAMPING = "D_M"


@pytest.mark.parametrize(("h", "plant_rate"), [(1, 1), (0.6, 1), (1, 10)])
def test_least_damping_of_impedance(simulate, prediction, h, plant_rate):
    """(4.17) on a spring: a mass below the arm's own costs damping, as the force comes late."""
    k_m, k_e = 500.0, 10e3
    loop = plant.loop(ring(simulate, h, 60, k_m, plant_rate), "x y", "x", -1).core()

    def stable(d_m, loop=loop):
        return loop.radius(sampled.impedance(loop, h, d_m, k_m)) < 1

    def settles(d_m):
        run = ring(simulate, h, d_m, k_m, plant_rate)
        return not grows(run.during("ring", "force.x", 0.302))

    predicted = sampled.critical(stable, 0.5, 50, 1e-6)
    case = f"impedance, planar2, {h} kg, 500 N/m on 10 kN/m, plant at {plant_rate} kHz"
    prediction(
        "least stable d_m [N·s/m]", "(4.17), sampled", case, predicted,
        sampled.bisected(settles, predicted),
        rtol=5e-3, because=BISECTED,
    )  # fmt: skip
    # The runner's force is one step of the plant late, T_p, and the torque is held for T.
    quick = sampled.Loop(loop.inertia, 0, k_e, 0.0, 0.0, 1e-6, plant_rate)
    late, held = (1 + 1 / plant_rate) / 2, (1 - 1 / plant_rate) / 2
    formula = ((1 - h / loop.felt) * k_e * late + k_m * held) * 1e-6
    prediction(
        "first order in T: least stable d_m/T [N/m]", "(4.17), held torque", case, formula / 1e-6,
        sampled.critical(lambda d: stable(d, quick), 0.5 * formula, 2 * formula, 1e-7) / 1e-6,
        rtol=1e-3, because="second order at T = 1 us",
    )  # fmt: skip
