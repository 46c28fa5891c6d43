"""Kills, locks, full disks and spoiled folders: how many of each a run's folder survives.

    python campaigns/faults.py --corruptions 10000 --table docs/faults.md

The exit code is 1 if something did not survive.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import mmap
import multiprocessing
import os
import random
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "disable")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "runner"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "link"))

import numpy as np
from corruptions import BYTES, PLACES, SEALED, Answer, answer
from cut_logs import TASKS
from cut_logs import cuts as log_cuts
from short_tasks import TAP
from strange_robots import a_welcome, stamps
from typer.testing import CliRunner

from taskspec.compiler import compile_task
from taskspec.program.program import Program
from taskspec.spec import load_text
from taskspec_runner.cli import app
from taskspec_runner.errors import OutputError
from taskspec_runner.loop.fixed_step import NATIVE, PYTHON
from taskspec_runner.record.log import read_log
from taskspec_runner.record.recorder import BATCH, Recorder
from taskspec_runner.record.whole import PARTIAL
from taskspec_runner.result import RunResult
from taskspec_runner.runs import Run
from taskspec_runner.session import execute_program

#: Goes on until it is ended; comes to its end after three batches.
LONG = TAP.replace("time: 0.3 s", "time: 36000 s")
SHORT = TAP.replace("time: 0.3 s", "time: 1.2 s")
#: Corruptions that one process takes at a time; seconds after which it hangs in C.
CHUNK, LOST = 20, 600
#: What varies in a sweep; and what a column map may say of a log.
VARY = "vary: {world.wall.stiffness: 5..20 kN/m}\n"
MAP = "signals: {force.x: {column: force.x, unit: N, sign: 1}}\ngap: 20 ms\n"
MARK = "<!-- table: faults -->"


@dataclass
class Tally:
    """What came of one kind of fault.

    Attributes:
        what: the kind, and what counts as surviving it.
        tried: how often.
        failures: what did not survive, a line each.
        lost: in words.
    """

    what: str
    tried: int = 0
    failures: list[str] = field(default_factory=list)
    lost: str = "-"

    @property
    def row(self) -> str:
        """Of the table."""
        return f"| {self.what} | {self.tried} | {self.tried - len(self.failures)} | {self.lost} |"


@cache
def program(text: str) -> Program:
    """A task, compiled once."""
    return compile_task(load_text(text, "tap.yaml"))


def forked(work: Callable[[], object]) -> int:
    """Process id of a copy of this process that does some work and ends."""
    pid = os.fork()
    if pid:
        return pid
    code = 70
    try:
        code = int(bool(work()))
    except OutputError as error:
        sys.stderr.write(f"{error}\n")
        code = 2
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


class Counted:
    """Ticks that a process has recorded, told to the one that ends it."""

    def __init__(self) -> None:
        self._memory = mmap.mmap(-1, 8)

    @property
    def ticks(self) -> int:
        return int.from_bytes(self._memory[:8], "little")

    def run(self, text: str, folder: Path, loop: str = PYTHON) -> object:
        """Runs a task, counting ticks once they are recorded: one by one, or by the native loop."""
        usual, memory, counted = Recorder.advance, self._memory, 0

        def advance(recorder: Recorder, ticks: int) -> None:
            nonlocal counted
            usual(recorder, ticks)
            counted += ticks
            memory[:8] = counted.to_bytes(8, "little")

        Recorder.advance = advance  # type: ignore[method-assign]
        return execute_program(program(text), folder, report=False, loop=loop).exit_code


def wait_until(condition: Callable[[], bool], seconds: float = 60) -> None:
    """Waits for something that another process does."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError
        time.sleep(0.002)


