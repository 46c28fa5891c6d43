"""The chapter's own conditions of stability, beside the sampled model that decides.

They are in continuous time, axis by axis, or for a rigid contact in sampled time. On a stiff
contact they can be wrong a hundredfold; where they agree with the sampled model they say why.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from taskspec.analysis.stage import Analysed, along
from taskspec.control.sensor import SensorModel
from taskspec.geometry.axis import AXES, Axis
from taskspec.spec import LAWS

#: A contact on which more than this share of a step's acceleration comes back is called rigid.
_RIGID_PHASE = 0.3


@dataclass(frozen=True, slots=True)
class Condition:
    """One inequality for one axis.

    Attributes:
        equation: its number. axis: of the stage. text: the inequality.
        gain: that it bounds. now, bound: its value and the largest (smallest) allowed [SI].
        upper: whether the bound is the largest.
    """

    equation: str
    axis: Axis
    text: str
    gain: str
    now: float
    bound: float
    upper: bool = True

    @property
    def holds(self) -> bool:
        """Whether the file's gain keeps it."""
        return self.now < self.bound if self.upper else self.now > self.bound


def conditions(seen: Analysed) -> tuple[Condition, ...]:
    """All conditions of the chapter that speak of a stage's contacts with the world's shapes."""
    found: list[Condition] = []
    for name in seen.pressed:
        if name not in seen.context.surfaces:
            continue
        for axis in seen.stage.axes:
            if along(seen.context, seen.rotation, name, axis):
                found.extend(_on_axis(seen, name, axis))
    return tuple(found)


def _on_axis(seen: Analysed, name: str, axis: Axis) -> Iterator[Condition]:
    law, plan = seen.stage.law, seen.stage.plans[axis]
    gains = {gain: by[axis].value for gain, by in seen.stage.gains.items() if axis in by}
    contact = seen.context.compliances[name]
    k_e, felt = contact.stiffness, felt_mass(seen, axis)
    if law.kind == "parallel" and plan.force:
        yield _routh(axis, gains, k_e)
    if law.kind == "parallel-pid" and plan.force:
        yield from _regulator(seen, axis, gains, k_e, felt)
    sensor = SensorModel.of(seen.context.loaded.task.robot.sensor, seen.context.period)
    if contact.phase > _RIGID_PHASE and sensor.direct:
        yield from _rigid(seen, axis, gains, felt)


def felt_mass(seen: Analysed, axis: Axis) -> float:
    """Lambda_n = 1/(a^T J H^-1 J^T a) along a translation of the stage's frame [kg]."""
    row = seen.rotation[:, AXES.index(axis)] @ seen.context.start_jacobian[:3]
    return float(1.0 / (row @ np.linalg.solve(seen.context.start_inertia, row)))


def _routh(axis: Axis, g: dict[str, float], k_e: float) -> Condition:
    """(4.46): d_m (k_m + k_F k_e) > h_m k_I k_e."""
    bound = g["damping"] * (g["stiffness"] + g["force.proportional"] * k_e) / (g["mass"] * k_e)
    return Condition(
        "(4.46)", axis, "d_m (k_m + k_F k_e) > h_m k_I k_e",
        "force.integral", g["force.integral"], bound,
    )  # fmt: skip


def _regulator(
    seen: Analysed, axis: Axis, g: dict[str, float], k_e: float, felt: float
) -> Iterator[Condition]:
    """(4.70), (4.71) with the region shrunk to the equilibrium, and the scalar twin of (4.61)."""
    d, k, k_F, k_I = (
        g[name] for name in ("damping", "stiffness", "force.proportional", "force.integral")
    )
    rows = [AXES.index(a) for a in seen.stage.axes]
    J = (np.kron(np.eye(2), seen.rotation.T) @ seen.context.start_jacobian)[rows]
    H_x = np.linalg.inv(J @ np.linalg.solve(seen.context.start_inertia, J.T))
    linear = [i for i, a in enumerate(seen.stage.axes) if not a.is_rotation]
    largest = float(np.max(np.linalg.eigvalsh(H_x[np.ix_(linear, linear)])))
    yield Condition(
        "(4.70), (4.71)", axis, "rho (1 + k_F) > k_I, d_m > rho lambda_max(H_x)",
        "force.integral", k_I, (1 + k_F) * d / largest,
    )  # fmt: skip
    yield Condition(
        "(4.61), one axis", axis, "d_m (k_m + (1 + k_F) k_e) > Lambda_n k_I k_e",
        "force.integral", k_I, d * (k + (1 + k_F) * k_e) / (felt * k_e),
    )  # fmt: skip


def _rigid(seen: Analysed, axis: Axis, g: dict[str, float], felt: float) -> Iterator[Condition]:
    """On a rigid contact, one tick late: -1 < K < 1 and 0 < K_I T < 2 (1 - K)."""
    kind, plan, T = seen.stage.law.kind, seen.stage.plans[axis], seen.context.period
    facts = LAWS[kind]
    if kind == "impedance" or (kind == "parallel" and plan.yields):
        yield Condition(
            "(4.17), rigid", axis, "h_m > Lambda_n / 2", "mass", g["mass"], felt / 2, upper=False
        )
        return
    if not plan.force:
        return
    scale = felt / g["mass"] if kind == "parallel" else 1.0
    K = g["force.proportional"] * scale - (1.0 if kind == "parallel" else 0.0)
    number = f"{facts.equations.split(',')[-1].strip()}, rigid"
    yield Condition(
        number, axis, "K_lambda < 1", "force.proportional", g["force.proportional"],
        (2.0 if kind == "parallel" else 1.0) / scale,
    )  # fmt: skip
    if "force.integral" in g:
        yield Condition(
            number, axis, "K_I T < 2 (1 - K_lambda)", "force.integral", g["force.integral"],
            2 * (1 - K) / (T * scale),
        )  # fmt: skip
