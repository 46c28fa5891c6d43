"""What mkdocs asks for while it builds the site: made pages, navigation, links, formulas."""

from __future__ import annotations

from typing import Any

import collected
import commands
from fences import dressed
from fitting import fitted
from formulas import as_mathml
from links import within_site
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

_PLACES = collected.places()


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Lays the pages of the diagnostic codes and of the tasks into the navigation."""
    tasks = [f"tasks/{path.stem}.md" for path in collected.TASKS]
    below = {
        "Diagnostics": collected.diagnostics_nav(),
        "Example tasks": [{path.removeprefix("tasks/")[:-3]: path} for path in tasks],
    }
    for section in config.nav or []:
        (pages,) = section.values()
        for entry in pages if isinstance(pages, list) else ():
            for title in below.keys() & (entry.keys() if isinstance(entry, dict) else set()):
                entry[title] = [entry[title], *below[title]]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages that are made and the files that pages link to."""
    made = dict(collected.task_pages())
    made["signals.md"] = collected.tables_page()
    made["cli.md"] = commands.reference()
    made["changelog.md"] = collected.changelog()
    made["contributing.md"] = collected.contributing()
    for path, text in made.items():
        files.append(File.generated(config, path, content=text))
    for path, place in _PLACES.items():
        if place.startswith("files/"):
            source = str(collected.ROOT / path)
            files.append(File.generated(config, place, abs_src_path=source))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Turns what the repository's pages write into what the site can show."""
    if page.is_homepage:
        page.meta["hide"] = ["navigation", "toc"]
    return as_mathml(dressed(within_site(markdown, page.file.src_uri, _PLACES)))


def on_page_content(content: str, **_: Any) -> str:
    """Says of every block how wide it is."""
    return fitted(content)
