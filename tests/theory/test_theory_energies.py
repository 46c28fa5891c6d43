"""Energies of laws over the logs of runs, held against the chapter and against another evaluation.

The log has the state at the start of each tick. The torque is held over T = 1 ms, and so is the
force of MuJoCo's contact: springs k_m and k_e take (k_m + k_e) T / 2 off the damper, so that V' is
between -x'^T D x' and that with so much less. Sums of works are by the trapezoidal rule.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import presses
import pytest

from taskspec.examination import examine
from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError
from taskspec_runner import run
from taskspec_runner.trial.check import check
from taskspec_runner.verdict.energy import INNER, PORTS, RunEnergies

SECTION = "4.1 Impedance, PD and stiffness control"
T = 1e-3
#: What PD with gravity compensation has no torque of its own for: none of them is redundant.
ARMS = [presses.SQUARE, presses.PLANAR3, presses.UR5E]


def energies(made):
    """Of the visits of a run."""
    return RunEnergies(made.program, made.history).visits


def shift(rng, contact):
    """PD that goes some way, off the surface or deeper into it, and stays."""
    arm = ARMS[rng.integers(len(ARMS))]
    k_m, k_e = rng.uniform(200, 900), 10 ** rng.uniform(3, 4)
    d_m = rng.uniform(40, 160)
    away = rng.uniform(10, 25) * (1 if contact else -1) * arm.into
    across = next(a for a in "xyz" if a in arm.axes.split() and a != arm.normal)
    law = f"{{kind: pd, stiffness: {k_m:.4g} N/m, damping: {d_m:.4g} N*s/m}}"
    text = arm.task(
        law,
        f"go: {{axes: {{N: {{move: {away:.4g} mm, speed: 1 m/s}}, "
        f"{across}: {{move: {rng.uniform(-20, 20):.3g} mm, speed: 1 m/s}}}}, time: 2 s}}",
        contact=f"stiffness: {k_e:.5g} N/m, damping: 0",
    )
    return text, (k_m + k_e * contact) * T / 2 / d_m


@pytest.mark.parametrize("contact", [False, True])
def test_no_random_pd_gains_and_each_loses_what_its_damper_takes(
    tmp_path, request, prediction, contact
):
    """(4.22), (4.23) in free motion, (4.28)-(4.30) in full contact, x_d at rest."""
    count = request.config.getoption("random_presses")
    rng, falling, as_fast, seen = np.random.default_rng(48 + contact), 0, 0, 0
    for number in range(count):
        text, sampled = shift(rng, contact)
        made = run(load_text(text, "task.yaml"), tmp_path / str(number), force=True, report=False)
        (each,) = energies(made)
        rows = [made.column(f"velocity.{a}.ref") for a in ("x", "y", "z")]
        moving = np.max([np.abs(np.nan_to_num(r)) for r in rows if r is not None], axis=0)
        first = int(np.flatnonzero(moving > 0)[-1]) + 1
        touched = np.nan_to_num(made.column("plane.gap"))[first:] < 0
        assert touched.all() if contact else not touched.any()
        V = each.signals["energy.lyapunov"][first:]
        taken = each.works["dissipated"][first:] - each.works["dissipated"][first]
        assert V[0] > 1e-5
        seen += 1
        falling += bool(np.all(np.diff(V) <= 1e-9 * V[0]))
        # To first order in T; what is left of it, of the second, is a tenth of that at most.
        as_fast += bool(np.all(np.abs(V[0] - V - taken) <= 1.1 * sampled * V[0] + 1e-3 * V[0]))
    assert seen == count > 0
    where = "full contact" if contact else "free motion"
    number = "(4.28)-(4.30)" if contact else "(4.22), (4.23)"
    case = f"pd, {count} random motions of three arms in {where}"
    for what, found in (("whose V never rises", falling), ("that lose what D takes", as_fast)):
        prediction(
            f"runs {what}", number, case, seen, found, atol=0.5, because="a proof has no exception"
        )


LAWS = {
    "pd": "kind: pd, stiffness: 500 N/m, damping: 40 N*s/m",
    "pd-joint": "kind: pd-joint, stiffness: 500 N/m",
    "impedance-natural": "kind: impedance-natural, stiffness: 500 N/m, damping: 40 N*s/m",
    "impedance": "kind: impedance, mass: 2 kg, stiffness: 500 N/m, damping: 40 N*s/m",
    "parallel-pid": "kind: parallel-pid, stiffness: 500 N/m, damping: 90 N*s/m",
    "parallel": "kind: parallel, mass: 2 kg, stiffness: 500 N/m, damping: 90 N*s/m",
}


def pressed(simulate, name, arm=presses.SQUARE):
    """A law that presses 10 mm deep, or with 10 N where it has a force loop, and moves across."""
    across = next(a for a in "yx" if a in arm.axes.split() and a != arm.normal)
    forced = name.startswith("parallel")
    into = "force: +10 N" if forced else f"move: {10 * arm.into} mm, speed: 100 mm/s"
    return simulate(
        arm.task(
            f"{{{LAWS[name]}}}",
            f"press: {{axes: {{N: {{{into}}}}}, time: 0.6 s}}",
            f"on: {{axes: {{N: {{{into}}}, {across}: {{move: 10 mm}}}}, time: 0.8 s}}",
            contact="stiffness: 5 kN/m, damping: 20 N*s/m",
        )
    )


@pytest.mark.parametrize("name", LAWS)
def test_the_storage_function_is_the_laws_own(simulate, name):
    """1/2 q'^T H q' or 1/2 e'^T M e', and 1/2 e^T K e, by Pinocchio and NumPy, to 1e-10."""
    made = pressed(simulate, name)
    assert len(energies(made)) == 2
    model = made.program.context.robot.pin
    data = model.createData()
    for each in energies(made):
        rows = np.arange(each.visit.first, each.visit.last + 1)[::50]
        for row in rows:
            k = row - each.visit.first
            q, v = (
                np.array([made[f"joint.{i}.{what}"][row] for i in (1, 2)])
                for what in ("position", "velocity")
            )
            e, rate, led = (
                np.nan_to_num([made[signal.format(a)][row] for a in "xy"])
                for signal in ("error.{}", "velocity.{}", "velocity.{}.ref")
            )
            H = np.triu(pin.crba(model, data, q))
            H = H + np.triu(H, 1).T
            kinetic = 0.5 * v @ H @ v
            if name in ("impedance", "parallel"):
                kinetic = 0.5 * 2.0 * np.sum((led - rate) ** 2)
            got = (each.signals["energy.kinetic"][k], each.signals["energy.spring"][k])
            assert got == pytest.approx((kinetic, 250.0 * e @ e), rel=1e-10, abs=1e-15)
            damping = 40.0 if "parallel" not in name else 90.0
            against = rate if name in ("pd", "parallel-pid") else led - rate
            if name != "pd-joint":
                taken = each.signals["power.dissipated"][k]
                assert taken == pytest.approx(damping * against @ against, rel=1e-10, abs=1e-15)
            force = np.array([made[f"force.{a}"][row] for a in "xy"])
            into = each.signals["power.contact"][k]
            assert into == pytest.approx(-force @ rate, rel=1e-10, abs=1e-15)


@pytest.mark.parametrize("name", LAWS)
def test_the_terms_make_up_what_is_stored(simulate, name):
    """What no term accounts for is of the order of what a period, or a late force, does to it.

    Integrals of forces are in no log: that they are wound again as the controller did shows here.
    """
    visits = energies(pressed(simulate, name))
    assert len(visits) == 2
    terms = (*PORTS, *INNER[:-1])
    through = max(float(np.max(np.abs(each.works[t]))) for each in visits for t in terms)
    assert through > 1e-3
    for each in visits:
        assert np.max(np.abs(each.works["rest"])) < 0.02 * through
        whole = sum((each.works[t] for t in (*PORTS, *INNER)), -each.works["dissipated"])
        assert each.stored - each.stored[0] == pytest.approx(whole, abs=1e-12)


def test_a_guard_has_the_energy_of_the_log(simulate):
    """The stage ends in the first tick at which the log's energy is beyond the bound."""
    made = simulate(
        presses.SQUARE.task(
            "{kind: pd, stiffness: 500 N/m, damping: 40 N*s/m}",
            "go: {axes: {N: {move: +20 mm, speed: 100 mm/s}}, until: energy.stored > 0.02 J, "
            "within: {time: 2 s}, next: on}",
            "on: {axes: {N: {move: 1 mm}}, time: 0.2 s}",
            contact="stiffness: 5 kN/m, damping: 20 N*s/m",
        ).replace("move: +20", "move: 20")
    )
    go, _ = energies(made)
    assert len(go.stored) > 50
    assert go.stored.max() <= 20e-3
    # The next tick is the first of the stage after it, with another reference.
    assert go.stored[-1] + 2 * (go.stored[-1] - go.stored[-2]) > 20e-3


