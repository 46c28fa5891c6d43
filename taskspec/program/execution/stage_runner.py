"""One stage of a machine: its function, bound to the arrays that it reads and writes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction
from taskspec.program.execution import entry
from taskspec.program.execution.stage_solver import OwnSolver, StageSolver
from taskspec.program.execution.tracks import Tracks
from taskspec.program.stages import carried_torque
from taskspec.program.stages.stage import CompiledStage

Vector = NDArray[np.float64]


class StageRunner:
    """One stage's function bound to its arrays; CasADi reads and writes them in place.

    Attributes:
        stage: which.
        tick: its function, on its arrays; `evaluate` evaluates it.
        memory, parameters: of the stage.
        tracks: its moves and path; `next_knot` is the stage time at which one changes [s].
        least_conditioning: below it the coordinates of constraints are chosen again.
        solver: what keeps its limits; None without a program.
    """

    def __init__(
        self,
        stage: CompiledStage,
        inputs: tuple[Vector, ...],
        torque: Vector,
        outputs: Vector,
        own: OwnSolver,
    ) -> None:
        self.stage, self._torque = stage, torque
        self.memory = np.zeros(max(stage.memory.size, 1))
        self.parameters = np.zeros(max(stage.parameters.size, 1))
        self._next_memory = np.zeros(max(stage.memory.size, 1))
        self.tracks = Tracks()
        self.least_conditioning = -np.inf if stage.choice is None else stage.choice.least
        memory = self.memory[: stage.memory.size]
        parameters = self.parameters[: stage.parameters.size]
        next_memory = self._next_memory[: stage.memory.size]
        arguments = [*inputs, memory, parameters]
        handed_over = np.zeros(stage.tick.numel_out(3))
        results = [torque, next_memory, outputs, handed_over]
        self.tick = BoundFunction(stage.tick, arguments, results)
        self._arguments = arguments
        self.evaluate = self.tick.evaluate
        self.solver: StageSolver | None = None
        if stage.resolution is not None:
            slots = stage.parameters.slots
            self.solver = StageSolver(
                stage.resolution, slots, arguments, parameters, handed_over, torque, outputs, own
            )

    def load(self, entered: entry.Entered) -> None:
        """Starts the stage with the numbers of its entry."""
        size = self.stage
        self.memory[: size.memory.size] = entered.memory
        self.parameters[: size.parameters.size] = entered.parameters
        self.tracks = entered.tracks
        self.next_knot = self.tracks.next_knot

    def answer(self, applied: Vector) -> bool:
        """Evaluates a tick and keeps its limits; whether there is a torque that may be used.

        Args:
            applied: (n,) torque of the tick before [N m].
        """
        if self.solver is None:
            self.evaluate()
            return True
        self.solver.remember(applied)
        self.evaluate()
        return self.solver.resolve()

    def settle(self) -> None:
        """Takes from a new stage what contacts cannot return, before its first tick."""
        if self.solver is None:
            return
        before = self._torque.copy()
        self.evaluate()
        self.solver.settle()
        self._torque[:] = before

    def carry(self, torque: Vector) -> float:
        """Has a new stage's torque go on from the (n,) `torque` of the last one at this tick.

        Returns:
            What is carried on, of the joint where that is most [N m].
        """
        closed_form = np.array(self.stage.closed_form(*self._arguments)).ravel()
        return carried_torque.carry(self.stage.parameters, self.parameters, torque - closed_form)

    def commit(self) -> None:
        """Makes the memory of the last evaluation current."""
        self.memory[:] = self._next_memory

    def refresh(self, t: float) -> None:
        """Renews the cubics that change at stage time t [s]."""
        self.tracks.refresh(self.stage, self.parameters, t)
        self.next_knot = self.tracks.next_knot
