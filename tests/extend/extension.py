"""What the commands say of tasks in a language that has grown.

Whatever is added to the language is registered before the language is imported, and stays there.
So each module of these tests has a process of its own, in which its `define` is called first:

    python extension.py MODULE FOLDER
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

_ANSWERS = "answers.json"


@dataclass(frozen=True)
class Answer:
    """What a command says and leaves behind.

    Attributes:
        exit_code: of the command.
        text: on standard output and standard error.
        folder: in which its files are.
    """

    exit_code: int
    text: str
    folder: Path

    @property
    def json(self) -> Any:
        """The text as data."""
        return json.loads(self.text)

    def file(self, name: str) -> str:
        """The text of a file that it wrote."""
        return (self.folder / name).read_text(encoding="utf-8")


def column(run: Answer, name: str) -> NDArray[Any]:
    """A column of the log of a run."""
    with pa.memory_map(str(run.folder / "run" / "log.arrow")) as file:
        table = pa.ipc.open_stream(file).read_all()
    return np.asarray(table[name])


def commands(laws: tuple[str, ...]) -> dict[str, list[str]]:
    """Every command by the name of its answer."""
    return {
        "validate": ["validate", "task.yaml"],
        "mistake": ["validate", "wrong.yaml"],
        "explain": ["explain", "task.yaml"],
        "run": ["run", "task.yaml", "--out", "run"],
        "compare": [
            "compare", "task.yaml", "--out", "compare", *(f"--law={law}" for law in laws),
        ],
        "refused": ["run", "wrong.yaml", "--out", "refused"],
        "report": ["report", "run"],
        "schema": ["schema"],
    }  # fmt: skip


def answers(module: Any, folder: Path) -> dict[str, Answer]:
    """Every command's answer with what a module adds to the language.

    Args:
        module: with `define`, which adds it, and the texts `TASK` and `WRONG` that use it; `LAWS`
            are compared. folder: an empty one.
    """
    (folder / "task.yaml").write_text(module.TASK, encoding="utf-8")
    (folder / "wrong.yaml").write_text(module.WRONG, encoding="utf-8")
    script = [sys.executable, __file__, module.__name__, str(folder)]
    done = subprocess.run(script, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    said = json.loads((folder / _ANSWERS).read_text(encoding="utf-8"))
    return {name: Answer(*answer, folder) for name, answer in said.items()}


def _drive(module: Any) -> None:
    module.define()

    from typer.testing import CliRunner

    from taskspec_runner.cli import app

    said = {}
    for name, arguments in commands(module.LAWS).items():
        done = CliRunner().invoke(app, arguments, env={"COLUMNS": "200"})
        said[name] = (done.exit_code, done.output)
    Path(_ANSWERS).write_text(json.dumps(said), encoding="utf-8")


if __name__ == "__main__":
    os.chdir(sys.argv[2])
    _drive(importlib.import_module(sys.argv[1]))
