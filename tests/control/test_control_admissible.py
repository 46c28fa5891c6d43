"""Bounds of one control period: whether the next one still has a way out."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskspec.control.admissible import (
    BRAKING,
    NEAREST,
    approach,
    braking_deceleration,
    highest_push,
    joint_accelerations,
    reach,
)
from taskspec.program.bound import BoundFunction
from taskspec.program.limits.pushes import FORCE_SHARE

T = 1e-3
share = st.floats(0, 1)


def compiled(fastest, braking, lower, upper, jerk=None):
    """joint_accelerations of one joint, (q, v) -> least, greatest."""
    q, v = ca.SX.sym("q"), ca.SX.sym("v")
    bounds = joint_accelerations(
        q,
        v,
        (ca.DM(lower), ca.DM(upper)),
        ca.DM(fastest),
        ca.DM(braking),
        T,
        None if jerk is None else ca.DM(jerk),
    )
    given, found = np.zeros((2, 1)), np.zeros((2, 1))
    bound = BoundFunction(ca.Function("bounds", [q, v], list(bounds)), [*given], [*found])

    def at(q, v):
        given[:, 0] = q, v
        bound.evaluate()
        return found[:, 0].tolist()

    return at


def step(q, v, a):
    """MuJoCo's integrator: the new velocity moves the position."""
    v = v + T * a
    return q + T * v, v


def viable(q, v, lower, upper, fastest, a):
    """Whether braking by a from now on keeps to the bounds, as the integrator has it.

    It is travelled at w = v - aT over this period: T w + w^2 / (2 a), and a stop within one period
    costs nothing. That is w T / 2 more than the way itself, by which the bounds are on the safe
    side: nearer to a limit than that they ask for more than a.
    """
    w = max(abs(v) - a * T, 0.0)
    room = upper - q if v > 0 else q - lower
    return lower <= q <= upper and abs(v) <= fastest and T * w + w * w / (2 * a) <= room


@settings(max_examples=400, deadline=None)
@given(
    braking=st.floats(0.5, 500),
    fastest=st.floats(0.05, 5),
    place=share,
    speed=st.floats(-1, 1),
    choices=st.lists(share, min_size=5, max_size=30),
)
def test_whatever_is_done_inside_the_bounds_the_joint_can_still_brake(
    braking, fastest, place, speed, choices
):
    """Any accelerations within the bounds, then braking by a: no limit is left, no bound is empty.

    Positions to 1e-12 m or rad, which is rounding of numbers of size 1.
    """
    lower, upper = -1.0, 0.7
    at = compiled(fastest, braking, lower, upper)
    q, v = lower + place * (upper - lower), speed * fastest
    if not viable(q, v, lower, upper, fastest, braking):
        return
    states = []
    for choice in choices:
        least, greatest = at(q, v)
        assert least <= greatest
        # A joint that keeps to the bounds never needs more than a to keep to them again.
        assert greatest >= -braking - 1e-6
        assert least <= braking + 1e-6
        q, v = step(q, v, least + choice * (greatest - least))
        states.append((q, v))
    while abs(v) > 1e-12:
        q, v = step(q, v, -np.sign(v) * min(braking, abs(v) / T))
        states.append((q, v))
    q, v = np.array(states).T
    assert np.all(q <= upper + 1e-12)
    assert np.all(q >= lower - 1e-12)
    assert np.all(abs(v) <= fastest * (1 + 1e-12))


@settings(max_examples=100, deadline=None)
@given(
    braking=st.floats(5, 500),
    fastest=st.floats(0.05, 5),
    beyond=st.floats(1e-6, 0.3),
    speed=st.floats(-1, 1),
)
def test_beyond_its_limit_a_joint_is_led_back(braking, fastest, beyond, speed):
    """From any distance, no faster than the joint may move, and with bounds that are not empty."""
    at = compiled(fastest, braking, -1.0, 1.0)
    q, v = 1.0 + beyond, speed * fastest
    for _ in range(int(1.2 * beyond / (fastest * T)) + 250):
        least, greatest = at(q, v)
        assert least <= greatest + 1e-9 / T
        q, v = step(q, v, greatest)
        assert v <= 1e-12
        assert v >= -fastest * (1 + 1e-12)
    # The last of it fades with a time constant of ten periods: e^-20 in 200.
    assert q <= 1.0 + 1e-8


def driven(at, jerk, wish, ticks):
    """A joint at rest at 0 that is driven as fast as the bounds and the rate allow.

    The bounds trust a rate j. What is viable falls as the joint goes on, which takes as much again;
    so they are given half of what there is (`BRAKING`), and twice j is what the joint has here.
    """
    q, v, a, rate = 0.0, 0.0, 0.0, jerk / BRAKING * T
    for k in range(ticks):
        _, greatest = at(q, v)
        a = float(np.clip(min(wish(k), greatest), a - rate, a + rate))
        q, v = step(q, v, a)
        yield q, v


