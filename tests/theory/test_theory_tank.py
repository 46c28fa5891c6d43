"""Energy tanks along runs: torques by a second implementation, passivity, and bounds on power.

The log has the state at the start of each tick. Torques, contact forces and H are held over T:
a balance of energies by mean velocities is off by the change of H within a tick alone.
"""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import presses
import pytest

from taskspec.laws.tank import _CLOSING as CLOSING
from taskspec.laws.tank import _LOW as LOW
from taskspec.spec import load_text
from taskspec.statics.tank_demand import first_contact
from taskspec_runner import run
from taskspec_runner.verdict.energy import RunEnergies

SECTION = "4.1 Impedance, PD and stiffness control"
T = 1e-3
SIX = ("x", "y", "z", "rx", "ry", "rz")
#: What of a balance may be left of the work that went through it: H turns within a tick.
LEFT = 2e-3
#: The velocity of the next period is known up to its second difference: of the most power, this.
AHEAD = 5e-3


def root(power, asked, own):
    """The positive root of s (asked + own s) = power."""
    return 2 * power / max(asked + np.sqrt(asked**2 + 4 * own * power), 1e-300)


class Recomputed:
    """The torques of a stage under a law with a tank, from its log, by NumPy and Pinocchio."""

    def __init__(self, made, law, tank, mass):
        self.made, self.law, self.mass = made, law, mass
        self.capacity, self.start, self.power = tank
        gains = made.program.stages[0].plan.gains["damping"]
        self.damping = np.array([gains[a].value for a in SIX])
        self.model = made.program.context.robot.pin
        self.data = self.model.createData()

    def row(self, k, names):
        """Columns of one tick, 0 where there is none."""
        return np.nan_to_num([self.made[n][k] for n in names])

    def terms(self, k):
        """q', g, H, C q' + g, J, J' q' of a tick."""
        n, model, data = self.model.nv, self.model, self.data
        q, v = (
            self.row(k, [f"joint.{i + 1}.{what}" for i in range(n)])
            for what in ("position", "velocity")
        )
        H = np.triu(pin.crba(model, data, q))
        H = H + np.triu(H, 1).T
        bias = pin.nonLinearEffects(model, data, q, v).copy()
        g = pin.computeGeneralizedGravity(model, data, q).copy()
        pin.forwardKinematics(model, data, q, v, np.zeros(n))
        pin.updateFramePlacements(model, data)
        frame, world = model.getFrameId("tip"), pin.LOCAL_WORLD_ALIGNED
        drift = pin.getFrameClassicalAcceleration(model, data, frame, world).vector.copy()
        J = pin.computeFrameJacobian(model, data, q, frame, world).copy()
        return v, g, H, bias, J, drift

    def stiffness(self, k):
        """(6,) of a tick."""
        given = [self.made.history.columns.get(f"gain.stiffness.{a}") for a in SIX]
        fixed = self.made.program.stages[0].plan.gains["stiffness"]
        pairs = zip(SIX, given, strict=True)
        return np.array([fixed[a].value if c is None else c[k] for a, c in pairs])

    def damper(self, terms):
        """(6, 6) D, of a law with an apparent mass (D^-1 + T Lambda^-1)^-1."""
        _, _, H, _, J, _ = terms
        if self.law == "pd":
            return np.diag(self.damping)
        mobility = J @ np.linalg.solve(H, J.T)
        return np.linalg.inv(np.diag(1 / self.damping) + T * mobility)

    def equation(self, k, pull, velocity, terms):
        """u of the law's own equation: (4.21), or (4.16) with a reference at rest."""
        _, g, H, bias, J, drift = terms
        if self.law == "pd":
            return J.T @ (pull - self.damping * velocity) + g
        f = -self.row(k, [f"{'torque' if a in SIX[3:] else 'force'}.{a}.measured" for a in SIX])
        a = (pull - self.damping * velocity + f) / self.mass
        Lambda = np.linalg.inv(J @ np.linalg.solve(H, J.T))
        return J.T @ (Lambda @ (a - drift)) + bias - J.T @ f

    def ticks(self):
        """Of each tick (torque, energy, power, r, s)."""
        before = None
        for k in range(len(self.made["t"])):
            terms = self.terms(k)
            v, g, _, _, J, _ = terms
            e = self.row(k, [f"error.{a}" for a in SIX])
            velocity, K = J @ v, self.stiffness(k)
            pull = K * e
            u = self.equation(k, pull, velocity, terms)
            spring, damper = J.T @ pull, -J.T @ self.damper(terms) @ velocity
            rest, U = u - g - spring - damper, 0.5 * e @ pull
            if before is None:
                E, left, out, ahead = self.start + U, None, 0.0, v
                allowed = E
            else:
                over = T * (before["v"] + v) / 2
                W = (before["torque"] - (before["g"] + g) / 2) @ over
                taken = -before["damper"] @ over
                E = before["energy"] + before["stretched"] - W
                left = before["stretched"] - W - taken
                allowed = max(E, 0.0)
                if np.isfinite(self.power):
                    allowed = min(allowed, max(left + T * self.power, 0.0))
                ahead = v + (v - before["v"]) / 2
            stretched = min(U, allowed)
            r = 1.0 if allowed >= U else allowed / U
            energy = min(E - stretched, self.capacity)
            if before is not None:
                out = (before["energy"] + taken - (E - stretched)) / T
            pushed = np.linalg.solve(np.linalg.cholesky(terms[2]), rest)
            asked = rest @ ahead
            if before is not None:
                asked -= T * pushed @ before["pushed"] / 2
            own = T * pushed @ pushed / 2
            free = max(energy, 0.0)
            s = min(1.0, free / (LOW * self.capacity), root(free / CLOSING, asked, own))
            if np.isfinite(self.power):
                pulled = 0.0
                if before is not None:
                    pulled = max(before["r"] * U - left - before["given"], 0.0) / T
                s = min(s, root(self.power, asked + pulled, own))
            torque = g + r * spring + damper + s * rest
            yield torque, energy, out, r, s
            # Each tick goes on from what the log has of the one before: rounding does not add up.
            energy, r, s = (self.made[f"tank.{name}"][k] for name in ("energy", "spring", "share"))
            torque = self.row(k, [f"joint.{i + 1}.torque" for i in range(len(v))])
            before = {
                "torque": torque, "v": v, "g": g, "damper": damper, "energy": energy,
                "stretched": r * U, "r": r, "given": T * s * (asked + own * s),
                "pushed": s * pushed,
            }  # fmt: skip


