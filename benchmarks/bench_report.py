"""What the report of a long run costs beside its simulation, and beside the report of ten seconds.

    python benchmarks/bench_report.py --minutes 10

Each command is a process of its own: its processor time, and the most memory that it had at a time,
pages of mapped files included. `run` simulates and writes a report; `report` writes it again.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "campaigns"))

from long_runs import TASK  # noqa: E402

#: The short run that memory is held against [min].
SHORT = 1 / 6
#: The memory of a long run's report may be so many times as much.
MOST = 1.2


def taskspec(*arguments: str | Path) -> tuple[float, float]:
    """Processor time [s] and the most memory [MB] of a command."""
    path = os.pathsep.join(map(str, (ROOT, ROOT / "runner")))
    process = subprocess.Popen(
        [sys.executable, "-m", "taskspec_runner", *map(str, arguments)],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0, (arguments, process.returncode)
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1000


def main() -> None:
    """Prints what both runs and their reports took; the exit code is 1 if it is too much."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10, help="simulated, of the long run")
    minutes = parser.parse_args().minutes
    needed, spent = {}, {}
    # The log of an hour has gigabytes: not in a /tmp that may be memory.
    with tempfile.TemporaryDirectory(dir="/var/tmp") as name:
        for length in (SHORT, minutes):
            task, run = Path(name) / "long.yaml", Path(name) / "run"
            task.write_text(TASK.format(minutes=f"{length:g}"), encoding="utf-8")
            both, _ = taskspec("run", task, "--out", run, "--quiet")
            report, memory = taskspec("report", run)
            spent[length], needed[length] = (both - report, report), memory
            print(
                f"{60 * length:6.0f} s: simulated in {both - report:5.1f} s, "
                f"report in {report:5.1f} s, {memory:5.0f} MB",
                flush=True,
            )
    more = needed[minutes] / needed[SHORT]
    simulated, report = spent[minutes]
    print(f"memory: {more:.2f} x, at most {MOST} x; time: {report / simulated:.2f} x, at most 1 x")
    sys.exit(more > MOST or report > simulated)


if __name__ == "__main__":
    main()
