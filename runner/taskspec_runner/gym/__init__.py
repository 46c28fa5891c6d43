"""Task files as environments of Gymnasium: `make` one, `make_vec` several at once.

`gymnasium.make("taskspec/Task-v0", task="task.yaml")` is the same where this package is imported,
and `gymnasium.make("taskspec_runner.gym:taskspec/Task-v0", task="task.yaml")` anywhere.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal

from taskspec.missing import require

require("gymnasium", "an environment for learning")

import gymnasium  # noqa: E402

from taskspec_runner.errors import InputError  # noqa: E402

if TYPE_CHECKING:
    import os

    from gymnasium.vector import AutoresetMode, VectorEnv

    from taskspec.spec import LoadedTask
    from taskspec_runner.gym.env import TaskEnv
    from taskspec_runner.gym.rewards import RewardFunction

__all__ = ["ID", "make", "make_vec"]

ID = "taskspec/Task-v0"
"""What it is registered as."""


def make(
    task: str | os.PathLike[str] | LoadedTask,
    act: Sequence[str] | Mapping[str, Any] | None = None,
    observe: Sequence[str] | Mapping[str, int] | None = None,
    *,
    worlds: bool = False,
    reward: RewardFunction | None = None,
    rate: float = 50.0,
    max_time: float | None = None,
    decide: bool = True,
    render_mode: Literal["rgb_array"] | None = None,
    size: tuple[int, int] = (480, 360),
    loop: Literal["native", "python"] | None = None,
    set: Mapping[str, str] | None = None,
) -> TaskEnv:
    """An environment of a task: actions from -1 to 1, of which 0 is what the file does by itself.

    Args:
        task: a file, or what `taskspec.load` makes of it.
        act: what is acted on. Names of live params, or a mapping: of such a name to True, of the
            name of an axis to what is added to it, as `{"z": "force +- 5 N"}`; to a list of such.
            With `at 50 N/s` behind it that goes no faster. None for all live params.
        observe: names of signals, as guards have them, with `.ref` behind them their references,
            with `.true` as they truly are. A bare name means all components, `joint.position` all
            joints, `param` all live params, `stage` one number for each stage. A mapping says
            how many of the newest ticks of each. None for force, motion, live params, stage, t.
        worlds: whether every episode is in another random world of `vary`.
        reward: of what is observed, by name, and of `info`; None for `reward` of the file, or at
            the end the least margin of its expectations.
        rate: of steps [Hz].
        max_time: that truncates an episode [s]; None where the task itself comes to an end.
        decide: whether an expectation that is missed for good ends an episode.
        render_mode: `rgb_array` for pictures.
        size: of pictures [px].
        loop: as `run` has it.
        set: overrides, as `taskspec.load` has them.

    Raises:
        InputError: an argument does not fit the task.
        MissingLibraryError: gymnasium is not installed.
        SpecError: the task is refused.
        OSError: the file cannot be opened.
    """
    from taskspec_runner.gym.env import TaskEnv

    return TaskEnv(
        task,
        act,
        observe,
        worlds=worlds,
        reward=reward,
        rate=rate,
        max_time=max_time,
        decide=decide,
        render_mode=render_mode,
        size=size,
        loop=loop,
        set=set,
    )


def make_vec(
    task: str | os.PathLike[str] | LoadedTask,
    num_envs: int = 1,
    *,
    workers: Literal["threads", "processes"] = "threads",
    threads: int | None = None,
    autoreset_mode: str | AutoresetMode = "NextStep",
    **given: Any,
) -> VectorEnv[Any, Any, Any]:
    """Several environments of a task at once.

    Environment i of `reset(seed=s)` has the episodes of one with the seed s + i, whatever runs it.

    Args:
        task: as `make` has it; of processes a file.
        num_envs: how many.
        workers: threads of this process, which share the compiled task, or processes.
        threads: how many of them; None for as many as there are processors.
        autoreset_mode: of Gymnasium.
        given: the other arguments of `make`.

    Raises:
        InputError: an argument does not fit, here or as `make` has it.
    """
    if not isinstance(num_envs, Integral) or num_envs < 1:
        raise InputError(f"num_envs: there is one environment or more, not {num_envs!r}")
    if workers not in ("threads", "processes"):
        raise InputError(f"workers are 'threads' or 'processes', not {workers!r}")
    if threads is not None and threads < 1:
        raise InputError(f"threads: there is one or more, not {threads!r}")
    if workers == "processes":
        from gymnasium.vector import AsyncVectorEnv

        envs = [partial(make, task, **given) for _ in range(num_envs)]
        # A process that was forked would share threads and locks with this one.
        return AsyncVectorEnv(envs, context="spawn", autoreset_mode=autoreset_mode)
    from taskspec_runner.gym.env import TaskEnv
    from taskspec_runner.gym.vector import ThreadVectorEnv

    first = make(task, **given)
    own = {key: given[key] for key in ("render_mode", "size") if key in given}
    others = [partial(TaskEnv, task, setup=first.setup, **own) for _ in range(1, num_envs)]
    return ThreadVectorEnv([lambda: first, *others], threads, autoreset_mode)


gymnasium.register(
    ID,
    entry_point="taskspec_runner.gym:make",
    vector_entry_point="taskspec_runner.gym:make_vec",
    disable_env_checker=True,
)
