"""The page of a sweep: what it says and embeds, and how its table is sorted and filtered."""

from __future__ import annotations

import base64
import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from screen import DESKTOP, PHONE, shown
from sweeps import BOUND, BROKE, NAMED, ROLL, STIFFNESS, STOPPED, said, sweep_of
from typer.testing import CliRunner

from browser import Browser
from taskspec_runner.cli import app
from taskspec_runner.sweep.page import render
from taskspec_runner.sweep.statistics import influences
from taskspec_runner.sweep.summary import summarise

EXPECTED = "sweep: {expect: [success >= 90 %, success >= 20 %, success >= 60 %]}\n"


def embedded(page: str) -> dict[str, Any]:
    """What a page gives its script."""
    found = re.search(r'<script type="application/json" id="run-data">(.*?)</script>', page, re.S)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def column(data: dict[str, Any], key: str) -> tuple[np.ndarray, str]:
    """Values and unit of a column that is embedded."""
    each = next(c for c in data["columns"] if c["key"] == key)
    return np.frombuffer(base64.b64decode(each["values"]), "<f4"), each["unit"]


def words(page: str) -> str:
    """The words of a page as they are read, without its script and data."""
    body = re.sub(r"<(script|style|details)\b.*?</\1>", " ", page, flags=re.S)
    return " ".join(re.sub(r"<[^>]*>", " ", body).split())


def test_success_is_told_with_its_interval_where_nothing_is_expected_of_it(tmp_path: Path) -> None:
    result = sweep_of(tmp_path)
    good = sum(row["success"] for row in result.rows)
    low, high = (100 * end for end in result.summary["success"]["interval"])
    assert f"{good} of 60 worlds" in words(render(result, said()))
    assert f"({low:.4g} to {high:.4g} %)" in words(render(result, said()))


def test_verdicts_are_those_of_the_file(tmp_path: Path) -> None:
    result = sweep_of(tmp_path, text=NAMED + EXPECTED)
    verdicts = [each["verdict"] for each in result.summary["judged"]]
    assert verdicts == ["missed", "met", "undecided"]
    text = words(render(result, said()))
    for verdict, least in zip(verdicts, (90, 20, 60), strict=True):
        assert f"{verdict} success &gt;= {least} %" in text
    assert f"some {result.summary['judged'][2]['needed']} more worlds would decide it" in text


def test_numbers_are_embedded_in_units_that_people_read(tmp_path: Path) -> None:
    result = sweep_of(tmp_path)
    data = embedded(render(result, said()))
    stiffness, unit = column(data, STIFFNESS)
    assert unit == "kN/m"
    # As 32 bit floats.
    assert stiffness == pytest.approx([row[STIFFNESS] / 1e3 for row in result.rows], rel=1e-7)
    roll, unit = column(data, ROLL)
    assert unit == "deg"
    assert roll == pytest.approx(np.degrees([row[ROLL] for row in result.rows]), rel=1e-6)
    assert column(data, "peak force")[1] == "N"
    # What is not there in any world, or zero in all, needs no column.
    assert "peak torque" not in [each["key"] for each in data["columns"]]


def test_what_was_broken_off_has_no_margin(tmp_path: Path) -> None:
    result = sweep_of(tmp_path)
    margins, unit = column(embedded(render(result, said())), "margin")
    assert unit == "%"
    assert [i for i, value in enumerate(margins) if np.isnan(value)] == [STOPPED, BROKE]
    known = [100 * r["margin"] for r in result.rows if r["world"] not in (STOPPED, BROKE)]
    assert margins[~np.isnan(margins)] == pytest.approx(known, rel=1e-6, abs=1e-5)


def test_why_a_world_was_no_success_is_said(tmp_path: Path) -> None:
    result = sweep_of(tmp_path)
    data = embedded(render(result, said()))
    numbers = np.frombuffer(base64.b64decode(data["why"]["of"]), "<u4")
    why = [data["why"]["names"][n] for n in numbers]
    assert why[STOPPED] == "limit on force: 4 N, measured 7 N, in stage hold"
    assert why[BROKE] == "ValueError: <script>"
    for row, text in zip(result.rows, why, strict=True):
        if row["verdict"] in ("passed", "missed"):
            assert text == ("" if row["success"] else "hold.force.x within 0..7 N for 99 %")