@pytest.mark.parametrize("seed", range(40))
def test_a_joint_whose_acceleration_changes_at_a_limited_rate_keeps_its_limits(seed):
    """Random brakes, speeds and rates; pushed at the bounds all the time, or now and then."""
    rng = np.random.default_rng(seed)
    braking, fastest, jerk = (
        float(np.exp(rng.uniform(np.log(low), np.log(high))))
        for low, high in ((1, 200), (0.1, 3), (50, 1e5))
    )
    on = rng.random(30) < 0.7
    at = compiled(fastest, braking, -1.0, 1.0, jerk)
    states = np.array(
        list(driven(at, jerk, lambda k: 1e4 * on[k // 50 % 30] if seed % 2 else 1e4, 1500))
    )
    assert states[:, 0].max() <= 1.0 + 1e-9
    assert abs(states[:, 1]).max() <= fastest * (1 + 1e-9)


def test_braking_is_half_of_what_the_motor_has_beside_gravity():
    found = braking_deceleration(
        np.array([10.0, 10.0, np.inf]), np.array([4.0, -12.0, 1.0]), np.diag([2.0, 1.0, 1.0])
    )
    # Numbers even where gravity takes all, or nothing limits the torque.
    np.testing.assert_allclose(found, [BRAKING * 3.0, 1e-3, 1e6], rtol=1e-12)


@pytest.mark.parametrize("slowing", [0.1, 10.0, 1e9])
@pytest.mark.parametrize("room", [0.0, 1e-9, 1e-3, 1.0])
def test_reach_is_the_root_of_its_equation(slowing, room):
    """lag w + w^2 / (2 slowing) = room, to rounding also where the two terms differ by 1e12."""
    w = float(reach(ca.DM(room), ca.DM(slowing), T))
    assert T * w + w * w / (2 * slowing) == pytest.approx(room, rel=1e-12, abs=1e-300)


def test_room_that_is_gone_is_won_back():
    """Beyond a limit the rate is that towards it, mirrored."""
    for jerk in (None, 100.0):
        there, back = (float(approach(ca.DM(x), jerk, T)) for x in (0.3, -0.3))
        assert there > 0
        assert back == -there


# ---- the greatest push on a contact


F, S, CAP, H, K = (ca.SX.sym(name) for name in ("f", "s", "cap", "h", "k"))
BOUND = ca.Function("bound", [F, S, CAP, H, K], [highest_push(CAP, F, S, H, K)])


def pushed(cap, h, k, s, d):
    """Force (ticks, masses) of masses that meet a spring at s [m/s], pushed at the bound.

    x+ = x + T s+, s+ = s + T (u - f) / h, f = k x + d s where they touch. What the bound gets is
    the force of the period before, as the program extrapolates it: + k T s.
    """
    x, forces = np.zeros_like(s), []
    felt, s, now, u = np.zeros_like(s), s.copy(), np.zeros_like(s), np.zeros_like(s)
    many = BoundFunction(BOUND.map(len(s)), [now, s, cap, h, k], [u])
    for _ in range(1500):
        now[:] = felt + k * T * np.maximum(s, 0)
        many.evaluate()
        felt = np.where(x > 0, np.maximum(k * x + d * s, 0.0), 0.0)
        forces.append(felt)
        s += T * (u - felt) / h
        x = x + T * s
    return np.array(forces)


RANDOM = np.random.default_rng(7)
COUNT = 1000
CAPS = RANDOM.uniform(5, 80, COUNT)
MASSES = np.exp(RANDOM.uniform(0, np.log(12), COUNT))
STIFFNESSES = np.exp(RANDOM.uniform(np.log(1e3), np.log(2e5), COUNT))
IMPACTS = RANDOM.uniform(0, 0.99, COUNT)


@pytest.mark.parametrize("ratio", [0.0, 0.05, 0.2])
def test_a_push_at_its_bound_stays_below_the_cap(ratio):
    """1000 impacts with v sqrt(h k) up to 0.99 cap, k 1..200 kN/m, h 1..12 kg.

    What is felt a tick late is f - k T s, so the program knows f, and ticks cost nothing: the force
    exceeds the cap by the 2.9 nu of the docstring at most (measured 2.74), and that is less than
    the share of the limit that is kept back for it. A damper that the bound does not know of takes
    energy: less than that.
    """
    s = IMPACTS * CAPS / np.sqrt(MASSES * STIFFNESSES)
    d = ratio * 2 * np.sqrt(MASSES * STIFFNESSES)
    force = pushed(CAPS, MASSES, STIFFNESSES, s, d)
    assert np.all(force.max(axis=0) <= (1 + 2.9 * NEAREST) * CAPS)
    assert FORCE_SHARE * (1 + 2.9 * NEAREST) < 1
    # The bound is not bought with a contact that is let go of: all settle at the cap.
    np.testing.assert_allclose(force[-200:].mean(axis=0), CAPS, rtol=0.05)


def test_without_room_the_push_turns_back():
    """At the cap and still closing, the bound is a pull; at rest there it is the cap."""

    def bound(f, s):
        return float(BOUND(f, s, 20.0, 3.0, 1e4))

    assert bound(20.0, 0.0) == 20.0
    assert bound(20.0, 0.05) == 20.0 - 3.0 * 1e4 * 0.05**2 / (2 * NEAREST * 20.0)
    assert bound(0.0, 0.0) == 10.0
    assert bound(30.0, -0.1) == 20.0
