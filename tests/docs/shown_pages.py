"""Files and output that pages show, step by step: the blocks are those of the files and commands.

A page that leads a reader along has comments above its blocks, worked off from top to bottom in one
folder:

    <!-- task: tutorial/press-1.yaml as press.yaml -->         the whole file, laid into the folder
    <!-- part: tutorial/press-1.yaml as press.yaml -->         lines of it; it is laid there too
    <!-- output: taskspec validate press.yaml -->              the output of the command
    <!-- output: taskspec explain press.yaml | stage press --> only what stands below this heading;
                                                               several lead to one within another
Run this file to write the blocks anew after a change of wording; then read the difference.
"""

from __future__ import annotations

import re
import shlex
import tempfile
from collections.abc import Iterator
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path

from typer.testing import CliRunner

from taskspec_runner.cli import app

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"

_SHOWN = re.compile(
    r"^<!-- (?P<kind>task|part|output): (?P<what>.+?) -->\n"
    r"```(?P<language>\w+)\n(?P<text>.*?)^```$",
    re.M | re.S,
)
#: How fast a run goes is the machine's affair, and differs from run to run.
_PACE = re.compile(r"; [\d.e+]+ x real time")
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Shown:
    """A block of a page, what the comment above it says it is, and what it should be."""

    label: str
    kind: str
    what: str
    text: str
    fresh: str


def pages() -> list[Path]:
    """Every page with such blocks, the README of the repository among them."""
    paths = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
    return [path for path in paths if _SHOWN.search(path.read_text(encoding="utf-8"))]


def task_file(what: str) -> tuple[Path, str]:
    """The file of a `task` or `part`, and the name that the reader gives it."""
    path, _, name = what.partition(" as ")
    return DOCS / path, name or Path(path).name


def shown(path: Path, folder: Path) -> Iterator[Shown]:
    """Works a page off in an empty folder; a `part` that the file has is as it should be."""
    text = path.read_text(encoding="utf-8")
    for match in _SHOWN.finditer(text):
        kind, what, block = match["kind"], match["what"], match["text"]
        if kind == "output":
            fresh = said(what, folder)
        else:
            file, name = task_file(what)
            content = file.read_text(encoding="utf-8")
            (folder / name).write_text(content, encoding="utf-8")
            fresh = block if kind == "part" and block in content else content
        line = text.count("\n", 0, match.start()) + 1
        yield Shown(f"{path.relative_to(ROOT)}:{line}", kind, what, block, fresh)


def said(command: str, folder: Path) -> str:
    """A command and what it says in a folder, results and messages, or a section of that."""
    command, *headings = command.split(" | ")
    name, *arguments = shlex.split(command)
    assert name == "taskspec", command
    with chdir(folder):
        done = CliRunner().invoke(app, arguments, env={"COLUMNS": "120"}, prog_name=name)
    assert done.exit_code in (0, 1, 2, 4, 5, 6), done.output
    text = "".join(f"{line.rstrip()}\n" for line in _PACE.sub("", done.output).splitlines())
    for heading in headings:
        text = _section(text, heading)
    left_out = "...\n" if headings else ""
    return f"$ {command}\n{left_out}{text}"


def _section(text: str, heading: str) -> str:
    """The lines from one that begins so, to the next after an empty one that is no further in."""
    found = re.search(rf"^( *){re.escape(heading)}.*\n", text, re.M)
    if found is None:
        raise LookupError(f"no output below {heading!r}:\n{text}")
    end = re.compile(rf"^\n {{0,{len(found[1])}}}\S", re.M).search(text, found.end())
    return text[found.start() : end.start() if end else None]


def same(block: str, fresh: str, tolerance: float = 0.02) -> bool:
    """Whether two texts have the same words, and numbers that a machine may round differently."""
    if _NUMBER.split(block) != _NUMBER.split(fresh):
        return False
    pairs = zip(_NUMBER.findall(block), _NUMBER.findall(fresh), strict=True)
    return all(abs(float(a) - float(b)) <= tolerance * abs(float(b)) for a, b in pairs)


def _write() -> None:
    for path in pages():
        with tempfile.TemporaryDirectory() as folder:
            fresh = iter([block.fresh for block in shown(path, Path(folder))])
        text = path.read_text(encoding="utf-8")

        def anew(match: re.Match[str], fresh: Iterator[str] = fresh) -> str:
            before = match[0].removesuffix(f"{match['text']}```")
            return f"{before}{next(fresh)}```"

        path.write_text(_SHOWN.sub(anew, text), encoding="utf-8")


if __name__ == "__main__":
    _write()