def test_a_worlds_text_cannot_end_the_script(tmp_path: Path) -> None:
    page = render(sweep_of(tmp_path), said())
    assert page.count("<script") == page.count("</script>") == 2


@pytest.mark.parametrize("kind", ["random", "corners", "grid"])
def test_the_command_names_the_world_and_what_was_overridden(tmp_path: Path, kind: str) -> None:
    opened = said(kind, overrides={"params.press": "6 N"}, force=True)
    stem = embedded(render(sweep_of(tmp_path), opened))["command"]
    named = shlex.split(f"{stem}17")
    assert named[:5] == ["taskspec", "run", "my tap.yaml", "--set", "params.press=6 N"]
    table = f"{tmp_path / 'worlds.parquet'}:17"
    last = ["--seed", "4", "--world", "17"] if kind == "random" else ["--world", table]
    assert named[5:] == ["--force", *last]


def test_only_reports_that_are_there_are_linked(tmp_path: Path) -> None:
    for world in (3, 9):
        (tmp_path / "worlds" / f"{world:06d}").mkdir(parents=True)
    (tmp_path / "worlds" / "000003" / "report.html").touch()
    data = embedded(render(sweep_of(tmp_path), said()))
    assert data["reports"] == {"3": "worlds/000003/report.html"}


def test_where_it_fails_is_a_filter_too(tmp_path: Path) -> None:
    result = sweep_of(tmp_path)
    page = render(result, said())
    (region,) = result.summary["regions"]
    assert region["text"].startswith(f"fails where {STIFFNESS} &gt;".replace("&gt;", ">"))
    found = re.search(rf'data-filter="{STIFFNESS} &gt; ([\d.]+)"', page)
    assert found is not None
    # Half way between two worlds, beside the bound itself.
    values = sorted(row[STIFFNESS] for row in result.rows)
    above = next(v for v in values if v > BOUND)
    assert max(v for v in values if v < BOUND) < 1e3 * float(found[1]) < above


def test_no_failure_and_nothing_but_failures_are_said(tmp_path: Path) -> None:
    result = sweep_of(tmp_path)
    for good, sentence in ((True, "In no world."), (False, "In every world")):
        rows = tuple({**row, "success": good} for row in result.rows)
        changed = type(result)(result.task, result.path, rows, summarise(result.task, rows))
        assert sentence in words(render(changed, said()))


def test_nothing_is_fetched_from_elsewhere(tmp_path: Path) -> None:
    page = render(sweep_of(tmp_path), said())
    assert not re.search(r"(?:src|href)=\"(?![#$])", page)
    assert not re.search(r"url\((?!#)|@import|fetch\(", page)


def test_ten_thousand_worlds_are_a_page_that_can_be_sent(tmp_path: Path) -> None:
    assert len(render(sweep_of(tmp_path, 10_000), said()).encode()) < 2e6


def test_the_command_writes_the_page_and_names_it_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tap.yaml").write_text(NAMED)
    asked = ["sweep", "tap.yaml", "--worlds", "6", "--jobs", "1", "--out", "swept"]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    assert done.output.splitlines()[-1] == "page: swept/sweep.html"
    data = embedded(Path("swept/sweep.html").read_text())
    assert data["worlds"] == list(range(6))
    # What the page says runs a world does run it.
    again = CliRunner().invoke(app, [*shlex.split(f"{data['command']}2")[1:], "--format", "json"])
    assert again.exit_code in (0, 1), again.output
    row = json.loads(Path("swept/worlds.jsonl").read_text().splitlines()[2].split(" ", 1)[1])
    assert row["world"] == 2
    assert json.loads(again.stdout)["exit_code"] == (0 if row["success"] else 1)


def test_what_goes_both_ways_is_no_chance_and_its_trend_is_none() -> None:
    """Margins that fall to both sides have a rank correlation of about 0, and all is explained."""
    rows = []
    for i in range(400):
        # A golden step spreads the second parameter evenly, without any tie to the first.
        x, y = i / 399 - 0.5, (i * 0.618034) % 1
        row = {"world.a.friction": x, "world.b.friction": y, "status": "done", "margin": -abs(x)}
        rows.append(row)
    first, second = influences(rows)
    assert first.parameter == "world.a.friction"
    assert abs(first.correlation) < 0.01
    # Of 7 like groups six span 2/7 of the ranks of |x| each and that in the middle 1/7, so that
    # (6 * 4 + 1) / (7 * 49) of the variance is left within groups: less than 4/49.
    assert first.explained > 1 - 4 / 49
    assert first.chance < 1e-6 < 0.01 < second.chance
    assert not first.one_way


