"""Contact stiffness by recursive least squares, and gains that follow it, by the logs of runs.

A second evaluation in NumPy: least squares over the rows of the log at once, no recursion; gains by
interpolation of the law's design at its knots; the torque of (4.50) by Pinocchio.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import presses
import pytest

from taskspec.examination import examine
from taskspec.laws.contact_stiffness import DECIDED, Schedule, knots
from taskspec.spec import load_text
from taskspec.text.diagnostic import Severity
from taskspec_runner import run

SECTION = "Estimated contact stiffness"
T = 1e-3
FORGETS = np.exp(-T / 0.2)


def estimated(made, stage="press"):
    """The estimate of the one axis of a stage, the rows of the stage, and its columns."""
    plan = next(s.plan for s in made.program.stages if s.name == stage)
    ((axis, each),) = plan.estimates.axes.items()
    rows, log = made.history.window(stage), made.history.columns
    names = ("force", "position", "velocity")
    columns = {name: log[f"{name}.{axis}"][rows] for name in names}
    columns["force"] = log.get(f"force.{axis}.measured", log[f"force.{axis}"])[rows]
    for name in ("stiffness", "deviation", "followed"):
        columns[name] = log[f"estimate.{name}.{axis}"][rows]
    return plan, axis, each, columns


def square(law, k, *, true=None, force="+8 N", lasts="1 s", more=""):
    """The square arm that presses with a force that rises and swings."""
    return presses.SQUARE.task(
        law,
        f"press: {{axes: {{N: {{force: {force}}}}}, time: {lasts}}}",
        contact=f"stiffness: {k} N/m, damping: 20 N*s/m",
        more=more,
        rest="" if true is None else f"truth: {{world.plane.stiffness: {true} N/m}}\n",
    )


def fitted(each, columns, last):
    """k and its standard deviation by weighted least squares over all rows up to `last`."""
    f, x, v = columns["force"], columns["position"] - T * columns["velocity"], columns["velocity"]
    slow, taken = f[0], []
    for i in range(last + 1):
        if abs(f[i]) > each.dead_zone and abs(f[i] - slow) > each.dead_zone:
            taken.append(i)
        slow += (1 - FORGETS) * (f[i] - slow)
    taken = np.array(taken)
    root = np.sqrt(FORGETS ** np.arange(len(taken) - 1, -1, -1)) / each.noise
    data = np.column_stack([x[taken], v[taken], np.ones(len(taken))]) * root[:, None]
    s_d = max(each.damping, 1e-3 * each.declared)
    prior = np.array([[1 / each.high, 0, 0], [0, 1 / s_d, 0]])
    A = np.vstack([data, prior])
    b = np.concatenate([f[taken] * root, [each.declared / each.high, each.damping / s_d]])
    scale = 1 / np.linalg.norm(A, axis=0)
    found = np.linalg.lstsq(A * scale, b, rcond=None)[0] * scale
    left = np.sum((A @ found - b) ** 2) / np.sum((root * each.noise) ** 2)
    covariance = np.linalg.inv((A * scale).T @ (A * scale)) * np.outer(scale, scale)
    return found[0], np.sqrt(covariance[0, 0] * max(1.0, left))


@pytest.mark.parametrize("true", [500, 5000, 40000])
def test_the_recursion_is_least_squares_over_the_log(simulate, true):
    """Sums of double precision, whose differences lose the square of 1 m against 10 um: 1e-6."""
    law = "{kind: parallel-pid, estimate: 300 N/m..60 kN/m}"
    made = simulate(square(law, 5000, true=true))
    _, _, each, columns = estimated(made)
    checked = 0
    for last in range(301, len(columns["force"]) - 1, 67):
        k, deviation = fitted(each, columns, last)
        if columns["stiffness"][last + 1] != columns["stiffness"][last]:
            assert deviation < DECIDED * k
            got = columns["stiffness"][last + 1], columns["deviation"][last + 1]
            assert got == pytest.approx((k, deviation), rel=1e-5)
            checked += 1
    assert checked > 3
    assert columns["stiffness"][-1] == pytest.approx(true, rel=0.02)


@pytest.mark.parametrize("true", [500, 5000, 40000])
def test_what_gains_follow_goes_there_at_the_bounded_rate(simulate, true):
    """ln k_f goes towards ln k by at most rate T in a tick; gains are those of the design there."""
    law = "{kind: parallel-pid, estimate: {stiffness: 500 N/m..50 kN/m, rate: 20 Hz}}"
    made = simulate(square(law, 5000, true=true))
    plan, axis, each, columns = estimated(made)
    found, followed = np.log(columns["stiffness"]), np.log(columns["followed"])
    step = np.clip(found[1:] - followed[:-1], -20 * T, 20 * T)
    assert np.diff(followed) == pytest.approx(step, abs=1e-12)
    assert np.abs(np.diff(followed)).max() == pytest.approx(20 * T if true != 5000 else 0, abs=0.02)
    for name, schedule in plan.estimates.schedules[axis].items():
        gains = np.exp(np.interp(followed, schedule.knots, schedule.values))
        assert made[f"gain.{name}.{axis}"][: len(gains)] == pytest.approx(gains, rel=1e-12)
        for k in schedule.knots[:: max(1, len(schedule.knots) // 4)]:
            designed = plan.design_rules.along(axis, np.exp(k))[name].value
            assert schedule.value(np.exp(k)) == pytest.approx(designed, rel=1e-9)
        # Between knots a line cuts the corners of what the rules take the least of.
        for k in np.geomspace(each.low, each.high, 41):
            designed = plan.design_rules.along(axis, k)[name].value
            assert schedule.value(k) == pytest.approx(designed, rel=0.05)


@pytest.mark.parametrize("share", [0, 1e-15, 1e-9, 1e-2])
def test_a_declared_stiffness_beside_a_knot_has_no_line_of_its_own(share):
    """The slope of a line between two equal logarithms is no number."""
    low, high = 1000.0, 10000.0
    grid = np.array(knots(low, high))
    assert len(grid) > 4
    for k in grid * (1 + share):
        found = np.array(knots(low, high, [k]))
        assert len(found) - len(grid) == (share == 1e-2 and k < high)
        assert np.all(np.diff(np.log(found)) > 0.9e-3)
        assert {low, high} < {*found}
        schedule = Schedule.of({each: each**0.5 for each in found})
        assert schedule.value(k) == pytest.approx(k**0.5 if k < high else high**0.5)


def test_torques_are_those_of_the_equation_at_the_gains_of_each_tick(simulate):
    """(4.50) from the log to 1e-10: K_I times the integral goes on while K_I changes."""
    law = "{kind: parallel-pid, stiffness: 300 N/m, estimate: 500 N/m..50 kN/m}"
    text = square(law, 5000, true=40000, force="+(8 N + 2 N * sin(20 rad/s * t))", lasts="0.5 s")
    made = simulate(text)
    _, axis, _, columns = estimated(made)
    assert axis == "x"
    model = made.program.context.robot.pin
    data = model.createData()
    frame = model.getFrameId("tip")
    d, i = (made[f"gain.{name}.x"] for name in ("damping", "force.integral"))
    assert i.max() > 1.5 * i.min()
    wound, compared = 0.0, 0
    for row in range(len(columns["force"]) - 1):
        missing = made["force.x.ref"][row] - columns["force"][row]
        wound += i[row] * T * missing
        q = np.array([made[f"joint.{n}.position"][row] for n in (1, 2)])
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:2]
        g = pin.computeGeneralizedGravity(model, data, q)
        e = np.array([made["error.x"][row], made["error.y"][row]])
        rate = np.array([made["velocity.x"][row], made["velocity.y"][row]])
        damping = np.array([d[row], made.program.stages[0].plan.gains["damping"]["y"].value])
        u = 300.0 * e - damping * rate
        u[0] += made["force.x.ref"][row] + wound
        torque = np.array([made[f"joint.{n}.torque"][row] for n in (1, 2)])
        assert torque == pytest.approx(J.T @ u + g, rel=1e-10, abs=1e-9)
        compared += 1
    assert compared > 400


def test_at_rest_nothing_is_forgotten_and_nothing_winds_up(simulate):
    """A constant force that slides says nothing of the stiffness, which stays to the last bit.

    What little the start of the motion tells does not outweigh a tenth of what was known.
    """
    law = "{kind: parallel-pid, estimate: 500 N/m..50 kN/m}"
    text = presses.SQUARE.task(
        law,
        "press: {axes: {N: {force: +8 N}}, time: 1.5 s}",
        "slide: {axes: {N: {force: +8 N}, y: {move: 20 mm, speed: 20 mm/s}}, time: 2 s}",
        contact="stiffness: 5000 N/m, damping: 20 N*s/m",
        more="sensor: {noise: 20 mN}",
        rest="truth: {world.plane.stiffness: 1000 N/m}\n",
    )
    made = simulate(text)
    _, _, _, pressed = estimated(made)
    _, _, _, slid = estimated(made, "slide")
    assert pressed["stiffness"][-1] == pytest.approx(1000, rel=0.05)
    # Handed on with the object, and what gains follow with it.
    assert slid["stiffness"][0] == pressed["stiffness"][-1]
    assert slid["followed"][0] == pytest.approx(pressed["followed"][-1], rel=1e-12)
    assert slid["stiffness"] == pytest.approx(1000, rel=0.1)
    assert np.ptp(slid["stiffness"][-1000:]) == 0
    assert np.ptp(slid["deviation"][-1000:]) == 0


@pytest.mark.parametrize("middle", [4713.2, np.nextafter(20e3, 0), 20e3])
def test_knots_that_differ_by_rounding_are_one(middle):
    """A declared stiffness in the middle of its bounds is a knot of the decades, too."""
    at = knots(middle / 12, 12 * middle, [middle])
    assert middle in at
    assert np.diff(np.log(at)).min() > 1e-3
    assert Schedule.of({k: k**0.5 for k in at}) is not None


LAWS = ("hybrid", "parallel", "parallel-pid", "hybrid-multipliers", "hybrid-reaction")


def random_press(rng):
    """A press on a contact that is up to ten times softer or stiffer than declared."""
    arm = [presses.PLANAR3, presses.UR5E, presses.PANDA][rng.integers(3)]
    servo = arm is presses.UR5E and rng.random() < 0.5
    law = ["admittance", "force-velocity"][rng.integers(2)] if servo else LAWS[rng.integers(5)]
    declared = 10 ** rng.uniform(np.log10(5e3), np.log10(30e3))
    true = declared * 10 ** rng.uniform(-1, 1)
    noise, force = rng.uniform(0, 60), rng.uniform(8, 25)
    low, high = declared / 12, declared * 12
    text = arm.task(
        f"{{kind: {law}, estimate: {low:.4g} N/m..{high:.5g} N/m}}",
        f"press: {{axes: {{N: {{force: +({force:.3g} N + {force / 4:.3g} N * sin(2*pi*t/(1 s))), "
        "ramp: 0.5 s}}, time: 2 s}",
        contact=f"stiffness: {declared:.5g} N/m, damping: 60 N*s/m",
        more=f"sensor: {{noise: {noise:.3g} mN}}" + (", command: velocity" if servo else ""),
        rest=f"truth: {{world.plane.stiffness: {true:.5g} N/m}}\n",
    )
    return text.replace("force: -(", "force: -1 * ("), true, noise / 1e3


def plant_stiffness(made, axis):
    """k of f = k x + d x' + c by least squares over the true forces of a press [N/m]."""
    rows = made.history.window("press")
    f, x, v = (made.column(f"{name}.{axis}")[rows] for name in ("force", "position", "velocity"))
    pressed = np.abs(f) > 1.0
    data = np.column_stack([x, v, np.ones(len(x))])[pressed]
    scale = np.linalg.norm(data, axis=0)
    return np.linalg.lstsq(data / scale, f[pressed], rcond=None)[0][0] / scale[0], x


