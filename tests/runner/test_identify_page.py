"""The page of an identification: its tables and charts have the numbers of the identification."""

from __future__ import annotations

import base64
import json
import re
import shlex
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from screen import DESKTOP, PHONE, shown
from typer.testing import CliRunner

from browser import Browser
from hidden_worlds import press, program, run
from taskspec_runner.cli import app
from taskspec_runner.identify import Identification, identify
from taskspec_runner.identify.page import render, write_page
from taskspec_runner.identify.residual import ChannelResidual
from taskspec_runner.identify.written import set_lines

NOISE = "{noise: {force: 0.15 N, torque: 8 mN*m}}"
LOUD = "{noise: {force: 0.6 N, torque: 32 mN*m}}"
#: Of a normal distribution, where 90 % of it are.
WITHIN_90 = 1.6448536
ROOT = Path(__file__).resolve().parents[2]
CELL = ROOT / "docs" / "how-to" / "cell"


class Page(HTMLParser):
    """The pieces of a page: rows of tables below their headings, and texts by the tag around."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tables: dict[str, list[list[str]]] = {}
        self.texts: dict[str, list[str]] = {}
        self.looks: dict[str, list[dict[str, str]]] = {}
        self._open: list[str] = []
        self._heading = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag not in ("meta", "input", "br", "img"):
            self._open.append(tag)
            self.texts.setdefault(tag, []).append("")
            self.looks.setdefault(tag, []).append({k: v or "" for k, v in attrs})
        if tag == "tr":
            self.tables.setdefault(self._heading, []).append([])
        if tag in ("td", "th"):
            self.tables[self._heading][-1].append("")

    def handle_endtag(self, tag: str) -> None:
        while self._open and self._open.pop() != tag:
            pass
        if tag == "h2":
            self._heading = self.texts["h2"][-1].strip()

    def handle_data(self, data: str) -> None:
        for tag in set(self._open):
            self.texts[tag][-1] += data
        if "td" in self._open or "th" in self._open:
            self.tables[self._heading][-1][-1] += data

    def rows(self, heading: str) -> list[list[str]]:
        """The rows of the table below a heading, without its own."""
        return [[cell.strip() for cell in row] for row in self.tables[heading][1:]]


def data_of(text: str) -> dict[str, Any]:
    """What a page gives its script."""
    found = re.search(r'<script type="application/json" id="run-data">(.*?)</script>', text, re.S)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def trace(data: dict[str, Any], key: str, label: str) -> tuple[np.ndarray, np.ndarray]:
    """Rows and values of a line of a chart, in the chart's unit."""
    each = next(t for t in data["charts"][key]["traces"] if t["label"] == label)
    sample = data["samples"][each["sample"]]
    values = np.frombuffer(base64.b64decode(sample["values"]), "<f4")
    if sample["kind"] == "all":
        return np.arange(len(values)), values
    steps = np.frombuffer(base64.b64decode(sample["rows"]), f"<{sample['kind']}")
    return np.cumsum(steps.astype(int)), values


@pytest.fixture(scope="module")
def found() -> Identification:
    hidden = {"world.bench.stiffness": "22 kN/m", "world.bench.friction": "0.31"}
    logs = [run(press(NOISE), hidden, seed)[1] for seed in (3, 4)]
    return identify(program(press(NOISE)), logs[:1], ["world.bench"], held_out=logs[1:])


@pytest.fixture(scope="module")
def text(found: Identification) -> str:
    return render(found)


def test_the_table_has_every_value_beside_that_of_the_file(
    found: Identification, text: str
) -> None:
    page = Page(text)
    rows = page.rows("Values")
    assert len(rows) == len(found.estimates) > 3
    lines = re.findall(r'<span class="span"[^>]*>(.*?)</span>', text)
    assert len(lines) == len(rows)
    for row, line, each in zip(rows, lines, found.estimates, strict=True):
        assert row[0] == each.name
        assert row[-1] == ("inside" if each.declared_inside else "outside")
        left, width, value, file = map(float, re.findall(r"(?:left|width): ([\d.e+-]+)%", line))
        # In widths of the interval; places on the line have six digits.
        span, off = each.high - each.low, 1e-3 / width
        assert (value - left) / width == pytest.approx((each.value - each.low) / span, abs=off)
        wanted = (each.declared - each.low) / span
        assert (file - left) / width == pytest.approx(wanted, rel=1e-3, abs=off)
    outside = {row[0] for row in rows if row[-1] == "outside"}
    assert {"world.bench.stiffness", "world.bench.friction"} <= outside