def test_chance_is_taken_for_an_influence_as_rarely_as_it_says() -> None:
    """Of parameters without influence a share of at most 5 % has a chance below 5 %."""
    values = np.random.default_rng(11)
    few, of = 0, 400
    for _ in range(of):
        pairs = values.random((60, 2))
        rows = [{"world.a.friction": x, "status": "done", "margin": y} for x, y in pairs]
        few += influences(rows)[0].chance < 0.05
    # Three standard deviations of a binomial number.
    assert few <= of * 0.05 + 3 * (of * 0.05 * 0.95) ** 0.5


# What a browser does with it.


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "worlds" / "000003").mkdir(parents=True)
    (folder / "worlds" / "000003" / "report.html").touch()
    result = sweep_of(folder, 120, text=NAMED + EXPECTED)
    (folder / "sweep.html").write_text(render(result, said()))
    return folder / "sweep.html"


WORLDS = """[...document.querySelectorAll(".list tbody")].map((b) => Number(b.dataset.world))"""
COUNTED = """document.querySelector(".filter output").textContent"""


def ask(browser: Browser, text: str) -> str:
    """Writes a filter, and what the page says of it."""
    browser.run(f"""(() => {{
        const query = document.querySelector(".query input");
        query.value = {json.dumps(text)};
        query.dispatchEvent(new Event("input"));
    }})()""")
    return str(browser.run(COUNTED))


def press(browser: Browser, what: str) -> None:
    """Presses what a selector finds first."""
    browser.run(f"document.querySelector({json.dumps(what)}).click()")


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_the_page_is_drawn_without_an_error_and_fits(
    browser: Browser, page: Path, size: tuple[int, int], dark: bool
) -> None:
    shown(browser, page, size, dark=dark)
    assert browser.errors == []
    assert browser.run("document.documentElement.scrollWidth <= innerWidth")
    empty = browser.run(
        """[...document.querySelectorAll("[data-chart]")].filter((f) => !f.querySelector(
        ".plot > svg path.good-dot, .plot > svg rect.cell, .plot > svg rect.column-good"))
        .map((f) => f.dataset.chart)"""
    )
    assert empty == []
    if size == PHONE:
        small = browser.run(
            """[...document.querySelectorAll("button, summary, a, select, input")]
            .filter((e) => e.getClientRects().length)
            .map((e) => [e, e.getBoundingClientRect()])
            .filter(([, box]) => box.height < 44 || box.width < 44)
            .map(([e]) => e.outerHTML)"""
        )
        assert small == []


def test_each_world_is_a_point_of_its_form(browser: Browser, page: Path) -> None:
    shown(browser, page)
    rows = sweep_of(page.parent, 120).rows
    good = sum(row["success"] for row in rows)
    # The world that broke has a stiffness too, and stands below with the one that was stopped.
    for mark, many in ((".good-dot", good), (".bad-cross", len(rows) - good)):
        found = browser.run(
            f"""document.querySelector('[data-chart="{STIFFNESS}"] .plot {mark}')
            .getAttribute("d").split("M").length - 1"""
        )
        assert found == many


def test_the_table_is_sorted_by_its_heads(browser: Browser, page: Path) -> None:
    shown(browser, page)
    rows = sweep_of(page.parent, 120).rows
    first = browser.run(WORLDS)
    # Not all are made at once; without an end comes before the least margin.
    assert len(first) < 120
    assert set(first[:2]) == {STOPPED, BROKE}
    ended = [row for row in rows if row["world"] not in (STOPPED, BROKE)]
    worst = sorted(ended, key=lambda row: row["margin"])
    assert first[2:] == [row["world"] for row in worst][: len(first) - 2]
    head = f'.list th[data-key="{STIFFNESS}"]'
    for order in ("ascending", "descending"):
        press(browser, f"{head} button")
        assert browser.run(f"document.querySelector('{head}').ariaSort") == order
        by = sorted(rows, key=lambda row: row[STIFFNESS], reverse=order == "descending")
        found = browser.run(WORLDS)
        assert found == [row["world"] for row in by][: len(found)]
    assert browser.run("document.querySelectorAll('.list th[aria-sort]').length") == 1