def test_bounds_rates_and_convergence_of_random_presses(tmp_path, request, prediction):
    """No estimate leaves its bounds, none moves faster, and each comes to the true stiffness.

    That is the plant's, by least squares over the true forces of the log. The estimate is within
    5 % of it before k times the place of the tool has changed by 50 times the forces that count as
    news: five standard deviations of the sensor, 0.2 N at least. What gains follow is there after
    ln(high/low)/rate, at the 12-fold bounds and the default rate of 50 1/s.
    """
    count = request.config.getoption("random_presses")
    rng, seen, within, slow, near, quick = np.random.default_rng(484), 0, 0, 0, 0, 0
    known = 0
    errors, swings, times = [], [], []
    for number in range(count):
        text, true, noise = random_press(rng)
        made = run(load_text(text, "task.yaml"), tmp_path / str(number), force=True, report=False)
        _, axis, each, columns = estimated(made)
        k, pressed_in = plant_stiffness(made, axis)
        known += bool(k == pytest.approx(true, rel=0.01))
        seen += 1
        found, followed = columns["stiffness"], columns["followed"]
        inside = [(c >= each.low * (1 - 1e-12)) & (c <= each.high * (1 + 1e-12)) for c in
                  (found, followed)]  # fmt: skip
        within += bool(np.all(inside))
        slow += bool(np.abs(np.diff(np.log(followed))).max() <= each.rate * T * (1 + 1e-9))
        off = np.abs(np.log(found / k)) > np.log(1.05)
        last = int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0
        errors.append(abs(found[-1] / k - 1))
        swings.append(k * float(np.ptp(pressed_in[: last + 1])) / max(5 * noise, 0.2))
        near += bool(errors[-1] < 0.05 and swings[-1] < 50)
        off = np.abs(np.log(followed / k)) > np.log(1.05)
        there = int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0
        times.append((there - last) * T)
        quick += bool(times[-1] <= np.log(12**2) / 50 + T)
    assert seen == count > 0
    case = f"{count} random presses of three arms and seven laws, up to 10 x off"
    for what, got in (
        ("whose plant has the stiffness of the file to 1 %", known),
        ("within the bounds of the file", within),
        ("no faster than `rate`", slow),
        ("within 5 % of the true stiffness", near),
        ("followed within `settling`", quick),
    ):
        prediction(
            f"runs {what}", "least squares", case, count, got, atol=0.5,
            because="a bound has no exception",
        )  # fmt: skip


