"""The folder of a run: what is in it, and how it is written so that no state is half a state."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from taskspec.deferred_methods import dataclass
from taskspec.regular_file import open_regular
from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.record.extent import ENDED
from taskspec_runner.record.lock import LOCK, FolderLock, holder
from taskspec_runner.record.manifest import RUNNING, SEAL, now, seal
from taskspec_runner.record.names import (
    BLOCK,
    COMPARISON,
    CRASH,
    EXPORTS,
    JOURNAL,
    LOG,
    MANIFEST,
    REPORT,
    SUMMARY,
    SWEEP,
    TABLE,
    TASK,
)
from taskspec_runner.record.whole import PARTIAL, write_whole

if TYPE_CHECKING:
    from taskspec_runner.record.log import Log

Json = Mapping[str, Any]

_OWN = (TASK, MANIFEST, LOG, BLOCK, SUMMARY, REPORT, CRASH)

#: The default folder of runs.
RUNS = Path("runs")
#: What a JSON file of a folder has at the most [bytes]; those of long runs have some 100 kB.
LARGEST = 1 << 26


@dataclass(slots=True)
class RunFolder:
    """A folder that holds one run. While that is written, the folder is locked until `close`.

    Attributes:
        path: the folder.
        manifest: what `manifest.json` says.
        lock: of the folder, None for one that is not written, or only beside a run.
    """

    path: Path
    manifest: dict[str, Any] = field(default_factory=dict)
    lock: FolderLock | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Gives the lock back."""
        if self.lock is not None:
            self.lock.close()
            self.lock = None

    @property
    def log(self) -> Path:
        """The log."""
        return self.path / LOG

    @property
    def block(self) -> Path:
        """What the next batch of the log is filled in."""
        return self.path / BLOCK

    def write(self, name: str, content: bytes | str) -> Path:
        """Writes a file whole or not at all.

        Raises:
            OutputError: it cannot be written.
        """
        return write_whole(self.path / name, content)

    def write_json(self, name: str, content: Mapping[str, Any]) -> Path:
        """Writes a mapping as JSON; numbers that are not finite become null.

        Raises:
            OutputError: it cannot be written.
        """
        return self.write(name, json_text(content))

    def write_sealed(self, name: str, content: Mapping[str, Any]) -> Path:
        """Writes a mapping as JSON, with a checksum of itself.

        Raises:
            OutputError: it cannot be written.
        """
        said = plain(content)
        return self.write_json(name, {**said, SEAL: seal(said)})

    def note(self, **entries: Any) -> None:
        """Puts entries into the manifest and writes it.

        Raises:
            OutputError: it cannot be written.
        """
        self.manifest = plain(self.manifest | entries)
        self.manifest[SEAL] = seal(self.manifest)
        try:
            self.write_json(MANIFEST, self.manifest)
        except OutputError:
            if self.lock is None:
                raise
            # The disk is full, which the manifest is to say.
            self.lock.make_room()
            self.write_json(MANIFEST, self.manifest)

    def keep_summary(self, summary: Mapping[str, Any], log: Log) -> Json:
        """Writes the summary of a log that is closed; returns it as it is written.

        The manifest has the checksums of both before: whoever reads the summary knows whether it is
        the one that was judged.

        Raises:
            OutputError: it cannot be written.
        """
        said: Json = plain(summary)
        text = json_text(said)
        sums = {LOG: log.sha256, SUMMARY: hashlib.sha256(text.encode()).hexdigest()}
        self.note(sha256={**self.manifest["sha256"], **sums}, log=log.facts)
        self.write(SUMMARY, text)
        return said

    def end(self, status: str, reason: str, **entries: Any) -> None:
        """Notes how a run ended; of one that was not judged, what its log came to.

        Raises:
            OutputError: it cannot be written.
        """
        sums = self.manifest["sha256"]
        if sums[LOG] is None:
            sums = {**sums, LOG: self.digest(LOG)}
        self.note(sha256=sums, status=status, reason=reason, finished=now(), **entries)
        if status in ENDED:
            # All of its ticks are in the log, which the manifest says now.
            self.block.unlink(missing_ok=True)

    @property
    def goes_on(self) -> bool:
        """Whether it was not noted yet how the run ended."""
        return bool(self.manifest.get("status", RUNNING) == RUNNING)

    @contextlib.contextmanager
    def failures_noted(self) -> Iterator[None]:
        """Has the manifest say which file could not be written; what was judged before stands.

        Raises:
            OutputError: a file cannot be written.
        """
        try:
            yield
        except (OutputError, OSError) as error:
            said = error if isinstance(error, OutputError) else OutputError.of(self.path, error)
            with contextlib.suppress(OutputError):
                if self.goes_on:
                    self.end("crashed", str(said))
                # What was judged stands, though not all of it is there to be read.
                self.note(unwritten={"file": said.path.name, "reason": said.reason})
            if said is error:
                raise
            raise said from error

    def crash(self, error: BaseException) -> Path:
        """Keeps the traceback of an internal error; returns where.

        Raises:
            OutputError: it cannot be written.
        """
        text = "".join(traceback.format_exception(error))
        return self.write(CRASH, text)

    @property
    def is_run(self) -> bool:
        """Whether it holds a run, or what is left of one."""
        return any((self.path / name).exists() for name in (LOG, MANIFEST))

    def digest(self, name: str) -> str | None:
        """SHA-256 of a file of the folder, None if there is none.

        Raises:
            OSError: it cannot be read, or is no regular file.
        """
        try:
            with open_regular(self.path / name) as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
        except FileNotFoundError:
            return None


