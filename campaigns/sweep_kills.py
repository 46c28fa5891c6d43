"""Kills of a sweep, of one of its processes and of all of it: afterwards the table is the same.

    python campaigns/sweep_kills.py --moments 20 --table docs/faults.md

A moment is a number of rows that the journal has, from none to all of them: the first one is before
the first world has been run, the last one while the table and the page are made. A sweep whose
process was killed goes on by itself; one that was killed itself is continued by the same command.
The exit code is 1 if a table differs, a row was lost, or a process was left over.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from taskspec_runner.sweep.folder import JOURNAL, TABLE

TASK = """taskspec: 1
name: tap
robot: {model: planar3, start: {xyz: [500 mm, 300 mm, 0]}}
world: {wall: {shape: plane, xyz: [520 mm, 0, 0], rpy: [0, -90 deg, 0]}}
frame: wall
stages:
  touch: {axes: {z: {velocity: -40 mm/s}}, until: force.z < -2 N, within: 0.6 s}
  press: {axes: {z: {force: -10 N}}, time: 0.1 s}
vary: {world.wall.stiffness: 1..100 kN/m, world.wall.xyz: [normal(1 mm), 0, 0]}
expect: [max(norm(force)) < 12 N]
"""
WORLDS, JOBS = 20, 2
#: A moment that does not come within this time never does [s].
_PATIENCE = 300.0
_MARK = "<!-- table: kills -->"


@dataclass
class Tally:
    """What came of one kind of kill."""

    what: str
    tried: int = 0
    failures: list[str] = field(default_factory=list)

    @property
    def row(self) -> str:
        """Of the table."""
        return f"| {self.what} | {self.tried} | {self.tried - len(self.failures)} |"


def main() -> None:
    """Kills sweeps at all moments and writes the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--moments", type=int, default=20)
    options.add_argument("--table", type=Path)
    given = options.parse_args()
    tallies = campaign(given.moments)
    lines = [
        "| SIGKILL | moments | same table, no row lost |",
        "| --- | --- | --- |",
        *(tally.row for tally in tallies),
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    failures = [failure for tally in tallies for failure in tally.failures]
    sys.stdout.write("".join(f"{failure}\n" for failure in failures))
    if given.table is not None:
        before, _, after = given.table.read_text(encoding="utf-8").split(_MARK)
        table = "\n".join(lines)
        given.table.write_text(f"{before}{_MARK}\n{table}\n{_MARK}{after}", encoding="utf-8")
    sys.exit(bool(failures))


def campaign(moments: int) -> list[Tally]:
    """Both kinds of kills at so many moments each."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "tap.yaml").write_text(TASK, encoding="utf-8")
        _run(folder, "whole")
        whole = (folder / "whole" / TABLE).read_bytes()
        tallies = [Tally("of a process that runs worlds"), Tally("of the whole sweep")]
        for tally, kill in zip(tallies, (_kill_worker, _kill_all), strict=True):
            for moment in range(moments):
                rows = round(moment * WORLDS / max(moments - 1, 1))
                out = f"{tally.what.replace(' ', '-')}-{moment}"
                tally.tried += 1
                failure = kill(folder, out, rows)
                if not failure and (folder / out / TABLE).read_bytes() != whole:
                    failure = "another table"
                if failure:
                    tally.failures.append(f"{tally.what} at {rows} rows: {failure}")
                sys.stderr.write(f"{tally.what} at {rows} rows: {failure or 'survived'}\n")
        return tallies


def _kill_worker(folder: Path, out: str, rows: int) -> str:
    """What goes wrong with a sweep that loses one of its processes."""
    sweeping = subprocess.Popen(_command(folder, out), stdout=subprocess.PIPE, text=True)
    _until(lambda: bool(_workers(sweeping.pid)) and _rows(folder / out) >= rows, sweeping)
    for worker in _workers(sweeping.pid)[:1]:
        os.kill(worker, signal.SIGKILL)
    text, _ = sweeping.communicate(timeout=_PATIENCE)
    lines = (folder / out / JOURNAL).read_bytes().splitlines()
    if sweeping.returncode not in (0, 1):
        return f"{sweeping.returncode}: {text}"
    return "" if len(lines) == WORLDS else f"{len(lines)} rows"


def _kill_all(folder: Path, out: str, rows: int) -> str:
    """What goes wrong with a sweep that is killed and continued."""
    sweeping = subprocess.Popen(_command(folder, out), stdout=subprocess.DEVNULL)
    _until(lambda: bool(_workers(sweeping.pid)) and _rows(folder / out) >= rows, sweeping)
    workers = _workers(sweeping.pid)
    sweeping.kill()
    sweeping.wait()
    had = _rows(folder / out)
    # Its processes end by themselves.
    _until(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers), None)
    ran = _run(folder, out)
    found = re.search(r"(\d+) worlds? w\w+ there already", ran.stdout)
    there = int(found.group(1)) if found else 0
    if ran.returncode not in (0, 1):
        return f"{ran.returncode}: {ran.stdout}{ran.stderr}"
    return "" if there == had else f"{had} rows were there, {there} were taken"


def _command(folder: Path, out: str) -> list[str]:
    command = [sys.executable, "-m", "taskspec_runner", "sweep", str(folder / "tap.yaml")]
    return [
        *command,
        "--out",
        str(folder / out),
        "-j",
        str(JOBS),
        "--worlds",
        str(WORLDS),
        "--keep",
        "none",
    ]


def _run(folder: Path, out: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(_command(folder, out), check=False, capture_output=True, text=True)


def _rows(out: Path) -> int:
    """Whole rows of a journal."""
    try:
        return (out / JOURNAL).read_bytes().count(b"\n")
    except FileNotFoundError:
        return 0


def _workers(pid: int) -> list[int]:
    """Processes of a sweep that run worlds, or are about to."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            try:
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                line = (entry / "cmdline").read_bytes()
            except OSError:
                continue
            if int(fields[1]) == pid and b"spawn_main" in line:
                found.append(int(entry.name))
    return sorted(found)


def _until(found: Callable[[], bool], process: subprocess.Popen[str] | None) -> None:
    began = time.monotonic()
    while not found() and (process is None or process.poll() is None):
        if time.monotonic() - began > _PATIENCE:
            raise TimeoutError("the moment does not come")
        time.sleep(0.01)


if __name__ == "__main__":
    main()
