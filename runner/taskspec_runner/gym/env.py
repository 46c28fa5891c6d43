"""A task file as an environment of Gymnasium."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from taskspec.spec import LoadedTask
from taskspec_runner.errors import InputError
from taskspec_runner.gym.actions import Act
from taskspec_runner.gym.episode import Episode
from taskspec_runner.gym.observations import ObservedTicks
from taskspec_runner.gym.rewards import FAILED, MISSED, PASSED, STOPPED, RewardFunction, StepEnd
from taskspec_runner.gym.setup import Setup
from taskspec_runner.loop.fixed_step import DONE
from taskspec_runner.loop.fixed_step import FAILED as FAIL
from taskspec_runner.loop.fixed_step import STOPPED as OUT_OF_LIMITS
from taskspec_runner.trial.trial import OPEN, Trial
from taskspec_runner.verdict.judged import Judged

if TYPE_CHECKING:
    from taskspec_runner.gym.pictures import EpisodePictures

Observation = NDArray[np.float32]
_SEEDS = 2**31
#: Along each side of a picture [px]: what graphics without a card draw.
_MOST_PIXELS = 8192


class TaskEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A task whose live params and residuals an agent sets, some ticks at a time.

    Attributes:
        setup: the compiled task with its actions, observations and reward.
        episode: the one under way; None before the first `reset`.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 50}  # noqa: RUF012 - as Gymnasium

    def __init__(
        self,
        task: str | os.PathLike[str] | LoadedTask,
        act: Act | None = None,
        observe: Sequence[str] | Mapping[str, int] | None = None,
        *,
        worlds: bool = False,
        reward: RewardFunction | None = None,
        rate: float = 50.0,
        max_time: float | None = None,
        decide: bool = True,
        render_mode: str | None = None,
        size: tuple[int, int] = (480, 360),
        loop: str | None = None,
        set: Mapping[str, str] | None = None,
        setup: Setup | None = None,
    ) -> None:
        """Compiles a task; the arguments are those of `taskspec_runner.gym.make`.

        Args:
            setup: one that is compiled already, with the arguments up to `decide` and `set`.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"render_mode is 'rgb_array' or None, not {render_mode!r}")
        _check_size(size)
        self.setup = setup or Setup(
            task,
            act,
            observe,
            worlds=worlds,
            reward=reward,
            rate=rate,
            max_time=max_time,
            decide=decide,
            loop=loop,
            set=set,
        )
        self.metadata = {
            **type(self).metadata,
            "render_fps": max(1, round(1 / self.setup.step_time)),
        }
        self.action_space = self.setup.actions.space
        self.observation_space = self.setup.observations.space
        self.render_mode, self._size = render_mode, size
        self.episode: Episode | None = None
        self._observer: ObservedTicks | None = None
        self._pictures: EpisodePictures | None = None
        self._seed: int | None = None
        self._number, self._over = 0, True
        self._seen = np.zeros(self.observation_space.shape, np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode.

        With worlds, the k-th episode after `reset(seed=s)` is that of `taskspec run --seed s
        --world k`; without, the first is that of `taskspec run --seed s`, and those after it have
        seeds that follow from s.

        Args:
            seed: of everything random from here on.
            options: `{"world": 17}` takes that world of the seed.

        Raises:
            InputError: an option is unknown.
        """
        super().reset(seed=seed)
        if not isinstance(options, Mapping | None):
            raise InputError(f"reset: options are a mapping, as {{'world': 3}}, not {options!r}")
        self._draw(seed, dict(options or {}))
        assert self._seed is not None
        world = self.setup.world(self._seed, self._number)
        self.episode = self.setup.episode(world, self.episode)
        self._observer = self.setup.observations.of_world(world.task)
        self._over = False
        self._seen = self._observer(self.episode.rows())
        info = self._info(self.episode)
        info["seed"] = self._seed
        if self.setup.worlds:
            info["world"] = self._number
        return self._seen, info

    def _draw(self, seed: int | None, options: dict[str, Any]) -> None:
        """Decides which world comes next."""
        number = options.pop("world", None)
        if options:
            raise InputError(f"reset has the option 'world' alone, not {', '.join(options)}")
        if number is not None and not self.setup.worlds:
            raise InputError("reset: there is one world, as worlds=True is left out")
        if seed is not None:
            self._seed, self._number = seed, 0
        elif self._seed is None or not self.setup.worlds:
            self._seed, self._number = int(self.np_random.integers(_SEEDS)), 0
        else:
            self._number += 1
        if number is not None:
            if not isinstance(number, Integral) or number < 0:
                raise InputError(f"reset: a world is a whole number from 0 on, not {number!r}")
            self._number = int(number)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Requests an action, and runs the ticks of a step.

        Returns:
            Observation, reward, whether the task is over or an expectation is missed for good,
            whether `max_time` is, and what is known beside.

        Raises:
            InputError: the episode is over, or has not begun; or the action does not fit.
        """
        episode, setup = self.episode, self.setup
        if episode is None or self._observer is None or self._over:
            raise InputError("the episode is over: reset() begins another one")
        # Requests hold from the next tick on.
        episode.request(setup.actions.params, setup.actions.requested(action))
        episode.advance(int(min(setup.every, setup.most - episode.ticks)))
        terminated = episode.outcome is not None or episode.decide()
        truncated = not terminated and episode.ticks >= setup.most
        self._over = terminated or truncated
        self._seen = self._observer(episode.rows())
        info = self._info(episode)
        verdict, judged = "", tuple[Judged, ...]()
        if self._over:
            trial = episode.trial()
            verdict = _verdict(trial) if terminated else ""
            judged = trial.judged
            info |= _end(trial, verdict or OPEN, episode.decided)
        rates = episode.watched[:, 0] if setup.rated else np.zeros(0)
        period = setup.program.context.period
        end = StepEnd(rates, period, verdict, judged, self._observed, info)
        return self._seen, setup.rewarding(end), terminated, truncated, info

    def _observed(self) -> dict[str, float]:
        return dict(zip(self.setup.observations.names, self._seen.tolist(), strict=True))

    def _info(self, episode: Episode) -> dict[str, Any]:
        stage = episode.stage
        info: dict[str, Any] = {
            "stage": stage,
            "clock": episode.ticks * self.setup.program.context.period,
        }
        if self.setup.idle[stage]:
            info["without_effect"] = self.setup.idle[stage]
        if episode.decided:
            info["decided"] = dict(episode.decided)
        return info

    def render(self) -> NDArray[np.uint8] | None:
        """(height, width, 3) the world as it is now; None without a `render_mode`.

        Raises:
            InputError: there is no episode.
            NoCanvasError: there is nothing to draw with.
        """
        if self.render_mode is None:
            return None
        if self.episode is None:
            raise InputError("there is nothing to draw before reset()")
        if self._pictures is None:
            # OpenGL, which nothing else needs.
            from taskspec_runner.gym.pictures import EpisodePictures

            self._pictures = EpisodePictures(self._size)
        return self._pictures.draw(self.episode)

    def close(self) -> None:
        """Gives back what drew."""
        if self._pictures is not None:
            self._pictures.close()
            self._pictures = None


def _check_size(size: tuple[int, int]) -> None:
    whole = isinstance(size, Sequence) and all(isinstance(each, Integral) for each in size)
    if not whole or len(size) != 2 or not all(0 < each <= _MOST_PIXELS for each in size):
        raise InputError(
            f"size is width and height, from 1 to {_MOST_PIXELS} px each, as (480, 360), "
            f"not {size!r}"
        )


def _verdict(trial: Trial) -> str:
    """Passed, missed, failed or stopped, as the table of a sweep has it."""
    if trial.good:
        return PASSED
    ended = {OUT_OF_LIMITS: STOPPED, FAIL: FAILED}
    return ended.get(trial.outcome.status, MISSED)


def _end(trial: Trial, verdict: str, decided: Mapping[str, bool]) -> dict[str, Any]:
    """What is known at the end of an episode; of one that is broken off, what is decided."""
    status, judged = trial.outcome.status, trial.judged
    known: dict[str, bool | None] = {
        e.title: e.passed if status == DONE or (e.missed and status != OPEN) else None
        for e in judged
    }
    return {
        "verdict": verdict,
        "reason": trial.outcome.reason,
        "text": trial.outcome.text,
        "expect": {**known, **decided},
        "margins": {
            e.title: min((m.left for m in e.margins if m.left is not None), default=None)
            for e in judged
        },
    }
