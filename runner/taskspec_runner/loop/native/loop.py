"""A run's ticks in machine code: what the code shares with machine, plant and log."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from taskspec.native import quadratic
from taskspec.native.code import Compiling, kernel_engine
from taskspec.native.engine import EngineError
from taskspec.native.expressions import UnsupportedOperationError
from taskspec.program import evaluation, ports
from taskspec.program.evaluation import Evaluation
from taskspec.program.execution import controller, controller_memory, pivots, stage_solver
from taskspec.program.execution.controller_memory import controller_memories
from taskspec.program.execution.machine import Opening
from taskspec.program.execution.observer import Observer
from taskspec.program.limits import relaxing
from taskspec_runner.loop.closed_loop import LOOK_EVERY, ClosedLoop
from taskspec_runner.loop.native import tick_memory, ticks
from taskspec_runner.loop.native.tick_memory import LIBRARY, TickMemory
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.plant import joint_servo, rigid_constraints, simulator
from taskspec_runner.plant.equations import XBODY
from taskspec_runner.plant.moving_base import INERTIA
from taskspec_runner.plant.plant import ENERGY_BOUND, FORCE_BOUND, Plant
from taskspec_runner.record import block as log_block
from taskspec_runner.record.block import Block, weights

Vector = NDArray[np.float64]

#: Where the loop has its functions, its record and its constants.
_MODULES = (
    *(ticks, tick_memory, controller, controller_memory, evaluation, quadratic, pivots),
    *(stage_solver, relaxing, ports, rigid_constraints, joint_servo, log_block),
)


class NativeLoop:
    """Runs ticks of a run as long as nothing happens that the machine decides.

    It shares the memory of bus, machine, sensor, plant and block: what it has done is done for all.

    Attributes:
        look: whether it has stopped for the plant's alarms to be looked at.
        sensed: whether the next tick is Python's, and has been sensed.
        ends: whether the next tick, which has been made, ends its stage: what follows is the
            matter of the next `run`.
        made: whether the machine has made the next tick, so that only its step and its record are
            Python's.
    """

    def __init__(self, loop: ClosedLoop, block: Block | None) -> None:
        """Connects the code with what it reads and writes.

        Args:
            loop: of the run.
            block: the log's newest ticks; None for a run that keeps none.

        Raises:
            LayoutError: MuJoCo's data lie otherwise than expected.
        """
        self.look = self.sensed = self.ends = self.made = False
        machine, plant, bus, sensing = loop.machine, loop.plant, loop.bus, loop.sensing
        # A plant that is elsewhere has no memory to share.
        assert isinstance(plant, Plant)
        assert isinstance(sensing, Sensing)
        self._machine, self._plant, self._sensing = machine, plant, sensing
        self._room = 0 if block is None else len(block.rows)
        base = TickMemory()
        _library(base)
        _measured(base, plant)
        _sensor(base, sensing)
        _plant(base, plant)
        base.take(look_every=LOOK_EVERY, bus=bus.array)
        places = bus.slices
        base.take(
            n_bus=len(bus.array),
            keeps=block is not None,
            checks=block is not None and block.in_file,
            **{f"i_{name}": places[name].start for name in ("clock", "t", "stage")},
        )
        if block is not None:
            base.take(
                room=len(block.rows),
                rows=block.rows.reshape(-1),
                sums=block.sums,
                bus_words=bus.array.view(np.int64),
                weights=weights(len(bus.array)),
            )
        self._stages = []
        for index, control in enumerate(controller_memories(machine)):
            stage = TickMemory(base)
            stage.control = control
            if plant.observer is not None:
                _observed(stage, plant.observer, index)
            self._stages.append(stage)
        #: Stages some of whose functions have no machine code of their own.
        self._lacking = set(range(len(self._stages)))
        #: Stages whose functions have been asked for.
        self._asked: set[int] = set()
        self._run: Callable[[int, int], int] | None = None

    def ready(self, compiling: Compiling) -> None:
        """Has the code of the loop and of the current stage: its own, or the interpreter.

        Args:
            compiling: what becomes of machine code that there is not. What is compiled beside is
                asked for all at once, so that one run leaves the code of all stages.

        Raises:
            EngineError: there is no machine code here.
            UnsupportedOperationError: an expression has an operation that machine code lacks.
        """
        current = self._machine.index
        if self._run is None:
            engine = kernel_engine(ticks.run, *_MODULES, compiling=Compiling.WAIT)
            arguments = ctypes.c_void_p, ctypes.c_int64
            self._run = engine.function("run", ctypes.c_int64, *arguments)
        wanted = self._lacking if compiling is Compiling.BESIDE else {current}
        for index in sorted(wanted, key=lambda index: index != current):
            if self._stages[index].load(compiling):
                self._lacking.discard(index)
        self._stages[current].interpret(programs=False)
        self._asked.add(current)

    def run(self, first: int, most: int, compiling: Compiling) -> int:
        """Up to `most` ticks after the `first` ones; returns how many there have been.

        Raises:
            EngineError, UnsupportedOperationError: as `ready`.
        """
        self.look = self.sensed = self.made = False
        opening = self._leave(first, compiling) if self.ends else None
        if self.made:
            return 0
        beside = self._lacking and compiling is Compiling.BESIDE
        if self._machine.index not in self._asked or beside:
            self.ready(compiling)
        assert self._run is not None
        record, sensor = self._record(first), self._sensing.sensor
        c = record.control
        if opening is not None:
            record.opens, c.carries = 1, opening.carries
            # The code finds the first knot itself.
            self._machine.runner.tracks.forget()
        while True:
            reason = self._run(record.address, first + most - c.ticks)
            if reason == ticks.NOISE and sensor is not None:
                sensor.draw()
                record.noise_used = sensor.used
            else:
                break
        if reason == ticks.OPENS:
            assert opening is not None
            record.opens = 0
            self._machine.open(opening)
            self.made = True
            return 0
        if reason == ticks.ENDS and not c.leaving.code:
            self._machine.runner.leaving.evaluate()
        if reason == ticks.SENSED:
            # It may be for a program, and more such ticks may come.
            record.interpret(programs=True)
        self.look, self.ends = reason == ticks.LOOK, reason == ticks.ENDS
        self.sensed = reason == ticks.SENSED
        self._take_back(record)
        if opening is not None:
            carried = float(self._machine.runner.carried[0]) if opening.carries else 0.0
            self._machine.has_opened(record.torque_step, carried)
        done = int(c.ticks) - first
        if done:
            self._machine.has_run(done)
        return done

    def _leave(self, first: int, compiling: Compiling) -> Opening | None:
        """Ends a stage; the one that follows, for machine code to open, if there is any of it."""
        machine = self._machine
        self.ends = False
        opening = machine.leave(first * machine.period)
        self.made = opening is None
        if opening is None:
            return None
        try:
            if machine.index not in self._asked:
                self.ready(compiling)
        except (EngineError, UnsupportedOperationError):
            # Whoever asks for its ticks is told.
            self.made = True
        if opening.rests or self.made or not self._opens_stage(machine.index):
            machine.open(opening)
            self.made = True
            return None
        if machine.runner.stage.entry.poses:
            machine.runner.place(machine.estimation.poses)
        return opening

    def _opens_stage(self, index: int) -> bool:
        """Whether there is code for all that a stage's begin needs."""
        control = self._stages[index].control
        return control.ready(control.OPENING)

    def _record(self, first: int) -> TickMemory:
        """The record of the current stage, with the state of all that Python has changed."""
        machine, sensor = self._machine, self._sensing.sensor
        index, runner, estimation = machine.index, machine.runner, machine.estimation
        record = self._stages[index]
        c = record.control
        c.ticks, c.stage_ticks, c.stage = first, machine.stage_ticks, index
        c.next_knot, record.last_time = runner.tracks.next_knot, self._plant.last_time
        c.tares = estimation.on and machine.sensor is not None
        c.estimates = estimation.on and estimation.estimates is not None
        if estimation.estimates is not None:
            c.estimate_ticks = estimation.estimates.collected
        if sensor is not None:
            record.noise_used, record.sensor_ticks = sensor.used, sensor.ticks
        if runner.solver is not None:
            c.solves = runner.solver.own is not None and c.ready(c.PROGRAMS)
            c.clear, c.paring = runner.solver.clear, runner.solver.paring
            c.solved, c.worst = runner.solver.counts.solved, runner.solver.counts.worst
            c.relaxed = runner.solver.counts.relaxed
        if self._room:
            record.recorded, record.row = first, first % self._room
        return record

    def _take_back(self, record: TickMemory) -> None:
        """Gives Python what the ticks have changed of its own."""
        c = record.control
        sensor, solver = self._sensing.sensor, self._machine.runner.solver
        estimates = self._machine.estimation.estimates
        self._machine.runner.tracks.next_knot = c.next_knot
        if estimates is not None:
            estimates.collected = c.estimate_ticks
        if sensor is not None:
            sensor.used, sensor.ticks = record.noise_used, record.sensor_ticks
        if solver is not None:
            solver.clear, solver.paring = bool(c.clear), bool(c.paring)
            solver.counts.solved, solver.counts.worst = c.solved, c.worst
            solver.counts.relaxed = c.relaxed
        if self.look:
            # Whoever looks sees the clock of the last look, and this step's force.
            self._plant.arm.read_forces()
        else:
            self._plant.last_time = record.last_time


