"""People's xacro files: expanded by the `xacro` package where that is installed."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from taskspec.robot.errors import RobotError
from taskspec.robot.files import note_program, read_part
from taskspec.text.confines import REMEDY, Confines

SUFFIX = ".xacro"

_SECONDS = 30
#: xacro ends the process on some mistakes, and what a file computes may take for ever.
_PROGRAM = """
import contextlib, json, sys
sys.path[:] = json.loads(sys.argv[2])
import xacro
xacro.all_includes.clear()
with contextlib.redirect_stdout(sys.stderr):
    document = xacro.parse(None, sys.argv[1])
    xacro.process_doc(document)
json.dump({"text": document.toxml(), "files": xacro.all_includes}, sys.stdout)
"""


def expanded(path: Path, shown: str, confines: Confines) -> str:
    """The URDF text that a xacro file stands for.

    Args:
        path: Where it is.
        shown: How the user wrote it.
        confines: Where it and what it includes may lie.

    Raises:
        RobotError: TS402 when the package is not installed or cannot expand it, TS409 when it
            includes a file from elsewhere.
    """
    if find_spec("xacro") is None:
        raise RobotError(
            "TS402",
            f"'{shown}' is xacro, and the package that expands it is not installed",
            "install it: pip install xacro; or expand the file yourself: xacro "
            f"{Path(shown).name} > {Path(shown).name.partition('.')[0]}.urdf",
        )
    note_program()
    command = [sys.executable, "-c", _PROGRAM, str(path.resolve()), json.dumps(sys.path)]
    try:
        done = subprocess.run(
            command, capture_output=True, timeout=_SECONDS, cwd=path.parent, check=False
        )
    except subprocess.TimeoutExpired:
        raise RobotError(
            "TS402", f"'{shown}' is not expanded after {_SECONDS} s", "expand it yourself"
        ) from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines() or ["no reason given"]
        reason = said[-1].strip()
        raise RobotError(
            "TS402",
            f"xacro cannot expand '{shown}': {reason[:200]}",
            "packages that it looks for are those of ROS: expand it where they are installed"
            if "find" in reason or "ackage" in reason
            else "",
        )
    found = json.loads(done.stdout)
    for name in found["files"]:
        included = path.parent / name
        if not confines.hold(included):
            raise RobotError(
                "TS409", f"'{shown}' includes '{name}' from outside of the task's project", REMEDY
            )
        read_part(included, name)
    text: str = found["text"]
    return text
