"""Holds what `validate` says of random files against what their runs do.

    python campaigns/truth.py --seed 1 --files 200

Every file is validated and run; one that is refused is run in spite of it. Files are those of two
generators: `workshop` is `truth_tasks.py`, `language` is `language_tasks.py`, which reads nothing
of the rules. Rows are kept under `runs/truth`, one line a file, so that a campaign that was broken
off goes on where it was. Which code announces which end is in `announcements.yaml`, reasons for
disagreements are in `explanations.yaml`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import queue
import shutil
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import yaml

sys.path.insert(0, str(Path(__file__).parent))

from truth_file import CRASHED, GENERATORS, REFUSED, WELL, row_of
from workers import Worker, serve

from taskspec import __version__

ROOT = Path(__file__).resolve().parents[1]
HERE = Path(__file__).resolve().parent
#: Folders of the packages whose sources are run.
PACKAGES = ("taskspec", "runner/taskspec_runner")
#: After which a file is given up as hanging [s].
LOST = 300.0
#: What is promised: of bad runs announced, of good runs with a warning, of refusals that are right,
#: of files without a finding that end well.
ANNOUNCED, WARNED, RIGHT, SILENT = 0.995, 0.04, 0.98, 0.99
Row = Mapping[str, Any]
_KEPT = """\
# How files of `make truth` end, and what is said of them, by generator, seed and number: the first
# 24, and those of the first 60 of which something is said or that do not end well. After a
# change on purpose: python campaigns/truth.py --seed 0 --files 60 --fresh --keep THIS_FILE
"""
#: So many files are kept although they end well and nothing is said of them: `make truth` has more.
_KEPT_WELL = 24


def announcements() -> dict[str, tuple[str, ...]]:
    """Patterns of the ends that each code announces."""
    listed = yaml.safe_load((HERE / "announcements.yaml").read_text("utf-8"))
    return {code: tuple(patterns) for code, patterns in listed.items()}


def explanations(generator: str, seed: int) -> dict[int, str]:
    """Reasons for disagreements of a generator's seed, by number."""
    listed = yaml.safe_load((HERE / "explanations.yaml").read_text("utf-8")) or {}
    reasons = (listed.get(generator) or {}).get(seed) or {}
    return {int(number): str(reason) for number, reason in reasons.items()}


# --- what a row is -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Judged:
    """A row as the table counts it."""

    row: Row
    announces: Mapping[str, tuple[str, ...]]

    @property
    def number(self) -> int:
        return int(self.row["number"])

    @property
    def ran(self) -> bool:
        return self.row["end"] not in (REFUSED, CRASHED)

    @property
    def codes(self) -> tuple[str, ...]:
        """Of errors and warnings."""
        found = (each["code"] for each in self.row["said"] if each["severity"] != "info")
        return tuple(sorted(set(found)))

    @property
    def alarms(self) -> tuple[str, ...]:
        """Codes of errors and warnings about the simulated run, not about another world."""
        return tuple(code for code in self.codes if self.announces.get(code, ("*",)))

    @property
    def severity(self) -> str:
        """Of the gravest finding; `silent` without one."""
        kinds = {each["severity"] for each in self.row["said"]}
        return next((kind for kind in ("error", "warning") if kind in kinds), "silent")

    @property
    def good(self) -> bool:
        """Whether the run ended well; one that was refused also did when it was run longer."""
        return self.row["end"] == WELL and not self.row["grew"]

    @property
    def announced(self) -> tuple[str, ...]:
        """Codes that announce how the run ended: of a refused file all errors, as it is not run."""
        if self.row["forced"]:
            return tuple(e["code"] for e in self.row["said"] if e["severity"] == "error")
        end = self.row["grew"] if self.row["end"] == WELL else self.row["end"]
        end = "oscillation" if end == "grows" else end
        return tuple(
            code
            for code in self.codes
            if any(fnmatchcase(end, pattern) for pattern in self.announces.get(code, ()))
        )

    @property
    def disagreement(self) -> str:
        """What was said against what was done; empty if they agree."""
        if self.row["end"] == CRASHED:
            return "crash"
        if not self.ran:
            return ""
        if not self.good:
            return "" if self.announced else "missed" if self.codes else "silent"
        if self.row["forced"]:
            return "" if self.row["near"] else "false refusal"
        return "warned" if self.alarms else ""


