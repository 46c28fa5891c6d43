"""A stage for every value of one of its gains, from three of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.laws.gains import Gain, Gains, pairs_of
from taskspec.laws.law import gain_named
from taskspec.stability.controller import LinearController
from taskspec.stability.sampled_stage import SampledStage


@dataclass(frozen=True, slots=True)
class Family:
    """A stage for every value of one gain.

    Torque and memory are polynomials of second degree in a gain, in 1/gain for an apparent mass:
    three values say them all. Velocities are fractions of gains, so that each value is linearised.

    Attributes:
        sampled: the stage as it is.
        what: the gain.
        on: its axes.
        controllers: at `_AT` times its gain; empty where each value is linearised.
    """

    sampled: SampledStage
    what: str
    on: tuple[str, ...]
    controllers: tuple[LinearController, ...]

    @staticmethod
    def of(sampled: SampledStage, what: str, on: Sequence[str]) -> Family | None:
        """The family of a gain on some axes; None where a member has no derivative."""
        if what == "mass" and pairs_of(sampled.stage.plan.gains, what):
            return None  # The inverse of a matrix is no polynomial of one of its entries.
        members: list[LinearController] = []
        if sampled.stage.plan.law.control_law.commands != "torque":
            return Family(sampled, what, tuple(on), ())
        for factor in _AT:
            moved = 1 / factor if what == "mass" else factor
            if moved == 1:
                members.append(sampled.controller)
                continue
            gains = scaled(sampled.stage.plan.gains, what, on, moved)
            controller = sampled.at.under(gains).linear()
            if not controller.finite or controller.slots != sampled.controller.slots:
                return None
            members.append(controller)
        return Family(sampled, what, tuple(on), tuple(members))

    def at(self, factor: float) -> LinearController:
        """The controller with its gain times `factor`."""
        if not self.controllers:
            plan = self.sampled.stage.plan
            gains = scaled(plan.gains, self.what, self.on, factor)
            for name, power in plan.law.control_law.following.get(self.what, {}).items():
                designed = [a for a in self.on if gains[name][a].origin != "file"]
                gains = scaled(gains, name, designed, factor**power)
            return self.sampled.at.under(gains).linear()
        x = 1 / factor if self.what == "mass" else factor
        torque = np.zeros_like(self.sampled.controller.torque)
        memory = np.zeros_like(self.sampled.controller.memory)
        for i, member in enumerate(self.controllers):
            others = [a for j, a in enumerate(_AT) if j != i]
            weight = np.prod([(x - a) / (_AT[i] - a) for a in others])
            torque += weight * member.torque
            memory += weight * member.memory
        return LinearController(torque, memory, self.sampled.controller.slots)


#: Factors of the members.
_AT = (1.0, 0.5, 2.0)


def scaled(gains: Gains, what: str, on: Sequence[str], factor: float) -> Gains:
    """Gains with one of them multiplied on some axes, and with it what follows from it."""
    found = {name: dict(by_axis) for name, by_axis in gains.items()}
    for name, power in (gain_named(what).powers or {what: 1}).items():
        for axis in on if name in found else ():
            old = found[name][axis]
            found[name][axis] = Gain(old.value * factor**power, old.origin)
    return found