def raised(amplitude, period, damping=12.0):
    """A press under PD whose stiffness swings."""
    return presses.PANDA.task(
        f"{{kind: pd, stiffness: {{z: 1000 N/m + {amplitude:.4g} N/m * sin(2*pi*t/({period:.4g} s))"
        f"}}, damping: {{z: {damping:.4g} N*s/m}}}}",
        "press: {axes: {N: {move: -20 mm, speed: 100 mm/s}}, time: 3 s}",
        contact="stiffness: 5 kN/m, damping: 0",
    )


def found(text):
    """Codes of what validate says."""
    try:
        return {each.code for each in check(load_text(text, "task.yaml")).findings}
    except SpecError as error:
        return {each.code for each in error.diagnostics}


def test_a_stiffness_that_swings_puts_in_energy(simulate):
    """power.gains is 1/2 K' e^2; the run says that it gains, when and by what."""
    made = simulate(raised(800, 0.25))
    (each,) = energies(made)
    t, e = made["t"], made["error.z"]
    rate = 800 * 2 * np.pi / 0.25 * np.cos(2 * np.pi * t / 0.25)
    expected = 0.5 * rate * e**2
    assert np.max(np.abs(expected)) > 1
    # A difference over a period is the rate half a period before: T/2 of the greatest change.
    near = 0.5 * T * np.max(np.abs(np.gradient(expected, T)))
    assert each.signals["power.gains"][1:] == pytest.approx(expected[1:], abs=1.5 * near)
    start, end, by = each.gain
    assert by == "gains"
    assert each.works["gains"][end] - each.works["gains"][start] > 0.5
    assert each.observed.min() < 0
    assert "TS509" in found(raised(800, 0.25))


