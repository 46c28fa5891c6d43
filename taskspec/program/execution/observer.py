"""Outputs of a machine's stages for the true state of the arm."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction
from taskspec.program.execution.compiled_terms import CompiledTerms
from taskspec.program.execution.machine import Machine
from taskspec.program.execution.stage_runner import StageRunner
from taskspec.robot import RobotModel

Vector = NDArray[np.float64]

#: Parameters that say where a stage began: those of an observer are the true ones.
_PLACES = ("frame.face", "entry", "base", "angle_at_entry", "lever")


class Observer:
    """Evaluates the ticks of a machine once more, at other joint positions and velocities.

    Frames, offsets, positions, velocities and errors come from the formulas of the controller. The
    reference is its own, and what counts from where a stage began counts from where that was.

    Attributes:
        state: (n,), (n,) of the arm, from which q and v are copied.
        q, v: (n,) where it observes.
        outputs: the numbers of `ports.fields`; of a law's own numbers none has a meaning.
        terms: of the arm's model there.
        stages: of the machine.
        visit: number of the stage that has been entered last, and how often it had been.
    """

    def __init__(
        self,
        robot: RobotModel,
        machine: Machine,
        state: tuple[Vector, Vector],
        views: tuple[Vector, Vector, Vector],
    ) -> None:
        """Watches a machine whose arm has a state; q, v and outputs are vectors to write into."""
        self._machine, self.state = machine, state
        self.q, self.v, self.outputs = views
        self.terms = CompiledTerms(robot, self.q, self.v)
        inputs = (machine.now, self.q, self.v, *self.terms.arrays, machine.wrench)
        given = (*inputs, machine.reactions)
        self.stages = [
            ObservedStage(runner, given, machine.handed, self.outputs) for runner in machine.runners
        ]
        self.visit = np.array([-1.0, 0.0])

    def observe(self) -> None:
        """Evaluates the tick that the machine has just made."""
        machine, stage = self._machine, self.stages[self._machine.index]
        self.q[:], self.v[:] = self.state
        self.terms.update()
        visit = machine.index, machine.now[2 + machine.index]
        if visit != (*self.visit,):
            self.visit[:] = visit
            stage.entry.evaluate()
        stage.observe()


class ObservedStage:
    """One stage, on arrays of its own.

    Attributes:
        entry: begins it where the arm truly is.
        tick: evaluates it there.
        memory, next_memory: of it, before a tick and after it.
        own: the parameters that the controller has.
        parameters: those of the tick: what says where the stage began is of `entered`, all others
            are the controller's.
        entered: as the entry made them.
        places: where parameters say where the stage began.
    """

    def __init__(
        self,
        runner: StageRunner,
        inputs: tuple[Vector, ...],
        handed: Vector,
        outputs: Vector,
    ) -> None:
        stage, entry = runner.stage, runner.stage.entry
        self.memory, self.next_memory = np.zeros((2, stage.memory.size))
        self.parameters, self.entered = np.zeros((2, stage.parameters.size))
        self.own = runner.parameters[: len(self.parameters)]
        cubics = np.zeros(entry.function.nnz_out(2))
        given = [*inputs, handed, runner.poses, stage.gains]
        self.entry = BoundFunction(entry.function, given, [self.memory, self.entered, cubics])
        n = len(inputs[1])
        nothing = np.zeros(n), np.zeros(stage.tick.numel_out(3)), np.zeros(n)
        results = [nothing[0], self.next_memory, outputs, *nothing[1:]]
        given = [*inputs, self.memory, self.parameters]
        self.tick = BoundFunction(stage.tick, given, results)
        slots = stage.parameters.slots
        ranges = [range(slots[n].start, slots[n].stop) for n in _PLACES if n in slots]
        self.places = np.array([i for each in ranges for i in each], dtype=np.int64)

    def observe(self) -> None:
        """One tick, with what the controller has of it."""
        self.parameters[:] = self.own
        self.parameters[self.places] = self.entered[self.places]
        self.tick.evaluate()
        self.memory[:] = self.next_memory
