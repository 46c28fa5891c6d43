"""The joint servo of an arm that takes positions or velocities, as a force loop around it has it.

Along one axis, with r the commanded position, x that of the tool on a contact of stiffness k and h
the arm's effective mass there,

    x / r = (2 z w s + w^2) / (s^2 + 2 z w s + w^2) (s^2 + c s + b) / (s^2 + c s + b + k / h),

where the servo follows commands with w and z, and gives way under load with the stiffness h b and
the damping h c. A force law that moves with the velocity (f_d - f) / D closes the loop

    L(s) = k / (D s) x / r e^(-T s),

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

    def least_damping(self, h: float, k: float, lag: float = 0.0) -> float:
        """The damping D below which a force loop on a contact is unstable [N s/m, N m s/rad].

        Args:
            h: effective mass along the axis [kg, kg m^2].
            k: stiffness of the contact [N/m, N m/rad].
            lag: time constant M / D of an apparent mass [s].
        """
        if k <= 0:
            return 0.0
        low, high = 0.0, _FASTEST
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            if self._phase(middle, h, k, lag) > -math.pi:
                low = middle
            else:
                high = middle
        return k * abs(self._response(low, h, k, lag))

    def crossing(self, h: float, k: float, lag: float = 0.0) -> float:
        """The frequency at which a loop on its boundary rings [rad/s]; arguments as above."""
        low, high = 0.0, _FASTEST
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            if self._phase(middle, h, k, lag) > -math.pi:
                low = middle
            else:
                high = middle
        return low

    def _response(self, frequency: float, h: float, k: float, lag: float) -> complex:
        """x / r / s, without its delay, at a frequency [rad/s]."""
        s = 1j * frequency
        b, c = self._give
        follows = (2 * self.ratio * self.w * s + self.w**2) / (
            s**2 + 2 * self.ratio * self.w * s + self.w**2
        )
        gives = (s**2 + c * s + b) / (s**2 + c * s + b + k / h)
        return follows * gives / (s * (1 + lag * s) * (1 + s / self.corner))

    @property
    def _give(self) -> tuple[float, float]:
        return self.give or (self.w**2, 2 * self.ratio * self.w)

    def _phase(self, frequency: float, h: float, k: float, lag: float) -> float:
        """Of the loop at a frequency [rad], without jumps."""
        b, c = self._give
        at = frequency
        damped = 2 * self.ratio * self.w * at
        return (
            math.atan2(damped, self.w**2)
            - math.atan2(damped, self.w**2 - at**2)
            + math.atan2(c * at, b - at**2)
            - math.atan2(c * at, b + k / h - at**2)
            - math.pi / 2
            - math.atan(lag * at)
            - math.atan(at / self.corner)
            - at * self.delay
        )
