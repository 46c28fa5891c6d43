"""Folders of runs, comparisons and sweeps as one line each, newest first."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec_runner.compare.folder import PAGE as COMPARISON_PAGE
from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.record.folder import mapping, mappings, number, read_json
from taskspec_runner.record.manifest import override_words
from taskspec_runner.record.names import COMPARISON, MANIFEST, REPORT, SWEEP
from taskspec_runner.runs import Run
from taskspec_runner.sweep.folder import PAGE as SWEEP_PAGE
from taskspec_runner.sweep.summary import rate_text
from taskspec_runner.sweep.world_run import margin_of
from taskspec_runner.verdict.outcome import verdict

#: Verdicts of what came to its end as it was to.
GOOD = frozenset({"passed", "done"})
#: Verdicts that say nothing of the task.
OPEN = frozenset({"undecided", "unfinished", "damaged", "compared"})


@dataclass(frozen=True, slots=True)
class KeptFolder:
    """A folder with the outcome of a run, a comparison or a sweep.

    Attributes:
        path: the folder.
        kind: run, comparison or sweep.
        task: name of the task.
        variant: overrides and world, as on a command line; empty for the task as it is written.
        started: when; of a comparison and a sweep the time of its summary.
        verdict: a word, as `Verdict.kind`.
        why: a sentence.
        margin: the least share of what its expectations allow that was left, negative where one
            is missed; None where none has a margin.
        page: its report; None where there is none.
    """

    path: Path
    kind: str
    task: str
    variant: str
    started: datetime
    verdict: str
    why: str
    margin: float | None
    page: Path | None

    @property
    def good(self) -> bool | None:
        """Whether the task did what it is to do; None where that is open."""
        return None if self.verdict in OPEN else self.verdict in GOOD

    @property
    def label(self) -> str:
        """The task with what it was changed by."""
        return f"{self.task} {self.variant}".rstrip()

    @property
    def when(self) -> str:
        """The start in local time, to the second."""
        return self.started.astimezone().strftime("%Y-%m-%d %H:%M:%S")

    def as_data(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "folder": str(self.path),
            "kind": self.kind,
            "task": self.task,
            "variant": self.variant,
            "started": self.started.isoformat(),
            "verdict": self.verdict,
            "why": self.why,
            "margin": self.margin,
            "page": None if self.page is None else str(self.page),
        }


@dataclass(frozen=True, slots=True)
class TaskHistory:
    """All runs, or all sweeps, of a task with the same overrides.

    Attributes:
        label: the task with what it was changed by.
        kind: run or sweep.
        folders: oldest first; at least one.
    """

    label: str
    kind: str
    folders: Sequence[KeptFolder]

    @property
    def last(self) -> KeptFolder:
        """The newest one."""
        return self.folders[-1]

    @property
    def misses_since(self) -> KeptFolder | None:
        """The first of the newest that all missed; None where the newest decided one was good."""
        first = None
        for folder in reversed(self.folders):
            if folder.good:
                break
            if folder.good is False:
                first = folder
        return first

    @property
    def last_good(self) -> KeptFolder | None:
        """The newest good one."""
        return next((each for each in reversed(self.folders) if each.good), None)


def kept_folders(root: Path) -> list[KeptFolder]:
    """All below a folder, newest first; what is inside of one, such as a sweep's worlds, is not.

    Raises:
        InputError: there is no such folder.
    """
    if not root.is_dir():
        raise InputError(f"cannot read {root}: there is no such folder; `taskspec run` makes runs/")
    return sorted(_below(root), key=lambda each: (each.started, each.path), reverse=True)


def histories(folders: Sequence[KeptFolder]) -> list[TaskHistory]:
    """The folders of each task, the task with the newest one first.

    Args:
        folders: newest first.
    """
    found: dict[tuple[str, str], list[KeptFolder]] = {}
    for each in folders:
        if each.kind != "comparison":
            found.setdefault((each.label, each.kind), []).append(each)
    return [TaskHistory(label, kind, own[::-1]) for (label, kind), own in found.items()]


def _below(folder: Path) -> Iterator[KeptFolder]:
    kinds = {MANIFEST: _run, COMPARISON: _comparison, SWEEP: _sweep}
    for marker, read in kinds.items():
        if (folder / marker).is_file():
            yield read(folder)
            return
    try:
        entries = sorted(folder.iterdir())
    except OSError:
        return
    for entry in entries:
        if entry.is_dir() and not entry.is_symlink():
            yield from _below(entry)


def _run(folder: Path) -> KeptFolder:
    manifest = read_json(folder / MANIFEST)
    margin = None
    try:
        run = Run.load(folder)
        judged = verdict(run)
        kind, why = judged.kind, judged.sentence
        # What a run that broke off would have come to is not known.
        if kind in ("passed", "missed"):
            margins = [margin_of(each) for each in run.expectations]
            margin = min((each for each in margins if each is not None), default=None)
    except (InputError, OutputError) as error:
        kind, why = "damaged", str(error)
    changed = override_words(mapping(manifest.get("overrides")))
    world = mapping(manifest.get("world")).get("label")
    return KeptFolder(
        folder,
        "run",
        str(manifest.get("task") or folder.name),
        shlex.join([*changed, *(("--world", str(world)) if world else ())]),
        _time(manifest.get("started"), folder / MANIFEST),
        kind,
        why,
        margin,
        _page(folder, REPORT),
    )


def _comparison(folder: Path) -> KeptFolder:
    said = read_json(folder / COMPARISON)
    laws = [law for law in mappings(said.get("laws")) if number(law.get("rank")) is not None]
    ranked = sorted(laws, key=lambda law: number(law.get("rank")) or 0.0)
    why = "; ".join(f"{law['rank']} {law.get('law')}" for law in ranked[:3])
    return KeptFolder(
        folder,
        "comparison",
        str(said.get("task") or folder.name),
        "",
        _time(None, folder / COMPARISON),
        "compared",
        why,
        None,
        _page(folder, COMPARISON_PAGE),
    )


def _sweep(folder: Path) -> KeptFolder:
    said = read_json(folder / SWEEP)
    code = number(said.get("exit_code"))
    rate = mapping(said.get("success"))
    kind = "unfinished" if code is None else "missed" if code else "passed"
    try:
        why = rate_text(rate) if rate else "it did not come to its end"
    except (KeyError, TypeError, ValueError):
        kind, why = "damaged", f"{SWEEP} is not as it was written"
    return KeptFolder(
        folder,
        "sweep",
        str(said.get("task") or folder.name),
        shlex.join(override_words(mapping(said.get("overrides")))),
        _time(None, folder / SWEEP),
        kind,
        why,
        number(rate.get("share")),
        _page(folder, SWEEP_PAGE),
    )


def _page(folder: Path, name: str) -> Path | None:
    path = folder / name
    return path if path.is_file() else None


def _time(written: object, path: Path) -> datetime:
    """What a manifest says, else when the file was written."""
    if isinstance(written, str):
        try:
            found = datetime.fromisoformat(written)
        except ValueError:
            pass
        else:
            return found if found.tzinfo else found.replace(tzinfo=UTC)
    return datetime.fromtimestamp(path.stat().st_mtime, UTC)
