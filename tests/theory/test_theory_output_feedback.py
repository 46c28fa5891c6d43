"""Estimated velocities held against runs: their bound, the torques they move, the loop's rates."""

from __future__ import annotations

import numpy as np
import presses
from arm import joint_columns
from identify import poles

from taskspec.program.velocity_estimate import VelocityEstimate
from taskspec.robot.model_terms import PinocchioTerms
from taskspec.stability.sampled_stage import loop_of

SECTION = "4.4 Output feedback: velocities that are estimated"
T = 1e-3
ARMS = tuple(presses.ARMS.values())
#: Laws under which a tool may move freely, and meet a plane with its motion axes.
LAWS = ("pd", "pd-joint", "impedance", "impedance-natural", "hybrid", "parallel")
BECAUSE = "a proof has no exception"


def source(rng):
    """A source of velocities, as a file has it, and its estimate."""
    corner = 10 ** rng.uniform(1, 2)
    kind = ("differences", "filter", "observer")[rng.integers(3)]
    z = 0.0 if kind == "differences" else np.exp(-2 * np.pi * corner * T)
    text = kind if kind == "differences" else f"{{{kind}: {corner:.9g} Hz}}"
    return text, VelocityEstimate(z, T, kind == "observer")


def wrench(made):
    """(ticks, 6) what the environment applies, as it is measured, world axes."""
    found = np.zeros((len(made["clock"]), 6))
    for row, axis in enumerate(("x", "y", "z", "rx", "ry", "rz")):
        name = f"{'force' if row < 3 else 'torque'}.{axis}.measured"
        if name in made.history.columns:
            found[:, row] = -np.nan_to_num(made[name])
    return found


def predicted(made, q, v):
    """(ticks, n) H^-1 (u + J^T f - C v - g), by Pinocchio."""
    terms, found = PinocchioTerms(made.program.context.robot), []
    for at, rate, u, f in zip(q, v, joint_columns(made, "torque"), wrench(made), strict=True):
        terms.at(at, rate)
        found.append(np.linalg.solve(terms.inertia, u + terms.jacobian.T @ f - terms.bias))
    return np.array(found)


def estimated_file(rng):
    """A random arm, law, source, encoder and unknown world; it moves, and half of them press."""
    arm, law = ARMS[rng.integers(len(ARMS))], LAWS[rng.integers(len(LAWS))]
    velocity, estimate = source(rng)
    r = 10 ** rng.uniform(-5, -3.3)
    pressing = bool(rng.integers(2))
    free = [a for a in "xyz" if a in arm.axes.split() and a != arm.normal]
    moves = [f"{a}: {{move: {rng.uniform(-30, 30):.3g} mm}}" for a in free]
    if pressing:
        moves.append(f"N: {{position: {arm.depth(rng.uniform(0, 4))}}}")
    text = arm.task(
        law,
        f"go: {{axes: {{{', '.join(moves)}}}, time: 0.4 s}}",
        f"back: {{axes: {{{free[0]}: {{move: {rng.uniform(-30, 30):.3g} mm}}}}, time: 0.3 s}}",
        contact="stiffness: 5 kN/m, damping: 20 N*s/m" if pressing else None,
        more=f"encoder: {{resolution: {r:.9g} rad}}",
        rest=f"control: {{velocity: {velocity}}}\n",
    )
    if rng.integers(2):
        payload, friction = rng.uniform(0, 300), rng.uniform(0, 0.3)
        text += (
            f"truth: {{robot.payload: {payload:.4g} g, robot.joint_friction: {friction:.4g} N*m}}\n"
        )
    return text, estimate, r


def test_no_random_estimate_is_off_by_more_than_its_bound(simulate, random_files, prediction):
    """|v - q'| <= r/2 sum |h| + c |d|, d what is not known of accelerations.

    A filter knows nothing of them. An observer knows what Pinocchio says of its own estimate; the
    plant's period moves joints by T^2 a, and not by T^2/2 a, which is T/2 a of velocity.
    """
    count, rng = random_files, np.random.default_rng(48154)
    kept, near = 0, []
    for _ in range(count):
        text, estimate, r = estimated_file(rng)
        made = simulate(text)
        rows = slice(0, int(np.sum(np.isfinite(joint_columns(made, "torque")[:, 0]))))
        v, own = (
            joint_columns(made, "velocity")[rows],
            joint_columns(made, "velocity.measured")[rows],
        )
        q = joint_columns(made, "position.measured")[rows]
        a = np.diff(v, axis=0) / T
        d, steps = a, 0.0
        if estimate.modelled:
            d, steps = a - predicted(made, q, own)[:-1], T / 2 * np.max(np.abs(a), axis=0)
        lines = r / 2 * estimate.of_position
        bound = lines + steps + estimate.of_acceleration * np.max(np.abs(d), axis=0)
        share = np.max(np.abs(own - v) / bound)
        kept += share <= 1 + 1e-9
        near.append(share)
    assert max(near) > 0.3
    prediction(
        "files whose velocities keep the bound", "r/2 Σ abs(h) + c d",
        f"{count} random files of four arms", count, kept, atol=0.5, because=BECAUSE,
    )  # fmt: skip


def exact(estimate, q, a):
    """(ticks, n) what the estimate makes of positions without lines, under these accelerations."""
    p, v, found = q[0], np.zeros(q.shape[1]), np.zeros_like(q)
    for k, at in enumerate(q):
        error = at - p
        p, v = p + estimate.position * error, v + estimate.rate / T * error
        found[k] = v
        known = a[k] if estimate.modelled else 0.0
        p, v = p + T * v + T**2 / 2 * known, v + T * known
    return found


