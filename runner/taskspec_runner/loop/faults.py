"""Faults between plant and machine: what is measured and what motors exert, otherwise than it is.

The controller, its guards and its references are given what comes out here. What is true stays in
the plant, and beside it on the bus, where expectations find it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taskspec.faults import ENCODER, SENSOR, TORQUE, FaultKind, Shown
from taskspec.program.execution.machine import Machine
from taskspec.robot import RobotModel
from taskspec.spec import Task
from taskspec.spec.fault import Fault
from taskspec.text.units import TIME, scaled
from taskspec_runner.errors import LinkError
from taskspec_runner.plant.plant import Plant
from taskspec_runner.record.bus import Bus
from taskspec_runner.record.fault_time import FaultTime

if TYPE_CHECKING:
    from taskspec_runner.loop.driven import Senses

Vector = NDArray[np.float64]

#: Ticks by which a time may exceed a whole number of them and still count as it.
_ROUNDING = 1e-6


class _Running:
    """A fault of a run: what it does, and since when.

    Attributes:
        fault: as declared.
        kind: what it does.
        first, after: the first tick of it and the first one after it; None while it has not been.
    """

    def __init__(
        self, fault: Fault, channels: Sequence[int], period: float, seed: Sequence[int]
    ) -> None:
        self.fault, self._channels, self._period = fault, list(channels), period
        random = np.random.Generator(np.random.PCG64(list(seed)))
        effect = fault.effect
        self.kind: FaultKind = effect.kind(effect.size, period, fault.every, random)
        #: Torques follow when the machine has made the tick, and counted it.
        self._made = int(fault.device == TORQUE)
        self.first: int | None = None
        self.after: int | None = None
        self._wait = self._ticks(fault.at)
        self._lasts = math.inf if fault.lasts is None else max(1, self._ticks(fault.lasts))

    def acts(self, machine: Machine, tick: int) -> bool:
        """Whether it acts at a tick."""
        if self.first is None:
            stage = self.fault.stage
            since = tick if stage is None else machine.stage_ticks - self._made
            there = stage is None or machine.stage.name == stage
            if not there or since < self._wait:
                return False
            self.first = tick
        if tick - self.first < self._lasts:
            return True
        if self.after is None:
            self.after = tick
        return False

    @property
    def channels(self) -> list[int]:
        """Channels that can fail: rows of a reading, or joints from 0 on."""
        return self._channels

    def on(self, machine: Machine, tick: int, values: Vector, rates: Vector | None = None) -> bool:
        """Changes what a device shows in place; whether it acts."""
        moving = None if rates is None else rates[self._channels]
        shown = Shown(values[self._channels], moving, tick)
        acts = self.acts(machine, tick)
        if not acts or self.kind.watches:
            self.kind.passes(shown)
        if acts:
            assert self.first is not None
            shown.since = tick - self.first
            self.kind.spoil(shown)
            values[self._channels] = shown.values
            if rates is not None:
                rates[self._channels] = shown.rates
        return acts

    def time(self, ticks: int) -> FaultTime:
        """When it was, in a run of so many ticks."""
        fault, first, after = self.fault, self.first, self.after
        if first is None:
            return FaultTime(fault.text, None, None)
        if after is None and first + self._lasts <= ticks:
            after = first + int(self._lasts)
        end = None if after is None else after * self._period
        return FaultTime(fault.text, first * self._period, end)

    def _ticks(self, time: float) -> int:
        return math.ceil(time / self._period - _ROUNDING)


class Faults:
    """The faults of a run, in the order of the file.

    Where torques fail, the bus has what the motors exert.

    Attributes:
        unheard: (n,) joints whose encoders give nothing at this tick.
    """

    def __init__(
        self, task: Task, robot: RobotModel, machine: Machine, plant: Plant, bus: Bus, seed: int
    ) -> None:
        """For a run at its start.

        Args:
            task: with the true world, and faults in it.
            robot, machine, plant, bus: of the run.
            seed: of everything random in it.
        """
        self._machine, self._plant = machine, plant
        self._ticks, self._period = 0, machine.period
        self._timeout = task.control.timeout
        running = [
            # From 1 on: NumPy takes (seed, 0) for seed, which is the stream of the sensor's noise.
            _Running(fault, fault.channels(robot.hinges), machine.period, (seed, number))
            for number, fault in enumerate(task.truth.faults, 1)
        ]
        self._running = tuple(running)
        self._of = {
            device: tuple(each for each in running if each.fault.device == device)
            for device in (SENSOR, TORQUE, ENCODER)
        }
        #: Ticks without a value, by device.
        self._silent = dict.fromkeys((SENSOR, ENCODER), 0)
        self._looked = -1
        self._times: tuple[FaultTime, ...] = ()
        self.unheard = np.zeros(len(machine.torque), dtype=np.bool_)
        self._limit, self._exerted = robot.torque_limit, np.zeros(len(machine.torque))
        self._log = bus.view("true.torque") if self._of[TORQUE] else None

    def read(self, sensing: Senses) -> None:
        """Measures what there is, and spoils it.

        Raises:
            LinkError: a device has given nothing for too long.
        """
        sensing.read()
        machine, tick = self._machine, self._ticks
        silent = dict.fromkeys(self._silent, False)
        self.unheard[:] = False
        for each in self._of[ENCODER]:
            nothing = each.on(machine, tick, machine.q, machine.v) and each.kind.silent
            self.unheard[each.channels] |= nothing
            silent[ENCODER] |= nothing
        if self._of[SENSOR]:
            reading = self._reading()
            for each in self._of[SENSOR]:
                silent[SENSOR] |= each.on(machine, tick, reading) and each.kind.silent
            self._show(reading)
        if self._looked != tick:
            for device, nothing in silent.items():
                self._silent[device] = self._silent[device] + 1 if nothing else 0
                self._wait(device)
        self._looked = tick

    def _wait(self, device: str) -> None:
        """Stops where a device has given nothing for longer than the controller waits."""
        ticks = self._silent[device]
        if ticks * self._period > self._timeout * (1 + _ROUNDING):
            gives = "force sensor gives" if device == SENSOR else "encoders give"
            text = f"the {gives} no value for {scaled(self._timeout, TIME)} (control.timeout)"
            lost = LinkError(f"{device}_lost", text)
            lost.ticks = self._ticks
            raise lost

    def step(self, torque: Vector) -> None:
        """Notes what is true of a tick, and holds what the motors make of a command."""
        if self._of[TORQUE]:
            exerted = self._exerted
            exerted[:] = torque
            for each in self._of[TORQUE]:
                each.on(self._machine, self._ticks, exerted)
            # Whatever they are commanded, motors exert no more than they can.
            np.clip(exerted, -self._limit, self._limit, out=exerted)
            if self._log is not None:
                self._log[:] = exerted
            torque = exerted
        self._plant.step(torque)
        self._ticks += 1

    def end(self) -> None:
        """The run is over: what they do to an arm that is brought to rest is no part of it."""
        self._times = self.times()

    def times(self) -> tuple[FaultTime, ...]:
        """When each of them was, so far, up to the end of the run."""
        return self._times or tuple(each.time(self._ticks) for each in self._running)

    def _reading(self) -> Vector:
        """(6,) what the sensor shows, in the tool's axes [N, N m]."""
        machine = self._machine
        if machine.sensor is not None:
            return machine.sensor.reading
        self._R = self._plant.arm.tip_rotation.reshape(3, 3)
        force, moment = machine.wrench[:3], machine.wrench[3:]
        self._before = np.concatenate([self._R.T @ force, self._R.T @ moment])
        return self._before.copy()

    def _show(self, reading: Vector) -> None:
        """Gives the controller a reading that is not corrected by itself."""
        machine = self._machine
        # What no fault has touched stays as it is, to the bit.
        if machine.sensor is None and not np.array_equal(reading, self._before):
            machine.wrench[:3] = self._R @ reading[:3]
            machine.wrench[3:] = self._R @ reading[3:]
