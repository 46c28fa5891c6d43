"""What long runs need of memory: a run, its report and all that reads it, by minutes of it.

    python campaigns/long_runs.py --minutes 1 10 60 --table docs/faults.md

Each command is a process of its own. Its anonymous memory (RssAnon in /proc/PID/status) is looked
at every 20 ms; pages of files, which the system takes back when it needs them, are no part of it.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Presses with 10 N for as long as it takes, in a frame that is estimated from a touch.
TASK = """\
taskspec: 1
name: long
robot: {{model: panda, start: {{xyz: [500 mm, 0, 310 mm]}}}}
world:
  table: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m, friction: 0.2}}
frames: {{felt: {{estimate: touch}}}}
frame: world
stages:
  approach:
    axes: {{z: {{velocity: -20 mm/s}}}}
    until: force.z < -2 N
    within: 3 s
  touch:
    axes: {{z: {{force: -10 N}}}}
    time: 1 s
  press:
    frame: felt
    axes: {{z: {{force: -10 N}}}}
    time: {minutes} * 60 s
expect:
  - press.force.z within -10 N +- 0.5 N for 90 %
  - rms(press.error.x) < 1 mm
  - max(norm(force)) < 40 N
  - press.force.z in world within -10 N +- 0.5 N for 90 %
  - max(press.tilt in felt) < 1 deg
"""
#: What `--table` replaces.
_MARK = "<!-- table: long -->"
#: A report may have so much [bytes].
LARGEST_PAGE = 5_000_000
#: Anonymous memory that a command may have [MB].
MOST = 400


@dataclass(frozen=True)
class Measured:
    """A command over a run of some minutes."""

    command: str
    minutes: float
    anonymous: float
    seconds: float


def commands(task: Path, run: Path) -> Iterator[tuple[str, list[str]]]:
    """Each command by its name, as arguments of `taskspec`."""
    yield "run", ["run", str(task), "--out", str(run), "--quiet"]
    yield "judge", ["judge", str(run)]
    yield "report", ["report", str(run)]
    yield "diff", ["diff", str(run), str(run)]
    yield "export --csv", ["export", str(run), "--csv"]
    yield "export --parquet", ["export", str(run), "--parquet"]
    video = ["--video", str(run / "video.mp4"), "--from", "5", "--to", "6", "--size", "320x180"]
    yield "export --mcap", ["export", str(run), "--mcap"]
    for form in ("csv", "parquet", "mcap"):
        log, out = run / f"log.{form}", run.with_name("measured")
        # A run's folder is replaced by the next one.
        yield f"judge FILE log.{form}", ["judge", str(task), str(log), "--out", str(out), "--quiet"]
    yield "replay --video", ["replay", str(run), *video, "--fps", "10", "--quiet"]


def measured(arguments: list[str], folder: Path) -> tuple[float, float]:
    """The most anonymous memory of a command [MB], and its seconds of a processor."""
    command = [sys.executable, "-m", "taskspec_runner", *arguments]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)
    status, most = Path(f"/proc/{process.pid}/status"), 0
    stat, seconds = Path(f"/proc/{process.pid}/stat"), 0.0
    while process.poll() is None:
        found = re.search(r"RssAnon:\s+(\d+) kB", status.read_text())
        most = max(most, int(found[1]) if found else 0)
        fields = stat.read_text().rpartition(")")[2].split()
        seconds = (int(fields[11]) + int(fields[12])) / 100
        time.sleep(0.02)
    assert process.returncode == 0, (arguments, process.returncode)
    return most / 1000, seconds


def campaign(minutes: list[float], folder: Path) -> Iterator[Measured]:
    """Measures every command over runs of some lengths."""
    for each in minutes:
        task, run = folder / "long.yaml", folder / "run"
        task.write_text(TASK.format(minutes=each), encoding="utf-8")
        for name, arguments in commands(task, run):
            most, seconds = measured(arguments, folder)
            print(f"{each:g} min, {name}: {most:.0f} MB, {seconds:.0f} s", flush=True)  # noqa: T201
            yield Measured(name, each, most, seconds)
            if name == "report":
                size = (run / "report.html").stat().st_size
                print(f"{each:g} min: report of {size} bytes", flush=True)  # noqa: T201
                assert size < LARGEST_PAGE, size


def table(found: list[Measured]) -> str:
    """The table of the page."""
    lengths = list(dict.fromkeys(each.minutes for each in found))
    lines = ["| command | " + " | ".join(f"{m:g} min" for m in lengths) + " |"]
    lines.append("| --- |" + " --- |" * len(lengths))
    for name in dict.fromkeys(each.command for each in found):
        cells = [f"{each.anonymous:.0f} MB" for each in found if each.command == name]
        lines.append(f"| `{name}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, nargs="+", default=[1, 10, 60])
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    # Two hours of columns lie in it for a while: not in a /tmp that may be memory.
    with tempfile.TemporaryDirectory(dir="/var/tmp") as folder:
        found = list(campaign(given.minutes, Path(folder)))
    if given.table is not None:
        before, _, after = given.table.read_text(encoding="utf-8").split(_MARK)
        text = f"{before}{_MARK}\n{table(found)}\n{_MARK}{after}"
        given.table.write_text(text, encoding="utf-8")
    over = [each for each in found if each.anonymous > MOST]
    if over:
        sys.exit(f"more than {MOST} MB: {over}")


if __name__ == "__main__":
    main()
