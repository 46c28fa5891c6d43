"""Whether a run's folder holds what the run wrote, file by file and batch by batch.

The manifest has a checksum of itself, of the task file, of the summary and of the log; each batch
of the log has one of its own. What is not as it was written is named, and not used.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

from taskspec.regular_file import open_regular
from taskspec.text.yaml import MAX_BYTES
from taskspec_runner.errors import InputError
from taskspec_runner.record.block import LeftTicks, read_block
from taskspec_runner.record.extent import ENDED
from taskspec_runner.record.folder import (
    LARGEST,
    Json,
    RunFolder,
    mapping,
    parse_json,
)
from taskspec_runner.record.log import LogReader
from taskspec_runner.record.manifest import FORMAT, SEAL, run_mark, seal
from taskspec_runner.record.names import BLOCK, LOG, MANIFEST, SUMMARY, TASK

_UNSEALED = 1


class Evidence:
    """The files of a run's folder, as far as they are what the run wrote."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @cached_property
    def _manifest(self) -> tuple[Json, str]:
        """The manifest, empty where it is not as it was written, and what is wrong with it."""
        content, wrong = self._read(MANIFEST)
        if content is None:
            return {}, wrong or f"{MANIFEST} is missing"
        try:
            said = parse_json(content)
        except (ValueError, RecursionError):
            said = {}
        number = said.get("format")
        if isinstance(number, int) and number > FORMAT:
            raise InputError(
                f"cannot read {self.folder}: a newer taskspec made it (format {number}, this one "
                f"reads up to {FORMAT})"
            )
        if number == _UNSEALED and SEAL not in said:
            return said, ""
        if not said or said.get(SEAL) != seal(said):
            return {}, f"{MANIFEST} was altered: it is not as the run wrote it"
        return said, ""

    @property
    def manifest(self) -> Json:
        """The content of the manifest.

        Raises:
            InputError: a newer version wrote it.
        """
        return self._manifest[0]

    @property
    def ended(self) -> bool:
        """Whether the run came to its end, so that its log is complete."""
        return self.manifest.get("status") in ENDED

    @cached_property
    def task(self) -> bytes:
        """The task file, also an altered one as far as a task may be long; empty without one."""
        return (self._read(TASK)[0] or b"")[:MAX_BYTES]

    @cached_property
    def task_damage(self) -> str:
        """The damage of the task file; empty if it has none."""
        content, wrong = self._read(TASK)
        unwritten = mapping(self.manifest.get("unwritten")).get("file")
        if content is None and (unwritten == TASK or not self._sum(TASK)):
            # There was no room for it, which the manifest says.
            return ""
        return self._held(TASK, content, wrong)

    @cached_property
    def _summary(self) -> tuple[Json, str]:
        """The summary, empty where it is not the one that was judged, and what is wrong with it."""
        content, wrong = self._read(SUMMARY)
        if not self._sum(SUMMARY):
            # Of a run that was not judged; what there is was put there by somebody else.
            early = self.ended and self.manifest.get("format") == _UNSEALED
            reason = f"an earlier taskspec made it, which kept no checksum of {SUMMARY}"
            return {}, f"{reason}; taskspec judge says what its log comes to" if early else ""
        wrong = self._held(SUMMARY, content, wrong)
        if wrong or content is None:
            return {}, wrong
        try:
            return parse_json(content), ""
        except (ValueError, RecursionError) as error:
            return {}, f"{SUMMARY} cannot be read: {error}"

    @property
    def summary(self) -> Json:
        """The content of the summary that was judged; empty without one."""
        return self._summary[0]

    def log(self) -> LogReader:
        """The log.

        Raises:
            OSError: there is none, or it is no regular file.
        """
        sealed = SEAL in self.manifest
        path, mark = self.folder / LOG, run_mark(self.manifest) if sealed else None
        last: str | None = str(self._log_facts.get("sha256_of_batches") or "") or None
        if self.log_is_whole:
            last = ""
        elif self.left is not None:
            last = self.left.sha256 or None
        return LogReader(path, run=mark, last=last)

    @property
    def _log_facts(self) -> Json:
        return mapping(self.manifest.get("log"))

    @cached_property
    def left(self) -> LeftTicks | None:
        """Ticks that a killed run had not brought into its log."""
        return None if self.ended else read_block(self.folder / BLOCK)

    @cached_property
    def log_is_whole(self) -> bool:
        """Whether the log is, byte by byte, that of a run that has ended."""
        written, size = self._sum(LOG), self._log_facts.get("bytes")
        try:
            # What has another size need not be read to its end.
            if size is not None and (self.folder / LOG).stat().st_size != size:
                return False
            return bool(written) and RunFolder(self.folder).digest(LOG) == written
        except OSError:
            return False

    @cached_property
    def log_damage(self) -> str:
        """The damage of the log; empty if it has none."""
        whole = self.ended and self.log_is_whole
        try:
            reader = self.log()
            for _ in reader:
                if whole:
                    # Its bytes are those of the manifest; that it is of this run is in each batch.
                    break
        except FileNotFoundError:
            # A run that was stopped, or killed, before its first batch has none.
            return f"{LOG} is missing" if self._sum(LOG) or self._first else ""
        except OSError as error:
            return f"{LOG} cannot be read: {error.strerror or error}"
        if whole:
            return reader.damage
        if not self.ended:
            return self._killed(reader)
        if reader.damage and not reader.cut:
            return reader.damage
        ticks = self._log_facts.get("ticks")
        if reader.cut or (isinstance(ticks, int) and reader.ticks < ticks):
            of = f" of {ticks}" if isinstance(ticks, int) else ""
            return f"{LOG} was cut short: it ends after {reader.ticks}{of} ticks"
        if not self._sum(LOG):
            return "" if not reader.ticks else f"{MANIFEST} has no checksum of {LOG}"
        return f"{LOG} was altered: its SHA-256 is not the one in {MANIFEST}"

    @property
    def _first(self) -> int:
        return self.left.first if self.left is not None else 0

    def _killed(self, reader: LogReader) -> str:
        if reader.damage and not reader.cut:
            return reader.damage
        if reader.ticks < self._first:
            return f"{LOG} was cut short: it ends after {reader.ticks} of {self._first} ticks"
        return self.left.damage if self.left is not None else ""

    def damage(self) -> str:
        """The damage of the manifest, else of log, summary and task file; empty if none."""
        if wrong := self._manifest[1]:
            return wrong
        found = (self.log_damage, self._summary[1], self.task_damage)
        return "; ".join(text for text in found if text)

    @cached_property
    def changed(self) -> tuple[str, ...]:
        """Files that the task draws on and that are no longer as the run read them."""
        return tuple(self._changed())

    def _changed(self) -> Iterator[str]:
        origin = self.manifest.get("file")
        base = Path(origin).parent if isinstance(origin, str) else Path()
        for name, digest in mapping(self.manifest.get("inputs")).items():
            try:
                with open_regular(base / name) as file:
                    same = hashlib.file_digest(file, "sha256").hexdigest() == digest
            except (OSError, ValueError):
                # It is not on this machine, which says nothing of the run.
                continue
            if not same:
                yield name

    def _sum(self, name: str) -> str:
        return str(mapping(self.manifest.get("sha256")).get(name) or "")

    def _held(self, name: str, content: bytes | None, wrong: str) -> str:
        """What is wrong with a file that is to have the checksum of the manifest."""
        if content is None:
            return wrong or f"{name} is missing"
        if not self.manifest or hashlib.sha256(content).hexdigest() == self._sum(name):
            return ""
        return f"{name} was altered: it is not as the run wrote it"

    def _read(self, name: str) -> tuple[bytes | None, str]:
        """The content of a file, None where it cannot be read, and why."""
        try:
            with open_regular(self.folder / name) as file:
                return file.read(LARGEST), ""
        except FileNotFoundError:
            return None, ""
        except OSError as error:
            return None, f"{name} cannot be read: {error.strerror or error}"
