"""A task as an environment: what is compiled once, for all episodes and all who run them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from numbers import Real
from pathlib import Path
from threading import Lock

from taskspec.compiler import compile_task
from taskspec.program.worlds import World, draws_of, random_world, true_world
from taskspec.spec import LoadedTask, load_task
from taskspec_runner.errors import InputError
from taskspec_runner.gym.actions import Act, Actions
from taskspec_runner.gym.decisions import breaking
from taskspec_runner.gym.episode import Episode
from taskspec_runner.gym.observations import Observations
from taskspec_runner.gym.rewards import (
    OfFile,
    OfFunction,
    OfMargins,
    RewardFunction,
    Rewarding,
)
from taskspec_runner.gym.true_values import TrueValues
from taskspec_runner.loop.fixed_step import loop_wanted
from taskspec_runner.record.layout import REWARD, reward_rates

#: Plants are built one after the other: they share the arm's models, which have memory.
_BUILDING = Lock()


class Setup:
    """A compiled task with its actions, observations and reward.

    Attributes:
        program: of the task, with its residuals.
        actions, observations: of a step.
        rewarding: gives rewards.
        every: ticks of a step.
        most: ticks of an episode; infinite where nothing but the task ends it.
        worlds: whether every episode is in another random world of `vary`.
        names: of the formulas that are worked out at every tick.
    """

    def __init__(
        self,
        task: str | os.PathLike[str] | LoadedTask,
        act: Act | None,
        observe: Sequence[str] | Mapping[str, int] | None,
        *,
        worlds: bool,
        reward: RewardFunction | None,
        rate: float,
        max_time: float | None,
        decide: bool,
        loop: str | None,
        set: Mapping[str, str] | None,
    ) -> None:
        """Loads and compiles a task; the arguments are those of `taskspec_runner.gym.make`.

        Raises:
            InputError: an argument does not fit the task.
            SpecError: the task is refused.
            OSError: the file cannot be opened.
        """
        loaded = task if isinstance(task, LoadedTask) else load_task(Path(task), set)
        self.actions = Actions(loaded, act)
        self.program = compile_task(self.actions.loaded)
        context = self.program.context
        if worlds and not draws_of(context):
            raise InputError(
                "nothing varies in this task, so that all its worlds are alike: give it a 'vary', "
                "or leave out worlds=True"
            )
        self.worlds, self._loop = worlds, loop_wanted(loop)
        self.every = self._every(rate, context.period)
        self.most = self._most(max_time, context.period)
        longest = self.most * context.period
        self.observations = Observations(self.program, observe, longest)
        declared = self.program.context.loaded.task
        self.rewarding = self._rewarding(reward)
        broken = breaking(declared) if decide else {}
        rates = reward_rates(declared) if isinstance(self.rewarding, OfFile) else {}
        self._broken = tuple(broken)
        self._watched = TrueValues(self.program, (), {**rates, **broken})
        self.rated = REWARD in rates
        self.idle = {name: self.actions.idle(name) for name in declared.stages}

    def _rewarding(self, reward: RewardFunction | None) -> Rewarding:
        said = self.program.context.loaded.task.reward
        if reward is not None:
            if not callable(reward):
                form = "reward=lambda observed, info: -abs(observed['force.z'])"
                raise InputError(f"reward is a function, such as {form}, not {reward!r}")
            return OfFunction(reward)
        return OfMargins() if said is None else OfFile(said)

    @staticmethod
    def _every(rate: float, period: float) -> int:
        _check_number("rate", rate)
        every = 1 / (rate * period) if rate > 0 else math.nan
        if not (every >= 1 and math.isclose(every, round(every), rel_tol=1e-9)):
            most = 1 / period
            raise InputError(
                f"rate: {rate:g} Hz is no whole share of the controller's {most:g} Hz: such as "
                f"{_share_near(rate, most):g}"
            )
        return round(every)

    @staticmethod
    def _most(max_time: float | None, period: float) -> float:
        """Ticks of an episode; infinite where nothing but the task ends it."""
        if max_time is None:
            return math.inf
        _check_number("max_time", max_time)
        if max_time == math.inf:
            return math.inf
        if not max_time >= period / 2:
            tick = f"a tick of the controller takes {period:g} s"
            raise InputError(f"max_time: an episode of {max_time:g} s has no step; {tick}")
        return max(1, round(max_time / period))

    @property
    def step_time(self) -> float:
        """Of a step [s]."""
        return self.every * self.program.context.period

    def world(self, seed: int, number: int) -> World:
        """The world of an episode: that of `taskspec run --seed SEED`, and `--world NUMBER`."""
        context = self.program.context
        return random_world(context, seed, number) if self.worlds else true_world(context, seed)

    def episode(self, world: World, before: Episode | None = None) -> Episode:
        """A run in a world, at its start; `before` is one that is over, and not used any more."""
        with _BUILDING:
            return Episode(
                self.program,
                world,
                self._watched.of(world.task),
                self._broken,
                self.every,
                self.observations.ticks,
                self._loop,
                before,
            )


def _check_number(name: str, value: object) -> None:
    if not isinstance(value, Real):
        raise InputError(f"{name} is a number, not {value!r}")


def _share_near(rate: float, most: float) -> float:
    """The whole share of a rate that is nearest to another one, of those with few digits [Hz]."""
    if not 0 < rate < math.inf:
        return most / 20
    longest = min(max(20, math.ceil(2 * most / rate)), 10_000)
    shares = [most / n for n in range(1, longest + 1)]
    written = [share for share in shares if math.isclose(float(f"{share:g}"), share, rel_tol=1e-9)]
    return min(written, key=lambda share: abs(math.log(share / rate)))