def test_validate_says_where_the_gains_do_not_hold():
    """On the stiffest contact with a damping of the file; and on the way there."""
    rings = presses.PANDA.task(
        "{kind: hybrid, estimate: 1..200 kN/m, force: {damping: {z: 60 N*s/m}}}",
        "press: {axes: {N: {force: +10 N}}, time: 1 s}",
        contact="stiffness: 2 kN/m, damping: 60 N*s/m",
    )
    softer = presses.UR5E.task(
        "{kind: force-velocity, estimate: 2..200 kN/m}",
        "press: {axes: {N: {force: +10 N}}, time: 1 s}",
        contact="stiffness: 5 kN/m, damping: 60 N*s/m",
        more="command: velocity",
    )
    for text, code in ((rings, "TS515"), (softer, "TS516")):
        found = [each.code for each in examine(load_text(text, "task.yaml")).findings]
        assert code in found
        narrow = text.replace("..200 kN/m", "..6 kN/m")
        assert code not in [e.code for e in examine(load_text(narrow, "task.yaml")).findings]


def test_validate_says_that_a_bound_is_stiffer_than_the_plant_resolves():
    """No loop is examined there, which is no sign that it holds."""
    text = presses.PANDA.task(
        "{kind: hybrid, estimate: 1..50000 kN/m}",
        "press: {axes: {N: {force: +10 N}}, time: 1 s}",
        contact="stiffness: 20 kN/m, damping: 60 N*s/m",
    )
    found = [e for e in examine(load_text(text, "task.yaml")).findings if e.code == "TS515"]
    (unseen,) = [e for e in found if "is not examined on a contact of" in e.message]
    assert unseen.severity is Severity.INFO
    assert "plant_rate" in unseen.hint
    narrow = load_text(text.replace("50000 kN/m", "100 kN/m"), "task.yaml")
    assert not [e for e in examine(narrow).findings if "not examined" in e.message]
