"""One stage of a machine: its functions, bound to the arrays that they read and write."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction
from taskspec.program.execution.choice import Chooser
from taskspec.program.execution.stage_solver import OwnSolver, StageSolver
from taskspec.program.execution.tracks import Tracks
from taskspec.program.last_commands import EARLIER_COMMAND, LAST_COMMAND
from taskspec.program.stages.carried_torque import RATE, STEP, carrying
from taskspec.program.stages.conditions import resting
from taskspec.program.stages.stage import CompiledStage
from taskspec.spec.limits import REACTING

Vector = NDArray[np.float64]


class StageRunner:
    """One stage's functions bound to their arrays; CasADi reads and writes them in place.

    Attributes:
        stage: which.
        tick: its function, on its arrays.
        memory, parameters: of the stage.
        entry: fills both, and the numbers of `tracks`.
        poses: (12 frames,) of the estimated frames that it is placed in.
        leaving: writes what it hands on, by its last outputs.
        tracks: its moves and path.
        chooser: of the coordinates that its constraints decide; None without any.
        least_conditioning: below it they are chosen again.
        solver: what keeps its limits; None without a program.
        carrying: has the torque go on from that of the stage before.
        carried: (1,) how much of it is carried on, of the joint where that is most [N m].
    """

    def __init__(
        self,
        stage: CompiledStage,
        inputs: tuple[Vector, ...],
        handed: Vector,
        torque: Vector,
        last: Vector,
        outputs: Vector,
        own: OwnSolver,
    ) -> None:
        """Binds the functions of a stage that is to be run.

        Args:
            stage: which.
            inputs: of its tick before memory and parameters.
            handed: what is handed from stage to stage, the numbers of `handed_of`.
            torque, outputs: that its tick writes.
            last: (n,) torque of the stage before.
            own: makes the solver that is tried first.
        """
        self.stage, self._torque = stage, torque
        self._reacting = {limit for limit in REACTING if resting(limit) in stage.memory}
        self.memory = np.zeros(max(stage.memory.size, 1))
        self.parameters = np.zeros(max(stage.parameters.size, 1))
        self._next_memory = np.zeros(max(stage.memory.size, 1))
        self._kept, self._next = self.memory.data, self._next_memory.data
        memory = self.memory[: stage.memory.size]
        parameters = self.parameters[: stage.parameters.size]
        next_memory = self._next_memory[: stage.memory.size]
        arguments = [*inputs, memory, parameters]
        handed_over = np.zeros(stage.tick.numel_out(3))
        self._closed_form = np.zeros(len(torque))
        results = [torque, next_memory, outputs, handed_over, self._closed_form]
        self.tick = BoundFunction(stage.tick, arguments, results)
        self.tracks, entry = Tracks(stage, parameters, memory), stage.entry
        self.poses = np.zeros(entry.function.nnz_in(len(inputs) + 1))
        given = [*inputs, handed, self.poses, stage.gains]
        results = [memory, parameters, self.tracks.numbers]
        self.entry = BoundFunction(entry.function, given, results)
        # The run's time is beside the stage's.
        self.leaving = BoundFunction(stage.leaving, [outputs, inputs[0][1:2]], [handed])
        slots = stage.parameters.slots
        self.carried = np.zeros(1)
        self.last_command, self.earlier_command = (
            parameters[slots[name]] if name in slots else None
            for name in (LAST_COMMAND, EARLIER_COMMAND)
        )
        step = *(parameters[slots[name]] for name in (STEP, RATE)), self.carried
        self.carrying = BoundFunction(
            carrying(len(torque), *_fading(stage)), [last, self._closed_form], step
        )
        self.chooser, self.least_conditioning = None, -np.inf
        if stage.choice is not None:
            self.chooser = Chooser(stage.choice, stage.parameters, arguments)
            self.least_conditioning = stage.choice.least
        self.solver: StageSolver | None = None
        if stage.resolution is not None:
            self.solver = StageSolver(
                stage.resolution, slots, arguments, parameters, handed_over, torque, outputs, own
            )

    def renew(self) -> None:
        """Forgets all visits."""
        for array in (self.memory, self.parameters, self._next_memory, self.poses, self.carried):
            array[:] = 0.0
        self.tracks.forget()
        self.tracks.next_knot = np.inf

    def enter(self, poses: Mapping[str, Vector], applied: Vector, earlier: Vector) -> None:
        """Begins the stage from what is handed over.

        Of its set points is taken what contacts cannot return, before its first tick.

        Args:
            poses: (12,) of the estimated frames, by parameter.
            applied: (n,) command of the tick before.
            earlier: (n,) of the one before that.
        """
        self.place(poses)
        self.entry.evaluate()
        self.tracks.begin()
        if self.chooser is not None:
            self.chooser.first()
        before = self._torque.copy()
        self.remember(applied, earlier)
        self.tick.evaluate()
        if self.solver is not None:
            self.solver.settle()
            if self.solver.paring:
                self.tick.evaluate()
        self._torque[:] = before

    def place(self, poses: Mapping[str, Vector]) -> None:
        """Has the entry know the (12,) `poses` of estimated frames, by parameter."""
        for i, name in enumerate(self.stage.entry.poses):
            self.poses[12 * i : 12 * i + 12] = poses[name]

    def group(self) -> None:
        """Groups the instructions of what each tick evaluates."""
        self.tick.group()
        if self.solver is not None:
            self.solver.group()

    def rests(self, t: float) -> dict[str, float]:
        """For how long limits do not count yet [s], by name, at stage time t [s]."""
        if not self._reacting:
            return {}
        slots = self.stage.memory.slots
        ends = {limit: self.memory[slots[resting(limit)]] for limit in self._reacting}
        return {limit: float(end[0]) - t for limit, end in ends.items() if end[0] > t}

    def rest(self, rests: Mapping[str, float]) -> None:
        """Keeps limits from counting for some time [s], by name, from the stage's begin on."""
        for limit in self._reacting & rests.keys():
            self.stage.memory.write(self.memory, resting(limit), rests[limit])

    def answer(self, applied: Vector, earlier: Vector) -> bool:
        """Evaluates a tick and keeps its limits; whether there is a command that may be used.

        Args:
            applied: (n,) command of the tick before.
            earlier: (n,) of the one before that.
        """
        self.remember(applied, earlier)
        if self.solver is None:
            self.tick.evaluate()
            return True
        self.tick.evaluate()
        return self.solver.resolve()

    def remember(self, applied: Vector, earlier: Vector) -> None:
        """Has the next tick and its program know what was commanded in the two before.

        Args:
            applied: (n,) in the tick before.
            earlier: (n,) in the one before that.
        """
        if self.solver is not None:
            self.solver.remember(applied)
        if self.last_command is not None:
            self.last_command[:] = applied
        if self.earlier_command is not None:
            self.earlier_command[:] = earlier

    def carry(self) -> float:
        """Has a new stage's torque go on from that of the last one at this tick.

        What is not finite is not carried.

        Returns:
            What is carried on, of the joint where that is most [N m].
        """
        self.carrying.evaluate()
        return float(self.carried[0])

    def commit(self) -> None:
        """Makes the memory of the last evaluation current."""
        self._kept[:] = self._next

    def refresh(self, t: float) -> None:
        """Renews the cubics that change at stage time t [s]."""
        self.tracks.refresh(t)


def _fading(stage: CompiledStage) -> tuple[float, float]:
    """How fast the command fades that a stage carries on: in its unit by 1 s, by a share of it."""
    context = stage.plan.context
    drives = context.drives
    return drives.fading * (context.period if drives.positions else 1.0), drives.fades