@pytest.mark.parametrize("held_out", [False, True])
def test_charts_have_the_log_and_what_is_predicted(
    found: Identification, text: str, held_out: bool
) -> None:
    data = data_of(text)
    channels = found.held_out if held_out else found.residuals
    assert {"force.x", "force.y", "force.z"} <= {each.channel for each in channels}
    for each in channels:
        key = f"{'held ' if held_out else ''}1 {each.channel}"
        column = each.history.columns[f"{each.channel}.measured"]
        unit = {"N": 1.0, "mN": 1e3, "N·m": 1.0, "mN·m": 1e3}
        factor = unit[data["charts"][key]["unit"]]
        rows, measured = trace(data, key, "measured")
        there = np.isfinite(measured)
        assert np.array_equal(rows[there], each.ticks)
        assert measured[there] == pytest.approx(factor * column[each.ticks], rel=1e-6)
        predicted = trace(data, key, "predicted")[1][there]
        left = trace(data, f"{key} left", "left")[1][there]
        fine = unit[data["charts"][f"{key} left"]["unit"]]
        # 32 bit floats.
        small = 1e-6 * np.abs(measured[there]).max() * fine / factor
        wanted = fine / factor * (measured[there] - predicted)
        assert left == pytest.approx(wanted, abs=small, rel=1e-5)
        assert np.sqrt(np.mean(left**2)) == pytest.approx(fine * each.rms, rel=1e-4)


def test_the_band_has_the_share_of_the_noise(found: Identification, text: str) -> None:
    """90 % of some 2,400 independent ticks are within it, and their share is off by 0.6 %."""
    data = data_of(text)
    for each in found.residuals:
        key = f"1 {each.channel} left"
        (band,) = data["charts"][key]["bands"]
        left = trace(data, key, "left")[1]
        left = left[np.isfinite(left)]
        share = np.mean((left > band["low"]) & (left < band["high"]))
        assert share == pytest.approx(0.9, abs=4 * (0.09 / len(left)) ** 0.5)
        fine = {"N": 1.0, "mN": 1e3, "mN·m": 1e3}[data["charts"][key]["unit"]]
        assert band["high"] == -band["low"]
        assert band["high"] == pytest.approx(fine * WITHIN_90 * each.explained, rel=1e-6)


def test_each_chart_has_the_stages_of_its_log(found: Identification, text: str) -> None:
    data = data_of(text)
    assert data["stages"] == []
    for key, each in (("1 force.z", found.residuals), ("held 1 force.z", found.held_out)):
        visits = [*each[0].history.visits()]
        shown_ = data["charts"][key]["visits"]
        assert [stay["name"] for stay in shown_] == ["approach", "press"]
        clock = each[0].history.columns["clock"]
        assert shown_[1]["start"] == pytest.approx(clock[visits[1].first])


def test_what_was_held_out_is_marked(found: Identification, text: str) -> None:
    page = Page(text)
    rows = page.rows("Held out")
    assert [row[1] for row in rows] == [each.channel for each in found.held_out]
    assert len(rows) == 6
    for row, each in zip(rows, found.held_out, strict=True):
        number, unit = row[2].split()
        size = {"N": 1.0, "mN": 1e-3, "mN·m": 1e-3}[unit]
        assert float(number) * size == pytest.approx(each.rms, rel=0.01)
        assert float(row[3].removesuffix(" %")) == pytest.approx(100 * each.share, rel=0.01)
    assert any(heading.startswith("Held out held-out log 1") for heading in page.texts["h2"])
    notes = re.findall(r'<p class="note">(held out: [^<]*)</p>', text)
    assert len(notes) == 6


def test_what_the_logs_do_not_decide_is_listed(found: Identification, text: str) -> None:
    rows = Page(text).rows("What the logs do not decide")
    shown_ = {name for row in rows for name in row[1].split(", ")}
    assert found.unseen
    tied = {name for group in found.confounded for name in group.names}
    assert shown_ == set(found.unseen) | tied


def test_the_options_can_be_copied(found: Identification, text: str) -> None:
    lines = [*set_lines(found)]
    assert lines
    options = Page(text).texts["pre"][0]
    assert shlex.split(options.replace("\\\n", "")) == shlex.split(" ".join(lines))


def test_residuals_that_surprise_are_warned_of(text: str) -> None:
    assert "Warning" not in Page(text).texts["strong"]
    _, history = run(press(LOUD), {})
    loud = identify(program(press(NOISE)), [history], ["world.bench.stiffness"])
    page = Page(render(loud))
    assert page.texts["strong"].count("Warning") == 1
    rows = page.rows("Left unexplained")
    assert [row[-1] for row in rows if row[0] == "force.x"] == ["more than noise"]


