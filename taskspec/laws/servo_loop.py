"""The joint servo of an arm that takes positions or velocities, as a force loop around it has it.

Along one axis, with r the commanded position, x that of the tool on a contact of stiffness k and h
the arm's effective mass there,

    x / r = (2 z w s + w^2) / (s^2 + 2 z w s + w^2)
            (s^2 + c s + b) / (s^2 + c s + b + (k + d s) / h),

where the servo follows commands with w and z, and gives way under load with the stiffness h b and
the damping h c; d is the damping of the contact. A force law that moves with the velocity
(f_d - f) / D closes the loop

    L(s) = (k + d s) / (D s) x / r e^(-T s),

whose gain at -180 degrees gives the least damping D that is stable. Everything is known in closed
form but for that frequency, which is found by bisection: the phase falls monotonically.
"""

from __future__ import annotations

import math

from taskspec.deferred_methods import dataclass

#: Steps of a bisection that leave one in 1e12 of the frequency.
_HALVINGS = 60
#: Frequencies beyond this are looked at no more [rad/s].
_FASTEST = 1e5


@dataclass(frozen=True, slots=True)
class Contact:
    """What a servo moves against, along one axis.

    Attributes:
        h: effective mass of the arm [kg, kg m^2].
        k: stiffness [N/m, N m/rad].
        d: damping [N s/m, N m s/rad].
    """

    h: float
    k: float
    d: float = 0.0


@dataclass(frozen=True, slots=True)
class ServoLoop:
    """A joint servo and what delays the loop around it.

    Attributes:
        w: natural frequency with which commands are followed [rad/s].
        ratio: damping ratio of that.
        delay: from a force to the velocity that is commanded for it, in all [s].
        corner: of the low-pass on the force [rad/s]; infinite for none.
        give: (b, c) of the servo under load [1/s^2, 1/s]; None for those with which it follows.
    """

    w: float
    ratio: float
    delay: float
    corner: float = math.inf
    give: tuple[float, float] | None = None

    def least_damping(self, on: Contact, lag: float = 0.0) -> float:
        """The damping D below which a force loop on a contact is unstable [N s/m, N m s/rad].

        Args:
            on: what returns the force; 0 where nothing does.
            lag: time constant M / D of an apparent mass [s].
        """
        return abs(self._response(self.crossing(on, lag), on, lag)) if on.k > 0 else 0.0

    def crossing(self, on: Contact, lag: float = 0.0) -> float:
        """The frequency at which a loop on its boundary rings [rad/s]; arguments as above."""
        low, high = 0.0, _FASTEST
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            if self._phase(middle, on, lag) > -math.pi:
                low = middle
            else:
                high = middle
        return low

    def _response(self, frequency: float, on: Contact, lag: float) -> complex:
        """D L, without its delay, at a frequency [rad/s]."""
        s = 1j * frequency
        b, c = self._give
        follows = (2 * self.ratio * self.w * s + self.w**2) / (
            s**2 + 2 * self.ratio * self.w * s + self.w**2
        )
        # Contact and servo give way one after the other; an exact one leaves the servo alone.
        returned = 1 / (1 / (on.k + on.d * s) + 1 / (on.h * (s**2 + c * s + b)))
        return returned * follows / (s * (1 + lag * s) * (1 + s / self.corner))

    def stiffness(self, on: Contact) -> float:
        """Of contact and servo together, at rest [N/m, N m/rad]."""
        b, _ = self._give
        return 1 / (1 / on.k + 1 / (on.h * b)) if on.k > 0 else 0.0

    @property
    def _give(self) -> tuple[float, float]:
        return self.give or (self.w**2, 2 * self.ratio * self.w)

    def _phase(self, frequency: float, on: Contact, lag: float) -> float:
        """Of the loop at a frequency [rad], without jumps."""
        b, c = self._give
        at = frequency
        damped = 2 * self.ratio * self.w * at
        return (
            math.atan2(damped, self.w**2)
            - math.atan2(damped, self.w**2 - at**2)
            + math.atan2(c * at, b - at**2)
            + math.atan2(on.d * at, on.k)
            - math.atan2((c + on.d / on.h) * at, b + on.k / on.h - at**2)
            - math.pi / 2
            - math.atan(lag * at)
            - math.atan(at / self.corner)
            - at * self.delay
        )
