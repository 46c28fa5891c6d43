"""The quantity that an arm's joints are commanded: torques, or velocities that a servo follows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taskspec.control.servo import excursions
from taskspec.deferred_methods import dataclass
from taskspec.laws.design import GAIN_MARGIN
from taskspec.laws.servo_loop import ServoTiming
from taskspec.program.sensor import SensorModel
from taskspec.robot import RobotModel

if TYPE_CHECKING:
    from taskspec.spec import Control, Robot

Vector = NDArray[np.float64]
Joints = tuple[float, ...]

#: How fast what is left of the last stage's torque fades in the joint with most [N m/s, N/s].
TORQUE_FADING = 1000.0
#: Within which part of a period of the servo's bandwidth a velocity does. Meanwhile goes on what a
#: guard has ended.
VELOCITY_FADING = 0.5


@dataclass(frozen=True, slots=True)
class Drives:
    """What the joints of an arm are commanded.

    A law commands torques or velocities. An arm that takes positions is commanded the sums of the
    velocities, from where it starts.

    Attributes:
        commands: `torque` [N m, N], `velocity` [rad/s, m/s] or `position` [rad, m].
        most: (n,) greatest size of what a law commands a joint.
        rates: (n,) how fast it may change [1/s of its unit]; infinite where nothing limits it. A
            servo then meets none of its own limits of acceleration and jerk.
        fading: how fast what the last stage's law commanded fades at most, in the joint that has
            most to fade [1/s of its unit].
        fades: by which share of it at most [1/s].
        timing: of the servo and what is late around it; None for torques.
    """

    commands: str
    most: Vector
    rates: Vector
    fading: float
    fades: float = math.inf
    timing: ServoTiming | None = None

    @property
    def positions(self) -> bool:
        """Whether positions are commanded."""
        return self.commands == "position"

    @property
    def lag(self) -> float:
        """For how long a joint goes on before it slows down [s], with a margin.

        A reference that is held stops within v / w of where it is, a delay later.
        """
        assert self.timing is not None
        return GAIN_MARGIN * (self.timing.whole_delay + 1 / self.timing.w)

    def approach(self, period: float) -> float:
        """The share of what is left before a limit of speed that a period may use up.

        x = w (2 zeta s + w) / (s^2 + 2 zeta w s + w^2) z goes beyond a step of z, and not beyond
        what z + z' 2 zeta / w has been.
        """
        assert self.timing is not None
        return 1 - math.exp(-period * self.timing.w / (2 * self.timing.ratio))

    @property
    def torques(self) -> bool:
        """Whether torques are commanded, which carry the arm while it rests."""
        return self.commands == "torque"


def drives(robot: RobotModel, declared: Robot, control: Control) -> Drives:
    """The drives of an arm.

    Args:
        robot: its model.
        declared: what the file says of it.
        control: its rates.
    """
    n = robot.n
    if declared.command == "torque":
        return Drives("torque", robot.torque_limit, np.full(n, np.inf), TORQUE_FADING)
    servo, protection = declared.servo, declared.protection
    joints = None if protection is None else protection.joints
    w = 2 * math.pi * servo.bandwidth
    most, rates = robot.velocity_limit, np.full(n, np.inf)
    period = 1.0 / control.rate
    bounds = [(owner.acceleration, owner.jerk) for owner in (servo, joints) if owner is not None]
    for velocities in (servo.velocity, None if joints is None else joints.speed):
        most = _lower(most, velocities)
    if any(bound is not None for pair in bounds for bound in pair):
        # What a command that changes by 1 in a second makes of the reference.
        made = excursions(w, servo.damping, 1 / servo.rate, round(servo.rate * period))
        for pair in bounds:
            for bound, one in zip(pair, made, strict=True):
                rates = _lower(rates, bound, one)
    sensor = SensorModel.of(declared.sensor, period)
    timing = ServoTiming(
        w=w,
        ratio=servo.damping,
        delay=servo.delay_ticks / servo.rate,
        period=period,
        tick=1.0 / servo.rate,
        step=1.0 / control.plant_rate,
        late=sensor.delay_ticks * period,
        held=sensor.hold_ticks,
        pole=sensor.pole,
    )
    fades = servo.bandwidth / VELOCITY_FADING
    return Drives(declared.command, most, rates, float(rates.min()), fades, timing)


def _lower(bounds: Vector, other: Joints | None, share: float = 1.0) -> Vector:
    """The lower of bounds (n,) and others over a share; of another number of joints they are none.

    That they are not for this robot, a rule says.
    """
    if other is None or len(other) not in (1, len(bounds)):
        return bounds
    return np.minimum(bounds, np.array(other) / share)