def test_more_rows_are_made_as_the_table_is_scrolled(browser: Browser, page: Path) -> None:
    shown(browser, page)
    before = len(browser.run(WORLDS))
    browser.run("""new Promise((done) => {
        const list = document.querySelector(".list");
        list.scrollTop = list.scrollHeight;
        setTimeout(done, 300);
    })""")
    assert before < len(browser.run(WORLDS))
    press(browser, ".further")
    assert sorted(browser.run(WORLDS)) == list(range(120))
    assert browser.run("document.querySelector('.further').hidden")


def test_the_table_is_filtered_by_relations_and_words(browser: Browser, page: Path) -> None:
    shown(browser, page)
    rows = sweep_of(page.parent, 120).rows

    def worlds(text: str) -> set[int]:
        told = ask(browser, text)
        found = set(browser.run(WORLDS))
        assert told == f"{len(found)} of 120 worlds"
        return found

    stiff = {row["world"] for row in rows if row[STIFFNESS] > 27e3}
    assert worlds("wall.stiffness > 27") == stiff
    assert worlds(f"{STIFFNESS} > 27 kN/m") == stiff
    turned = {row["world"] for row in rows if row[STIFFNESS] > 27e3 and row[ROLL] <= 0}
    assert turned
    assert turned != stiff
    assert worlds("stiffness > 27 and roll <= 0 deg") == turned
    assert worlds("world = 17") == worlds("17") == {17}
    assert worlds("limit on force") == {STOPPED}
    ask(browser, "")
    press(browser, '[data-verdict="broken"]')
    assert browser.run(WORLDS) == [BROKE]
    assert browser.errors == []


@pytest.mark.parametrize(
    ("text", "said_"),
    [
        ("stiffnes > ", "no number after the sign in “stiffnes >”"),
        ("stifness > 3", "there is no column “stifness”"),
        ("peak > 3", "“peak” is peak force or peak speed"),
        ("stiffness > 9000 N/m", "wall.stiffness is in kN/m, not “N/m”"),
    ],
)
def test_a_filter_that_says_nothing_is_told_so(
    browser: Browser, page: Path, text: str, said_: str
) -> None:
    shown(browser, page)
    before = browser.run(WORLDS)
    assert ask(browser, text) == said_
    assert browser.run('document.querySelector(".query input").ariaInvalid') == "true"
    assert browser.run(WORLDS) == before


def test_where_it_fails_shows_its_worlds(browser: Browser, page: Path) -> None:
    shown(browser, page)
    press(browser, ".regions button")
    (region,) = sweep_of(page.parent, 120).summary["regions"]
    assert browser.run(COUNTED) == f"{region['of']} of 120 worlds"
    top = browser.run('document.querySelector("#worlds").getBoundingClientRect().top')
    # Scrolled to whole pixels.
    assert -1 < top < DESKTOP[1] / 2


def test_a_click_on_a_point_shows_its_world(browser: Browser, page: Path) -> None:
    shown(browser, page)
    browser.run(f"""document.querySelector('[data-chart="{STIFFNESS}"]').scrollIntoView()""")
    rows = sweep_of(page.parent, 120).rows
    least = min(rows, key=lambda row: row[STIFFNESS])
    x, y = browser.run(
        f"""(() => {{
        const plot = document.querySelector('[data-chart="{STIFFNESS}"] .plot');
        const dots = plot.querySelector(".good-dot").getAttribute("d").match(/[\\d.]+ [\\d.]+/g);
        const [x, y] = dots.map((d) => d.split(" ").map(Number)).sort((a, b) => a[0] - b[0])[0];
        const box = plot.getBoundingClientRect();
        return [box.left + x, box.top + y];
    }})()"""
    )
    browser.mouse("Moved", x, y)
    assert browser.run(
        f"""document.querySelector('[data-chart="{STIFFNESS}"] .tip').textContent"""
    ).startswith(f"world {least['world']}, passed: ")
    for kind in ("Pressed", "Released"):
        browser.mouse(kind, x, y, down=kind == "Pressed", clicks=1)
    assert browser.run(WORLDS) == [least["world"]]


