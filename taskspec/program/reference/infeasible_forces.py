"""What of a stage's force set points the last tick found out of reach, as this tick takes it in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from taskspec.control.state import ARM_LENGTH
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.reference.axis_plan import AxisPlan
from taskspec.program.slots import Slots
from taskspec.spec import Law

#: A limit that takes less than this from a force is rounding [N, N m].
_FORCE_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class InfeasibleForces:
    """What the last tick found, as parameters of this one, by axis or equation.

    Attributes:
        unreachable: of a force set point, as the robot would apply it [N, N m].
        cut: what limits took from the force on it.
    """

    unreachable: Mapping[str, ca.SX]
    cut: Mapping[str, ca.SX]

    def reachable(self, name: str, force: ca.SX) -> ca.SX:
        """A set point without what cannot be returned of it."""
        return force - self.unreachable[name] if name in self.unreachable else force

    def step(self, name: str, step: ca.SX) -> ca.SX:
        """What a force integral grows by: nothing towards a force that limits are keeping away."""
        if name not in self.cut:
            return step
        held_back = step * self.cut[name] < -_FORCE_ROUNDING * ca.fabs(step)
        return ca.if_else(held_back, 0, step)

    def size(self) -> ca.SX:
        """How much cannot be returned [N]; moments count by the arm's length."""
        parts = [x / ARM_LENGTH if is_moment(name) else x for name, x in self.unreachable.items()]
        return ca.norm_2(ca.vertcat(0, *parts))


def infeasible_of(names: Sequence[str], parameters: Slots) -> InfeasibleForces:
    """Makes the parameters for the force set points `names`."""
    if not names:
        return InfeasibleForces({}, {})
    r = len(names)
    left, cut = parameters.add("unreachable", r), parameters.add("cut", r)
    return InfeasibleForces(
        {name: left[i] for i, name in enumerate(names)},
        {name: cut[i] for i, name in enumerate(names)},
    )


def requested(law: Law, plans: Mapping[Axis, AxisPlan], active: Sequence[str]) -> tuple[str, ...]:
    """Names of a stage's force set points, axes before equations; none without a program."""
    if law.solve != "qp":
        return ()
    return (*(a for a, p in plans.items() if p.set_point), *active)


def is_moment(name: str) -> bool:
    """Whether a set point is a moment: one about an axis."""
    return name in AXES[3:]