def _library(record: TickMemory) -> None:
    record.take(**{name: simulator.address(name) for name in LIBRARY})


def _measured(record: TickMemory, plant: Plant) -> None:
    """What the controller's inputs are measured from."""
    arm = plant.arm
    record.take(
        true_q=arm.q,
        true_v=arm.v,
        true_wrench=arm.wrench,
        true_reactions=plant.views.equations,
    )


def _observed(record: TickMemory, observer: Observer, index: int) -> None:
    """Who observes the truth of a stage."""
    stage = observer.stages[index]
    record.observed_terms = Evaluation(observer.terms.bound)
    record.observed_entry, record.observed = Evaluation(stage.entry), Evaluation(stage.tick)
    record.take(
        n_observed=len(stage.memory),
        n_observed_parameters=len(stage.parameters),
        n_observed_places=len(stage.places),
        observed_q=observer.q,
        observed_v=observer.v,
        observed_visit=observer.visit,
        observed_memory=stage.memory,
        observed_next_memory=stage.next_memory,
        observed_own=stage.own,
        observed_parameters=stage.parameters,
        observed_entered=stage.entered,
        observed_places=stage.places,
    )


def _sensor(record: TickMemory, sensing: Sensing) -> None:
    record.encoder = Evaluation(sensing.encoder)
    sensor = sensing.sensor
    if sensor is None:
        return
    record.sensor = Evaluation(sensor.function)
    record.take(
        noisy=len(sensor.drawn) > 0,
        noise_drawn=len(sensor.drawn),
        hold_ticks=sensor.hold_ticks,
        n_sensor=len(sensor.memory),
        noise_rows=sensor.drawn.reshape(-1),
        noise=sensor.noise,
        samples=sensor.samples,
        sensor_memory=sensor.memory,
        sensor_kept=sensor.kept,
    )


