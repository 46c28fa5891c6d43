"""After a run that did not come to `end`: its arm is brought to rest."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taskspec.control.stopping import decay_time, slowed, stopping_torque, within_rate
from taskspec.deferred_methods import dataclass
from taskspec.program.execution.machine import Machine
from taskspec_runner.errors import LinkError

if TYPE_CHECKING:
    from taskspec_runner.loop.closed_loop import ClosedLoop
    from taskspec_runner.plant.joint_servo import JointServo
    from taskspec_runner.plant.plant import Plant

Vector = NDArray[np.float64]

#: For how long an arm is brought to rest [s].
STRETCH = 0.5
#: Outputs of a stage about its commands, which have no value any more.
_COMMAND_OUTPUTS = (
    *("force_ref", "position_ref", "velocity_ref", "error", "reaction_ref"),
    *("gap_ref", "reaction_residual", "joint_ref", "gain", "tank"),
    *("path_done", "force_inconsistent", "limited", "limits", "residual", "friction"),
)
#: Squared joint velocities of a sane arm stay far below this.
_HEALTHY = 1e8


@dataclass(frozen=True, slots=True)
class Brought:
    """Result of bringing an arm to rest.

    Attributes:
        why: it was broken off; empty if it was not.
        undamped: joints, from 1 on, that were carried alone for at least a tick, as their encoders
            gave nothing.
    """

    why: str
    undamped: tuple[int, ...]


def bring_to_rest(closed: ClosedLoop, plant: Plant, ticks: int, period: float) -> Brought:
    """Runs the stop controller on a plant for `STRETCH`, and records that.

    What is recorded is measured as the stage did that was broken off, in its frame; what that
    commanded has no value any more.

    Args:
        closed: the loop, after its last tick.
        plant: that it stepped.
        ticks: of the run so far.
        period: of control [s].

    A joint whose encoder gives nothing is carried and not damped. Torques change no faster than the
    last stage's limits and the robot's protection have. An arm that takes no torques is slowed down
    by what it is commanded, as fast as limits of acceleration and jerk let a command change.
    """
    machine, bus = closed.machine, closed.bus
    slowing = None if plant.arm.servo is None else _Slowing(machine, plant.arm.servo, period)
    step_most, undamped = (
        period * machine.stage.plan.torque_rates,
        np.zeros(len(machine.torque), dtype=np.bool_),
    )
    most, decay = plant.scene.arm.robot.torque_limit, decay_time(period)
    clock, t, stage = (bus.slices[name].start for name in ("clock", "t", "stage"))
    commanded = [
        where
        for name, where in bus.slices.items()
        if name.removeprefix("true.") in _COMMAND_OUTPUTS
    ]
    # Whoever held the torques of a plant that is served is gone.
    step = plant.step if closed.faults is None else closed.faults.step
    for number in range(round(STRETCH / period)):
        # A force sensor that says nothing is not needed.
        with contextlib.suppress(LinkError):
            closed.read()
        if not float(machine.v @ machine.v) < _HEALTHY:
            return Brought("its state is no longer finite", _numbers(undamped))
        unheard = None if closed.faults is None else closed.faults.unheard
        if unheard is not None:
            undamped |= unheard
        before = machine.torque.copy()
        if slowing is not None:
            torque = slowing.command((ticks + number) * period)
        else:
            torque = _torque(machine, most, decay, (ticks + number) * period, unheard)
        if slowing is None and np.isfinite(step_most).any():
            # What is no number has not been applied.
            known = np.where(np.isfinite(before), before, torque)
            torque[:] = within_rate(torque, known, step_most, most)
        bus.array[clock], bus.array[t] = (ticks + number) * period, number * period
        bus.array[stage] = len(machine.runners) + machine.index
        step(torque)
        machine.predict()
        for where in commanded:
            bus.array[where] = np.nan
        closed.recorder.add()
        alarm = plant.alarm()
        if alarm is not None:
            return Brought(alarm[1], _numbers(undamped))
    return Brought("", _numbers(undamped))


def _numbers(joints: NDArray[np.bool_]) -> tuple[int, ...]:
    """Joints as a reader counts them, from 1 on."""
    return tuple((np.flatnonzero(joints) + 1).tolist())


def _torque(
    machine: Machine, most: Vector, decay: float, clock: float, unheard: NDArray[np.bool_] | None
) -> Vector:
    """The machine's torque at this instant, by the stop controller."""
    machine.look(clock)
    terms = machine.terms
    machine.torque[:] = stopping_torque(
        terms.inertia, terms.gravity, machine.v, most, decay, unheard
    )
    return machine.torque


class _Slowing:
    """What an arm that takes velocities or positions is commanded until it rests."""

    def __init__(self, machine: Machine, servo: JointServo, period: float) -> None:
        """Begins with where the servo is, and not with how far ahead it was commanded to be."""
        delay = machine.stage.plan.context.loaded.task.robot.servo.delay
        self._machine, self._positions, self._period = machine, servo.positions, period
        self._step = period * machine.drives.rates
        self._rate = servo.rate.copy() if servo.positions else machine.torque.copy()
        # What a steady motion was last commanded, by a servo that is late.
        self._place = servo.reference + delay * servo.rate

    def command(self, clock: float) -> Vector:
        """The command at an instant, in the machine's vector."""
        machine = self._machine
        machine.look(clock)
        self._rate = slowed(self._rate, self._step)
        self._place += self._period * self._rate
        machine.torque[:] = self._place if self._positions else self._rate
        return machine.torque
