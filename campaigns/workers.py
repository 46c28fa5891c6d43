"""Processes that take one file after another: one that kills its process costs only itself."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

#: An order, or what came of it: as JSON, one line.
Data = Mapping[str, Any]


class Worker:
    """A process that answers orders with the taskspec of a folder; one that dies begins anew."""

    def __init__(self, script: Path, checkout: Path, lost: float) -> None:
        """A worker that has not begun.

        Args:
            script: run with `--worker`; it calls `serve`.
            checkout: whose `taskspec` and `taskspec_runner` it imports.
            lost: after which an order is given up as hanging [s].
        """
        self._script, self._checkout, self._lost = script, checkout, lost
        self._process: subprocess.Popen[str] | None = None

    def ask(self, order: Data) -> dict[str, Any] | str:
        """What comes of an order, or what the process died of."""
        if self._process is None or self._process.poll() is not None:
            self._process = self._started()
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        late = threading.Timer(self._lost, process.kill)
        late.start()
        try:
            process.stdin.write(json.dumps(order) + "\n")
            process.stdin.flush()
            line = process.stdout.readline()
        except BrokenPipeError:
            line = ""
        finally:
            late.cancel()
        if line:
            return dict(json.loads(line))
        return f"the process died with {process.wait()}"

    def _started(self) -> subprocess.Popen[str]:
        paths = (self._checkout, self._checkout / "runner")
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(map(str, paths)),
            "OPENBLAS_NUM_THREADS": "1",
            "OMP_NUM_THREADS": "1",
            "MUJOCO_GL": "disable",
        }
        return subprocess.Popen(
            [sys.executable, str(self._script.resolve()), "--worker"],
            env=environment,
            cwd=self._checkout,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def close(self) -> None:
        """Ends the process."""
        if self._process is not None:
            assert self._process.stdin is not None
            with contextlib.suppress(BrokenPipeError):
                self._process.stdin.close()
            self._process.wait()


def serve(answer: Callable[[dict[str, Any]], Data]) -> None:
    """Answers the orders of a `Worker` until there are no more.

    Raises:
        SystemExit: the `taskspec` that is imported is not of the folder it was started in.
    """
    import taskspec

    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    if not Path(taskspec.__file__).is_relative_to(Path.cwd()):
        raise SystemExit(f"{taskspec.__file__} is not of {Path.cwd()}")
    for line in sys.stdin:
        answers.write(json.dumps(answer(json.loads(line))) + "\n")
