"""What was found about a task file, kept by all that it follows from.

It follows from the text of the file and how it is named, from overrides, from files that the task
names, from this package and the libraries beside it. The first ones are a key. Which files a task
names nobody knows before it is read, so these lie with what was found, by their content, and are
looked at again. Nothing of this needs the models of the language or a numerical library.

Files that cannot be read as a task, or have no robot, are not kept: little is examined of them.
"""

from __future__ import annotations

import hashlib
import os
import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from taskspec.deferred_methods import dataclass
from taskspec.store import Store, cache_folder, digest_of
from taskspec.text.confines import VARIABLE, project
from taskspec.text.diagnostic import Diagnostic
from taskspec.text.source import Source

if TYPE_CHECKING:
    from pydantic import TypeAdapter

    from taskspec.examined import Examination

_LIMIT = 64 * 1024 * 1024
_PACKAGE = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class KeptFindings:
    """What was found about a file.

    Attributes:
        findings: as an examination has them.
        texts: that places refer to, by name.
        files: SHA-256 of what the task names, None of what was not there; by path, links followed.
    """

    findings: tuple[Diagnostic, ...]
    texts: Mapping[str, str]
    files: Mapping[str, str | None]

    @property
    def sources(self) -> dict[str, Source]:
        """The texts that places refer to, by name."""
        return {name: Source(name, text) for name, text in self.texts.items()}


def findings_key(path: Path, options: Sequence[str], makers: Sequence[Path] = ()) -> str | None:
    """The key of what is found about a file; None where that cannot be read.

    Args:
        path: the file as it was named.
        options: overrides and whatever else changes what is found, in their order.
        makers: folders of further packages that it follows from.
    """
    digest = digest_of(path)
    if digest is None:
        return None
    made = [fact for maker in makers for fact in sorted(_facts(maker))]
    named = (str(path), os.path.realpath(path), str(project(path.parent)))
    return repr((_made_by(), made, os.environ.get(VARIABLE), named, digest, *options))


def known_findings(key: str) -> KeptFindings | None:
    """What is kept under a key, None where there is nothing or a file that it names has changed."""
    data = _store().get(key)
    if data is None:
        return None
    try:
        found = _form().validate_json(data)
    except ValueError:
        # What cannot be read is found anew; it is nothing that this version has written.
        return None
    if any(digest_of(Path(path)) != digest for path, digest in found.files.items()):
        return None
    return found


def keep_findings(key: str, examined: Examination) -> None:
    """Keeps what was found, under the key that the file had before it was read.

    A robot that a program expands, or that comes with a package, has files that nobody can name.
    """
    if examined.plan is None:
        return
    from taskspec.program.inputs import input_files
    from taskspec.robot.packages import is_packaged

    context = examined.plan.context
    if context.robot.absent is None or is_packaged(context.loaded.task.robot.model):
        return
    files = {os.path.realpath(path): digest for path, digest in input_files(context).items()}
    texts = {name: source.text for name, source in examined.loaded.sources.items()}
    _store().put(key, _form().dump_json(KeptFindings(examined.findings, texts, files)))


@cache
def _form() -> TypeAdapter[KeptFindings]:
    """As text, of which nothing is ever executed."""
    from pydantic import TypeAdapter

    return TypeAdapter(KeptFindings)


def _store() -> Store:
    return _store_in(cache_folder())


@cache
def _store_in(folder: Path | None) -> Store:
    """One for all files: it looks through its folder when it has put much."""
    return Store(None if folder is None else folder / "findings", limit=_LIMIT)


@cache
def _made_by() -> tuple[str, ...]:
    """This package, the distributions beside it and the interpreter.

    The package goes by names, sizes and times of its files: to read them all takes longer than to
    read a task. A distribution's version is in the name of its folder.
    """
    installed: set[str] = set()
    for folder in sys.path:
        try:
            entries = os.scandir(folder or ".")
        except OSError:
            continue
        with entries:
            installed.update(entry.name for entry in entries if entry.name.endswith("-info"))
    whole = "\n".join((*sorted(_facts(_PACKAGE)), *sorted(installed)))
    return (
        hashlib.sha256(whole.encode()).hexdigest(),
        f"{sys.implementation.name} {platform.python_version()} {sys.platform}",
        platform.machine(),
    )


def _facts(folder: Path | str) -> Iterator[str]:
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir():
                if entry.name != "__pycache__":
                    yield from _facts(entry.path)
            else:
                yield _fact(entry.stat(), entry.path)


def _fact(found: os.stat_result, path: str) -> str:
    return f"{path} {found.st_size} {found.st_mtime_ns}"
