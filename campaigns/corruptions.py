"""Spoiled folders of runs, comparisons, sweeps and logs: what a command makes of one.

A corruption is its number: the same number spoils the same folder in the same way.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import re
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import typer
from typer.testing import CliRunner

import taskspec_runner
from taskspec_runner.cli import app
from taskspec_runner.cli.guard import guarded
from taskspec_runner.record.manifest import seal
from taskspec_runner.runs import Run

_RUN = ("log.arrow", "summary.json", "manifest.json", "task.yaml", "log.block")
#: Commands that read a run; `{run}` is its folder, `{good}` that of one which is whole.
_READERS = (
    ("report", "{run}"),
    ("export", "{run}", "--csv"),
    ("export", "{run}", "--parquet"),
    ("export", "{run}", "--mcap"),
    ("diff", "{run}", "{good}"),
    ("diff", "{good}", "{run}", "--format", "json"),
    ("judge", "{run}"),
    ("judge", "{run}", "--format", "json"),
    ("read", "{run}"),
    ("replay", "{run}", "--video", "{run}/run.mp4", "--to=0.1", "--fps=10", "--size=320x180"),
)
_OUT = ("--out", "{run}/judged")
_SWEEP = ("sweep.json", "worlds.jsonl", "task.yaml", "worlds.parquet")


@dataclass(frozen=True)
class Subject:
    """A kind of folder, and who reads it.

    Attributes:
        folder: its name among those that `faults.made` makes.
        names: of the files that are spoiled.
        commands: one of them reads it; `{run}` is the folder.
        same: whether what was read is still so, of the spoiled folder and the one as it was.
    """

    folder: str
    names: tuple[str, ...]
    commands: tuple[tuple[str, ...], ...]
    same: Callable[[Path, Path], bool]

    @staticmethod
    def of(number: int) -> Subject:
        """That of a corruption: three of four are of runs."""
        return SUBJECTS[number % len(SUBJECTS)]


#: After which a command hangs [s]: by the clock, long for a busy computer, and of the processor.
PATIENCE, PROCESSOR = 300, 10.0
#: What a reader may answer: all is well, the run is damaged or missed, it cannot be read, it was
#: stopped, nobody knows, it failed where what is left of its log ends.
ANSWERS = (0, 1, 2, 4, 5, 6)


class HangError(BaseException):
    """A command takes longer than it may."""


@dataclass(frozen=True)
class Spoiled:
    """A corruption.

    Attributes:
        number: of it.
        kind: what was done.
        name: of the file.
        same: whether the file is as it was before, by chance.
    """

    number: int
    kind: str
    name: str
    same: bool


@dataclass(frozen=True)
class Answer:
    """What a command made of a spoiled folder.

    Attributes:
        spoiled: the folder.
        command: its arguments.
        code: its exit code, -1 if it did not end.
        output: both streams.
        true: whether, where nothing is told, ticks and verdict are still those of the run.
        took: processor time of the command [s].
    """

    spoiled: Spoiled
    command: tuple[str, ...]
    code: int
    output: str
    true: bool = True
    took: float = 0.0

    @property
    def survived(self) -> bool:
        """Whether the answer is one that a reader may give, with a message, in time."""
        told = bool(self.output.strip()) and "Traceback" not in self.output
        well = told and "internal error" not in self.output and self.took <= PROCESSOR
        return self.code in ANSWERS and well and self.true


def _flip(content: bytes, dice: random.Random) -> bytes:
    found = bytearray(content)
    for _ in range(dice.choice((1, 1, 1, 2, 8, 64))):
        found[dice.randrange(len(found))] ^= 1 << dice.randrange(8)
    return bytes(found)


def _cut(content: bytes, dice: random.Random) -> bytes:
    return content[: dice.randrange(len(content))]


def _inner(content: bytes, dice: random.Random) -> bytes:
    a, b = sorted(dice.randrange(len(content)) for _ in range(2))
    return content[:a] + content[b:]


def _noise(content: bytes, dice: random.Random) -> bytes:
    a = dice.randrange(len(content))
    length = min(dice.choice((4, 64, 4096)), len(content) - a)
    return content[:a] + dice.randbytes(length) + content[a + length :]


def _twice(content: bytes, dice: random.Random) -> bytes:
    a = dice.randrange(len(content))
    return content[:a] + content[a // 2 :]


def _longer(content: bytes, dice: random.Random) -> bytes:
    return content + dice.choice((b"\0", b"\n", b"{}", dice.randbytes(100), content))


def _other(_content: bytes, dice: random.Random) -> bytes:
    return dice.choice(_NONE)


_NONE = (
    b"",
    b"\0" * 1000,
    b"[" * 100_000,
    b'{"a":' * 100_000,
    b"[]",
    b"null",
    b"{}",
    b'"\\ud800"',
    b'{"task": "\\ud800", "format": 2}',
    b"\xff\xfe\xfd",
    b"ARROW1\0\0",
    b"\xff\xff\xff\xff\x10\x00\x00\x00",
    b"\xff\xff\xff\xff\xff\xff\xff\x7f",
)
_VALUES = (None, 5, -1e308, "x", [], {}, [[1]], {"a": {}}, True, "\ud800", 10**400, "../..")


def _json(content: bytes, dice: random.Random) -> bytes:
    """Another value somewhere in a JSON file."""
    try:
        said = json.loads(content)
    except ValueError:
        return _flip(content, dice)
    holder, keys = said, list(said)
    while True:
        key = dice.choice(keys)
        inner = holder[key]
        keys = list(inner) if isinstance(inner, dict) else list(range(_length(inner)))
        if not keys or dice.random() < 0.4:
            break
        holder = inner
    holder[key] = dice.choice(_VALUES)
    return json.dumps(said).encode()


def _length(value: object) -> int:
    return len(value) if isinstance(value, list) else 0


def _sealed(folder: Path, name: str, dice: random.Random) -> bool:
    """Another value in a JSON file, and all checksums anew; whether there is something to seal."""
    path = folder / name
    manifest = path.parent / "manifest.json"
    path.write_bytes(_json(path.read_bytes(), dice))
    if name.endswith("sweep.json"):
        # What it says of itself has no checksum.
        return True
    try:
        if path.name in ("summary.json", "compare.json", "manifest.json"):
            said = json.loads((path if path.name == "compare.json" else manifest).read_bytes())
            if path.name == "summary.json":
                said["sha256"]["summary.json"] = hashlib.sha256(path.read_bytes()).hexdigest()
            said["seal"] = seal(said)
            target = path if path.name == "compare.json" else manifest
            target.write_text(json.dumps(said), encoding="utf-8")
    except (ValueError, TypeError, LookupError):
        # What was exchanged is the seal's own place.
        return False
    return True


#: What is altered together with all that holds it to be as it was.
SEALED = "a value exchanged, sealed anew"
#: Files that have a seal, or none.
_SEALABLE = ("summary.json", "manifest.json", "compare.json", "sweep.json")
BYTES: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "bits flipped": _flip,
    "cut short": _cut,
    "a part taken out": _inner,
    "noise written over": _noise,
    "a part there twice": _twice,
    "made longer": _longer,
    "something else": _other,
    "a value exchanged": _json,
}


def _missing(path: Path) -> None:
    path.unlink()


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _loop(path: Path) -> None:
    path.unlink()
    path.symlink_to(path.name)


def _endless(path: Path) -> None:
    path.unlink()
    path.symlink_to("/dev/zero")


def _huge(path: Path) -> None:
    os.truncate(path, 1 << 33)


PLACES: dict[str, Callable[[Path], None]] = {
    "missing": _missing,
    "a pipe": _pipe,
    "a folder": _folder,
    "a link to itself": _loop,
    "a link to /dev/zero": _endless,
    "8 GiB of holes behind it": _huge,
}
#: Corruptions of bytes are more often, as there are more of them.
_WEIGHTS = {**dict.fromkeys(BYTES, 6), "bits flipped": 24, **dict.fromkeys(PLACES, 1), SEALED: 12}


def spoil(folder: Path, number: int, names: tuple[str, ...] = _RUN) -> Spoiled:
    """Spoils one of some files of a folder."""
    dice = random.Random(number)
    names = tuple(name for name in names if (folder / name).is_file())
    name = dice.choice([*names, names[0]])
    sealable = [each for each in names if Path(each).name in _SEALABLE]
    kinds = [*BYTES, *PLACES, *([SEALED] if sealable else [])]
    kind = dice.choices(kinds, [_WEIGHTS[each] for each in kinds])[0]
    if kind == SEALED:
        name = dice.choice(sealable)
        _sealed(folder, name, dice)
        return Spoiled(number, kind, name, same=False)
    path = folder / name
    if kind in PLACES:
        PLACES[kind](path)
        return Spoiled(number, kind, name, same=False)
    before = path.read_bytes()
    after = BYTES[kind](before, dice) if before else b"x"
    path.write_bytes(after)
    return Spoiled(number, kind, name, same=after == before)


@contextmanager
def _watched(seconds: int) -> Iterator[None]:
    def over(*_: object) -> None:
        raise HangError

    usual = signal.signal(signal.SIGALRM, over)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, usual)


@contextmanager
def _drawing(*, on: bool) -> Iterator[None]:
    """Lets a film be drawn; the pictures of reports are left out, as they take long."""
    usual = os.environ.pop("MUJOCO_GL", None)
    if not on:
        os.environ["MUJOCO_GL"] = "disable"
    try:
        yield
    finally:
        os.environ.pop("MUJOCO_GL", None)
        if usual is not None:
            os.environ["MUJOCO_GL"] = usual


def answer(folders: Path, work: Path, number: int) -> Answer:
    """Spoils a copy of a folder and has a command read it.

    Args:
        folders: those that `faults.made` made.
        work: a folder to work in.
        number: of the corruption.
    """
    subject, run, good = Subject.of(number), work / "run", folders / "whole"
    source = folders / subject.folder
    _remove(run)
    shutil.copytree(source, run)
    spoiled = spoil(run, number, subject.names)
    template = random.Random(f"command {number}").choice(subject.commands)
    command = tuple(part.format(run=run, good=good) for part in template)
    began = time.process_time()
    try:
        with _watched(PATIENCE), _drawing(on=command[0] == "replay"):
            result = CliRunner().invoke(READERS, list(command))
            took = time.process_time() - began
            # Who seals all anew is found out by `judge` as far as the log goes, and else by nobody.
            open_ = spoiled.kind == SEALED and command[0] != "judge"
            true = result.exit_code != 0 or open_ or subject.same(run, source)
    except HangError:
        return Answer(spoiled, command, -1, "hangs")
    finally:
        _remove(run)
    return Answer(spoiled, command, result.exit_code, result.output, true, took)


READERS = typer.Typer()
READERS.registered_commands = [*app.registered_commands]


@READERS.command("read")
@guarded
def _read(folder: Path) -> int:
    """Reads a run in Python, all of it."""
    run = taskspec_runner.read(folder)
    for column in run.columns.values():
        column.sum()
    typer.echo(f"{run.verdict}: {run.reason} {run!r} {run.visits} {run.expectations} {run.metrics}")
    run._repr_html_()
    return int(bool(run.damage) or not run.passed)


def _same_run(spoiled: Path, source: Path) -> bool:
    """Whether ticks are the first ones of another run, bit by bit, and the verdict is the same."""
    run, was = Run(spoiled), Run(source)
    found, whole = run.history, was.history
    ticks = len(found)
    return (
        run.verdict == was.verdict
        and ticks <= len(whole)
        and bool((found.stages == whole.stages[:ticks]).all())
        and all(
            values.tobytes() == whole.columns[name][:ticks].tobytes()
            for name, values in found.columns.items()
        )
    )


def _judged(spoiled: Path, _source: Path) -> bool:
    """Whether the folder of a judged log is one; of what a log says there is no other witness."""
    return Run(spoiled / "judged").damage == ""


def _alike(name: str, of: str = "") -> Callable[[Path, Path], bool]:
    """Whether a file that was made is, byte by byte, what it was, but for where it says it is."""
    return lambda spoiled, source: _made(spoiled, name) == _made(source, of or name)


def _made(folder: Path, name: str) -> bytes:
    return re.sub(rb"<dt>folder</dt><dd>[^<]*</dd>", b"", (folder / name).read_bytes())


def _ran(spoiled: Path, source: Path) -> bool:
    """Whether the world of a row is that of the table."""
    world = Run(spoiled / "one").summary["world"]
    return bool(world == Run(source / "one").summary["world"])


def _recorded(form: str) -> Subject:
    command = ("judge", "{run}/tap.yaml", f"{{run}}/log.{form}", "--columns", "{run}/map.yaml")
    return Subject("recorded", (f"log.{form}", "map.yaml"), ((*command, *_OUT),), _judged)


def _inside(folder: str, names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{folder}/{name}" for name in names)


_RUNS = (
    Subject("whole", _RUN, _READERS, _same_run),
    Subject("killed", _RUN, _READERS, _same_run),
)
_ONE = ("run", "{run}/tap.yaml", "--world", "{run}/all/worlds.parquet:1", "--out", "{run}/one")
_CONTINUE = ("sweep", "{run}/tap.yaml", "--out", "{run}/all", "--jobs=1", "--keep=none")
_MERGE = ("sweep", "--merge", "{run}/1", "{run}/2", "--out", "{run}/merged")
_OTHERS = (
    *(_recorded(form) for form in ("csv", "parquet", "mcap")),
    Subject("compared", ("compare.json",), (("report", "{run}"),), _alike("compare.html")),
    Subject("swept", _inside("all", _SWEEP), (("report", "{run}/all"),), _alike("all/sweep.html")),
    Subject("swept", _inside("all", _SWEEP), (_CONTINUE,), _alike("all/worlds.parquet")),
    Subject(
        "swept",
        _inside("1", _SWEEP),
        (_MERGE,),
        _alike("merged/worlds.parquet", "all/worlds.parquet"),
    ),
    Subject("swept", ("all/worlds.parquet",), (_ONE,), _ran),
)
SUBJECTS = tuple(each for other in _OTHERS for each in (*_RUNS, other, _RUNS[0]))


def _remove(folder: Path) -> None:
    if folder.exists():
        shutil.rmtree(folder)


if __name__ == "__main__":
    # One by one, to look at.
    folders, work = map(Path, sys.argv[1:3])
    for text in sys.argv[3:]:
        sys.stdout.write(f"{answer(folders, work, int(text))}\n")
