"""MuJoCo's warnings while episodes go on, in however many threads.

Left alone it writes them to a file in the working directory. What listens is the process's, so that
threads share it: the first sets it, and the last one puts back what was there.
"""

from __future__ import annotations

from threading import Lock

import mujoco


class _Hush:
    """A context that any thread may enter while others are in it."""

    def __init__(self) -> None:
        self._lock, self._inside = Lock(), 0

    def __enter__(self) -> None:
        with self._lock:
            if not self._inside:
                self._before = mujoco.get_mju_user_warning()
                mujoco.set_mju_user_warning(_drop)
            self._inside += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._inside -= 1
            if not self._inside:
                mujoco.set_mju_user_warning(self._before)


def _drop(_: str) -> None:
    """What a plant warns of that matters is an alarm of its own."""


HUSH = _Hush()
