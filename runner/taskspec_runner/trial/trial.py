"""One run of a program in a world, in memory: the same plant, loop, noise and judging as `run`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

from taskspec.program import events
from taskspec.program.execution.machine import Machine
from taskspec.program.execution.transition import Transition
from taskspec.program.program import Program
from taskspec.program.worlds import World, true_world
from taskspec.robot.description import listening
from taskspec_runner import exit_codes
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.fixed_step import DONE, PYTHON, Outcome
from taskspec_runner.loop.fixed_step import run as simulate
from taskspec_runner.record.history import History
from taskspec_runner.record.layout import LogLayout
from taskspec_runner.record.rows import RowKeeper
from taskspec_runner.verdict.findings import findings
from taskspec_runner.verdict.judge import judge_run
from taskspec_runner.verdict.judged import Judged
from taskspec_runner.verdict.run_finding import RunFinding
from taskspec_runner.verdict.summary import exit_code

#: Status of a trial that its bound on ticks ended.
OPEN = "open"
#: Limits of the file and of the robot's controller, beyond which the arm can still go on.
PASSABLE = frozenset({"force", "torque", "speed", "deviation", "protection"})
#: So many limits are passed at most: what comes after more of them says little about the file.
MOST_PASSED = 3


class _BoundReachedError(Exception):
    """A trial has come to its bound on ticks."""


class Trial:
    """What a program came to in a world.

    Attributes:
        program: that ran.
        world: that the plant was.
        outcome: how it ended; its status is `OPEN` where the bound on ticks ended it.
        history: every tick, true signals and measured ones, as a log has them.
        transitions: the stages that ended, in order.
    """

    def __init__(
        self,
        program: Program,
        world: World,
        outcome: Outcome,
        history: History,
        transitions: tuple[Transition, ...],
    ) -> None:
        self.program, self.world, self.outcome = program, world, outcome
        self.history, self.transitions = history, transitions

    @cached_property
    def judged(self) -> tuple[Judged, ...]:
        """The expectations of the task, judged on all ticks."""
        return judge_run(self.program, self.history, self.world.task)

    @cached_property
    def findings(self) -> tuple[RunFinding, ...]:
        """Oscillations and saturations."""
        return findings(self.program, self.history, self.world.task)

    @property
    def faults(self) -> tuple[RunFinding, ...]:
        """The findings that no stage allows."""
        return tuple(each for each in self.findings if not each.allowed)

    @property
    def exit_code(self) -> int:
        """That `run` would end with."""
        return exit_code(self.outcome, self.judged, 0, self.findings)

    @property
    def good(self) -> bool:
        """Whether it came to `end` with all expectations met and nothing found."""
        return self.exit_code == exit_codes.WELL

    @property
    def limit(self) -> str:
        """The name of the limit that stopped it; empty where none did."""
        last = self.transitions[-1] if self.transitions else None
        stopped = last is not None and last.kind == events.LIMIT and not last.to
        return last.name if stopped and last is not None else ""


def trial(
    program: Program,
    world: World | None = None,
    loop: str | None = None,
    ticks: int | None = None,
    over: Callable[[], bool] = lambda: False,
) -> Trial:
    """Runs a program in a world to its end, and keeps its ticks in memory.

    Args:
        program: the compiled task.
        world: that the plant is, and the seed of everything random; None for the true one of the
            file under the seed that a run has by default.
        loop: `native` or `python`, None for what there is.
        ticks: after which it is broken off; None for no bound.
        over: whether it is to be broken off now.

    Raises:
        InputError: what the robot holds is where it cannot hold it.
    """
    context = program.context
    world = true_world(context) if world is None else world
    parts = assemble(program, world)
    machine, keeper = parts.machine, RowKeeper(parts.bus)
    last_clock = 0.0

    def watch(_: Machine, clock: float) -> None:
        nonlocal last_clock
        last_clock = clock
        if over() or (ticks is not None and clock >= ticks * context.period):
            raise _BoundReachedError

    try:
        with listening([]):
            outcome = simulate(
                machine,
                parts.plant,
                parts.bus,
                keeper,
                context.period,
                watch,
                world.noise_seed,
                # Faults are Python's, whatever loop serves other tasks.
                loop if parts.faults is None else PYTHON,
                faults=parts.faults,
            )
    except _BoundReachedError:
        text = f"broken off after {last_clock:.4g} s"
        made = round(last_clock / context.period)
        outcome = Outcome(OPEN, OPEN, text, machine.stage.name, last_clock, made)
    history = keeper.history(LogLayout.of(program, world.task), program.stages)
    return Trial(program, world, outcome, history, tuple(machine.transitions))


def trials_past_limits(
    program: Program, world: World | None, ticks: int, over: Callable[[], bool] = lambda: False
) -> tuple[Trial, ...]:
    """A trial, and as long as a limit of the file stops it another one that passes this limit.

    In each the ticks up to the limit are those of the one before. A run has the first of them.

    Args:
        program: the compiled task.
        world: as `trial` has it.
        ticks: after which each is broken off.
        over: whether one is to be broken off now, and none is to follow.

    Returns:
        At least one, at most `MOST_PASSED` more.

    Raises:
        InputError: what the robot holds is where it cannot hold it.
    """
    found = [trial(program, world, ticks=ticks, over=over)]
    while found[-1].limit in PASSABLE and len(found) <= MOST_PASSED and not over():
        last = found[-1]
        program = last.program.past(last.outcome.stage, last.limit)
        found.append(trial(program, world, ticks=ticks, over=over))
    return tuple(found)


__all__ = ["DONE", "OPEN", "Trial", "trial", "trials_past_limits"]