def test_of_random_stiffnesses_none_grows_that_validate_lets_pass(tmp_path, request, prediction):
    """k' + alpha d' <= 2 alpha k is sufficient: left alone, such a mass comes to rest."""
    count = request.config.getoption("random_presses")
    rng, passed, settled, told, grown = np.random.default_rng(509), 0, 0, 0, 0
    for number in range(count):
        loaded = load_text(swinging(rng), "task.yaml")
        made = run(loaded, tmp_path / str(number), force=True, report=False)
        sizes = np.hypot(made.column("error.x"), made.column("error.y"))
        # What grows until a limit stops it has grown.
        stopped = made.summary["status"] != "done"
        before, after = np.max(sizes[300:1200]), np.inf if stopped else np.max(sizes[-900:])
        assert before > 1e-6
        if any(each.code == "TS509" for each in examine(loaded).findings):
            told += 1
            grown += after > before
        else:
            passed += 1
            settled += after < before
    # Both kinds are there, and some of what is warned of does grow.
    assert min(passed, told) > 0.1 * count
    assert grown > 0
    case = f"pd, {count} random stiffnesses that swing, {passed} of them without TS509"
    prediction(
        "runs that come to rest", "Kronander and Billard (2016)", case, passed, settled,
        atol=0.5, because="the condition is sufficient",
    )  # fmt: skip


def swinging(rng):
    """A motion in free space under PD whose stiffness swings, near twice the natural frequency."""
    k, d = rng.uniform(300, 900), 10 ** rng.uniform(0, 2)
    share, frequency = rng.uniform(0.1, 0.9), rng.uniform(0.2, 2.5) * np.sqrt(k / 1.5) / np.pi
    stiffness = f"{k:.4g} N/m * (1 + {share:.3g} * sin(2*pi * {frequency:.4g} Hz * t))"
    return presses.SQUARE.task(
        f"{{kind: pd, stiffness: {{x: '{stiffness}', y: '{stiffness}'}}, damping: {d:.4g} N*s/m}}",
        "go: {axes: {x: {move: -20 mm, speed: 1 m/s}, y: {move: 20 mm, speed: 1 m/s}}, time: 4 s}",
        contact=None,
    )