def open_folder(out: Path | None, name: str) -> RunFolder:
    """Makes and locks the folder of a new run.

    Args:
        out: where; an earlier run in it is replaced. None for `runs/NAME`, or with -2, -3, ...
            where that exists.
        name: of the task.

    Raises:
        OutputError: it cannot be made, holds something else than a run, or is written by another
            process.
    """
    return opened(out, RUNS / name, check_folder, clear)


def opened(
    out: Path | None, usual: Path, check: Callable[[Path], None], clear: Callable[[Path], None]
) -> RunFolder:
    """Makes and locks a folder that is to be written.

    Args:
        out: where; what is in it is replaced. None for the usual place.
        usual: the usual place; -2, -3, ... is added where it exists.
        check: raises `OutputError` for a folder that holds something else.
        clear: takes out what is to be replaced.

    Raises:
        OutputError: it cannot be made, holds something else, or is written by another process.
    """
    try:
        if out is None:
            path = new(usual)
            return RunFolder(path, lock=FolderLock(path))
        check(out)
        out.mkdir(parents=True, exist_ok=True)
        folder = RunFolder(out, lock=FolderLock(out))
    except OSError as error:
        raise OutputError.of(out or usual, error) from error
    try:
        # Another run may have come and gone since it was read.
        check(out)
        clear(out)
    except BaseException as error:
        folder.close()
        if isinstance(error, OSError):
            raise OutputError.of(out, error) from error
        raise
    return folder


