"""How gains of others are tuned: a stated budget of runs of a task that nobody is judged by."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from referee.admittance import EXAMPLE as ROS_EXAMPLE
from referee.admittance import AdmittanceGains
from referee.forward_dynamics import EXAMPLE as FORWARD_EXAMPLE
from referee.forward_dynamics import ComplianceGains
from referee.metrics import BAND, Metrics

#: Runs of each rule: anywhere in its space, and then about the best so far.
ANYWHERE, ABOUT = 8, 3
#: Standard deviation of those about the best, of a logarithm.
NEAR = 0.4
#: What costs as much as a force that is off by `BAND`: error of a path [m], time to settle [s].
PATH, SETTLING = 1e-3, 0.5
#: Of a run that did not come to the end of its stage, or never settled [as the terms of `cost`].
LOST = 100.0

Space = Mapping[str, tuple[float, float]]

#: Of the axis of force, M [kg], D [N s/m] and the filter; of the others, K [N/m].
ROS_SPACE: Space = {
    "mass": (0.5, 20.0),
    "damping": (50.0, 2000.0),
    "filter": (0.05, 1.0),
    "stiffness": (100.0, 10000.0),
}
#: PD with d by p [s], K of the axes that are led [N/m], and iterations.
FORWARD_SPACE: Space = {
    "p": (0.005, 0.2),
    "d_by_p": (0.01, 1.0),
    "stiffness": (200.0, 20000.0),
    "iterations": (1.0, 10.0),
}
#: Of the axis of force under the rule of ROS 2: its damper is made of its spring, which has to be
#: there, but pulls [N/m].
SLIGHT = 1.0


def ros_gains(values: Mapping[str, float]) -> AdmittanceGains:
    """Gains for a task that presses along z, from a point of `ROS_SPACE`."""
    mass, led = values["mass"], values["stiffness"]
    pressed = values["damping"] / (2 * np.sqrt(mass * SLIGHT))
    free = replace(
        ROS_EXAMPLE,
        mass=(mass,) * 3 + (0.1,) * 3,
        damping_ratio=(1.0,) * 6,
        stiffness=(led,) * 3 + (led / 50,) * 3,
        selected_axes=(False,) * 6,
        filter_coefficient=values["filter"],
    )
    return replace(
        free,
        damping_ratio=(1.0, 1.0, float(pressed), 1.0, 1.0, 1.0),
        stiffness=(led, led, SLIGHT, led / 50, led / 50, led / 50),
        selected_axes=(False, False, True, False, False, False),
        free=free,
    )


def forward_gains(values: Mapping[str, float]) -> ComplianceGains:
    """Gains for a task that presses along z, from a point of `FORWARD_SPACE`."""
    p, led = values["p"], values["stiffness"]
    d = p * values["d_by_p"]
    return replace(
        FORWARD_EXAMPLE,
        stiffness=(led, led, 0.0, *FORWARD_EXAMPLE.stiffness[3:]),
        free=(led,) * 3 + FORWARD_EXAMPLE.stiffness[3:],
        p=(p,) * 3 + FORWARD_EXAMPLE.p[3:],
        d=(d,) * 3 + FORWARD_EXAMPLE.d[3:],
        error_scale=1.0,
        iterations=round(values["iterations"]),
    )


def cost(found: Metrics | None, set_point: float, *, ended: bool) -> float:
    """What a run is worth; 1 for each of its parts that is as good as it needs to be.

    Args:
        found: of the stage that presses; None if the run did not come to it.
        set_point: [N].
        ended: whether the run came to its end.
    """
    if found is None or not ended:
        return LOST
    band = BAND * abs(set_point)
    settled = found.settled / SETTLING if np.isfinite(found.settled) else LOST / 2
    force = (found.force_rms + found.overshoot) / band
    return float(force + found.path_rms / PATH + settled + LOST * found.lost)


def tuned(
    space: Space,
    tried: Callable[[Mapping[str, float]], float],
    *,
    anywhere: int = ANYWHERE,
    about: int = ABOUT,
    seed: int = 0,
) -> tuple[dict[str, float], float]:
    """The best point of a space, and what it costs.

    Args:
        space: bounds by name; values are drawn evenly by their logarithms.
        tried: the cost of a point.
        anywhere, about: numbers of points, anywhere and about the best so far.
        seed: of what is drawn.
    """
    random = np.random.default_rng(seed)
    low, high = np.log(np.array(list(space.values()))).T
    best, least = np.zeros(len(space)), np.inf
    for number in range(anywhere + about):
        near = best + NEAR * random.standard_normal(len(space))
        far = random.uniform(low, high)
        at = far if number < anywhere else np.clip(near, low, high)
        price = tried(dict(zip(space, np.exp(at).tolist(), strict=True)))
        if price < least:
            best, least = at, price
    return dict(zip(space, np.exp(best).tolist(), strict=True)), float(least)