def test_a_worlds_command_is_copied_and_its_report_linked(browser: Browser, page: Path) -> None:
    shown(browser, page)
    allowed = ["clipboardReadWrite", "clipboardSanitizedWrite"]
    browser.command("Browser.grantPermissions", permissions=allowed)
    ask(browser, "world = 3")
    # As a person does: the page may use the clipboard where it is pressed.
    box = browser.run(
        """(() => {
        const button = document.querySelector(".how button");
        button.scrollIntoView({ block: "center" });
        return button.getBoundingClientRect().toJSON();
    })()"""
    )
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    for kind in ("Pressed", "Released"):
        browser.mouse(kind, x, y, down=kind == "Pressed", clicks=1)
    done = browser.run("""new Promise((done) => {
        const button = document.querySelector(".how button"), end = performance.now() + 10000;
        (function look() {
            const text = button.textContent;
            if (text === "copied" || performance.now() > end) done(text); else setTimeout(look, 20);
        })();
    })""")
    assert done == "copied"
    command = embedded(page.read_text())["command"]
    assert browser.run("navigator.clipboard.readText()") == f"{command}3"
    assert browser.run('document.querySelector(".how a").getAttribute("href")') == (
        "worlds/000003/report.html"
    )
    ask(browser, "world = 4")
    assert browser.run('document.querySelector(".how a")') is None


def test_another_pair_of_parameters_can_be_mapped(browser: Browser, page: Path) -> None:
    shown(browser, page)
    cells = """[...document.querySelectorAll('[data-chart="map"] rect.cell title')]
        .map((t) => t.textContent)"""
    before = browser.run(cells)
    good, of = np.sum([[int(n) for n in re.findall(r"\d+", text)] for text in before], axis=0)
    rows = sweep_of(page.parent, 120).rows
    assert (good, of) == (sum(row["success"] for row in rows), 120)
    browser.run(f"""(() => {{
        const across = document.querySelector('[data-axis="x"]');
        across.value = "{ROLL}";
        across.dispatchEvent(new Event("change"));
    }})()""")
    # Roll over roll: only the diagonal has worlds.
    full = [text for text in browser.run(cells) if not text.startswith("0 of 0 ")]
    assert len(full) ** 2 == len(before)


def test_a_few_huge_forces_do_not_hide_the_others(browser: Browser, tmp_path: Path) -> None:
    """They are counted in the last column, and the others spread over the rest."""
    result = sweep_of(tmp_path)
    result.rows[STOPPED]["peak force"] = 7000.0
    (tmp_path / "sweep.html").write_text(render(result, said()))
    shown(browser, tmp_path / "sweep.html")
    figure = """document.querySelector('[data-chart="peak force"]')"""
    assert browser.run(f"{figure}.querySelector('.note').textContent") == (
        "1 far above in the last column"
    )
    titles = browser.run(f"[...{figure}.querySelectorAll('rect title')].map((t) => t.textContent)")
    assert len(titles) > 5
    assert titles[-1].endswith("and more N: 0 succeeded, 1 did not")
    assert sum(int(n) for text in titles for n in re.findall(r"(\d+) (?:succ|did)", text)) >= 59


def test_a_page_on_paper_has_its_charts_and_its_rows(browser: Browser, page: Path) -> None:
    # A4 without its margins.
    shown(browser, page, (703, 1030), kind="print")
    assert browser.run("document.documentElement.scrollWidth <= innerWidth")
    right = """document.querySelector(".list table").getBoundingClientRect().right"""
    assert browser.run(right) <= 703
    seen = """(s) => [...document.querySelectorAll(s)].some((e) => e.getClientRects().length)"""
    for what in (".filter", ".how button", ".regions button"):
        assert not browser.run(f"({seen})({json.dumps(what)})"), what
    # Rows that are not printed are counted.
    for what in (".list tbody code", "[data-chart] .plot > svg", ".further"):
        assert browser.run(f"({seen})({json.dumps(what)})"), what
    printed = browser.run("document.querySelectorAll('.list tbody').length")
    left = browser.run("document.querySelector('.further').textContent")
    assert left == f"{120 - printed} more worlds"
