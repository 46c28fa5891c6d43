"""Outputs of a machine's stages for the true state of the arm."""

from __future__ import annotations

from collections.abc import Mapping

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
        q, v: (n,) to be written before `observe`.
        outputs: the numbers of `ports.fields`; of a law's own numbers none has a meaning.
    """

    def __init__(self, robot: RobotModel, machine: Machine, outputs: Vector) -> None:
        """Watches a machine; `outputs` is a vector to write into."""
        self._machine, self.outputs = machine, outputs
        self._terms = CompiledTerms(robot)
        self.q, self.v = self._terms.q, self._terms.v
        inputs = (machine.now, self.q, self.v, *self._terms.arrays, machine.wrench)
        given = (*inputs, machine.reactions)
        self._stages = [
            _Observed(runner, given, machine.handed, outputs) for runner in machine.runners
        ]
        self._visit = (-1, 0.0)

    def observe(self) -> None:
        """Evaluates the tick that the machine has just made."""
        machine, stage = self._machine, self._stages[self._machine.index]
        self._terms.update()
        visit = machine.index, float(machine.now[2 + machine.index])
        if visit != self._visit:
            self._visit = visit
            stage.enter(machine.estimation.poses)
        stage.tick()


class _Observed:
    """One stage, on arrays of its own."""

    def __init__(
        self,
        runner: StageRunner,
        inputs: tuple[Vector, ...],
        handed: Vector,
        outputs: Vector,
    ) -> None:
        stage = runner.stage
        self._runner, entry = runner, stage.entry
        self._memory, self._next = np.zeros((2, stage.memory.size))
        self._parameters, self._entered = np.zeros((2, stage.parameters.size))
        self._poses = np.zeros(12 * len(entry.poses))
        cubics = np.zeros(entry.function.nnz_out(2))
        given = [*inputs, handed, self._poses, stage.gains]
        self._entry = BoundFunction(entry.function, given, [self._memory, self._entered, cubics])
        n = len(inputs[1])
        results = [np.zeros(n), self._next, outputs, np.zeros(stage.tick.numel_out(3)), np.zeros(n)]
        given = [*inputs, self._memory, self._parameters]
        self._tick = BoundFunction(stage.tick, given, results)
        slots = stage.parameters.slots
        self._places = [slots[name] for name in _PLACES if name in slots]

    def enter(self, poses: Mapping[str, Vector]) -> None:
        """Begins the stage where the arm truly is."""
        for i, name in enumerate(self._runner.stage.entry.poses):
            self._poses[12 * i : 12 * i + 12] = poses[name]
        self._entry.evaluate()

    def tick(self) -> None:
        """One tick, with what the controller has of it."""
        own = self._runner.parameters[: len(self._parameters)]
        self._parameters[:] = own
        for where in self._places:
            self._parameters[where] = self._entered[where]
        self._tick.evaluate()
        self._memory[:] = self._next