def _plant(record: TickMemory, plant: Plant) -> None:
    arm, views = plant.arm, plant.views
    model, data = plant.model, plant.data
    layout, words = simulator.data_layout(), simulator.words(data)
    velocity = np.zeros(model.nv)
    warnings = simulator.warnings(data)
    record.take(
        model=model._address,
        data=data._address,
        substeps=plant.substeps,
        simple=plant.simple,
        n_applied=model.nv,
        n_joints=len(arm.rates),
        n_warnings=len(warnings),
        at_efc_force=layout.efc_force,
        force_bound=FORCE_BOUND,
        energy_bound=ENERGY_BOUND,
    )
    record.take(
        data_words=words,
        time=words[layout.time : layout.time + 1].view(np.float64),
        warnings=warnings,
        qpos=data.qpos,
        qvel=data.qvel,
        motors=arm.torque,
        joint_rates=arm.rates,
        applied=data.qfrc_applied,
        velocity=velocity,
        arm_velocity=velocity[arm.velocities],
        momentum=np.zeros(model.nv),
    )
    record.forces = Evaluation(arm.forces)
    if arm.grip is not None:
        rows = arm.grip.rows
        record.take(
            grip_rows=rows.ctypes.data,
            grip_first=rows.itemsize * arm.grip.first,
            grip_bytes=rows.nbytes,
        )
    if arm.handling is not None:
        handling = arm.handling
        record.handling = Evaluation(handling.function)
        record.take(
            body_kind=int(XBODY),
            tip_body=handling.body,
            applied_at=data.qfrc_applied.ctypes.data,
            tip=handling.tip,
            n_handled=len(handling.dofs),
            n_handling=len(handling.memory),
            handled_dof=handling.dofs,
            handling_twist=handling.twist,
            handling_on_tip=handling.on_tip,
            handling_about_tip=handling.about_tip,
            handling_forces=handling.forces,
            handling_memory=handling.memory,
            handling_kept=handling.kept,
            grip_source=handling.source,
            grip_command=handling.command,
        )
    if plant.mechanisms is not None:
        mechanisms = plant.mechanisms
        record.take(
            n_mechanisms=len(mechanisms.dofs),
            mechanism_at=mechanisms.positions,
            mechanism_dof=mechanisms.dofs,
            mechanism_positions=views.mechanism_positions,
            mechanism_rates=views.mechanism_rates,
        )
        if mechanisms.detents is not None:
            record.detents = Evaluation(mechanisms.detents)
            record.take(
                n_detents=len(mechanisms.detent_dofs),
                detent_dof=mechanisms.detent_dofs,
                detent_forces=mechanisms.detent_forces,
            )
    if plant.loose is not None:
        record.take(
            n_loose=len(plant.loose.positions), loose_at=plant.loose.positions, loose=views.loose
        )
    if plant.moving_bases is not None:
        moving = plant.moving_bases
        record.moving = Evaluation(moving.function)
        record.take(
            n_moving=len(moving.dofs),
            moving_inertia=INERTIA,
            moving_at=moving.positions,
            moving_dof=moving.dofs,
            moving_clock=moving.clock,
            moving_place=moving.place,
            moving_rate=moving.rate,
            moving_bend=moving.bend,
        )
    if arm.equations is not None:
        equations = arm.equations
        record.equations = Evaluation(equations.function)
        record.take(
            cartesian=equations.cartesian,
            body_kind=int(XBODY),
            tip_body=equations.body,
            applied_at=data.qfrc_applied.ctypes.data,
        )
        record.take(
            equations_clock=equations.clock,
            tip=equations.tip,
            tip_twist=equations.twist,
            on_tip=equations.on_tip,
            about_tip=equations.about_tip,
            on_joints=equations.on_joints,
            applied_joints=equations.joints,
        )

    if arm.rigid is not None:
        rigid = arm.rigid
        record.rigid = Evaluation(rigid.function)
        record.take(
            n_rigid=len(rigid.multipliers),
            rigid_cartesian=rigid.cartesian,
            tip_body=rigid.body,
            tip=rigid.tip,
            applied_joints=rigid.joints,
            constraint_forces=rigid.constraint_forces,
        )
        names = (
            *("clock", "J", "J_rate", "turning_J", "turning_J_rate", "H", "others", "on_joints"),
            *("exerted", "round", "settled"),
            *("multipliers", "before", "step", "broyden"),
            *("next_multipliers", "next_step", "next_broyden"),
        )
        record.take(**{f"rigid_{name}": getattr(rigid, name) for name in names})
    if arm.servo is not None:
        servo = arm.servo
        record.servo = Evaluation(servo.function)
        record.take(
            servo_positions=servo.positions,
            servo_every=servo.every,
            servo_ticks=servo.ticks,
            servo_rows=servo.rows,
            servo_unknown=servo.unknown,
            tip_body=servo.body,
        )
        of_servo = (
            *("before", "queue", "delayed", "place", "H", "J", "turning_J"),
            *("state", "next_state", "wanted", "exerted", "shown"),
        )
        record.take(**{f"servo_{name}": getattr(servo, name) for name in of_servo})