@dataclass(frozen=True)
class Share:
    """A share that is promised, as a count of a total; `most` of what must not be exceeded."""

    title: str
    count: int
    total: int
    bound: float
    most: bool = False

    @property
    def value(self) -> float:
        return self.count / self.total if self.total else float(not self.most)

    @property
    def kept(self) -> bool:
        return self.value <= self.bound if self.most else self.value >= self.bound


def shares(rows: Sequence[Judged]) -> list[Share]:
    """The four promises, and the first of them with any error or warning as an announcement."""
    ran = [row for row in rows if row.ran]
    bad, good = [r for r in ran if not r.good], [r for r in ran if r.good]
    forced = [r for r in ran if r.row["forced"] and not r.row["near"]]
    silent = [r for r in ran if r.severity == "silent"]
    announced, loosely = sum(bool(r.announced) for r in bad), sum(bool(r.codes) for r in bad)
    return [
        Share("bad runs that were announced", announced, len(bad), ANNOUNCED),
        Share("bad runs with any error or warning", loosely, len(bad), ANNOUNCED),
        Share(
            "good runs with an error or warning",
            sum(bool(r.alarms) for r in good),
            len(good),
            WARNED,
            most=True,
        ),
        Share("refusals that were right", sum(not r.good for r in forced), len(forced), RIGHT),
        Share("silent files that end well", sum(r.good for r in silent), len(silent), SILENT),
    ]


def kept_line(row: Row) -> str:
    """How a file ends and what is said of it, as `fixed.yaml` keeps it."""
    said = sorted({f"{each['code']} {each['severity']}" for each in row["said"]})
    return " | ".join((f"{row['end']}, then {row['grew']}" if row["grew"] else row["end"], *said))


# --- the campaign --------------------------------------------------------------------------------


class Kept:
    """Rows of a seed in a file, a line each; of several of one number the last counts."""

    def __init__(self, path: Path) -> None:
        self._path = path
        path.parent.mkdir(parents=True, exist_ok=True)

    def rows(self) -> dict[int, Row]:
        if not self._path.is_file():
            return {}
        found = {}
        for line in self._path.read_text("utf-8").splitlines():
            # The last line of a campaign that was killed may be cut short.
            if line.endswith("}"):
                row = json.loads(line)
                found[int(row["number"])] = row
        return found

    def add(self, row: Row) -> None:
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")

    def clear(self) -> None:
        self._path.unlink(missing_ok=True)


def campaign(
    generator: str, seed: int, numbers: Sequence[int], jobs: int, tree: Path
) -> Iterator[Row]:
    """Rows of files, as they are done."""
    waiting: queue.SimpleQueue[int | None] = queue.SimpleQueue()
    done: queue.SimpleQueue[Row] = queue.SimpleQueue()
    for number in [*numbers, *[None] * jobs]:
        waiting.put(number)

    def run() -> None:
        worker = Worker(tree / Path(__file__).resolve().relative_to(ROOT), tree, LOST)
        while (number := waiting.get()) is not None:
            row = worker.ask({"generator": generator, "seed": seed, "number": number})
            done.put(row if isinstance(row, dict) else crashed(number, row))
        worker.close()

    for _ in range(jobs):
        threading.Thread(target=run, daemon=True).start()
    for _ in numbers:
        yield done.get()


def crashed(number: int, text: str) -> Row:
    """The row of a file that took its process with it."""
    from dataclasses import asdict

    from truth_file import Row as Filled

    return asdict(Filled(number, text=text))


def answer(order: Mapping[str, Any]) -> Row:
    return row_of(order["generator"], order["seed"], order["number"])


def copied(folder: Path) -> Path:
    """The tree as it is now in a folder, so that it may change during the campaign."""
    unwanted = shutil.ignore_patterns(".*", "__pycache__", "runs", "build", "dist", "*.egg-info")
    shutil.copytree(ROOT, folder / "tree", ignore=unwanted, symlinks=True)
    return folder / "tree"