def kills(number: int, work: Path, seed: int = 0) -> Tally:
    """SIGKILL at any time of a run of each loop: every recorded tick is read, and judged."""
    dice, most, tally = random.Random(seed), 0, Tally("SIGKILL while it runs")
    for i in range(number):
        folder, counted, loop = work / f"kill{i}", Counted(), (PYTHON, NATIVE)[i % 2]
        # Before the first tick, around the first batches, and later.
        until = dice.choice((0, dice.randrange(1500), 500 * dice.randrange(1, 4), 4000))
        pid = forked(lambda c=counted, folder=folder, loop=loop: c.run(LONG, folder, loop))
        wait_until(lambda folder=folder: (folder / "log.arrow").exists())
        wait_until(lambda counted=counted, until=until: counted.ticks >= until)
        time.sleep(dice.random() * 2e-3)
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        done, run = counted.ticks, Run.load(folder)
        tally.tried += 1
        most = max(most, done - len(run))
        clock = np.arange(len(run)) * program(LONG).context.period
        # Of ticks under way, the native loop tells when some dozens are done.
        good = done <= len(run) <= done + (1 if loop == PYTHON else BATCH)
        good = good and np.array_equal(run.columns.get("clock", []), clock)
        if not (good and not run.damage and run.verdict == "unfinished"):
            tally.failures.append(f"kill {i}, {loop}: {len(run)} of {done} ticks; {run.reason}")
        elif len(run) and len(run.expectations) != len(program(LONG).context.loaded.task.expect):
            tally.failures.append(f"kill {i}: not judged; {run.reason}")
        shutil.rmtree(folder)
    tally.lost = f"{most} recorded ticks"
    return tally


def locks(number: int, work: Path, seed: int = 0) -> Tally:
    """A second run into a folder: it ends at once and names the first, which goes on."""
    dice, tally = random.Random(seed), Tally("a second run into the same folder")
    for i in range(number):
        folder, counted = work / f"lock{i}", Counted()
        loop = (PYTHON, NATIVE)[i // 2 % 2]
        first = forked(lambda c=counted, folder=folder, loop=loop: c.run(LONG, folder, loop))
        wait_until(lambda folder=folder: (folder / "log.arrow").exists())
        time.sleep(dice.random() * 0.2)
        tally.tried += 1
        try:
            execute_program(program(SHORT), folder, report=False)
            tally.failures.append(f"lock {i}: the second one ran")
        except OutputError as error:
            if f"process {first} on {socket.gethostname()} since " not in str(error):
                tally.failures.append(f"lock {i}: {error}")
        ticks = counted.ticks
        wait_until(lambda counted=counted, ticks=ticks: counted.ticks > ticks)
        stop = signal.SIGKILL if i % 2 else signal.SIGTERM
        os.kill(first, stop)
        os.waitpid(first, 0)
        if stop != signal.SIGKILL and Run.load(folder).extent.status != "stopped":
            tally.failures.append(f"lock {i}: the first one did not end well")
        # A lock of a process that is gone is none.
        if execute_program(program(SHORT), folder, report=False).exit_code:
            tally.failures.append(f"lock {i}: the folder was not free again")
        shutil.rmtree(folder)
    return tally


@contextmanager
def small_disk(work: Path, size: int) -> Iterator[Path | None]:
    """A file system of a size [bytes]; None where this process may not mount one."""
    place = work / "disk"
    place.mkdir(exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)]
    if subprocess.run(command, capture_output=True, check=False).returncode:
        yield None
        return
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=True)


def _full(folder: Path, counted: Counted, code: int) -> str:
    """What is wrong with the folder of a run on a full disk; empty if nothing is."""
    if not folder.exists() or not (folder / "manifest.json").exists():
        return "" if code == 2 and not counted.ticks else "no manifest"
    run, said = Run.load(folder), json.loads((folder / "manifest.json").read_text())
    if any(path.name.startswith(PARTIAL) for path in folder.iterdir()):
        return "half a file is left"
    if code == 0:
        return "" if run.passed else run.reason
    if code != 2 or run.damage or run.passed:
        return f"code {code}: {run.reason}"
    if said["status"] == "running" or not said.get("unwritten"):
        return f"the manifest says {said['status']}, and no file"
    # The last one may be in the block and not counted, as the write that followed failed.
    if len(run) - counted.ticks not in (0, 1):
        return f"{len(run)} of {counted.ticks} ticks"
    return ""