SWINGS = "{x: 500 N/m, y: 500 N/m, z: '1000 N/m + 700 N/m * sin(2*pi*t*3 Hz)'}"
CASES = {
    "pd": ("pd", "", "tank: 4 mJ", (4e-3, 4e-3, np.inf)),
    "pd with a limit on its power": (
        *("pd", "", "tank: {energy: 60 mJ, start: 30 mJ, power: 60 mW}"),
        (60e-3, 30e-3, 60e-3),
    ),
    "impedance": ("impedance", "mass: {linear: 3 kg, angular: 0.2 kg*m^2}, ", "tank: 9 mJ",
                  (9e-3, 9e-3, np.inf)),
    "impedance with a limit on its power": (
        *("impedance", "mass: {linear: 3 kg, angular: 0.2 kg*m^2}, "),
        *("tank: {energy: 0.1 J, power: 20 mW}", (0.1, 0.1, 20e-3)),
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_torques_are_those_of_the_equation(simulate, case):
    """u_tank of `laws.tank` to 1e-10, over ticks in which it refuses and in which it does not."""
    law, mass, tank, sizes = CASES[case]
    angular = ", angular: 3 N*m*s/rad" if mass else ""
    text = presses.UR5E.task(
        f"{{kind: {law}, {mass}stiffness: {SWINGS}, "
        f"damping: {{linear: 60 N*s/m{angular}}}, {tank}}}",
        # An open-loop force displaces the reference, and nothing of that is fed forward.
        "go: {axes: {N: {force: +12 N}}, time: 1 s}",
        contact="stiffness: 5 kN/m, damping: 20 N*s/m",
    )
    made = simulate(text)
    assert np.nanmax(np.abs(made["velocity.z.ref"])) == 0
    again = Recomputed(made, law, sizes, np.array([3.0] * 3 + [0.2] * 3))
    n = again.model.nv
    torques = np.stack([made[f"joint.{i + 1}.torque"] for i in range(n)], axis=1)
    found = [*again.ticks()]
    assert len(found) == len(made["t"]) > 900
    for column, name in ((1, "energy"), (2, "power"), (3, "spring"), (4, "share")):
        values = np.array([each[column] for each in found])
        scale = max(1.0, np.max(np.abs(values)))
        assert made[f"tank.{name}"] == pytest.approx(values, abs=1e-9 * scale), name
    expected = np.array([each[0] for each in found])
    assert torques == pytest.approx(expected, abs=1e-10 * np.max(np.abs(expected)))
    least = 1 - made["tank.refused"]
    assert np.mean(least < 1 - 1e-6) > 0.05
    assert np.mean(least == 1) > 0.01


def energies(made):
    """Of the visits of a run."""
    return RunEnergies(made.program, made.history).visits


ARMS = [presses.PLANAR3, presses.UR5E, presses.PANDA]


def careless(rng):
    """A press or a motion under a law with a tank, with gains that swing and a way to go."""
    arm = ARMS[rng.integers(len(ARMS))]
    law = str(rng.choice(["pd", "impedance-natural", "parallel-pid", "impedance", "parallel"]))
    swing, rate = rng.uniform(0.2, 0.9), rng.uniform(0.5, 6)
    stiffness = f"{rng.uniform(200, 900):.4g} N/m"
    gains = (
        f"stiffness: {{linear: {stiffness}}}, damping: {{linear: {rng.uniform(30, 90):.4g} N*s/m}}"
    )
    if rng.uniform() < 0.5:
        formula = f"{stiffness} * (1 + {swing:.3g} * sin(2*pi*t*{rate:.3g} Hz))"
        gains = gains.replace(f"{{linear: {stiffness}}}", f"{{x: '{formula}', y: '{formula}'}}")
    energy = 10 ** rng.uniform(-2.5, 0)
    limit = f", power: {10 ** rng.uniform(-1.5, 1):.3g} W" if rng.uniform() < 0.6 else ""
    tank = f"tank: {{energy: {energy:.3g} J, start: {energy * rng.uniform(0.3, 1):.3g} J{limit}}}"
    forced = law.startswith("parallel") or rng.uniform() < 0.3
    into = f"force: +{rng.uniform(5, 25):.3g} N" if forced else "move: 5 mm"
    across = next(a for a in "yx" if a in arm.axes.split() and a != arm.normal)
    way, speed = rng.uniform(-80, 80), rng.uniform(50, 400)
    return arm.task(
        f"{{kind: {law}, {gains}, {tank}}}",
        f"press: {{axes: {{N: {{{into}}}}}, time: 0.6 s}}",
        f"on: {{axes: {{N: {{{into}}}, {across}: {{move: {way:.3g} mm, "
        f"speed: {speed:.3g} mm/s}}}}, time: 1 s}}",
        contact=f"stiffness: {10 ** rng.uniform(3.3, 4.3):.4g} N/m, damping: 20 N*s/m, "
        f"friction: {rng.uniform(0, 0.4):.2g}",
    ), limit != ""


def test_no_random_law_with_a_tank_gives_more_than_there_was(tmp_path, request, prediction):
    """V(0) + T(0) + int f.x' never falls below zero, whatever law, gains, references and forces."""
    count = request.config.getoption("random_presses")
    rng, passive, bounded, seen, limited, refused = np.random.default_rng(48021), 0, 0, 0, 0, 0
    for number in range(count):
        text, limit = careless(rng)
        made = run(load_text(text, "task.yaml"), tmp_path / str(number), force=True, report=False)
        visits = energies(made)
        assert visits
        seen += 1
        through = max(float(np.max(np.abs(each.works[n]))) for each in visits
                      for n in ("contact", "tank", "dissipated"))  # fmt: skip
        slack = LEFT * through + 1e-6
        passive += all(
            np.min(each.observed) >= -slack
            and np.max(each.stored + each.tank.energy - each.observed) <= slack
            and np.min(each.tank.energy) >= -slack
            for each in visits
        )
        refused += any(np.max(each.tank.refused) > 1e-3 for each in visits)
        if limit:
            limited += 1
            power = visits[0].tank.tank.power
            bounded += all(np.max(each.tank.power) <= power * (1 + AHEAD) for each in visits)
    assert seen == count > 0
    assert min(limited, refused) > 0.2 * count
    case = f"{count} random presses and motions under five laws"
    because = "a proof has no exception"
    prediction("runs that give no more than there was", "V' <= f.x'", case, seen, passive,
               atol=0.5, because=because)  # fmt: skip
    prediction("runs whose tank gives no more power than its limit", "P <= P_max",
               f"{case}, those with a limit", limited, bounded, atol=0.5,
               because=because)  # fmt: skip


def lowered(rng):
    """A force in the air that leads to a surface, with a limit on the power of the tank."""
    arm = [presses.SQUARE, presses.UR5E, presses.PANDA][rng.integers(3)]
    law = str(rng.choice(["parallel-pid", "parallel"]))
    gap = rng.uniform(10, 60) * (1 if arm.normal == "z" else -1)
    x, y, z = (500, 0, 300) if arm is presses.PANDA else (400, 100, 300)
    start = f"[{x} mm, {y} mm, {z + gap:.4g} mm]"
    if arm is presses.SQUARE:
        start = f"[{300 + gap:.4g} mm, 300 mm, 0]"
    k_e, d_e = 10 ** rng.uniform(3.3, 4.7), rng.uniform(0, 60)
    power = 10 ** rng.uniform(-1.3, 0.5)
    damping = f"{rng.uniform(40, 120):.4g} N*s/m"
    text = arm.task(
        f"{{kind: {law}, stiffness: {{linear: 20 N/m}}, damping: {{linear: {damping}}}, "
        f"tank: {{energy: 3 J, power: {power:.4g} W}}}}",
        f"down: {{axes: {{N: {{force: +{rng.uniform(8, 30):.3g} N}}}}, time: 4 s}}",
        contact=f"stiffness: {k_e:.5g} N/m, damping: {d_e:.4g} N*s/m",
    )
    return re.sub(r"start: \{[^}]*\}", f"start: {{xyz: {start}}}", text)


def test_the_first_contact_is_within_its_bound(tmp_path, request, prediction):
    """v <= sqrt(P / d), and the surface takes P ((sqrt(k m) / 2 + d_e) / d + pi / 2) at most."""
    count = request.config.getoption("random_presses")
    rng, slow, weak, seen, worst = np.random.default_rng(48022), 0, 0, 0, 0.0
    for number in range(count):
        loaded = load_text(lowered(rng), "task.yaml")
        made = run(loaded, tmp_path / str(number), force=True, report=False)
        (stage,) = made.program.stages
        bound = first_contact(stage.plan)
        (each,) = energies(made)
        gap = made.column("plane.gap")
        touched = np.flatnonzero(gap < 0)
        assert len(touched)
        seen += 1
        # Until the tool is deepest.
        first = int(touched[0])
        end = first + int(np.argmax(np.diff(gap[first:]) > 0)) + 1
        speed = np.max(np.abs(made.column(f"velocity.{bound.axis}")[: first + 1]))
        power = -np.min(each.signals["power.contact"][: end + 1])
        slow += speed <= bound.speed
        weak += power <= bound.power
        worst = max(worst, power / bound.power)
    assert seen == count > 0
    # It is not so far off that it says nothing.
    assert worst > 0.2
    case = f"{count} random forces in the air, three arms"
    because = "an inequality has no exception"
    prediction("first contacts within their speed", "v <= sqrt(P/d)", case, seen, slow,
               atol=0.5, because=because)  # fmt: skip
    prediction("first contacts within their power", "P ((sqrt(k m)/2 + d_e)/d + pi/2)", case, seen,
               weak, atol=0.5, because=because)  # fmt: skip
