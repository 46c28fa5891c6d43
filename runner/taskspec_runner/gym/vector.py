"""Several environments of one task at once: over threads of this process, or over processes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.vector.utils import iterate

from taskspec_runner.gym.env import TaskEnv

if TYPE_CHECKING:
    _OneByOne = SyncVectorEnv[Any, Any]
else:
    # It takes no types before Gymnasium 1.3.
    _OneByOne = SyncVectorEnv


class _Ahead(gymnasium.Wrapper[Any, Any, Any, Any]):
    """An environment whose next step or reset is under way before it is requested."""

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        self._next: Future[Any] | None = None

    def begin(self, pool: ThreadPoolExecutor, call: Callable[..., Any], *given: Any) -> None:
        """Has a thread make a call, whose result the next step or reset gives."""
        self._next = pool.submit(call, *given)

    def step(self, action: Any) -> Any:
        """The step that is under way, or one that is made now."""
        return self._taken() or self.env.step(action)

    def reset(self, **given: Any) -> Any:
        """The reset that is under way, or one that is made now."""
        return self._taken() or self.env.reset(**given)

    def _taken(self) -> Any:
        coming, self._next = self._next, None
        return None if coming is None else coming.result()


class ThreadVectorEnv(_OneByOne):
    """Environments of one process that share a compiled task, stepped by threads.

    Ticks are machine code, which leaves Python to the other threads.
    """

    def __init__(
        self,
        envs: Sequence[Callable[[], TaskEnv]],
        threads: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
    ) -> None:
        """Makes the environments; `threads` as many as processors are there where it is None."""
        self._members = [_Ahead(make()) for make in envs]
        made = [partial(_itself, member) for member in self._members]
        super().__init__(made, autoreset_mode=autoreset_mode)
        self._pool = ThreadPoolExecutor(threads, "environment")
        self._ended = np.zeros(self.num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins an episode in each; environment i of a seed has the seed that is i more."""
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed
        mask = None if options is None else options.get("reset_mask")
        for i, env in enumerate(self._members):
            if mask is None or mask[i]:
                own = None if seeds is None else seeds[i]
                rest = {k: v for k, v in (options or {}).items() if k != "reset_mask"}
                env.begin(self._pool, _reset, env.env, own, rest)
        self._ended[mask if mask is not None else slice(None)] = False
        return super().reset(seed=seed, options=options)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """A step of each; of one whose episode was over, a reset, where that is the mode."""
        again = self.autoreset_mode == AutoresetMode.NEXT_STEP
        each = zip(self._members, iterate(self.action_space, actions), self._ended, strict=True)
        for env, action, ended in each:
            if ended and again:
                env.begin(self._pool, env.env.reset)
            else:
                env.begin(self._pool, env.env.step, np.array(action))
        found = super().step(actions)
        self._ended = found[2] | found[3]
        return found

    def close_extras(self, **given: Any) -> None:
        """Ends the threads."""
        self._pool.shutdown()
        super().close_extras(**given)


def _itself(member: _Ahead) -> _Ahead:
    return member


def _reset(env: gymnasium.Env[Any, Any], seed: int | None, options: dict[str, Any]) -> Any:
    return env.reset(seed=seed, options=options or None)
