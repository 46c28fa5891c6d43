"""The site: what is made when it is built, and that every page has its place in it."""

from __future__ import annotations

import importlib
import inspect
import json
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
import yaml
from documents import CONVENTIONS, DOCUMENTS, ROOT, first_words, text_of

from browser import Browser, browser_path
from taskspec_runner.cli.app import app

DOCS = ROOT / "docs"
BUILDING = DOCS / "building"


def module(name: str, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A module of the site, as its hooks import it."""
    monkeypatch.syspath_prepend(str(BUILDING))
    return importlib.import_module(name)


def config() -> dict[str, object]:
    """The site's configuration; what calls Python in it stands for nothing."""

    class Loader(yaml.SafeLoader):
        pass

    Loader.add_multi_constructor("!!python/", lambda *_: None)
    Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda *_: None)
    return dict(yaml.load(text_of(ROOT / "mkdocs.yml"), Loader=Loader))


def in_navigation(entries: object) -> set[str]:
    if isinstance(entries, str):
        return {entries}
    inner = entries.values() if isinstance(entries, dict) else entries
    return set().union(*map(in_navigation, inner))  # type: ignore[arg-type]


def test_every_page_is_in_the_navigation(monkeypatch):
    collected = module("collected", monkeypatch)
    made = {"signals.md", "cli.md", "changelog.md", "contributing.md", "tasks/README.md"}
    written = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    codes = {page for page in written if re.fullmatch(r"diagnostics/TS\d+\.md", page)}
    assert in_navigation(config()["nav"]) == written - codes | made
    assert in_navigation(collected.diagnostics_nav()) == codes


def test_nothing_is_fetched_by_a_reader():
    """No font, script or style from elsewhere: the theme fetches fonts unless it is told not to."""
    site = config()
    theme = site["theme"]
    assert isinstance(theme, dict)
    assert theme["font"] is False
    # What makes search work from a disk is fetched, unless a script of this name is here.
    (script,) = site["extra"]["polyfills"]  # type: ignore[index]
    assert "offline" in site["plugins"]  # type: ignore[operator]
    assert "iframe-worker" in script
    assert (DOCS / script).is_file()
    assert not any("://" in text_of(BUILDING / name) for name in ("site.css", "iframe-worker.js"))
    assert not site.keys() & {"extra_javascript", "repo_url"}
    pages = "".join(map(text_of, DOCS.rglob("*.md")))
    # What stands in a block of code, such as a robot's file, is shown, not fetched.
    prose = re.sub(r"^```.*?^```", "", pages, flags=re.DOTALL | re.MULTILINE)
    assert "gives:" in prose
    assert not re.search(r"<(img|script|link|iframe)\b", prose)


def test_the_log_has_the_columns_that_are_plotted():
    (block,) = re.findall(
        r"^```python\n(.*?)^```$", text_of(DOCS / "how-to" / "export.md"), re.M | re.S
    )
    named = set(re.findall(r'"([a-z.]+)"', block)) - {"press"}
    columns = {word.replace("AXIS", "z") for word in first_words(CONVENTIONS, "table: columns")}
    assert {"clock", "force.z"} <= named <= columns
    assert "log.stage" in block


def test_pictures_are_there_and_are_shown():
    """Every picture of a page exists, and every picture that is kept is on a page.

    The page of a task has the pictures of its name, and the gallery the small one.
    """
    images = DOCS / "images"
    names = [path.stem for path in (ROOT / "tasks").glob("*.yaml")]
    shown = {images / f"{name}.svg" for name in names}
    shown |= {images / "tasks" / f"{name}{kind}" for name in names for kind in (".svg", ".webp")}
    kept = {p for p in images.rglob("*") if p.suffix in (".svg", ".png", ".webp")}
    shown &= kept
    for path in DOCUMENTS:
        for targets in re.findall(r"!\[[^\]]+\]\(([^)]+)\)|<img src=\"([^\"]+)\"", text_of(path)):
            shown.add((path.parent / "".join(targets)).resolve())
    assert kept == shown


def test_the_reference_has_every_command_and_option(monkeypatch):
    commands = module("commands", monkeypatch)
    page = commands.reference()
    for command in app.registered_commands:
        name = command.name or command.callback.__name__
        (section,) = re.findall(rf"^## taskspec {name}\n(.*?)(?=^## |\Z)", page, re.M | re.S)
        assert inspect.getdoc(command.callback) in section
        given = inspect.signature(inspect.unwrap(command.callback)).parameters
        rows = [row for row in section.splitlines() if row.startswith("| `")]
        assert len(rows) == len(given)
    (run,) = re.findall(r"^## taskspec run\n(.*?)(?=^## )", page, re.M | re.S)
    assert "| `--set` `KEY=VALUE` | Override a value; may be repeated. |  |" in run
    assert "| `--quiet`, `-q` | Print only what failed. |  |" in run
    assert "| `--seed` `INTEGER` | The seed of all random numbers. | `0` |" in run
    formats = "`text`, `json`, `junit`, `github`"
    assert f"| `--format` {formats} | The format of the outcome. | `text` |" in run