def disks(number: int, work: Path, seed: int = 0) -> tuple[Tally, Tally]:
    """Disks that become full, and files that become too large: the manifest names the file."""
    dice = random.Random(seed)
    tallies = Tally("a disk that becomes full (tmpfs)"), Tally("a file that becomes too large")
    for i in range(number):
        size = dice.choice((dice.randrange(1 << 12, 1 << 17), dice.randrange(1 << 17, 1 << 20)))
        counted = Counted()
        with small_disk(work, size // 4096 * 4096) as place:
            if place is not None:
                pid = forked(lambda c=counted, p=place: c.run(SHORT, p / "run"))
                code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
                tallies[0].tried += 1
                if wrong := _full(place / "run", counted, code):
                    tallies[0].failures.append(f"disk of {size} B: {wrong}")
        counted, folder = Counted(), work / f"limit{i}"

        def limited(counted: Counted = counted, folder: Path = folder, size: int = size) -> object:
            # Python would leave half a file of what it compiles, too.
            sys.dont_write_bytecode = True
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
            return counted.run(SHORT, folder)

        code = os.waitstatus_to_exitcode(os.waitpid(forked(limited), 0)[1])
        tallies[1].tried += 1
        if wrong := _full(folder, counted, code):
            tallies[1].failures.append(f"files of {size} B: {wrong}")
        shutil.rmtree(folder, ignore_errors=True)
    for tally in tallies:
        tally.lost = "0 recorded ticks"
    return tallies


def made(work: Path) -> Path:
    """Folders to be spoiled: runs, a log of elsewhere, a comparison, a sweep and its shares."""
    counted = Counted()
    execute_program(program(SHORT), work / "whole")
    pid = forked(lambda: counted.run(LONG, work / "killed", NATIVE))
    # The log is written by a thread of its own, which may be behind.
    log = work / "killed" / "log.arrow"
    wait_until(
        lambda: counted.ticks > 1234 and log.stat().st_size > 0 and len(read_log(log)) >= 1000
    )
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    recorded, swept = work / "recorded", work / "swept"
    for folder in (recorded, swept):
        folder.mkdir()
        (folder / "tap.yaml").write_text(SHORT + VARY, encoding="utf-8")
    (recorded / "map.yaml").write_text(MAP, encoding="utf-8")
    for form in ("csv", "parquet", "mcap"):
        RunResult.load(work / "whole").export(form, recorded / f"log.{form}")
    task = swept / "tap.yaml"
    ran("compare", task, "--law=parallel", "--law=impedance", "--out", work / "compared")
    # In this process: workers of their own would take longer to begin than the worlds take.
    ran("sweep", task, "--worlds=4", "--jobs=1", "--out", swept / "all", "--keep=none")
    for share in ("1", "2"):
        shard = "--shard", f"{share}/2"
        ran("sweep", task, "--worlds=4", "--jobs=1", *shard, "--out", swept / share)
    ran("run", task, "--world", f"{swept / 'all' / 'worlds.parquet'}:1", "--out", swept / "one")
    return work


def ran(*arguments: object) -> None:
    """Has a command make a folder."""
    result = CliRunner().invoke(app, [str(each) for each in arguments])
    assert result.exit_code in (0, 1, 6), result.output


def spoiled(folders: Path, first: int, count: int, until: float = float("inf")) -> list[Answer]:
    """Answers to some corruptions; none is begun after `until` [s since the epoch]."""
    with tempfile.TemporaryDirectory(prefix="taskspec-faults-") as work:
        found = []
        for number in range(first, first + count):
            if time.time() > until:
                break
            faulthandler.dump_traceback_later(LOST, exit=True)
            found.append(answer(folders, Path(work), number))
            faulthandler.cancel_dump_traceback_later()
        return found


def corruptions(
    number: int, work: Path, first: int, processes: int, until: float = float("inf")
) -> list[Tally]:
    """Folders with one file spoiled: exit 0, 1 or 2 with a message, and nothing that is not so.

    Args:
        number: of corruptions, in the order of their numbers; fewer where time is over.
        work: where the folders are made. first: number of the first. processes: that do it.
        until: after which none is begun [s since the epoch].
    """
    folders, tallies = made(work), dict[str, Tally]()
    codes, slowest, began = Counter[int](), 0.0, time.monotonic()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context) as pool:
        last = first + number
        starts = range(first, last, CHUNK)
        jobs = [pool.submit(spoiled, folders, s, min(CHUNK, last - s), until) for s in starts]
        for job in as_completed(jobs):
            for each in job.result():
                codes[each.code] += 1
                slowest = max(slowest, each.took)
                told = f"{each.spoiled.name}: {' '.join(each.command)} ends with {each.code}"
                failure = f"corruption {each.spoiled.number}, {each.spoiled.kind}: {told}: "
                for what in (each.spoiled.kind, f"of what `{each.command[0]}` reads"):
                    tally = tallies.setdefault(what, Tally(f"corruption: {what}"))
                    tally.tried += 1
                    if not each.survived:
                        tally.failures.append(f"{failure}{each.output.strip()[-200:]}")
            took = time.monotonic() - began
            text = f"{sum(codes.values())} corruptions, {took:.0f} s, {codes}"
            say(f"{text}, slowest {slowest:.1f} s of the processor")
    return [tallies[what] for what in sorted(tallies, key=_place)]