def test_noise_that_is_not_declared_is_not_called_noise() -> None:
    """A log of 90 ticks, and a file that declares no noise: what is left is held to itself."""
    from taskspec.spec import load_task

    logs = [CELL / f"press-0{i}.csv" for i in (1, 2)]
    made = identify(load_task(CELL / "press.yaml"), logs, ["world.cell"],
                    columns=CELL / "columns.yaml")  # fmt: skip
    page = Page(render(made))
    rows = page.rows("Left unexplained")
    assert [row[-1] for row in rows] == ["no noise declared"] * 2
    assert [row[0] for row in rows] == [str(log) for log in logs]
    data = data_of(render(made))
    assert {"1 force.z", "2 force.z", "1 force.z left", "2 force.z left"} == set(data["charts"])


def test_names_of_files_cannot_end_the_page() -> None:
    _, history = run(press(NOISE), {})
    made = identify(program(press(NOISE)), [history], ["world.bench.stiffness"])
    name = "</script><b>log"
    renamed = tuple(
        ChannelResidual(name, each.history, each.channel, each.unit, each.ticks, each.measured,
                        each.predicted, each.white, each.explained, each.declared)
        for each in made.residuals
    )  # fmt: skip
    object.__setattr__(made, "residuals", renamed)
    text = render(made)
    assert text.count("<script") == text.count("</script>") == 2
    assert name in Page(text).texts["code"]


def test_a_browser_draws_it(found: Identification, browser: Browser, tmp_path: Path) -> None:
    path = write_page(found, tmp_path / "page.html")
    for size in (DESKTOP, PHONE):
        page = shown(browser, path, size)
        assert page.run("document.documentElement.scrollWidth") <= size[0]
        drawn = page.run("document.querySelectorAll('.plot path.trace').length")
        assert drawn == 3 * (len(found.residuals) + len(found.held_out))
        assert page.run("document.querySelectorAll('.plot path.band').length") * 3 == drawn
        page.run("document.querySelector('[data-copy]').click()")
        assert not page.errors


def test_what_is_exact_has_no_chart_of_rounding() -> None:
    _, history = run(press(), {"world.bench.stiffness": "22 kN/m"})
    made = identify(program(press()), [history], ["world.bench.stiffness"])
    text = render(made)
    assert [each.channel for each in made.residuals if each.exact and each.peak]
    assert all(each.exact for each in made.residuals if each.peak)
    charts = set(data_of(text)["charts"])
    assert charts == {f"1 {each.channel}" for each in made.residuals if each.peak}
    said = {row[-1] for row in Page(text).rows("Left unexplained")}
    assert said == {"nothing left"}


# The command.


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "press.yaml"
    path.write_text(press(NOISE), encoding="utf-8")
    return path


def test_the_command_writes_it_and_says_where(file: Path, tmp_path: Path) -> None:
    runner, out = CliRunner(), tmp_path / "page.html"
    made = runner.invoke(app, ["run", str(file), "--out", str(tmp_path / "run"), "--quiet"])
    assert made.exit_code == 0, made.output
    arguments = ["identify", str(file), str(tmp_path / "run"), "--what", "world.bench.stiffness"]
    done = runner.invoke(app, [*arguments, "--page", str(out), "--format", "json"])
    assert done.exit_code == 0, done.output
    assert f"page: {out}" in done.stderr
    data = json.loads(done.stdout)
    rows = Page(out.read_text(encoding="utf-8")).rows("Values")
    assert [row[0] for row in rows] == [each["name"] for each in data["estimates"]]
    # One log: the buttons for the window of time are its stages.
    names = [stage["name"] for stage in data_of(out.read_text(encoding="utf-8"))["stages"]]
    assert names == ["approach", "press"]


@pytest.mark.parametrize(
    ("page", "said"),
    [
        ("none/page.html", "cannot write"),
        ("folder.html", "it is not a regular file"),
        ("press.yaml", "--page writes HTML, not 'press.yaml'"),
        ("page", "--page writes HTML, not 'page'"),
    ],
)
def test_a_page_that_cannot_be_written_is_an_error_before_anything_is_computed(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, page: str, said: str
) -> None:
    def never(*_: object) -> None:
        raise AssertionError("it was computed")

    monkeypatch.setattr("taskspec_runner.cli.identify.identify", never)
    (tmp_path / "folder.html").mkdir()
    before = sorted(tmp_path.iterdir())
    arguments = ["identify", str(file), str(tmp_path / "run"), "--page", str(tmp_path / page)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2, done.output
    assert said in " ".join(done.output.split())
    assert sorted(tmp_path.iterdir()) == before
    assert file.read_text(encoding="utf-8") == press(NOISE)


def test_a_design_has_no_page(file: Path, tmp_path: Path) -> None:
    out = tmp_path / "measure.yaml"
    arguments = ["identify", str(file), "--design", str(out), "--page", str(tmp_path / "a.html")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2
    assert "without --design" in " ".join(done.output.split())
    assert not out.exists()
