"""Writes, validates and runs a first task for each robot that nobody here wrote.

    python campaigns/first_tasks.py --packages runs/foreign --page docs/robots.md

The robots are those of `foreign_robots.yaml`; `make foreign` puts their packages into that folder.
A robot loads with at most the one line of help that stands there.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from foreign_robots import ROOT, load_listed, packages

from taskspec.compiler import admit
from taskspec.examination import examine
from taskspec.robot import RobotError
from taskspec.spec import load_task
from taskspec.text.confines import VARIABLE
from taskspec_runner.cli.first_task import first_task
from taskspec_runner.errors import InputError
from taskspec_runner.session import execute_program

#: Of all listed robots so many load, and so many that have masses wipe.
LOADED, WIPED = 36, 30
_START, _END = "<!-- table: first tasks -->", "<!-- end of table -->"


def row(root: Path, name: str, robot: dict[str, Any]) -> dict[str, str]:
    """What becomes of one robot: its joints, the help it took, and how its first task ended."""
    found = {"name": name, "help": "", "joints": "", "flange": "", "loads": "", "wipes": ""}
    if "flange" in robot:
        found["help"] = f"flange: {robot['flange']}"
    try:
        loaded = load_listed(root, robot)
    except RobotError as error:
        found["loads"] = f"{error.code}: {error.message}"
        return found
    found |= {"joints": str(len(loaded.joint_names)), "flange": loaded.flange, "loads": "yes"}
    if robot.get("weightless"):
        found["wipes"] = "weightless"
        return found
    with tempfile.TemporaryDirectory(dir=root) as folder:
        target = Path(folder) / "first.yaml"
        try:
            first_task(str(root / robot["file"]), target, robot.get("flange"))
            program = admit(examine(load_task(target)))
        except InputError as error:
            found["wipes"] = str(error)
            return found
        run = execute_program(program, Path(folder) / "run", report=False)
        found["wipes"] = "passes" if run.exit_code == 0 else "fails"
    return found


def main(arguments: list[str] | None = None) -> int:
    """Prints a line for each robot; 1 where fewer load or wipe than promised."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--packages", type=Path, default=ROOT / "runs" / "foreign")
    parser.add_argument("--only", nargs="*", default=(), help="names of robots")
    parser.add_argument("--page", type=Path, help="write the table there")
    options = parser.parse_args(arguments)
    folder = options.packages.resolve()
    os.environ[VARIABLE] = str(folder)
    sys.path.append(str(folder))
    rows = []
    for package in packages().values():
        for name, robot in package["robots"].items():
            if options.only and name not in options.only:
                continue
            began = time.monotonic()
            rows.append(row(folder / package["root"], name, robot))
            line = "  ".join(rows[-1].values())
            sys.stdout.write(f"{line}  ({time.monotonic() - began:.0f} s)\n")
            sys.stdout.flush()
    loaded = sum(each["loads"] == "yes" for each in rows)
    wiped = sum(each["wipes"] == "passes" for each in rows)
    sys.stdout.write(f"{loaded} of {len(rows)} load, {wiped} wipe\n")
    if options.page:
        write(options.page, rows)
    return int(not options.only and (loaded < LOADED or wiped < WIPED))


def write(page: Path, rows: list[dict[str, str]]) -> None:
    """Puts the table of all robots into a page."""
    text = page.read_text("utf-8")
    head, rest = text.split(_START)
    tail = rest.split(_END)[1]
    keys = {
        "name": "robot",
        "joints": "joints",
        "flange": "flange",
        "help": "help it takes",
        "loads": "loads",
        "wipes": "first task",
    }
    loaded = sum(each["loads"] == "yes" for each in rows)
    wiped = sum(each["wipes"] == "passes" for each in rows)
    lines = [
        f"{loaded} of {len(rows)} load; {wiped} wipe.",
        "",
        f"| {' | '.join(keys.values())} |",
        f"|{' --- |' * len(keys)}",
        *(f"| {' | '.join(each[key] for key in keys)} |" for each in rows),
    ]
    page.write_text(f"{head}{_START}\n" + "\n".join(lines) + f"\n{_END}{tail}", "utf-8")


if __name__ == "__main__":
    sys.exit(main())
