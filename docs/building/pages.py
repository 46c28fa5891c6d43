"""Writes the site's sources: the pages of docs/ as a site shows them, and those that are made.

`python docs/building/pages.py build` writes `build/pages` and `build/mkdocs.yml`. Any generator
that reads a `mkdocs.yml` builds the site from these two: no code of this project runs in it. With
`--watch` behind it, it goes on and writes again what has changed.
"""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import collected
import commands
import yaml
from fences import dressed
from formulas import as_mathml
from links import within_site
from words import tags_of

ROOT, DOCS = collected.ROOT, collected.DOCS
#: What the search is to show last: pages of measurements and of the project, which name everything.
_LAST = {"changelog.md", "architecture.md", "contributing.md", "truth.md", "chapter.md", "field.md"}


def sources() -> dict[str, str | Path]:
    """Every file of the site's sources, by its path there: a text, or a file to copy."""
    places = collected.places()
    plain = [path for path in DOCS.rglob("*") if path.is_file() and path.suffix != ".pyc"]
    found: dict[str, str | Path] = {
        path.relative_to(DOCS).as_posix(): path for path in plain if path.suffix != ".py"
    }
    found |= {to: ROOT / path for path, to in places.items() if to.startswith("files/")}
    texts = {to: path.read_text("utf-8") for to, path in found.items() if _is_page(to, path)}
    texts |= dict(collected.task_pages())
    texts["signals.md"] = collected.tables_page()
    texts["cli.md"] = commands.reference()
    texts |= collected.documents()
    tags = tags_of(texts["words.md"])
    return found | {to: page(to, text, places, tags.get(to, ())) for to, text in texts.items()}


def _is_page(to: str, path: object) -> bool:
    return isinstance(path, Path) and to.endswith(".md") and not to.startswith("files/")


def page(to: str, text: str, places: Mapping[str, str], tags: tuple[str, ...]) -> str:
    """A page as the site has it: links within the site, titles of blocks, formulas as MathML."""
    meta: dict[str, object] = {}
    if to == "README.md":
        meta["hide"] = ["navigation", "toc"]
    if tags:
        meta["tags"] = list(tags)
    if to in _LAST:
        meta["search"] = {"boost": 0.2}
    head = f"---\n{yaml.safe_dump(meta, sort_keys=False)}---\n\n" if meta else ""
    return head + as_mathml(dressed(within_site(text, to, places)))


def configuration() -> str:
    """mkdocs.yml as it stands beside the pages, with a page for each code and each task."""
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    text, folders = re.subn(r"^(docs_dir|site_dir): build/", r"\1: ", text, flags=re.M)
    below = {
        "diagnostics/README.md": collected.diagnostics_nav(),
        "tasks/README.md": [{path.stem: f"tasks/{path.stem}.md"} for path in collected.TASKS],
    }
    for index, pages in below.items():
        entry = re.compile(rf"^(?P<margin> *)(?P<title>- .+:) {re.escape(index)}$", re.M)
        (match,) = entry.finditer(text)
        lines = yaml.safe_dump([index, *pages], sort_keys=False).splitlines()
        inner = "".join(f"\n{match['margin']}    {line}" for line in lines)
        text = (
            f"{text[: match.start()]}{match['margin']}{match['title']}{inner}{text[match.end() :]}"
        )
    if folders != 2:
        raise LookupError("mkdocs.yml has no docs_dir or site_dir below build/")
    return text


def write(build: Path) -> None:
    """Writes what is missing or differs, and removes what no longer belongs there.

    Args:
        build: the folder that gets the pages, as `pages`, and `mkdocs.yml`.
    """
    folder = build / "pages"
    wanted = sources()
    for path in [path for path in folder.rglob("*") if path.is_file()]:
        if path.relative_to(folder).as_posix() not in wanted:
            path.unlink()
    for to, content in [*wanted.items(), ("../mkdocs.yml", configuration())]:
        data = content.read_bytes() if isinstance(content, Path) else content.encode()
        path = folder / to
        if not path.is_file() or path.read_bytes() != data:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)


def _changed() -> dict[Path, float]:
    files = [*DOCS.rglob("*"), *(ROOT / "tasks").iterdir(), *ROOT.glob("*.md"), ROOT / "mkdocs.yml"]
    return {path: path.stat().st_mtime for path in files if path.is_file()}


if __name__ == "__main__":
    target, *options = sys.argv[1:]
    write(Path(target))
    before = _changed()
    while "--watch" in options:
        time.sleep(1)
        if (now := _changed()) != before:
            write(Path(target))
            before = now
