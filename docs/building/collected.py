"""Pages of the site that are made from the repository: tasks, tables, the changelog."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path

from taskspec.spec import load_task

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
LANGUAGE = DOCS / "language"
TASKS = sorted((ROOT / "tasks").glob("*.yaml"))

#: Tables of the language reference that one looks things up in, by the comments above them.
_TABLES = {
    "Signals": "table: signals",
    "Signals of objects": "table: object signals",
    "Units": "table: units",
    "Functions": "table: functions",
    "Reducers": "table: reducers",
    "Laws and their gains": "table: laws",
    "Designed gains": "table: designed",
    "Defaults": "table: defaults",
    "What people write first": "table: mistakes",
}


#: Documents outside docs/ that are pages of the site.
_DOCUMENTS = {
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "findings/README.md": "findings.md",
}
_LINK = re.compile(r"\]\((?P<to>[^)#:\s]*)(?P<anchor>#[^)]*)?\)")
#: A link from a page to a source file: code, or a test.
_SOURCE = re.compile(r"\]\((?:\.\./)+(?P<path>(?:taskspec|runner|tests)/[^)#\s]+\.py)\)")


def places() -> dict[str, str]:
    """Files of the repository that the site has, to where it has them."""
    files = [*(ROOT / "examples").iterdir(), *(ROOT / "tasks").glob("*.csv")]
    files += [*(ROOT / "tasks" / "robots").iterdir(), ROOT / "action.yml"]
    files += (ROOT / "findings").glob("*.sh")
    plain = [path.relative_to(ROOT).as_posix() for path in files if path.is_file()]
    plain += sorted({path for page in DOCS.rglob("*.md") for path in _sources(page)})
    pages = {f"tasks/{path.name}": f"tasks/{path.stem}.md" for path in TASKS}
    named = {"tasks": "tasks/README.md", "README.md": "README.md"}
    return {path: f"files/{path}" for path in plain} | pages | named | _DOCUMENTS


def _sources(page: Path) -> list[str]:
    return _SOURCE.findall(page.read_text(encoding="utf-8"))


def task_pages() -> Iterator[tuple[str, str]]:
    """A page for each shipped task, and the list of them: path and Markdown."""
    rows = []
    for path in TASKS:
        task = load_task(path).task
        about = " ".join((task.about or "").split())
        picture = f"[![{path.stem} as it starts](../images/tasks/{path.stem}.webp)]({path.stem}.md)"
        rows.append(f"- {picture}\n  **[{path.stem}]({path.stem}.md)** `{task.law.kind}`: {about}")
        yield f"tasks/{path.stem}.md", _task_page(path, about)
    yield "tasks/README.md", _INDEX + "\n".join(rows) + "\n\n</div>\n"


_INDEX = """\
# Example tasks

They come with the package, and all of them run and pass with every change. `taskspec new NAME`
copies one to begin from, with the files that it needs. The pictures are those of
`taskspec explain NAME.yaml --picture`: the arm as it starts, the near view with the frames of the
stages, in red what force and in blue what motion control decides, and the path.

<div class="gallery" markdown>

"""


def _task_page(path: Path, about: str) -> str:
    text = path.read_text(encoding="utf-8")
    lines = [f"# {path.stem}", "", about, ""]
    drawn = f"![{path.stem} before it runs: start, frames, path, and what each stage controls]"
    lines += [f"{drawn}(../images/tasks/{path.stem}.svg){{ .task }}", ""]
    if (DOCS / "images" / f"{path.stem}.svg").is_file():
        lines += [f"![What a run of {path.stem} recorded](../images/{path.stem}.svg)", ""]
    lines += [f"```sh\ntaskspec new {path.stem}\ntaskspec run my-{path.stem}.yaml\n```", ""]
    lines += [f'```yaml title="tasks/{path.name}"', text.rstrip(), "```", ""]
    return "\n".join(lines)


def tables_page() -> str:
    """The tables of the language reference on one page."""
    pages = {path: path.read_text(encoding="utf-8") for path in sorted(LANGUAGE.glob("*.md"))}
    lines = [_TABLES_HEAD]
    for heading, comment in _TABLES.items():
        marked = re.compile(rf"^<!-- {comment} -->\n((?:\|.*\n)+)", re.M)
        found = [(path, table) for path, text in pages.items() for table in marked.findall(text)]
        if len(found) != 1:
            raise LookupError(f"docs/language has not one table '{comment}' but {len(found)}")
        ((path, table),) = found
        here = f"{LANGUAGE.name}/{path.name}"
        lines += [
            f"## {heading}",
            "",
            f"From [the task language]({here}).",
            "",
            _moved(table, here),
        ]
    return "\n".join(lines)


def _moved(table: str, page: str) -> str:
    """A table of a page of docs/language, with links as they are one folder above."""

    def link(match: re.Match[str]) -> str:
        path = posixpath.normpath(f"{LANGUAGE.name}/{match['to']}") if match["to"] else page
        return f"]({path}{match['anchor'] or ''})"

    return _LINK.sub(link, table)


_TABLES_HEAD = """\
# Signals, units, functions

These are the tables of [the task language](language/README.md) that one looks things up in. The
pages that they come from explain them, and tests check each of them against the code.
"""


def documents() -> dict[str, str]:
    """Documents that lie outside docs/, as pages at the top of the site."""
    return {to: _at_the_top(path) for path, to in _DOCUMENTS.items()}


def _at_the_top(path: str) -> str:
    """A document of the repository with its links as a page in docs/ writes them."""

    def link(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(path), match["to"]))
        return f"]({posixpath.relpath(target, DOCS.name)}{match['anchor'] or ''})"

    return _LINK.sub(link, (ROOT / path).read_text(encoding="utf-8"))


def diagnostics_nav() -> list[dict[str, object]]:
    """The pages of the codes by family, for the navigation."""
    text = (DOCS / "diagnostics" / "README.md").read_text(encoding="utf-8")
    parts = re.split(r"^## (.+)\n", text, flags=re.M)
    families = zip(parts[1::2], parts[2::2], strict=True)
    return [
        {family: [{code: f"diagnostics/{code}.md"} for code in re.findall(r"\| \[(TS\d+)\]", body)]}
        for family, body in families
    ]