def _place(what: str) -> tuple[int, str]:
    """Kinds of corruptions as they are listed, then commands."""
    kinds = [*BYTES, SEALED, *PLACES]
    return (kinds.index(what), "") if what in kinds else (len(kinds), what)


def cuts(number: int) -> Tally:
    """Logs of shipped tasks that end within a stage: the exit code that follows from the file."""
    tally = Tally("a log that ends within a stage, or with its task")
    for task in sorted(TASKS.glob("*.yaml"))[:number]:
        with tempfile.TemporaryDirectory(prefix="taskspec-cut-") as work:
            for cut in log_cuts(task, Path(work)):
                tally.tried += 1
                if not cut.survived:
                    tally.failures.append(str(cut))
    return tally


def robots(number: int, work: Path, first: int = 0) -> tuple[Tally, Tally]:
    """Robots whose welcome or stamps are any value: refused, stopped by name, or run."""
    tallies = Tally("a robot's welcome, of any value"), Tally("a robot's stamps, of any value")
    for tally, tried in zip(tallies, (a_welcome, stamps), strict=True):
        for seed in range(first, first + number):
            tally.tried += 1
            if wrong := tried(seed, work / "robot"):
                tally.failures.append(f"{tally.what}, {seed}: {wrong}")
    return tallies


def table(tallies: Sequence[Tally]) -> str:
    """The rows as Markdown."""
    head = "| fault | tried | survived | lost |\n| --- | --- | --- | --- |\n"
    return head + "\n".join(tally.row for tally in tallies) + "\n"


def say(text: str) -> None:
    """Writes a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main() -> int:
    """Runs the campaign; the exit code is 1 if something did not survive."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--corruptions", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0, help="number of the first corruption")
    parser.add_argument(
        "--minutes",
        type=float,
        default=float("inf"),
        help="from now, after which no more corruptions are begun",
    )
    parser.add_argument("--folders", type=Path, help="keeps the folders that are spoiled here")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--locks", type=int, default=20)
    parser.add_argument("--disks", type=int, default=40)
    parser.add_argument("--robots", type=int, default=500, help="of each kind")
    parser.add_argument("--cuts", type=int, default=100, help="shipped tasks whose logs are cut")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--table", type=Path, help="the page that keeps the table")
    asked = parser.parse_args()
    tallies, until = list[Tally](), time.time() + asked.minutes * 60
    with tempfile.TemporaryDirectory(prefix="taskspec-faults-") as place:
        work = Path(place)
        tallies.append(kills(asked.kills, work))
        tallies.append(locks(asked.locks, work))
        tallies.extend(tally for tally in disks(asked.disks, work) if tally.tried)
        tallies.append(cuts(asked.cuts))
        tallies.extend(robots(asked.robots, work))
        folders = asked.folders or work / "folders"
        folders.mkdir(parents=True)
        tallies.extend(corruptions(asked.corruptions, folders, asked.first, asked.processes, until))
    say(table(tallies))
    failures = list(dict.fromkeys(line for tally in tallies for line in tally.failures))
    for line in failures:
        say(line)
    if asked.table is not None:
        text = asked.table.read_text(encoding="utf-8")
        before, after = text.split(MARK)[0], text.split(MARK)[2]
        asked.table.write_text(f"{before}{MARK}\n{table(tallies)}{MARK}{after}", encoding="utf-8")
    return int(bool(failures))


if __name__ == "__main__":
    sys.exit(main())
