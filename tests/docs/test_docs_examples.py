"""Every example of the documents runs through the checks; links and codes lead somewhere."""

from __future__ import annotations

import re

import pytest
from documents import DOCUMENTS, LANGUAGE, ROOT, TASKS, blocks, completed, is_task, load, words

from taskspec.compiler import admit
from taskspec.examination import examine
from taskspec.laws import LAWS
from taskspec.motion.table import read_table
from taskspec.text.codes import CODES
from taskspec.text.confines import confines
from taskspec.text.diagnostic import Severity
from taskspec.text.units import parse_unit
from taskspec_runner.trial import reported  # noqa: F401  (it registers the codes of trials)


def test_the_readme_counts_the_tasks_and_its_table_names_the_laws():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"(tasks): {len(list(TASKS.glob('*.yaml')))} tasks" in text
    text = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    (row,) = re.findall(r"^\| laws \|(.*)\|$", text, re.M)
    assert set(words(row)) == LAWS.keys()


@pytest.mark.parametrize(("path", "name", "text"), blocks("yaml"))
def test_every_yaml_block_is_a_task_that_validates(path, name, text):
    if name is not None:
        assert not is_task(text)
        text = completed(text, path, name)
    assert is_task(text), "a fragment says which task it completes: <!-- completes: NAME -->"
    loaded = load(text)
    examined = examine(loaded)
    errors = [d for d in examined.findings if d.severity is Severity.ERROR]
    assert errors == []
    assert admit(examined).stages


def test_there_are_examples():
    assert [param for param in blocks("yaml") if param.values[0] == ROOT / "README.md"]
    assert [param for param in blocks("yaml") if param.values[0].parent == LANGUAGE]


@pytest.mark.parametrize("text", [block.values[2] for block in blocks("csv")])
def test_every_csv_block_is_a_path(text, tmp_path):
    file = tmp_path / "points.csv"
    file.write_text(text, encoding="utf-8")
    points = read_table(file, lambda unit, _column: parse_unit(unit).scale, confines(file.parent))
    assert points.length > 0


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    text = re.sub(r"^```.*?^```$", "", path.read_text(encoding="utf-8"), flags=re.M | re.S)
    for target in re.findall(r"\]\(([^)#\s:]*)(?:#[^)]*)?\)", text):
        assert (path.parent / target).exists(), target
    for target, anchor in re.findall(r"\]\(([^)\s:]*)#([^)]+)\)", text):
        other = (path.parent / target) if target else path
        heads = re.findall(r"^#+ (.+)$", other.read_text(encoding="utf-8"), re.M)
        assert anchor in {re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in heads}


#: Codes that are not given again; tables of older commits and the index name them.
RETIRED = {"TS328", "TS329"}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_codes_that_are_named_exist(path):
    named = set(re.findall(r"TS\d{3}", path.read_text(encoding="utf-8")))
    assert named <= CODES.keys() | RETIRED
    assert not RETIRED & CODES.keys()
