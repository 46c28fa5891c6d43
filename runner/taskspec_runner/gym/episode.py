"""One episode: a run in a world, stepped by whoever acts on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.program.program import Program
from taskspec.program.worlds import World
from taskspec_runner.gym.hush import HUSH
from taskspec_runner.gym.true_values import Values
from taskspec_runner.loop.assembly import Assembly, assemble
from taskspec_runner.loop.fixed_step import PYTHON, Outcome, Steps
from taskspec_runner.plant.plant import Plant
from taskspec_runner.record.layout import LogLayout
from taskspec_runner.record.rows import RowKeeper
from taskspec_runner.trial.trial import OPEN, Trial

Vector = NDArray[np.float64]

#: Ticks that are collected before they are put aside, at least.
_ROOM = 500


class Episode:
    """A run that goes on by steps, with the ticks of `run`, bit for bit.

    Attributes:
        program, world: of the run.
        decided: expectations that no tick more can change, by their titles: False is missed.
    """

    def __init__(
        self,
        program: Program,
        world: World,
        watched: Values | None,
        broken: tuple[str, ...],
        every: int,
        kept: int,
        loop: str | None = None,
        before: Episode | None = None,
    ) -> None:
        """Builds the plant and enters the first stage; no tick is run.

        Args:
            program: of the task.
            world: that the plant is.
            watched: works out the formulas that are worked out at every tick; None for none.
            broken: those of them that are 1 where an expectation is broken, as `breaking` names
                them.
            every: ticks of a step.
            kept: how many of the newest ticks are shown.
            loop: as `run` has it.
            before: one that is over, whose controller is taken.

        Raises:
            InputError: what the robot holds is where it cannot hold it.
        """
        self.program, self.world = program, world
        self.decided: dict[str, bool] = {}
        self._watched, self._broken = (
            watched,
            {name: int(name.partition(".")[0]) for name in broken},
        )
        self._every, self._kept = every, kept
        with HUSH:
            last = None if before is None else before._parts
            parts = assemble(program, world, before=last)
            self._parts: Assembly[Plant] = parts
            room = every * -(-max(_ROOM, every, kept) // every)
            self._keeper = RowKeeper(parts.bus, room)
            faults = parts.faults
            self._steps = Steps(
                parts.machine,
                parts.plant,
                parts.bus,
                self._keeper,
                program.context.period,
                seed=world.noise_seed,
                # Faults are Python's, whatever loop serves other tasks.
                loop=loop if faults is None else PYTHON,
                faults=faults,
            )
            self._steps.advance(0)
        self._transitions = parts.machine.transitions
        #: The values of the formulas at the ticks of the last step.
        self.watched = np.zeros((0, 0 if watched is None else len(watched.names)))
        self._first = parts.bus.array.copy()

    @property
    def stage(self) -> str:
        """The current one, or that in which it ended."""
        return self._parts.machine.stage.name

    @property
    def ticks(self) -> int:
        """That have been run."""
        return self._steps.ticks

    @property
    def outcome(self) -> Outcome | None:
        """How it ended; None while it goes on."""
        return self._steps.outcome

    def request(self, params: tuple[str, ...], values: Vector) -> None:
        """Sets live params (k,) [SI] from the next tick on."""
        live = self._parts.machine.live
        for name, value in zip(params, values.tolist(), strict=True):
            if value != live.target(name):
                live.set(name, value)

    def advance(self, most: int) -> int:
        """Runs the ticks of a step, at most so many; how many there were."""
        with HUSH:
            done = self._steps.advance(most)
        if self._watched is not None and done:
            self.watched = self._watched(self._keeper.latest(done))
        else:
            self.watched = self.watched[:0]
        return done

    def rows(self) -> Vector:
        """(kept, fields) the newest ticks; before the first as many as there are not repeat it."""
        kept, ticks = self._kept, self.ticks
        if not ticks:
            return np.broadcast_to(self._first, (kept, len(self._first)))
        if ticks >= kept:
            return self._keeper.latest(kept)
        there = self._keeper.latest(ticks)
        return np.vstack([np.broadcast_to(there[0], (kept - ticks, there.shape[1])), there])

    def decide(self) -> bool:
        """Whether an expectation is missed for good, by the last step's ticks or those before."""
        if self._watched is None or not len(self.watched):
            return bool(self.decided)
        names = self._watched.names
        flags = {name for name in self._broken if self.watched[:, names.index(name)].any()}
        judged = self.trial().judged if flags else ()
        for name in flags:
            # What the judge says otherwise of is decided at the end.
            each = judged[self._broken.pop(name)]
            if each.broken is not None and each.broken.final:
                self.decided[each.title] = False
        return bool(self.decided)

    def state(self) -> tuple[float, Vector, list[float], Vector]:
        """Where everything is now, as `DrawnWorld.put` takes it."""
        plant, mechanisms = self._parts.plant, self.world.task.mechanisms
        coordinates = []
        for mechanism, place in zip(
            mechanisms.values(), plant.views.mechanism_positions.tolist(), strict=True
        ):
            coordinates.append(place)
            if mechanism.mechanism == "screw":
                coordinates.append(mechanism.lead * place)
        return self._steps.clock, plant.arm.q, coordinates, plant.views.loose

    def trial(self) -> Trial:
        """The run so far, as one that was made in memory."""
        outcome = self.outcome
        if outcome is None:
            text = f"broken off after {self._steps.clock:.4g} s"
            outcome = Outcome(OPEN, OPEN, text, self.stage, self._steps.clock, self.ticks)
        else:
            outcome = self._steps.finish()
        layout = LogLayout.of(self.program, self.world.task)
        history = self._keeper.history(layout, self.program.stages)
        return Trial(self.program, self.world, outcome, history, tuple(self._transitions))
