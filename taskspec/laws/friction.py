"""Compensation of the joints' friction: a torque beside that of any law.

With q'_r = q'_d + e_q / T_f the velocity that would take the error away in a time T_f, and the
smooth sign s(x) = x / sqrt(1 + x^2),

    u_f = share (tau_c s(q'_r / w) + b q'_d).

tau_c and b are Coulomb's friction and the damping of the joints as they are declared, w the width
of the sign. e_q and q'_d are error and rate of the motion reference, J^bar e and J^bar x'_d of the
tool's axes: an axis under a force loop has none. No velocity that is measured comes into it.

Coulomb's friction tau takes |q'| tau, and the first term gives at most |q'| share tau_c. So the two
together never give the arm energy, whatever share, width, sensors and delays are, as long as

    share tau_c <= tau                                                                       (1)

in each joint: the arm stays stable that is stable without both. Beyond (1) nothing of the kind
holds: the term is a spring of share tau_c / (w T_f) about the reference, which the law's damper
has to settle (TS518).

A joint that its law pulls with kappa e_q rests where |kappa e_q + u_f| <= tau: at most at the root
of

    kappa e + share tau_c s(e / (w T_f)) = tau                                               (2)

from its reference, which is near (tau - share tau_c) / kappa where that is far beyond w T_f, and
tau / kappa without compensation.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from taskspec.control.resolution import resolved
from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.text.units import TIME, scaled, show

if TYPE_CHECKING:
    from taskspec.laws.case import Case


@dataclass(frozen=True, slots=True)
class Compensation:
    """What is compensated of the friction of n joints.

    Attributes:
        coulomb: (n,) share tau_c [N m, N].
        viscous: (n,) share b [N m s/rad, N s/m].
        width: w [rad/s, m/s].
        time: T_f [s].
    """

    coulomb: tuple[float, ...]
    viscous: tuple[float, ...]
    width: float
    time: float

    def torque(self, case: Case) -> ca.SX:
        """(n,) u_f [N m, N]."""
        rate, error = _reference(case)
        wanted = (rate + error / self.time) / self.width
        sign = wanted / ca.sqrt(1 + wanted * wanted)
        return ca.DM(self.coulomb) * sign + ca.DM(self.viscous) * rate

    def rows(self) -> Iterator[tuple[str, str]]:
        """What is compensated, and how."""
        most = " to ".join(
            show(x, "N*m", 3) for x in sorted({min(self.coulomb), max(self.coulomb)})
        )
        damped = max(self.viscous)
        viscous = f" and damping of {show(damped, 'N*m*s/rad', 3)}" if damped else ""
        width, time = show(self.width, "mrad/s", 3), scaled(self.time, TIME, 3)
        yield (
            "friction",
            f"compensates {most}{viscous} of each joint: most of it from {width} of the reference "
            f"on, which would take an error away in {time}",
        )

    def stiffness(self, joint: int) -> float:
        """Of the spring about the reference that the sign is [N m/rad, N/m]."""
        return self.coulomb[joint] / (self.width * self.time)

    def rests_within(self, joint: int, stiffness: float, friction: float) -> float:
        """How far from its reference a joint rests at most, the root of (2) [rad, m].

        Args:
            joint: its number, from 0 on.
            stiffness: kappa, with which its law pulls it [N m/rad, N/m].
            friction: tau, the true one [N m, N].
        """
        low, high = 0.0, friction / stiffness
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            x = middle / (self.width * self.time)
            pull = stiffness * middle + self.coulomb[joint] * x / math.sqrt(1 + x * x)
            low, high = (middle, high) if pull < friction else (low, middle)
        return high


#: An interval that is halved so often is as small as rounding.
_HALVINGS = 60


def _reference(case: Case) -> tuple[ca.SX, ca.SX]:
    """(n,), (n,) rate and error of the motion reference in the joints."""
    if case.joints is not None:
        return case.joints.velocity, case.joints.error
    state, reference = case.state, case.reference
    moves = ca.DM([float(axis not in case.force) for axis in state.axes])
    rate = case.by_the_arm(moves * reference.velocity)
    return resolved(rate, state, None), resolved(moves * reference.error, state, None)
