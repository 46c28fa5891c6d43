"""The chapter's own conditions of stability of one axis on a contact, as laws state them.

They are in continuous time, axis by axis, or for a rigid contact in sampled time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis


@dataclass(frozen=True, slots=True)
class AxisContact:
    """An axis of a stage along the normal of a contact.

    Attributes:
        axis: its name.
        force: whether a force loop is on it.
        normal: whether it is a motion axis whose contact force is left uncancelled.
        gains: on it, by name [SI].
        stiffness: of the contact, k_e [N/m].
        mass: effective along it, Lambda_n [kg].
        rigid: whether a good part of a step's acceleration comes back from the contact within it,
            as measured by a sensor without a filter.
        period: control period T [s].
        largest_mass: gives lambda_max(H_x) of the translations [kg].
    """

    axis: Axis
    force: bool
    normal: bool
    gains: Mapping[str, float]
    stiffness: float
    mass: float
    rigid: bool
    period: float
    largest_mass: Callable[[], float]


@dataclass(frozen=True, slots=True)
class StabilityCondition:
    """One inequality for one axis.

    Attributes:
        equation: its number.
        axis: of the stage.
        text: the inequality.
        gain: that it bounds.
        now: value of the gain [SI].
        bound: the largest (smallest) allowed [SI].
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


def rigid_mass(at: AxisContact) -> StabilityCondition:
    """On a rigid contact, one tick late, the apparent mass of (4.17): h_m > Lambda_n / 2."""
    return StabilityCondition(
        "(4.17), rigid", at.axis, "h_m > Lambda_n / 2", "mass", at.gains["mass"], at.mass / 2,
        upper=False,
    )  # fmt: skip


def rigid_loop(
    at: AxisContact, equation: str, scale: float = 1.0, uncancelled: float = 0.0
) -> Iterator[StabilityCondition]:
    """On a rigid contact, one tick late, a force loop: -1 < K < 1 and 0 < K_I T < 2 (1 - K).

    Args:
        at: the axis.
        equation: that the loop stands in.
        scale: Lambda_n / h_m, by which an apparent mass scales the loop's gains.
        uncancelled: share of the force that the loop itself leaves to the contact.
    """
    if "force.proportional" not in at.gains:
        return
    g, number = at.gains, f"{equation}, rigid"
    K = g["force.proportional"] * scale - uncancelled
    yield StabilityCondition(
        number, at.axis, "K_lambda < 1", "force.proportional", g["force.proportional"],
        (1.0 + uncancelled) / scale,
    )  # fmt: skip
    if "force.integral" in g:
        yield StabilityCondition(
            number, at.axis, "K_I T < 2 (1 - K_lambda)", "force.integral", g["force.integral"],
            2 * (1 - K) / (at.period * scale),
        )  # fmt: skip