def sources(tree: Path = ROOT) -> str:
    """Version and a hash of all sources of both packages: what a table can stand for.

    A commit is rewritten when it is put upon another one; the sources that were run are not.
    """
    made = hashlib.sha256()
    for path in sorted(p for part in PACKAGES for p in (tree / part).rglob("*.py")):
        made.update(path.relative_to(tree).as_posix().encode() + b"\0" + path.read_bytes())
    return f"{__version__}, sources {made.hexdigest()[:12]}"


def say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def progress(done: int, count: int, began: float, rows: Sequence[Judged]) -> None:
    """How far the campaign is: on a terminal in place, else a line now and then."""
    rate = done / (time.monotonic() - began)
    apart = Counter(row.disagreement for row in rows if row.disagreement)
    counts = ", ".join(f"{n} {kind}" for kind, n in apart.most_common())
    left = (count - done) / rate / 60
    text = f"{done} of {count}, {rate:.2f} /s, {left:.0f} min left; {counts}"
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\x1b[K{text}" + "\n" * (done == count))
    elif done % 50 == 0 or done == count:
        sys.stderr.write(text + "\n")
    sys.stderr.flush()


def main() -> int:
    """Runs a campaign; the exit code is 1 if a promise is not kept."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--generator", choices=GENERATORS, action="append", help="default: all")
    parser.add_argument("--files", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first file")
    parser.add_argument("--only", type=int, nargs="+", help="these files, made anew")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--fresh", action="store_true", help="forget rows that are kept")
    parser.add_argument("--rows", type=Path, default=ROOT / "runs" / "truth")
    parser.add_argument("--page", type=Path, help="where the page is written")
    parser.add_argument("--keep", type=Path, help="where ends and codes are kept, for the tests")
    parser.add_argument("--sources", action="store_true", help="say which sources these are")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.worker:
        serve(answer)
        return 0
    if arguments.sources:
        say(sources())
        return 0
    from truth_page import listed, page

    judged = {name: judged_files(name, arguments) for name in arguments.generator or GENERATORS}
    found: list[Share] = []
    for name, rows in judged.items():
        say(f"--- {name}, seed {arguments.seed}")
        for line in listed(rows, explanations(name, arguments.seed)):
            say(line)
        found += shares(rows)
        for share in shares(rows):
            say(f"{share.title}: {share.count} of {share.total}, {share.value:.1%}")
    if arguments.keep is not None:
        lines = {
            name: {
                arguments.seed: {
                    row.number: line
                    for row in rows
                    if (line := kept_line(row.row)) != WELL or row.number < _KEPT_WELL
                }
            }
            for name, rows in judged.items()
        }
        arguments.keep.write_text(_KEPT + yaml.safe_dump(lines, sort_keys=False), "utf-8")
    if arguments.page is not None:
        arguments.page.write_text(page(arguments.seed, judged), "utf-8")
    return int(not all(share.kept for share in found))


def judged_files(generator: str, arguments: argparse.Namespace) -> list[Judged]:
    """The rows of a generator's files; those that are not kept are made first."""
    kept = Kept(arguments.rows / f"{generator}-{arguments.seed}.jsonl")
    if arguments.fresh:
        kept.clear()
    numbers = arguments.only or range(arguments.first, arguments.first + arguments.files)
    known = kept.rows()
    missing = [n for n in numbers if arguments.only or n not in known]
    announces, version, began = announcements(), sources(), time.monotonic()
    with tempfile.TemporaryDirectory(prefix="truth-") as scratch:
        judged: list[Judged] = []
        tree = copied(Path(scratch).resolve()) if missing else ROOT
        for row in campaign(generator, arguments.seed, missing, arguments.jobs, tree):
            kept.add({**row, "sources": version})
            judged.append(Judged(row, announces))
            progress(len(judged), len(missing), began, judged)
    rows = kept.rows()
    return [Judged(rows[number], announces) for number in sorted(numbers)]


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