def held_file(rng):
    """A random arm that holds still by the readings of its encoders, and is pushed for a while."""
    arm, law = ARMS[rng.integers(len(ARMS))], LAWS[rng.integers(len(LAWS))]
    velocity, estimate = source(rng)
    r = 10 ** rng.uniform(-6, -5)
    text = arm.task(
        law, "hold: {time: 0.4 s}", contact=None, more=f"encoder: {{resolution: {r:.9g} rad}}",
        rest=f"control: {{velocity: {velocity}}}\n",
    )  # fmt: skip
    push = f"bias {2000 * r:.6g} N*m, joint: {1 + rng.integers(2)}, at: 20 ms, for: 150 ms"
    return f"{text}truth: {{faults: [{{torque: {push}}}]}}\n", estimate, r


def of_gravity(made, q):
    """(n, n) dg/dq, by differences of Pinocchio's."""
    terms, columns = PinocchioTerms(made.program.context.robot), []
    for step in 1e-5 * np.eye(len(q)):
        either = []
        for at in (q + step, q - step):
            terms.at(at, 0 * q)
            either.append(terms.gravity.copy())
        columns.append((either[0] - either[1]) / 2e-5)
    return np.column_stack(columns)


def test_no_random_torque_is_moved_by_more_than_its_bound(simulate, random_files, prediction):
    """|u(q, v) - u(exact ones)| <= |K| r/2 + |D| r/2 sum |h|, K and D those of the sampled loop."""
    count, rng = random_files, np.random.default_rng(48155)
    kept, near, number = 0, [], 0
    while number < count:
        text, estimate, r = held_file(rng)
        made = simulate(text)
        sampled = loop_of(made.program.plan, "hold")
        assert sampled is not None
        if sampled.modes()[0].s.real > 0:
            continue  # A filter below its law's bandwidth: the arm leaves where K and D hold.
        number += 1
        n = made.program.context.robot.n
        K, D = sampled.controller.torque[:, :n], sampled.controller.torque[:, n : 2 * n]
        read, own = (
            joint_columns(made, "position.measured"),
            joint_columns(made, "velocity.measured"),
        )
        q, u = joint_columns(made, "position"), joint_columns(made, "torque")
        G = of_gravity(made, read[0])
        v = exact(estimate, q, predicted(made, read, own) if estimate.modelled else None)
        # Entered with the joints as they were read, at rest.
        off = np.abs(u - u[0] - (q - read[0]) @ (K + G).T - v @ D.T)
        whole = np.abs(K + G).sum(axis=1) + estimate.of_position * np.abs(D).sum(axis=1)
        bound = r / 2 * whole
        share = np.max(off / bound)
        # K and D are those of the start; the arm turns by some r.
        kept += share <= 1 + 1e-2
        near.append(share)
    assert max(near) > 0.3
    prediction(
        "files whose torques keep the bound", "K r/2 + D r/2 Σ abs(h)",
        f"{count} random files of four arms", count, kept, atol=0.5, because=BECAUSE,
    )  # fmt: skip


def swinging_file(rng):
    """A random planar arm under a law with springs, whose filter takes a part of its damping."""
    start = f"{rng.uniform(350, 500):.4g} mm, {rng.uniform(100, 300):.4g} mm, 0"
    velocity, estimate = source(rng)
    f = rng.uniform(1.5, 6)
    corner = f * 10 ** rng.uniform(0.3, 1)
    if estimate.pole:
        kind = "observer" if estimate.modelled else "filter"
        velocity = f"{{{kind}: {corner:.9g} Hz}}"
    law = (
        f"{{kind: hybrid, bandwidth: {f:.4g} Hz, damping_ratio: {rng.uniform(0.15, 0.6):.3g}}}",
        f"{{kind: impedance, stiffness: {rng.uniform(0.5, 2):.4g} kN/m, "
        f"damping: {rng.uniform(20, 60):.4g} N*s/m}}",
    )[rng.integers(2)]
    return (
        f"taskspec: 1\nrobot: {{model: planar2, start: {{xyz: [{start}]}}}}\n"
        f"control: {{velocity: {velocity}}}\nlaw: {law}\n"
        "stages:\n  step: {axes: {x: {position: 1 mm}}, time: 1.5 s}\n"
    )


def test_random_rates_are_those_of_the_sampled_loop(simulate, random_files, prediction):
    """Of the swing that a step of 1 mm along x leaves, as lines that are fitted show it."""
    count, rng = random_files, np.random.default_rng(48156)
    worst, number = (0.0, 1.0), 0
    while number < count:
        made = simulate(swinging_file(rng))
        sampled = loop_of(made.program.plan, "step")
        assert sampled is not None
        swings = [mode.s for mode in sampled.modes() if mode.s.imag > 1]
        # What goes at once leaves nothing to fit lines to, what stays or grows nothing at rest.
        if not swings or not -25 < swings[0].real < -0.5:
            continue
        number += 1
        fitted = poles(made.during("step", "error.x", 0.22, 1.2), 6, T, 20)
        found = fitted[np.argmin(np.abs(fitted - swings[0]))]
        off = abs(found - swings[0]) / -swings[0].real
        worst = max(worst, (off, found.real / swings[0].real))
    # Rates, as they are less than frequencies, in the plane of both.
    assert worst[0] < 0.02
    prediction(
        "rate of runs over that of the sampled loop, the worst", "loop with its estimate",
        f"{count} random files of planar2, hybrid and impedance", 1, worst[1],
        rtol=0.02, because="lines are fitted to a second of a motion of 1 mm",
    )  # fmt: skip
