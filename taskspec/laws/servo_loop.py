"""The joint servo of an arm that takes positions or velocities, as a force loop around it has it.

Along one axis, with r the commanded position, x that of the tool, h the arm's effective mass and a
contact that returns R = k + d s + m s^2,

    x / r = (2 z w s + w^2) / (s^2 + 2 z w s + w^2) (s^2 + c s + b) / (s^2 + c s + b + R / h),

where the servo follows commands with w and z, and gives way under load with the stiffness h b and
the damping h c: b = w^2 and c = 2 z w where its drives have no stiffness of their own. A force law
that moves with the velocity (f_d - f) / D closes the loop

    G(s) / D,    G(s) = R / s x / r e^(-T s),

with T from a force to what moves for it. It rings for ever where G = -D: the largest D for which
that is so at any frequency is the least that is stable.

Here every part is taken as it is sampled, in closed form, z = e^(s h) for a part with period h:
the reference, the torque that is held for a tick of the servo, the plant's steps, the command that
is held for a period of control, and the sensor's low-pass. What a part samples folds frequencies
that differ by whole multiples of its rate into one, so that these are summed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from taskspec.control.servo import transition
from taskspec.deferred_methods import dataclass

Frequencies = NDArray[np.float64]
Response = NDArray[np.complex128]
Matrix = NDArray[np.float64]

#: Frequencies at which a loop is evaluated first, and those between two where it turns over.
_COARSE, _FINE = 500, 50
#: The lowest of them as a share of the highest.
_LOWEST = 1e-4
#: Rounds of evaluating it closer, each of which leaves a fiftieth.
_CLOSER = 3


@dataclass(frozen=True, slots=True)
class Contact:
    """What returns a force along one axis.

    Attributes:
        k: stiffness [N/m, N m/rad]; without bounds along an exact equation.
        d: damping [N s/m, N m s/rad].
        m: mass that the simulator's contact adds [kg, kg m^2].
    """

    k: float
    d: float = 0.0
    m: float = 0.0


@dataclass(frozen=True, slots=True)
class DrivenAxis:
    """An arm along one axis, in c coordinates in which its inertia is the unit matrix.

    Attributes:
        stiffness: (c, c) of the drives [1/s^2].
        damping: (c, c) of them [1/s].
        motion: (c,) what the axis moves by each coordinate [1/sqrt(kg), 1/sqrt(kg m^2)].
        command: (c,) what each coordinate is commanded for the axis, the dual of that.
    """

    stiffness: Matrix
    damping: Matrix
    motion: Matrix
    command: Matrix

    @staticmethod
    def alone(h: float, w: float, ratio: float) -> DrivenAxis:
        """Where the bandwidth makes stiffness and damping of the inertia: each axis for itself.

        Args:
            h: effective mass [kg, kg m^2].
            w: natural frequency of the servo [rad/s].
            ratio: damping ratio.
        """
        root = math.sqrt(h)
        stiffness, damping = np.array([[w**2]]), np.array([[2 * ratio * w]])
        return DrivenAxis(stiffness, damping, np.array([1 / root]), np.array([root]))


@dataclass(frozen=True, slots=True)
class ServoTiming:
    """A joint servo, and what is late around it.

    Attributes:
        w: natural frequency with which commands are followed [rad/s].
        ratio: damping ratio of that.
        delay: of commands [s].
        period: of control [s].
        tick: of the servo, of which a period has a whole number [s].
        step: of the plant, of which a tick has a whole number [s].
        late: the sensor's delay, beyond the last step of the plant, whose force it has [s].
        held: periods of control for which it holds a reading.
        pole: of its low-pass, per period of control.
    """

    w: float
    ratio: float
    delay: float
    period: float
    tick: float
    step: float
    late: float = 0.0
    held: int = 1
    pole: float = 0.0

    def along(self, h: float, contact: Contact) -> ServoLoop:
        """The loop along an axis with the effective mass h [kg, kg m^2], for itself."""
        return ServoLoop(self, DrivenAxis.alone(h, self.w, self.ratio), contact)

    @property
    def whole_delay(self) -> float:
        """From a force to a servo that moves for it, without a low-pass [s]."""
        # A command is held for a period, half of it on the average.
        sensed = self.step + self.late + (self.held - 1) / 2 * self.period
        return sensed + self.period / 2 + self.delay


@dataclass(frozen=True, slots=True)
class ServoLoop:
    """A force loop along one axis of an arm with a servo.

    Attributes:
        timing: of servo and sensor.
        arm: along the axis.
        contact: what it moves against.
        carried: mass beyond a sensor at the wrist, whose inertia that has in its reading [kg].
    """

    timing: ServoTiming
    arm: DrivenAxis
    contact: Contact
    carried: float = 0.0

    @property
    def known(self) -> bool:
        """Whether anything returns a force along the axis, so that the loop has a boundary."""
        return self.contact.k > 0

    @property
    def stiffness(self) -> float:
        """Of contact and drives, one behind the other [N/m, N m/rad]."""
        gives = self.arm.motion @ np.linalg.solve(self.arm.stiffness, self.arm.motion)
        return float(1 / (1 / self.contact.k + gives))

    def least_damping(
        self,
        *,
        lag: float = 0.0,
        mass: float = 0.0,
        spring: float = 0.0,
        integral: float = 0.0,
    ) -> tuple[float, float]:
        """The damping D below which the loop is unstable, and where a loop with that rings [Hz].

        D is in N s/m or N m s/rad, and 0 where the loop is always stable.

        Args:
            lag: time constant M / D of an apparent mass that grows with D [s].
            mass: an apparent mass of its own [kg, kg m^2].
            spring: stiffness of the axis about the measured position [N/m, N m/rad].
            integral: of a law that takes the error of the force times 1 [1/s].
        """
        highest = math.pi / self.timing.period

        def wanted(frequencies: Frequencies) -> Response:
            s = np.asarray(1j * frequencies)
            late = np.exp(-s * self.timing.period)
            rate = (1 - late) / self.timing.period
            # The law takes its spring and its integral at the end of a period.
            found = -self._response(s, spring) * (1 + integral / rate)
            found -= mass * rate + spring * self.timing.period
            return np.asarray(found / (1 + lag * rate))

        frequencies = np.geomspace(_LOWEST * highest, highest, _COARSE)
        found = wanted(frequencies)
        # At half the rate of control all is real: that boundary is reached from tick to tick.
        least, at = max((0.0, 0.0), (float(found[-1].real), highest))
        turns = np.flatnonzero(np.signbit(found.imag[1:]) != np.signbit(found.imag[:-1]))
        largest = np.maximum(found.real[1:], found.real[:-1])
        for i in turns[np.argsort(-largest[turns])]:
            if largest[i] <= least:
                break
            low, high = float(frequencies[i]), float(frequencies[i + 1])
            for _ in range(_CLOSER):
                between = np.linspace(low, high, _FINE)
                closer = wanted(between)
                side = np.signbit(closer.imag)
                j = int(np.argmax(side[1:] != side[:-1]))
                low, high = float(between[j]), float(between[j + 1])
            if closer[j].real > least:
                least, at = float(closer[j].real), low
        return least, at / (2 * math.pi)

    def _response(self, s: Response, spring: float) -> Response:
        """G (k,): force that the law has, per velocity that it commands."""
        t = self.timing
        n = round(t.period / t.tick)
        return sum(
            (self._alias(s + 2j * math.pi * i / t.period, n, spring) for i in range(n)),
            np.zeros(len(s), dtype=np.complex128),
        )

    def _alias(self, s: Response, n: int, spring: float) -> Response:
        """One of the frequencies that control folds into one; n ticks are a period."""
        t, arm = self.timing, self.arm
        late, tick = np.exp(-s * t.period), np.exp(s * t.tick)
        # A reference at rest but for the velocity 1: what is left of it each tick is `left`.
        T = transition(t.w, t.ratio, t.tick)
        c = T[1] / (tick - T[0])
        left = T[3] + T[2] * c
        rate = (1 - left) / (tick - left)
        place = t.tick / (tick - 1) - c * (1 - rate)
        ahead = (tick - 1) / t.tick * rate
        one = np.eye(len(arm.motion))
        push = _times(ahead, one) + _times(place, arm.stiffness) + _times(rate, arm.damping)

        free, moving, pulled, through = self._plant(s, spring)
        dyad = np.outer(arm.motion, arm.motion)
        loop = one + arm.stiffness @ (_times(free[0], one) - _times(free[1], dyad))
        loop = loop + arm.damping @ (_times(moving[0], one) - _times(moving[1], dyad))
        torque = np.linalg.solve(loop, (push @ arm.command)[..., None])[..., 0]
        pull = torque @ arm.motion
        command = _holding(s, t.period, n) * np.exp(-s * t.delay)
        filtered = (1 - t.pole) / (1 - t.pole * late) * _holding(s, t.held * t.period, t.held)
        return np.asarray(command * pull * (pulled * filtered * np.exp(-s * t.late) + through))

    def _plant(
        self, s: Response, spring: float
    ) -> tuple[tuple[Response, Response], tuple[Response, Response], Response, Response]:
        """What a torque of the servo's ticks does: a factor of the unit matrix, one of the dyad.

        Returns:
            Of the coordinates, of their rates, the force of the contact for what pulls along the
            axis, and that of a spring on the measured position.
        """
        t, on = self.timing, self.contact
        m = round(t.tick / t.step)
        gamma = float(self.arm.motion @ self.arm.motion)
        free, moving = ([np.zeros_like(s), np.zeros_like(s)] for _ in range(2))
        pulled, through = np.zeros_like(s), np.zeros_like(s)
        for i in range(m):
            at = s + 2j * math.pi * i / t.tick
            step = np.exp(-at * t.step)
            held = _holding(at, t.tick, m)
            # Of a step v' = v + h a, y' = y + h v'.
            rate = (1 - step) / t.step
            twice = rate**2 / step
            gives: Response = np.zeros_like(s)
            if math.isfinite(on.k):
                gives = np.asarray(1 / (on.k + on.d * rate + on.m * twice), dtype=complex)
            force = 1 / (gamma + twice * gives)
            alone, loaded = held / twice, held * force * gives
            free[0] += alone
            free[1] += alone * force
            moving[0] += alone * rate
            moving[1] += alone * force * rate
            pulled += (held * force + loaded * self.carried * twice) * step
            through += spring * loaded
        return (free[0], free[1]), (moving[0], moving[1]), pulled, through


def _holding(s: Response, period: float, parts: int) -> Response:
    """(k,) mean of what is held over so many parts of a period."""
    if parts == 1:
        return np.ones_like(s)
    return np.asarray((1 - np.exp(-s * period)) / (parts * (1 - np.exp(-s * period / parts))))


def _times(values: Response, matrix: Matrix) -> Response:
    """(k, c, c) numbers (k,) times a matrix."""
    return np.asarray(values[:, None, None] * matrix)
