"""Fuzzing on demand: many spoiled files at full depth, failing ones saved as small as they get.

    python tests/fuzz/campaign.py --files 100000

A file is its seed: `--first N --files 1` makes the one of seed N again.
"""

from __future__ import annotations

import argparse
import faulthandler
import multiprocessing
import os
import sys
import time
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from injuries import Case, case
from promises import HangError, found_in, held, resident

#: Files that one process takes at a time; seconds after which it is given up as hanging in C.
CHUNK, LOST = 200, 600
#: Seconds for making a failing file smaller.
EFFORT = 10.0
#: What a file should take at the most [s of processor time]; what takes longer is counted.
PROMISED = 1.0
#: Files at the end of a chunk, read without an error, that are examined anew for memory kept.
AGAIN = 8


@dataclass(frozen=True)
class Failure:
    """A file that breaks a promise.

    Attributes:
        seed: of the file. key: what kind of failure, and where. text: of the file. trace: of it.
    """

    seed: int
    key: str
    text: str
    trace: str


@dataclass(frozen=True)
class Outcome:
    """What came of a chunk of files.

    Attributes:
        files: how many. deep: how many of them were read without an error. slowest: (s, seed).
        late: how many took longer than `PROMISED`, each examination by itself.
        grown: what the process kept of the last `AGAIN` deep files, examined anew [MiB].
        failures: in the order of the seeds.
    """

    files: int
    deep: int
    slowest: tuple[float, int]
    late: int
    grown: float
    failures: tuple[Failure, ...]


def broken(check: Callable[[], object]) -> tuple[str, str] | None:
    """What kind of failure a check ends in, and its traceback; None if it ends well."""
    try:
        check()
    except (Exception, HangError) as error:
        frames = traceback.extract_tb(error.__traceback__)
        last = [f for f in frames if "taskspec" in Path(f.filename).parts] or frames
        place = f"{Path(last[-1].filename).name}:{last[-1].name}"
        return f"{type(error).__name__} at {place}", "".join(traceback.format_exception(error))
    return None


def chunk(first: int, count: int) -> Outcome:
    """Holds the files of seeds `first` to `first + count - 1` to the promises."""
    warnings.simplefilter("error")
    deep, slowest, late, failures = 0, (0.0, first), 0, []
    known: deque[Case] = deque(maxlen=AGAIN)
    for seed in range(first, first + count):
        made = case(seed)
        faulthandler.dump_traceback_later(LOST, exit=True)
        began = time.process_time()

        def check(made=made, seed=seed) -> None:  # type: ignore[no-untyped-def]
            nonlocal deep
            if held(made.text, made.base, twice=seed % 4 == 0):
                deep += 1
                known.append(made)

        found = broken(check)
        took = (time.process_time() - began) / (2 if seed % 4 == 0 else 1)
        slowest, late = max(slowest, (took, seed)), late + (took > PROMISED)
        if found is not None:
            text = smaller(made.text, made.base, found[0])
            failures.append(Failure(seed, found[0], text, found[1]))
        faulthandler.cancel_dump_traceback_later()
    return Outcome(count, deep, slowest, late, _grown(known), tuple(failures))


def _grown(known: Iterable[Case]) -> float:
    """Memory kept of files that were examined before [MiB].

    All that they need is loaded and every cache holds them, so what grows here each time is a
    leak. What the allocator takes from the system once is in one of the two rounds only.
    """

    def growth() -> float:
        before = resident()
        for made in known:
            found_in(made.text, made.base)
        return resident() - before

    return min(growth(), growth())


def smaller(text: str, base: Path, key: str) -> str:
    """A shorter text that fails in the same way, by leaving out lines and then characters."""
    end = time.monotonic() + EFFORT

    def fails(candidate: str) -> bool:
        found = broken(lambda: held(candidate, base))
        return found is not None and found[0] == key

    for split, join in ((str.splitlines, "\n"), (list, "")):
        parts = split(text)
        step = max(len(parts) // 2, 1)
        while time.monotonic() < end:
            at = 0
            while at < len(parts) and time.monotonic() < end:
                left = parts[:at] + parts[at + step :]
                if left and fails(join.join(left)):
                    parts = left
                else:
                    at += step
            if step == 1:
                break
            step //= 2
        text = join.join(parts)
    return text


def save(failure: Failure, folder: Path) -> None:
    """Keeps a failing file and how it failed."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{failure.seed}.yaml").write_text(failure.text, "utf-8", "surrogatepass")
    (folder / f"{failure.seed}.txt").write_text(failure.trace, "utf-8", "backslashreplace")


def say(text: str) -> None:
    """Writes a line at once."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def main() -> int:
    """Runs a campaign; the exit code is 1 if a promise was broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=100_000)
    parser.add_argument("--first", type=int, default=1_000_000, help="seed of the first file")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--save", type=Path, default=Path("runs/fuzz"))
    asked = parser.parse_args()
    began, done, deep, failures, late = time.monotonic(), 0, 0, 0, 0
    slowest, grown = (0.0, 0), 0.0
    starts = range(asked.first, asked.first + asked.files, CHUNK)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(asked.processes, context) as pool:
        last = asked.first + asked.files
        jobs = [pool.submit(chunk, start, min(CHUNK, last - start)) for start in starts]
        for job in as_completed(jobs):
            outcome = job.result()
            done, deep, late = done + outcome.files, deep + outcome.deep, late + outcome.late
            slowest, grown = max(slowest, outcome.slowest), max(grown, outcome.grown)
            for failure in outcome.failures:
                failures += 1
                save(failure, asked.save)
                say(f"seed {failure.seed}: {failure.key}; see {asked.save}/{failure.seed}.yaml")
            if done % (10 * CHUNK) == 0:
                say(f"{done} files, {deep} to the checks, {time.monotonic() - began:.0f} s")
    say(
        f"seeds {asked.first} to {last - 1}: {done} files, {deep} of them to the checks, "
        f"{failures} failures, {time.monotonic() - began:.0f} s, slowest {slowest[0]:.2f} s "
        f"(seed {slowest[1]}), {late} over {PROMISED:g} s, "
        f"most memory kept of {AGAIN} files examined anew {grown:.1f} MiB"
    )
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
