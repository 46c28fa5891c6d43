"""The joint servo about an equilibrium, tick by tick as the plant has it; see `control.servo`.

Where nothing is limited a position that is commanded moves in a straight line for a period, at the
velocity by which it changes: both kinds of command are one.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from taskspec.control.servo import drive_gains, transition
from taskspec.deferred_methods import dataclass
from taskspec.spec import Robot
from taskspec.spec.control import Control

Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LinearServo:
    """The servo of n joints.

    Attributes:
        period: of the servo [s].
        every: steps of the plant from tick to tick.
        ticks: of it in a period of control.
        delay: ticks by which it takes a command late.
        transition: (4,) what a period makes of the errors of its reference.
        H, K, D: (n, n) inertia that it knows, stiffness and damping of its drives.
    """

    period: float
    every: int
    ticks: int
    delay: int
    transition: Matrix
    H: Matrix
    K: Matrix
    D: Matrix

    @staticmethod
    def of(robot: Robot, control: Control, H: Matrix) -> LinearServo | None:
        """The servo of an arm with inertia H (n, n); None for one that takes torques."""
        if robot.command == "torque":
            return None
        servo = robot.servo
        w, period = 2 * math.pi * servo.bandwidth, 1.0 / servo.rate
        K, D = drive_gains(H, w, servo.damping, servo.stiffness)
        return LinearServo(
            period=period,
            every=round(control.plant_rate / servo.rate),
            ticks=round(servo.rate / control.rate),
            delay=servo.delay_ticks,
            transition=transition(w, servo.damping, period),
            H=H,
            K=K,
            D=D,
        )

    @property
    def waiting(self) -> int:
        """Commands of earlier periods that it has not taken to their end."""
        return -(-self.delay // self.ticks)

    @property
    def states(self) -> int:
        """Numbers that it remembers: set points, references, their velocities, and commands."""
        return (3 + self.waiting) * len(self.H)

    def begin(self, now: Matrix, command: Matrix) -> ServoPeriod:
        """A period of control, from what it remembers (states, .) and the command (n, .)."""
        n = len(self.H)
        r, q, v, *earlier = np.split(now, 3 + self.waiting) if n else (now, now, now)
        return ServoPeriod(self, r, q, v, [command, *earlier])


@dataclass(slots=True)
class ServoPeriod:
    """A servo in a period of control, as linear maps (n, .).

    Attributes:
        servo: whose period.
        r, q, v: set point, reference and its velocity.
        commands: velocities of this period and of those before, the newest first.
    """

    servo: LinearServo
    r: Matrix
    q: Matrix
    v: Matrix
    commands: list[Matrix]

    def tick(self, number: int, q: Matrix, v: Matrix) -> Matrix:
        """The torque (n, .) of a tick of this period, from 0 on, at joints q, v (n, .)."""
        servo, h = self.servo, self.servo.period
        z = self.commands[-((number - servo.delay) // servo.ticks)]
        e, rate, T = self.r - self.q, z - self.v, servo.transition
        r = self.r + h * z
        reference, velocity = r - (T[0] * e + T[1] * rate), z - (T[2] * e + T[3] * rate)
        pushed = servo.H @ ((velocity - self.v) / h)
        torque = pushed + servo.K @ (self.q - q) + servo.D @ (self.v - v)
        self.r, self.q, self.v = r, reference, velocity
        return np.asarray(torque)

    @property
    def end(self) -> Matrix:
        """(states, .) what is remembered as the period ends."""
        return np.vstack([self.r, self.q, self.v, *self.commands[: self.servo.waiting]])
