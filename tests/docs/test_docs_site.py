"""The site: what is made for it, that every page has its place, and that two tools build it."""

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
    """A module of the site, as those beside it import it."""
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
    made = {"signals.md", "cli.md", "tasks/README.md", *collected.documents()}
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
    own = [*site["extra_css"], *site["extra_javascript"], script]  # type: ignore[misc]
    assert {Path(name).name for name in own} == {"site.css", "fitting.js", "iframe-worker.js"}
    assert not any("://" in text_of(DOCS / name) for name in own)
    assert "repo_url" not in site
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


def needs_a_browser() -> None:
    if browser_path() is None:
        pytest.skip("there is no browser")


#: Parts of a page that are wider than what holds them, or than the page.
CUT_OFF = """JSON.stringify([...document.querySelectorAll(
  'article pre code, article .formula, article table, article img, article h1, article h2')]
  .filter((e) => (e.clientWidth > 0 && e.scrollWidth > e.clientWidth + 1)
    || e.getBoundingClientRect().right > document.documentElement.clientWidth + 1)
  .map((e) => e.tagName + ': ' + e.textContent.slice(0, 40)))"""


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """The folder with the sources of the site and its configuration."""
    pytest.importorskip("latex2mathml", reason="the extra 'docs' is not installed")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, str(BUILDING / "pages.py"), str(folder)]
    subprocess.run(command, check=True, cwd=ROOT, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def site(sources):
    pytest.importorskip("mkdocs", reason="the extra 'docs' is not installed")
    return built("mkdocs", sources, "--quiet")


def built(tool: str, sources: Path, *options: str) -> Path:
    """The site as a tool builds it; a link that leads nowhere ends the test."""
    text = text_of(sources / "mkdocs.yml")
    (sources / f"{tool}.yml").write_text(
        text.replace("site_dir: site", f"site_dir: {tool}"), "utf-8"
    )
    command = [sys.executable, "-m", tool, "build", "--strict", *options, "-f", f"{tool}.yml"]
    done = subprocess.run(command, cwd=sources, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return sources / tool


def test_the_sources_have_a_page_for_each_code_and_each_task(sources, monkeypatch):
    collected = module("collected", monkeypatch)
    pages = {path.relative_to(sources / "pages").as_posix() for path in sources.rglob("*.md")}
    listed = re.findall(r"(?:: |- )(\S+\.md)$", text_of(sources / "mkdocs.yml"), re.M)
    assert sorted(listed) == sorted(pages)
    assert {f"tasks/{path.stem}.md" for path in collected.TASKS} <= pages


def test_sources_that_no_longer_belong_there_are_removed(sources, monkeypatch):
    pages = module("pages", monkeypatch)
    stale, kept = sources / "pages" / "gone.md", sources / "pages" / "cli.md"
    stale.write_text("# Gone\n", "utf-8")
    before = kept.stat().st_mtime_ns
    pages.write(sources)
    assert not stale.exists()
    assert kept.stat().st_mtime_ns == before


def test_another_tool_builds_the_same_site(sources, site):
    pytest.importorskip("zensical", reason="zensical is not installed")
    other = built("zensical", sources)
    pages = {path.relative_to(site) for path in site.rglob("*.html")}
    assert len(pages) > 300
    assert {path.relative_to(other) for path in other.rglob("*.html")} == pages
    formulas = [sum(text_of(at / page).count("<math") for page in pages) for at in (site, other)]
    assert formulas[0] == formulas[1] > 100


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_of_a_page_is_cut_off(site, width):
    needs_a_browser()
    pages = ["index", "conventions", "truth", "theory", "signals", "how-to/compare"]
    pages += [
        "chapter",
        "words",
        *(f"language/{name}" for name in ("index", "robot", "signals", "law", "paths", "trial")),
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


#: Types a word into the search of the open page and returns the first page that it finds.
FIRST_FOUND = """(async () => {
  const later = (time) => new Promise((done) => setTimeout(done, time));
  const field = document.querySelector('[data-md-component=search-query]');
  const toggle = document.querySelector('[data-md-toggle=search]');
  if (!toggle.checked) {
    toggle.click();
    field.dispatchEvent(new FocusEvent('focus'));
    await later(3000);
  }
  const link = () => document.querySelector('.md-search-result__link');
  const found = () => link()?.getAttribute('href') ?? '';
  for (const word of ['', WORD]) {
    field.value = word;
    field.dispatchEvent(new KeyboardEvent('keyup', {bubbles: true}));
    for (let i = 0; i < 100 && (found() === '') !== (word === ''); i++) await later(50);
  }
  return found();
})()"""


def test_words_of_the_field_find_the_page_that_helps(site, monkeypatch):
    """The first hit of a word is the page that its row on the page of words links first."""
    needs_a_browser()
    tags = module("words", monkeypatch).tags_of(text_of(DOCS / "words.md"))
    # Two words of each row; those of one page stand in the order of its rows.
    wanted = {word: page for page, words in tags.items() for word in words[:2]}
    assert len(wanted) >= 50
    wrong = {}
    with Browser(browser_path()) as browser:
        browser.size(1280, 900)
        browser.open(site / "index.html")
        for word, page in wanted.items():
            found = browser.run(FIRST_FOUND.replace("WORD", json.dumps(word)))
            expected = page.replace("README.md", "index.html").replace(".md", ".html")
            if expected not in found:
                wrong[word] = found
    assert wrong == {}


def test_words_that_newcomers_type_are_listed(monkeypatch):
    tags = module("words", monkeypatch).tags_of(text_of(DOCS / "words.md"))
    listed = [word for words in tags.values() for word in words]
    assert len(listed) == len(set(listed))
    typed = "chatter payload collision oscillates vibration bounce overshoot stiction singularity"
    typed += " gravity compliance admittance teach urdf gripper hardware ros"
    assert set(typed.split()) <= set(listed)
    assert all((DOCS / page).is_file() for page in tags)
