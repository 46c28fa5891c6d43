"""The pages as a browser shows them: drawn without an error, on two screens and on paper."""

from __future__ import annotations

import contextlib
import json
import re
import shutil
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from screen import DESKTOP, PHONE, shown
from sealed import seal_folder
from short_tasks import TAP
from typer.testing import CliRunner

from browser import Browser, browser_path
from taskspec.compiler import compile_task
from taskspec.spec import load_task, load_text
from taskspec_runner.cli import app
from taskspec_runner.diff import diff_runs, write_difference
from taskspec_runner.report import write_report
from taskspec_runner.runs import Run
from taskspec_runner.session import execute_program

pytestmark = pytest.mark.skipif(
    browser_path() is None, reason="there is no chromium or chrome on this machine"
)

#: What spoils the task: a force beyond what is expected, a limit on it, a guard that is not met.
SPOILED = {
    "good": {},
    "missed": {"params.press": "9 N"},
    "stopped": {"limits.force": "4 N"},
    "failed": {"stages.approach.until": "force.x > 50 N"},
}


@dataclass(frozen=True)
class Looked:
    """A page that is shown: its name, the size of the screen, the browser that shows it."""

    name: str
    size: tuple[int, int]
    browser: Browser


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Reports of runs that ended in every way, by how, and pages of two runs and of two laws."""
    folder = tmp_path_factory.mktemp("pages")
    found = {}
    for name, sets in SPOILED.items():
        # A second expectation that is broken, after the first one.
        text = (
            TAP.replace("max(abs(hold.error.y)) < 1 mm", "last(force.x) < 8 N")
            if name == "missed"
            else TAP
        )
        program = compile_task(load_text(text, "tap.yaml", overrides=sets))
        found[name] = execute_program(program, folder / name, report=False).folder
        found[name] = write_report(Run(found[name]))
    killed = folder / "killed"
    killed.mkdir()
    for name in ("task.yaml", "manifest.json"):
        shutil.copy(folder / "good" / name, killed)
    whole = (folder / "good" / "log.arrow").read_bytes()
    # Without the mark of the end, which a killed run does not write.
    (killed / "log.arrow").write_bytes(whole[:-8])
    seal_folder(killed, status="running")
    found["killed"] = write_report(Run(killed))
    empty = folder / "empty"
    empty.mkdir()
    found["empty"] = write_report(Run(empty))
    difference = diff_runs(Run(folder / "good"), Run(folder / "missed"))
    found["diff"] = write_difference(difference, folder / "diff.html")
    (folder / "tap.yaml").write_text(TAP)
    laws = ["--law", "hybrid", "--law", "pd", "--out", str(folder / "compare"), "--quiet"]
    told = CliRunner().invoke(app, ["compare", str(folder / "tap.yaml"), *laws])
    assert told.exit_code == 0, told.output
    found["compare"] = folder / "compare" / "compare.html"
    log = ["--csv", str(folder / "log.csv")]
    assert CliRunner().invoke(app, ["export", str(folder / "good"), *log]).exit_code == 0
    to = [str(folder / "log.csv"), "--out", str(folder / "judged"), "--quiet"]
    told = CliRunner().invoke(app, ["judge", str(folder / "tap.yaml"), *to])
    assert told.exit_code == 0, told.output
    found["judged"] = folder / "judged" / "report.html"
    return found


@pytest.fixture(scope="module")
def opened(request: pytest.FixtureRequest, browser: Browser, pages: dict[str, Path]) -> Looked:
    """A page on a screen, drawn once for all tests that only look at it."""
    name, size = request.param
    return Looked(name, size, shown(browser, pages[name], size))


def looking(
    names: Sequence[str], sizes: Sequence[tuple[int, int]] = (DESKTOP,)
) -> pytest.MarkDecorator:
    """Parametrises a test by pages that it looks at and leaves as they are, as `opened`."""
    screens = {DESKTOP: "desktop", PHONE: "phone"}
    params = [
        pytest.param((name, size), id=f"{name}-{screens[size]}") for name in names for size in sizes
    ]
    return pytest.mark.parametrize("opened", params, indirect=True)


#: Times that stand at the axes of the charts, one text a chart.
TIMES = """[...document.querySelectorAll("[data-chart] .plot > svg")].map(
    (svg) => [...svg.querySelectorAll("text.mid")].map((t) => t.textContent).join(" "))"""


@looking(
    ["good", "missed", "stopped", "failed", "killed", "empty", "diff", "compare"], [DESKTOP, PHONE]
)
def test_pages_are_drawn_without_an_error_and_fit(opened: Looked) -> None:
    browser = opened.browser
    assert browser.errors == []
    figures = browser.run("document.querySelectorAll('[data-chart]').length")
    drawn = browser.run(
        """[...document.querySelectorAll("[data-chart] .plot > svg")].filter(
        (svg) => [...svg.querySelectorAll("path.trace")].some((p) => p.getTotalLength() > 100)
        ).length"""
    )
    assert drawn == figures
    # A run that failed before its contact has no chart of force; one without a log has none.
    assert figures >= (0 if opened.name == "empty" else 3)
    # Tables may be wider; they scroll by themselves.
    assert browser.run("document.documentElement.scrollWidth <= innerWidth")
    assert browser.run("document.body.innerText").strip()


@looking(["good", "missed", "stopped", "failed", "killed"], [DESKTOP, PHONE])
def test_the_verdict_is_seen_without_scrolling(opened: Looked) -> None:
    browser, size = opened.browser, opened.size
    box = browser.run("document.getElementById('verdict').getBoundingClientRect().toJSON()")
    assert 0 <= box["top"] < box["bottom"] <= size[1]
    assert 0 <= box["left"] < box["right"] <= size[0]
    text = browser.run("document.getElementById('verdict').innerText")
    said = {
        "good": "Passed",
        "missed": "`hold.force.x within 0..7 N for 99 %` was broken",
        "stopped": "limit on force: 4 N, measured",
        "failed": "without force.x > 50 N",
        "killed": "Unfinished",
    }
    assert said[opened.name].replace("`", "") in text


@looking(["missed"], [DESKTOP, PHONE])
def test_what_was_broken_first_is_named_with_its_time_and_drawn(
    opened: Looked, pages: dict[str, Path]
) -> None:
    browser = opened.browser
    summary = json.loads((pages["missed"].parent / "summary.json").read_text())
    broken = [e for e in summary["expectations"] if e["broken"]]
    assert len(broken) == 2
    first = min(broken, key=lambda e: e["broken"]["clock"])
    told = browser.run("document.getElementById('first-broken').innerText")
    assert first["text"] in told
    assert f"{first['broken']['clock']:.3f} s" in told
    assert (
        browser.run("document.querySelector('.expectations tbody code').innerText")
        == (first["text"])
    )
    main = "document.querySelector('.main [data-chart]')"
    assert browser.run(f"{main}.dataset.chart") == "force.x.ref"
    assert browser.run(f"{main}.querySelectorAll('.plot .upright.broken').length") == 2
    # The bound that broke first, and that on the last force.
    assert browser.run(f"{main}.querySelectorAll('.plot .band.bad').length") == 2


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_look_there_brings_the_chart_on_screen_from_anywhere(
    browser: Browser, pages: dict[str, Path], size: tuple[int, int]
) -> None:
    shown(browser, pages["missed"], size)
    browser.run("scrollTo(0, document.body.scrollHeight)")
    browser.run("document.querySelector('.look').click()")
    chart, bar = (
        browser.run(f"document.querySelector('{of}').getBoundingClientRect().toJSON()")
        for of in (".main [data-chart]", ".bar")
    )
    assert bar["bottom"] <= chart["top"]
    assert chart["bottom"] <= size[1]


@looking(["stopped"])
def test_a_stop_shows_the_chart_of_its_limit(opened: Looked) -> None:
    browser = opened.browser
    main = "document.querySelector('.main [data-chart]')"
    assert browser.run(f"{main}.dataset.chart") == "force"
    assert browser.run(f"{main}.querySelectorAll('.plot .upright.stop').length") == 1
    # A force and its opposite, in each stage.
    assert browser.run(f"{main}.querySelectorAll('.plot .level.limit').length") >= 2


@looking(["good"])
def test_charts_show_stages_events_limits_bands_and_values_at_rest(opened: Looked) -> None:
    browser = opened.browser
    main = "document.querySelector('.main .plot > svg')"
    assert browser.run(f"{main}.querySelectorAll('.ground').length") == 2
    assert browser.run(f"{main}.querySelectorAll('.upright.event').length") == 2
    # On the force within 0..7 N, and on its last value.
    assert browser.run(f"{main}.querySelectorAll('.band.good').length") == 2
    assert browser.run(f"{main}.querySelectorAll('.level.predicted').length") >= 1
    torques = "document.querySelector('[data-chart=\"joint torques\"] .plot')"
    assert browser.run(f"{torques}.querySelectorAll('.level.limit').length") == 2
    # A value at rest is dashed.
    style = f"getComputedStyle({main}.querySelector('.level.predicted')).strokeDasharray"
    assert browser.run(style) != "none"


def test_zooming_one_chart_zooms_all(browser: Browser, pages: dict[str, Path]) -> None:
    # Here all charts are equally wide, and have the same marks.
    shown(browser, pages["good"], (1000, 1400))
    whole = browser.run(TIMES)
    assert len(set(whole)) == 1
    box = browser.run("document.querySelector('.main .plot').getBoundingClientRect().toJSON()")
    y, left, right = box["y"] + 100, box["x"] + 0.4 * box["width"], box["x"] + 0.5 * box["width"]
    browser.mouse("Moved", left, y)
    browser.mouse("Pressed", left, y, down=True, clicks=1)
    browser.mouse("Moved", right, y, down=True)
    assert browser.run("getComputedStyle(document.querySelector('.choice')).display") == "block"
    browser.mouse("Released", right, y, clicks=1)
    near = browser.run(TIMES)
    assert len(set(near)) == 1
    assert near != whole
    assert browser.run("document.querySelectorAll('.windows .on').length") == 0
    browser.run("document.querySelector('.windows [data-start]').click()")
    assert browser.run(TIMES) == whole
    # A stage fills the charts.
    browser.run("document.querySelectorAll('.windows [data-start]')[2].click()")
    assert browser.run("document.querySelectorAll('.main .ground').length") == 1
    assert browser.errors == []


def test_a_finger_zooms_sideways_and_scrolls_down(browser: Browser, pages: dict[str, Path]) -> None:
    shown(browser, pages["good"], PHONE)
    plot = "document.querySelector('.main .plot')"
    browser.run(f"{plot}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
    before, scrolled = browser.run(TIMES), browser.run("scrollY")
    box = browser.run(f"{plot}.getBoundingClientRect().toJSON()")
    y = box["y"] + 100
    browser.swipe((box["x"] + 120, y), (box["x"] + 240, y))
    zoomed = browser.run(TIMES)
    assert zoomed != before
    assert len(set(zoomed)) == 1
    assert browser.run("scrollY") == scrolled
    browser.swipe((box["x"] + 120, y), (box["x"] + 120, y - 200))
    assert browser.run(TIMES) == zoomed
    # What begins as scrolling chooses no window.
    assert browser.run(f"getComputedStyle({plot}.querySelector('.choice')).display") == "none"


def test_the_cursor_reads_all_charts(browser: Browser, pages: dict[str, Path]) -> None:
    shown(browser, pages["good"])
    box = browser.run("document.querySelector('.main .plot').getBoundingClientRect().toJSON()")
    browser.mouse("Moved", box["x"] + 0.8 * box["width"], box["y"] + 100)
    assert "hold + " in browser.run("document.querySelector('.bar output').textContent")
    read = browser.run(
        """[...document.querySelectorAll("[data-chart]")].map(
        (f) => [...f.querySelectorAll(".legend output")].some((o) => o.textContent))"""
    )
    assert all(read)


def test_charts_are_reached_and_moved_by_keys(browser: Browser, pages: dict[str, Path]) -> None:
    shown(browser, pages["good"])
    whole = browser.run(TIMES)
    for _ in range(60):
        browser.key("Tab")
        if browser.run("document.activeElement.classList.contains('plot')"):
            break
    else:
        pytest.fail("no chart gets the focus")
    assert browser.run("getComputedStyle(document.activeElement).outlineStyle") != "none"
    browser.key("ArrowRight")
    first = browser.run("document.querySelector('.bar output').textContent")
    browser.key("ArrowRight")
    assert browser.run("document.querySelector('.bar output').textContent") != first != ""
    browser.key("+")
    assert browser.run(TIMES) != whole
    browser.key("0")
    assert browser.run(TIMES) == whole
    # Names for those who do not see the charts.
    assert browser.run(
        "[...document.querySelectorAll('.plot')].every((p) => p.getAttribute('aria-label'))"
    )


@pytest.mark.parametrize("name", ["good", "diff", "compare"])
def test_dark_pages_are_dark_and_can_be_read(
    browser: Browser, pages: dict[str, Path], name: str
) -> None:
    seen = {}
    for dark in (False, True):
        shown(browser, pages[name], dark=dark)
        assert browser.errors == []
        seen[dark] = {
            key: browser.run(f"getComputedStyle({of}).{what}")
            for key, of, what in (
                ("paper", "document.body", "backgroundColor"),
                ("ink", "document.body", "color"),
                ("line", "document.querySelector('path.trace.line')", "stroke"),
                ("soft", "document.querySelector('.plot text')", "fill"),
            )
        }
        for words in ("ink", "soft"):
            # What WCAG asks of text of this size.
            assert contrast(seen[dark][words], seen[dark]["paper"]) >= 4.5
        # What WCAG asks of graphics.
        assert contrast(seen[dark]["line"], seen[dark]["paper"]) >= 3
    assert luminance(seen[True]["paper"]) < 0.05 < 0.8 < luminance(seen[False]["paper"])


def test_paper_shows_the_charts_and_no_controls(browser: Browser, pages: dict[str, Path]) -> None:
    shown(browser, pages["missed"], kind="print")
    seen = "document.querySelector('{}').getClientRects().length"
    for control in (".bar", ".zoom", ".legend output"):
        assert browser.run(seen.format(control)) == 0
    assert browser.run("document.querySelector('.main .plot path.trace').getTotalLength()") > 100
    browser.media()
    pdf = browser.pdf()
    assert pdf.startswith(b"%PDF")
    assert browser.errors == []


@looking(["good", "missed", "stopped", "diff", "compare", "judged"], [PHONE])
def test_on_a_phone_tables_are_cards_and_targets_are_large(opened: Looked) -> None:
    browser = opened.browser
    browser.run("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    # No table has to be pushed sideways, and every cell is in view.
    wider = browser.run(
        """[...document.querySelectorAll(".scroll")].filter((s) => s.scrollWidth > s.clientWidth)
        .map((s) => s.firstElementChild.className)"""
    )
    assert wider == []
    beside = browser.run(
        """[...document.querySelectorAll("td")].filter((c) => {
        const b = c.getBoundingClientRect();
        return b.width && (b.left < 0 || b.right > innerWidth); }).length"""
    )
    assert beside == 0
    # What a heading says of a column stands at each cell; the first is the card's title.
    nameless = browser.run(
        """[...document.querySelectorAll(".cards:not(.findings) td:not(:first-child)")]
        .filter((c) => c.textContent.trim() && c.offsetHeight && !c.dataset.label
            && !c.querySelector("a")).map((c) => c.textContent)"""
    )
    assert nameless == []
    # The headings of a card stand below each other, and none stands alone.
    ragged = browser.run(
        """[...document.querySelectorAll(".cards:not(.metrics):not(.findings) tbody tr")].filter(
        (row) => new Set([...row.querySelectorAll("td[data-label]")].filter((c) => c.offsetHeight)
            .map((c) => Math.round(c.getBoundingClientRect().left
                + parseFloat(getComputedStyle(c).paddingLeft)))).size > 1)
        .map((row) => row.textContent)"""
    )
    assert ragged == []
    alone = browser.run(
        """[...document.querySelectorAll(".cards td + td[data-label]")].filter(
        (c) => c.offsetHeight && !c.textContent.trim() && !c.firstElementChild)
        .map((c) => c.dataset.label)"""
    )
    assert alone == []
    for each in browser.run(
        """[...document.querySelectorAll("button, summary, a, [role=button]")]
        .filter((e) => e.getClientRects().length)
        .map((e) => [e.textContent.trim(), e.getBoundingClientRect().toJSON()])"""
    ):
        assert each[1]["height"] >= 44, each
        assert each[1]["width"] >= 44, each


def test_what_helps_gives_way_to_the_stages(browser: Browser, pages: dict[str, Path]) -> None:
    shown(browser, pages["good"])
    room = """((w) => w.scrollWidth - w.clientWidth)(document.querySelector(".windows"))"""
    assert browser.run(room) == 0
    # As many stages again as make the line full, with a word of help that is cut.
    added = browser.run(
        """(() => {
        const windows = document.querySelector(".windows"), help = document.querySelector(".help");
        let added = 0;
        for (; help.scrollWidth <= help.clientWidth && added < 50; added++)
            windows.append(windows.lastElementChild.cloneNode(true));
        return added; })()"""
    )
    assert 0 < added < 50
    assert browser.run(room) == 0


@looking(["good", "missed", "diff", "judged"])
def test_no_printed_page_is_nearly_empty(opened: Looked) -> None:
    printed = [_lowest(content) for content in _contents(opened.browser.pdf())]
    assert len(printed) >= 3
    # All but the last are used to two thirds, and the last is more than a remainder.
    assert min(printed[:-1]) > 0.66, printed
    assert printed[-1] > 0.2, printed


def _contents(pdf: bytes) -> list[str]:
    """What is drawn on each page of a PDF file."""
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", pdf, re.S)
    found = []
    for stream in streams:
        with contextlib.suppress(zlib.error):
            text = zlib.decompress(stream).decode("latin-1")
            if re.search(r"\bBT\b", text):
                found.append(text)
    return found


def _lowest(content: str) -> float:
    """How far down text goes on a page of a height of 842 pt (A4), as a share of it."""
    height, lowest = 842.0, 0.0
    matrix, kept = np.eye(3), []
    numbers: list[float] = []
    for word in content.split():
        if re.fullmatch(r"-?\d*\.?\d+", word):
            numbers.append(float(word))
            continue
        if word == "q":
            kept.append(matrix)
        elif word == "Q":
            matrix = kept.pop()
        elif word in ("cm", "Tm"):
            a, b, c, d, e, f = numbers[-6:]
            moved = np.array([[a, b, 0], [c, d, 0], [e, f, 1]]) @ matrix
            if word == "cm":
                matrix = moved
            elif moved[2, 1] > 0:
                lowest = max(lowest, 1 - moved[2, 1] / height)
        numbers = []
    return lowest


@looking(["compare"])
def test_axes_over_orders_are_in_powers(opened: Looked) -> None:
    marks = opened.browser.run(
        """[...document.querySelectorAll('[data-chart$="error"] .plot text.end:not(.name)')]
        .map((t) => [t.textContent, t.getBoundingClientRect().left
            - t.closest("figure").getBoundingClientRect().left])"""
    )
    assert len(marks) > 3
    for text, left in marks:
        assert re.fullmatch(r"([25]·)?10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", text), text
        assert left >= 0


@looking(["good", "stopped", "compare"], [DESKTOP, PHONE])
def test_marks_of_axes_are_whole(opened: Looked) -> None:
    cut = opened.browser.run(
        """[...document.querySelectorAll(".plot > svg > text")].filter((t) => {
        const b = t.getBoundingClientRect(), f = t.closest(".plot").getBoundingClientRect();
        return b.left < f.left - 0.5 || b.right > f.right + 0.5; }).map((t) => t.textContent)"""
    )
    assert cut == []


@looking(["good", "missed", "stopped", "compare", "diff"])
def test_units_are_written_in_one_way(opened: Looked) -> None:
    # Files and expressions are code, and as their author wrote them.
    text = opened.browser.run(
        """(() => { const all = document.body.cloneNode(true);
        all.querySelectorAll("code, pre, script, .task, footer, .legend .static, .plot")
            .forEach((e) => e.remove());
        return all.textContent; })()"""
    )
    assert re.findall(r"\d ?(?:[mµ]?N\*m|N m\b|um\b|urad|mrad|Nm\b)", text) == []


def test_a_minute_of_control_is_a_small_file_that_is_drawn(
    browser: Browser, tmp_path: Path
) -> None:
    task = Path(__file__).parents[2] / "tasks" / "wipe-table.yaml"
    program = compile_task(load_task(task, overrides={"stages.wipe.time": "58 s"}))
    run = execute_program(program, tmp_path / "run", report=False)
    page = write_report(run)
    size = page.stat().st_size
    assert json.loads((run.folder / "summary.json").read_text())["ticks"] > 60_000
    assert size < 5_000_000
    shown(browser, page)
    assert browser.errors == []
    points = browser.run("Math.min(...[...document.querySelectorAll('.main .plot path.trace.line')]"
                         ".map((p) => p.getAttribute('d').length))")  # fmt: skip
    assert points > 1000


def luminance(colour: str) -> float:
    """Relative luminance of `rgb(r, g, b)`, as WCAG has it."""
    parts = [float(p) / 255 for p in colour[colour.index("(") + 1 : -1].split(",")[:3]]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)
