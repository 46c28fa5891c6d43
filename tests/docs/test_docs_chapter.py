"""The walk through the chapter: no number is missing, and what each row links to is there."""

from __future__ import annotations

import ast
import importlib
import re
from collections import Counter
from dataclasses import dataclass
from functools import cache

import pytest
from documents import ROOT, TASKS, text_of

from taskspec.laws import LAWS
from taskspec.laws.law import ControlLaw
from taskspec.spec import load_task

PAGE = ROOT / "docs" / "chapter.md"
LAW_PAGES = ROOT / "docs" / "laws"
THEORY = ROOT / "docs" / "theory.md"

_NUMBERS = re.compile(r"\(4\.(\d+)\)(?:[-–]\(4\.(\d+)\))?")
_CODE = re.compile(r"\[`(?P<name>[\w.]+)`\]\(\.\./(?P<path>[\w/]+\.py)\)")
_TASK = re.compile(
    r"\[`(?P<name>[\w-]+)`\]\(\.\./tasks/(?P<file>[\w-]+)\.yaml\) \(`(?P<law>[\w-]+)`\)"
)
_THEORY = re.compile(
    r"\[(?P<equation>[^`\[]*), `(?P<what>[^`]+)`\]\(theory\.md#(?P<section>[\w-]+)\)"
)
_LAW_PAGE = re.compile(r"\[`(?P<law>[\w-]+)`\]\(laws/(?P<file>[\w-]+)\.md\)")
#: With what a cell begins that has no link.
_ABSENT = {"code": ("no function", "not there"), "task": "none", "test": "none", "theory": "none"}


@dataclass(frozen=True)
class Row:
    """A row of the page, cell by cell."""

    number: str
    what: str
    code: str
    task: str
    test: str
    theory: str

    @property
    def laws(self) -> set[str]:
        """Names of the laws whose page or class it links to."""
        found = {match["law"] for match in _LAW_PAGE.finditer(self.what)}
        for match in _CODE.finditer(self.code):
            if match["path"].startswith("taskspec/laws/"):
                module = importlib.import_module(match["path"][:-3].replace("/", "."))
                owner = getattr(module, match["name"].partition(".")[0])
                if isinstance(owner, type) and issubclass(owner, ControlLaw):
                    found.add(owner.kind)
        return found


def numbers(text: str) -> list[int]:
    """All equation numbers in a text, those of ranges one by one."""
    found = []
    for first, last in _NUMBERS.findall(text):
        found += range(int(first), int(last or first) + 1)
    return found


@cache
def rows() -> tuple[Row, ...]:
    parts = re.findall(r"^<!-- table: chapter -->\n((?:\|.*\n)+)", text_of(PAGE), re.M)
    lines = [line for part in parts for line in part.splitlines()[2:]]
    found = tuple(Row(*(c.strip() for c in line.strip("| ").split(" | "))) for line in lines)
    assert len(found) > 70
    return found


@cache
def defined(path: str) -> frozenset[str]:
    """Functions, classes and methods at the top of a file."""
    found = set()
    for node in ast.parse(text_of(ROOT / path)).body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found.add(node.name)
        if isinstance(node, ast.ClassDef):
            found |= {
                f"{node.name}.{inner.name}"
                for inner in node.body
                if isinstance(inner, ast.FunctionDef)
            }
    return frozenset(found)


def test_every_equation_has_its_row_in_order():
    assert [n for row in rows() for n in numbers(row.number)] == [*range(1, 129)]


def test_so_has_every_statement_that_is_no_equation():
    text = "\n".join(row.number for row in rows())
    statements = re.findall(r"^((?:Property|Lemma|Theorem) 4\.\d)", text, re.M)
    assert Counter(statements) == dict.fromkeys(
        ("Property 4.1", "Property 4.2", "Property 4.3", "Lemma 4.1", "Theorem 4.1"), 1
    )
    remarks = re.findall(r"^Remark (\d) of (4\.\d\.\d)", text, re.M)
    lists = {"4.1.3": 2, "4.2.1": 4, "4.2.2": 2, "4.3.2": 3}
    assert remarks == [(str(i + 1), at) for at, count in lists.items() for i in range(count)]
    assert "eleven remarks" in text_of(PAGE)
    assert len(remarks) == 11
    assert len(re.findall(r"^Example: ", text, re.M)) == 4


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.number)
def test_no_cell_is_empty(row):
    cells = {
        name: getattr(row, name) for name in ("number", "what", "code", "task", "test", "theory")
    }
    for name, cell in cells.items():
        assert re.search(r"\w", cell), name
        if name in _ABSENT:
            assert "](" in cell or cell.startswith(_ABSENT[name]), (name, cell)


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.number)
def test_what_it_links_to_is_there(row):
    for name in ("code", "test"):
        cell = getattr(row, name)
        links = [*_CODE.finditer(cell)]
        # Each link to a file is one that is understood here.
        assert len(links) == cell.count(".py)"), cell
        for link in links:
            assert (ROOT / link["path"]).is_file(), link["path"]
            assert link["name"] in defined(link["path"]), link["name"]
            assert name == "code" or (
                link["path"].startswith("tests/") and link["name"].startswith("test_")
            )
    assert not _CODE.search(row.what + row.task + row.theory)