def new(path: Path) -> Path:
    """Makes a folder that was not there, with -2, -3, ... behind its name where it was.

    Raises:
        OSError: it cannot be made.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    number = 1
    while True:
        candidate = path if number == 1 else path.with_name(f"{path.name}-{number}")
        try:
            candidate.mkdir()
        except FileExistsError:
            number += 1
        else:
            return candidate


def check_folder(path: Path) -> None:
    """Finds out whether a run may be written into a folder: it is new, empty, or holds a run.

    Raises:
        OutputError: it may not.
    """
    check_own(path, "run", is_manifest(path / MANIFEST), (*_OWN, *EXPORTS))


def check_unlocked(path: Path) -> None:
    """Finds out whether a folder could be locked, before much work is done.

    Raises:
        OutputError: another process writes into it.
    """
    writer = holder(path)
    if writer is not None:
        raise OutputError(path, f"{writer.text} writes into it")


def check_own(path: Path, what: str, own: bool, names: tuple[str, ...]) -> None:
    """Finds out whether a folder may be written.

    Args:
        path: the folder.
        what: it is to hold, in a word.
        own: whether it holds such a thing.
        names: of the files that are replaced then.

    Raises:
        OutputError: it holds something else.
    """
    try:
        held = {entry.name for entry in path.iterdir()}
        in_the_way = [n for n in names if (path / n).is_dir() and not (path / n).is_symlink()]
    except FileNotFoundError:
        return
    except OSError as error:
        raise OutputError.of(path, error) from error
    left = {name for name in held if name != LOCK and not name.startswith(PARTIAL)}
    if left and not own:
        raise OutputError(path, f"the folder is not empty and holds no {what}")
    if in_the_way:
        raise OutputError(path / in_the_way[0], "it is a folder")


def check_target(path: Path) -> None:
    """Finds out whether a file may be written that a user names.

    Raises:
        OutputError: the outcome of a run, a comparison or a sweep follows from it.
    """
    place = path.resolve()
    evidence = (
        ("run", MANIFEST, is_manifest, (TASK, MANIFEST, LOG, BLOCK, SUMMARY)),
        ("comparison", COMPARISON, is_comparison, (COMPARISON,)),
        ("sweep", SWEEP, is_sweep, (TASK, SWEEP, JOURNAL, TABLE)),
    )
    for what, marker, own, names in evidence:
        if place.name in names and own(place.parent / marker):
            raise OutputError(path, f"it is part of the evidence of a {what}; choose another name")


def is_manifest(path: Path) -> bool:
    """Whether a file is the manifest of a run: it names the version that made the run."""
    said = read_json(path)
    made_by = mapping(said.get("versions")).get("taskspec")
    return isinstance(said.get("format"), int) and isinstance(made_by, str)


def is_comparison(path: Path) -> bool:
    """Whether a file is what is said of a comparison."""
    said = read_json(path)
    return isinstance(said.get("format"), int) and isinstance(said.get("laws"), list)


def is_sweep(path: Path) -> bool:
    """Whether a file is what is said of a sweep."""
    said = read_json(path)
    return isinstance(said.get("format"), int) and isinstance(said.get("identity"), str)


def clear(path: Path) -> None:
    """Takes an earlier run out of a folder, and what killed processes left half written.

    Raises:
        OSError: a file cannot be removed.
    """
    remove(path, (*_OWN, *EXPORTS))


def remove(path: Path, names: tuple[str, ...]) -> None:
    """Takes files out of a folder, and what killed processes left half written.

    Raises:
        OSError: a file cannot be removed.
    """
    for entry in [*path.iterdir()]:
        if entry.name in names or entry.name.startswith(PARTIAL):
            entry.unlink(missing_ok=True)


def json_text(content: Mapping[str, Any]) -> str:
    """A mapping as the text of a JSON file; numbers that are not finite become null."""
    return json.dumps(plain(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def plain(value: Any) -> Any:
    """A value as it is read back from JSON: what is not finite is None, what is a tuple a list."""
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return str.__str__(value) if isinstance(value, str) else value


def read_json(path: Path) -> Json:
    """The mapping of a JSON file; empty where there is none, or something else."""
    with contextlib.suppress(OSError, ValueError, RecursionError), open_regular(path) as file:
        return parse_json(file.read(LARGEST))
    return {}


def parse_json(content: bytes) -> Json:
    """The mapping that some JSON holds; an empty one in place of anything else.

    Raises:
        ValueError: it is no JSON, or has characters that no text can have, or an integer that no
            number of the machine can have.
        RecursionError: it is nested too deeply.
    """
    said = mapping(json.loads(content.decode(), parse_int=_integer))
    if b"\\u" in content:
        # Half a pair of surrogates, which can neither be printed nor written.
        json.dumps(said, ensure_ascii=False).encode()
    return said


def _integer(text: str) -> int:
    value = int(text)
    try:
        float(value)
    except OverflowError as error:
        raise ValueError(f"an integer of {len(text)} digits") from error
    return value


@contextlib.contextmanager
def as_written(path: Path) -> Iterator[None]:
    """What reads the values of a JSON file that has the right checksum, whoever has made that.

    Raises:
        InputError: a value is not of the type, or in the place, that this program writes.
    """
    try:
        yield
    except (InputError, OutputError):
        raise
    except (TypeError, LookupError, AttributeError, ValueError, ArithmeticError) as error:
        raise InputError(
            f"cannot read {path}: it is not as it was written ({type(error).__name__}: {error})"
        ) from error


def number(value: object) -> float | None:
    """A finite number of a JSON file that may hold anything, else None."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def mapping(value: object) -> Json:
    """A mapping of such a file, an empty one in place of anything else."""
    return value if isinstance(value, Mapping) else {}


def mappings(value: object) -> list[Json]:
    """The mappings of a list of such a file, none in place of anything else."""
    return [v for v in value if isinstance(v, Mapping)] if isinstance(value, list) else []
