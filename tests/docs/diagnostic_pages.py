"""The pages of the diagnostic codes: their parts, and the findings about their files.

Run this file to write the findings of the bad files anew, and the index, after a change of wording;
then read the difference.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from taskspec.spec import load_task
from taskspec.text.codes import CODES
from taskspec.text.diagnostic import Diagnostic, SpecError
from taskspec.text.render import render
from taskspec.text.source import Source
from taskspec_runner.trial.check import check

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "diagnostics"
INDEX = FOLDER / "README.md"
PAGES = sorted(FOLDER.glob("TS*.md"))

FAMILIES = {
    "TS0": "Text and shape of the file",
    "TS1": "Names, units, expressions",
    "TS2": "Axes, laws, frames",
    "TS3": "Contact and objects",
    "TS4": "Robots, reach, sensors",
    "TS5": "Stability",
    "TS6": "Stages",
    "TS7": "Expectations and variation",
}

_HEAD = re.compile(r"# (TS\d{3}): (.+)\n\n\*\*Severity:\*\* (.+)\.\n\n")
_BLOCK = re.compile(
    r"(?:^`(?P<file>[^`]+)`:\n\n)?^```(?P<kind>\w+)\n(?P<text>.*?)^```$", re.M | re.S
)
_SET = "# --set "


@dataclass(frozen=True)
class Example:
    """A task, the files beside it, and the findings about it."""

    task: str
    files: dict[str, str]
    findings: str


@dataclass(frozen=True)
class Page:
    """A page: the code, its title and severities, and its two examples if it has any."""

    path: Path
    code: str
    title: str
    severities: tuple[str, ...]
    examples: dict[str, Example]


def page(path: Path) -> Page:
    text = path.read_text(encoding="utf-8")
    head = _HEAD.match(text)
    assert head is not None, f"{path.name}: a page begins with its title and severity"
    sections = re.split(r"^## (\w+)\n", text, flags=re.M)[1:]
    examples = {
        name.lower(): _example(body)
        for name, body in zip(sections[::2], sections[1::2], strict=True)
    }
    return Page(path, head[1], head[2], tuple(head[3].split(", or ")), examples)


def _example(body: str) -> Example:
    found = [(m["file"], m["kind"], m["text"]) for m in _BLOCK.finditer(body)]
    (task,) = (text for file, kind, text in found if kind == "yaml" and file is None)
    findings = "".join(text for file, kind, text in found if kind == "text")
    return Example(task, {file: text for file, _, text in found if file}, findings)


def diagnostics_of(
    example: Example, name: str, folder: Path
) -> tuple[tuple[Diagnostic, ...], dict[str, Source]]:
    """Return what `validate` finds in an example that is laid into an empty folder."""
    for file, text in example.files.items():
        (folder / file).write_text(text, encoding="utf-8")
    path = folder / name
    path.write_text(example.task, encoding="utf-8")
    lines = example.task.splitlines()
    sets = [line.removeprefix(_SET) for line in lines if line.startswith(_SET)]
    try:
        loaded = load_task(path, dict(pair.split("=", 1) for pair in sets))
    except SpecError as error:
        return error.diagnostics, dict(error.sources)
    return check(loaded).findings, dict(loaded.sources)


def shown_of(found: tuple[Diagnostic, ...], sources: dict[str, Source], folder: Path) -> str:
    """Return how a page shows what is found in an example, independent of where it lies."""
    return render(found, sources).replace(f"{folder}/", "") + "\n"


def index() -> str:
    """Return the lists of codes, one table for each family."""
    return "\n".join(_index())


def _index() -> Iterator[str]:
    for family, heading in FAMILIES.items():
        pages = [page(path) for path in PAGES if path.stem.startswith(family)]
        if pages:
            yield f"## {heading}\n\n| code | severity | what is wrong |\n| --- | --- | --- |"
            for p in pages:
                severities = ", or ".join(p.severities)
                yield f"| [{p.code}]({p.path.name}) | {severities} | {p.title} |"
            yield ""


def _write() -> None:
    for path in PAGES:
        if "bad" not in (examples := page(path).examples):
            continue
        with tempfile.TemporaryDirectory() as folder:
            found, sources = diagnostics_of(examples["bad"], "bad.yaml", Path(folder))
            new = shown_of(found, sources, Path(folder))
        text = path.read_text(encoding="utf-8")
        block = re.compile(r"^```text\n.*?^```$", re.M | re.S)
        text = block.sub(lambda _: f"```text\n{new}```", text, count=1)  # noqa: B023
        path.write_text(text, encoding="utf-8")
    head = INDEX.read_text(encoding="utf-8").partition("## ")[0] if INDEX.exists() else ""
    INDEX.write_text(head + index(), encoding="utf-8")


if __name__ == "__main__":
    assert CODES
    _write()