def laws_of(task: str) -> set[str]:
    """The laws of a shipped task's stages."""
    found = load_task(TASKS / f"{task}.yaml").task
    kinds = {stage.law.kind for stage in found.stages.values() if stage.law is not None}
    every = all(stage.law is not None for stage in found.stages.values())
    return kinds if every else kinds | {found.law.kind}


def test_tasks_are_shipped_and_have_the_law_that_stands_with_them():
    page = text_of(PAGE)
    found = [*_TASK.finditer(page)]
    assert len(found) == page.count(".yaml)")
    assert len(found) > 40
    used = {match["name"]: laws_of(match["name"]) for match in found}
    for match in found:
        assert match["name"] == match["file"]
        assert match["law"] in used[match["name"]], match[0]
    assert {match["law"] for match in found} == LAWS.keys()


def test_a_row_of_a_law_has_tasks_of_that_law():
    of_laws = [row for row in rows() if row.laws]
    assert {law for row in of_laws for law in row.laws} == LAWS.keys()
    for row in of_laws:
        assert {match["law"] for match in _TASK.finditer(row.task)} <= row.laws, row.number


@pytest.mark.parametrize("law", LAWS)
def test_equations_of_a_law_have_rows_that_lead_to_it(law):
    own = numbers(LAWS[law].equations)
    # The text has laws that command torques alone: others have a row that says so.
    assert bool(own) == (LAWS[law].commands == "torque")
    unnumbered = [row for row in rows() if row.number.startswith("No equation: ")]
    assert [law in row.laws for row in unnumbered].count(True) == (0 if own else 1)
    for number in own:
        (row,) = (row for row in rows() if number in numbers(row.number))
        assert law in row.laws, number
    pages = [match for row in rows() for match in _LAW_PAGE.finditer(row.what)]
    assert law in {match["law"] for match in pages}
    assert all(match["law"] == match["file"] for match in pages)


def slug(title: str) -> str:
    """The anchor of a heading, as the site makes it."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def test_rows_of_the_predictions_are_there():
    sections = re.split(r"^## (.+)\n", text_of(THEORY), flags=re.M)[1:]
    known, counted = {}, set()
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        lines = [line.strip("|").split(" | ") for line in body.splitlines() if line[:2] == "| "]
        known[slug(title)] = {(cells[1].strip(), cells[0].strip()) for cells in lines[2:]}
        counted |= {n for cells in lines[2:] for n in numbers(cells[1])}
    found = 0
    for row in rows():
        links = [*_THEORY.finditer(row.theory)]
        assert len(links) == row.theory.count("theory.md")
        for link in links:
            assert (link["equation"], link["what"]) in known[link["section"]], link[0]
            found += 1
        # An equation that a prediction is from is not said to have none.
        assert links or not counted & {*numbers(row.number)}, row.number
    assert found > 60


@pytest.mark.parametrize("law", [law for law in LAWS if LAWS[law].commands == "torque"])
def test_the_page_of_a_law_gives_its_equations(law):
    """As formulas with their numbers, for readers who do not have the text.

    Laws without a number there are held against their pages by `test_page_names_its_equations`.
    """
    part = text_of(LAW_PAGES / f"{law}.md").partition("## Equation")[2].partition("\n## ")[0]
    labels = re.findall(r"^\$\$.+\\qquad (.+)\$\$$", part, re.M)
    assert labels
    given = {n for label in labels for n in numbers(re.sub(r"\\text\{(.*?)\}", r"\1", label))}
    assert {*numbers(LAWS[law].equations)} <= given
