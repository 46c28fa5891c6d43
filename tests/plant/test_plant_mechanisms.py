"""Hinges, slides and screws by themselves: their own dynamics, with nothing grasped."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from plants import Pushed


class Alone:
    """One mechanism, set going by itself; the arm beside it does not matter."""

    def __init__(self, declared: str) -> None:
        self.pushed = Pushed(f"mech: {{xyz: [500 mm, 200 mm, 300 mm], {declared}}}")
        plant = self.plant = self.pushed.plant
        kind = "shift" if "slide" in declared else "turn"
        joint = self.pushed.model.joint(f"world/mech/{kind}").id
        self.at = self.pushed.model.jnt_qposadr[joint]
        self.dof = self.pushed.model.jnt_dofadr[joint]
        self.positions, self.rates = plant.views.mechanism_positions, plant.views.mechanism_rates

    def go(self, seconds: float, force: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Coordinate and rate, tick by tick, under a constant generalised force [N m, N]."""
        body = self.pushed.model.dof_bodyid[self.dof]
        axis = self.pushed.data.xmat[body].reshape(3, 3)[:, 2]
        slot = slice(3, 6) if self.pushed.model.jnt_type[-1] == 3 else slice(0, 3)
        way = []
        for _ in range(round(seconds * 1000)):
            self.pushed.data.xfrc_applied[body, slot] = force * axis
            self.plant.step(np.zeros(7))
            way.append((self.positions[0], self.rates[0]))
        return tuple(np.array(way).T)


HINGE = "mechanism: hinge, rpy: [30 deg, 20 deg, 0], handle: [100 mm, 0, 0], inertia: 0.01 kg*m^2"
SLIDE = "mechanism: slide, rpy: [30 deg, 20 deg, 0], mass: 2 kg"
SCREW = (
    "mechanism: screw, rpy: [30 deg, 20 deg, 0], handle: [50 mm, 0, 0], pitch: 2 mm/turn, "
    "inertia: 0.001 kg*m^2, mass: 0.5 kg"
)


@pytest.mark.parametrize(
    ("declared", "inertia"),
    [
        (HINGE, 0.01),
        (HINGE + ", knob: free", 0.01),
        (SLIDE, 2.0),
        (SCREW, 0.001 + 0.5 * (0.002 / (2 * np.pi)) ** 2),
    ],
)
def test_inertia_is_the_declared_one_and_gravity_does_not_act(declared, inertia):
    force = 0.5 * inertia
    _, rates = Alone(declared).go(0.5, force)
    # A free knob of 1e-6 kg m^2 turns along: 1e-4 of the hinge's. The first row is still at rest.
    assert rates[-1] == pytest.approx(0.5 * 0.499, rel=1.2e-4)


@pytest.mark.parametrize(
    ("declared", "damping"), [(HINGE + ", damping: 0.05 N*m*s/rad", 5.0), (SLIDE, 0.0)]
)
def test_damping_brakes_at_its_own_rate(declared, damping):
    alone = Alone(declared)
    alone.pushed.data.qvel[alone.dof] = 1.0
    _, rates = alone.go(0.401)
    # Damping is implicit in a step of 1 ms: (1 + b T / I)^-400.
    assert rates[-1] == pytest.approx((1 + damping * 1e-3) ** -400, rel=1e-9)


def test_friction_holds_up_to_its_limit_and_brakes_beyond():
    still = Alone(HINGE + ", friction: 0.2 N*m")
    way, _ = still.go(1.0, 0.199)
    # It gives way by what one step of settling leaves: 1e-3 of the acceleration times 2 T.
    assert abs(way[-1]) < 0.199 / 0.01 * 1e-3 * 2e-3 * 1.1
    gone = Alone(HINGE + ", friction: 0.2 N*m")
    _, rates = gone.go(0.5, 0.25)
    assert rates[-1] == pytest.approx(0.05 / 0.01 * 0.499, rel=1e-3)


def test_a_stop_holds_without_much_overshoot_and_does_not_throw_back():
    stopped = Alone(HINGE + ", stop: -90 deg .. 90 deg")
    stopped.pushed.data.qvel[stopped.dof] = 5.0
    way, rates = stopped.go(2.0)
    reach = np.pi
    assert np.max(way) - np.pi / 2 < 0.01 * reach
    assert abs(rates[-1]) < 0.5
    held = Alone(SLIDE + ", stop: 0 .. 50 mm")
    way, _ = held.go(1.0, 100.0)
    assert way[-1] == pytest.approx(0.05, abs=0.01 * 0.05)


def test_a_detent_gives_back_what_it_takes():
    """F sin(pi (s - at)/width): resists before `at`, pulls along after it, no work in all."""
    declared = HINGE + ", detent: {at: 0.5 rad, force: 0.3 N*m, width: 0.2 rad}"
    alone = Alone(declared)
    alone.pushed.data.qvel[alone.dof] = 4.5
    way, rates = alone.go(0.3)
    # Semi-implicit steps have the velocity half a step beside the position.
    way, rates = way[:-1], (rates[:-1] + rates[1:]) / 2
    energy = 0.5 * 0.01 * rates**2

    def work(s: np.ndarray) -> np.ndarray:
        u = np.clip((s - 0.5) / 0.2, -1, 1)
        return -0.3 * 0.2 / np.pi * (1 + np.cos(np.pi * u))

    # Half way over the hump 38 mJ of 101 mJ are gone; a step of 1 ms goes 2 % of the width.
    assert np.min(energy) < 0.65 * energy[0]
    np.testing.assert_allclose(energy - energy[0], work(way), atol=1e-4)


def test_the_thread_of_a_screw_holds_its_pitch():
    alone = Alone(SCREW)
    data, model = alone.pushed.data, alone.pushed.model
    lead = 0.002 / (2 * np.pi)
    shift = int(model.joint("world/mech/shift").qposadr[0])
    body = model.dof_bodyid[alone.dof]
    axis = data.xmat[body].reshape(3, 3)[:, 2].copy()
    # 50 N along the axis against the moment that balances it, and some to turn with.
    data.xfrc_applied[body, :3] = -50.0 * axis
    data.xfrc_applied[body, 3:] = (50.0 * lead + 0.01) * axis
    for _ in range(1130):
        alone.plant.step(np.zeros(7))
    turned = float(data.qpos[alone.at])
    assert turned > 2 * np.pi
    assert data.qpos[shift] == pytest.approx(lead * turned, rel=1e-4)


def test_the_arm_comes_first():
    world = ", ".join(f"{n}: {{{d}}}" for n, d in (("aa", SCREW), ("bb", HINGE), ("cc", SLIDE)))
    pushed = Pushed(world)
    names = [pushed.model.joint(i).name for i in range(7)]
    assert tuple(names) == pushed.robot.joint_names
    assert pushed.model.nu == 7
    momentum = np.zeros(pushed.model.nv)
    pushed.data.qvel[:] = 1.0
    mujoco.mj_mulM(pushed.model, pushed.data, momentum, pushed.data.qvel)
    assert pushed.plant.arm.kinetic_energy() == pytest.approx(0.5 * momentum[:7].sum(), rel=1e-12)