def test_tasks_and_tables_have_pages(monkeypatch):
    collected = module("collected", monkeypatch)
    pages = dict(collected.task_pages())
    for path in collected.TASKS:
        assert text_of(path).rstrip() in pages[f"tasks/{path.stem}.md"]
        assert f"[{path.stem}]({path.stem}.md)" in pages["tasks/README.md"]
    tables = collected.tables_page()
    assert "| `force_inconsistent` | `N` |" in tables
    assert "](#" not in tables


def test_links_to_files_of_the_repository_lead_into_the_site(monkeypatch):
    collected, links = module("collected", monkeypatch), module("links", monkeypatch)
    places = collected.places()
    for path in places:
        assert (ROOT / path).exists()
    text = "[a](../../tasks/ring.yaml) [b](hybrid.md#gains) [c](../../examples/press.py)\n"
    moved = links.within_site(f"{text}```text\n{text}```\n", "laws/constraints.md", places)
    there = "[a](../tasks/ring.md) [b](hybrid.md#gains) [c](../files/examples/press.py)\n"
    assert moved == f"{there}```text\n{text}```\n"


def test_no_link_leaves_the_site(monkeypatch):
    """What lies outside docs/ and is linked to, the site has a place for."""
    places = module("collected", monkeypatch).places()
    for path in DOCS.rglob("*.md"):
        text = re.sub(r"^```.*?^```$", "", text_of(path), flags=re.M | re.S)
        for target in re.findall(r"\]\(([^)#\s:]+)(?:#[^)]*)?\)", text):
            found = (path.parent / target).resolve()
            if not found.is_relative_to(DOCS):
                assert found.relative_to(ROOT).as_posix() in places, (path.name, target)


@pytest.mark.parametrize("path", sorted(DOCS.rglob("*.md")), ids=lambda path: path.name)
def test_lists_are_read_alike_everywhere(path: Path):
    """Where GitHub's Markdown and the site's differ.

    For the site a list begins after an empty line, and a paragraph of an item is four spaces in.
    """
    text = re.sub(r"^```.*?^```$", "```", text_of(path), flags=re.M | re.S)
    assert not re.search(r"^(?![ \-\d\n|]).+\n- ", text, re.M)
    assert not re.search(r"\n\n {1,3}\S", text)


def test_formulas_are_drawn_with_their_numbers(monkeypatch):
    pytest.importorskip("latex2mathml", reason="the extra 'docs' is not installed")
    formulas = module("formulas", monkeypatch)
    drawn = formulas.as_mathml("$$u = J^T (K_m e - D_m \\dot x) + g \\qquad (4.21)$$\n")
    assert drawn.startswith('<div class="formula"><div class="formula-parts"><math')
    assert '<span class="formula-number">(4.21)</span>' in drawn
    assert "4.21" not in drawn.rpartition("</math>")[0]
    # A line may end before each term.
    assert formulas.pieces("u = J^T (K_m e - D_m v) + g") == ["u ", "= J^T (K_m e - D_m v) ", "+ g"]
    assert drawn.count("<math") == 3
    block = "```text\n$$x$$\n```\n"
    assert formulas.as_mathml(block) == block
    found = 0
    for path in (DOCS / "laws").glob("*.md"):
        text = formulas.as_mathml(text_of(path))
        found += text.count("<math")
        assert "$$" not in text
        # A command that the converter does not know is left as it is written.
        assert not re.search(r"<m[ion][^>]*>\\", text), path.name
    assert found >= 30


#: Parts of a page that are wider than what holds them, or than the page.
CUT_OFF = """JSON.stringify([...document.querySelectorAll(
  'article pre code, article .formula, article table, article img, article h1, article h2')]
  .filter((e) => (e.clientWidth > 0 && e.scrollWidth > e.clientWidth + 1)
    || e.getBoundingClientRect().right > document.documentElement.clientWidth + 1)
  .map((e) => e.tagName + ': ' + e.textContent.slice(0, 40)))"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    pytest.importorskip("mkdocs", reason="the extra 'docs' is not installed")
    if browser_path() is None:
        pytest.skip("there is no browser")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    subprocess.run(command, check=True, cwd=ROOT, capture_output=True)
    return folder


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_of_a_page_is_cut_off(site, width):
    pages = ["index", "language", "conventions", "truth", "theory", "signals", "how-to/compare"]
    pages += [
        "chapter",
        *(f"laws/{path.stem}" for path in sorted((DOCS / "laws").glob("[!R]*.md"))),
    ]
    cut = {}
    with Browser(browser_path()) as browser:
        browser.size(width, 900, phone=width < 500)
        for page in pages:
            browser.open(site / f"{page}.html")
            found = json.loads(browser.run(CUT_OFF))
            if found:
                cut[page] = found
    assert cut == {}
