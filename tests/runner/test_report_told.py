"""What a report tells beside its charts: what broke, margins, closed forms, findings, responses."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_report import ESCAPED, NASTY, decoded, drawn, log, page, rewrite, tiny_summary

from taskspec_runner.pages.html import prose
from taskspec_runner.runs import Run
from taskspec_runner.verdict.outcome import first_broken, verdict

#: Towards -15 N with a time constant of 30 ms, from the second stage on.
CONSTANT = 0.03


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    rows = np.arange(800)
    since = 1e-3 * (rows - 200)
    force = np.where(since < 0, 0.0, -15 + 5 * np.exp(-since / CONSTANT))
    wanted = np.where(since < 0, np.nan, -15.0)
    gap = np.where(since < 0, 0.01, force / 20e3)
    columns = {
        "force.z": (force, "N"),
        "force.z.ref": (wanted, "N"),
        "table.gap": (gap, "m"),
        "position.x": (1e-3 * rows, "m"),
    }
    log(tmp_path, ["touch"] * 200 + ["press"] * 600, columns)
    (tmp_path / "task.yaml").write_text("name: tiny\nexpect:\n  - a < b\n  - c < d\n")
    rewrite(tmp_path, summary())
    return tmp_path


def summary() -> dict[str, Any]:
    found = tiny_summary()
    found["stages"][1]["end"] = 0.8
    found["expectations"] = [
        expectation("a < b", 0.6, line=3, signals=["press.force.z"], stage="press"),
        expectation("c < d", 0.25, line=4, signals=["press.table.gap"], stage="press"),
        expectation("e < f", None, margins=[margin(0.5, 0.25), margin(-2.0, -1.5)]),
    ]
    found["rest_values"] = {
        "touch": {},
        "press": {"force.z": {"value": -15.0, "source": "set point"}},
    }
    found["diagnostics"] = [
        {"code": "TS304", "severity": "warning", "message": f"open {NASTY}", "line": 1},
        {"code": "TS999", "severity": "info", "message": "aside", "source": "--set", "line": None},
    ]
    found["responses"] = {
        "press": {
            "force.z": {
                "set_point": -15.0,
                "step": -5.0,
                "overshoot": 0.5,
                "settling_time": 0.123,
                "below": 0.3,
                "above": 0.3,
                "settled_within": "2 %",
                "time_constant": 0.031,
                "rest": -14.9,
            }
        }
    }
    found["contact"] = {"press": {"losses": 2, "time": 0.015}}
    found["solver"] = {
        "press": {"ticks": 600, "solved": 40, "relaxed": 0, "held": 3, "worst": 1e-9}
    }
    return found


def expectation(text: str, broken: float | None, **more: Any) -> dict[str, Any]:
    found = {"text": text, "passed": broken is None, "explanation": f"{text} -3 N", **more}
    if broken is not None:
        found["broken"] = {"clock": broken, "text": "it passed -3 N", "final": broken < 0.5}
    return found


def margin(value: float, left: float) -> dict[str, Any]:
    return {"name": "m", "value": value, "unit": "N", "left": left}


def test_the_first_broken_expectation_is_the_verdict(folder: Path) -> None:
    run = Run(folder)
    first = first_broken(run)
    assert first is not None
    assert first.text == "c < d"
    told = verdict(run)
    assert told.sentence == (
        "At 0.250 s in stage press, `c < d` was broken: it passed -3 N. "
        "The run reached its end, but missed 2 of 3 expectations."
    )
    text = page(folder)
    # Missed ones first, in the order in which they were broken.
    rows = re.findall(r'<tr class="(good|bad)">.*?<code>(.*?)</code>', text, re.S)
    assert rows == [("bad", "c &lt; d"), ("bad", "a &lt; b"), ("good", "e &lt; f")]
    # The chart of what it is about stands first; others may be looked at too.
    assert re.search(r'main"><figure data-chart="gap"', text.replace("\n", ""))
    assert [e["at"] for e in drawn(folder)["events"] if e["kind"] == "broken"] == [0.6, 0.25]


def test_what_a_run_that_broke_off_could_have_mended_is_not_broken(folder: Path) -> None:
    rewrite(folder, summary() | {"status": "stopped"})
    run = Run(folder)
    assert [e.broken is not None for e in run.expectations] == [False, True, False]
    assert verdict(run).kind == "stopped"


def test_margins_are_shown_with_what_is_left(folder: Path) -> None:
    cells = re.search(r"e &lt; f.*?</tr>", page(folder), re.S)
    assert cells is not None
    assert "0.500 N" in cells[0]
    assert "25 % left" in cells[0]
    assert "width: 25%" in cells[0]
    assert "−2.00 N" in cells[0]
    assert "outside" in cells[0]
    assert "width: 0%" in cells[0]


def test_values_at_rest_are_drawn_where_their_stage_is(folder: Path) -> None:
    levels = drawn(folder)["charts"]["force.z.ref"]["levels"]
    assert [(x["start"], x["end"], x["value"], x["kind"]) for x in levels] == [
        (0.2, 0.8, -15.0, "predicted")
    ]


def test_without_closed_forms_nothing_is_drawn_as_one(folder: Path) -> None:
    gone = ("rest_values", "responses", "diagnostics")
    rewrite(folder, {k: v for k, v in summary().items() if k not in gone})
    charts = drawn(folder)["charts"]
    assert all(level["kind"] == "limit" for c in charts.values() for level in c["levels"])
    assert decoded(charts["force.z.ref"]["traces"][0])


@pytest.mark.parametrize("key", ["rest_values", "responses", "diagnostics", "contact", "solver"])
@pytest.mark.parametrize("value", [None, 3, [1], {"press": 3}, {"press": {"force.z": [1]}}])
def test_summaries_of_any_kind_are_borne(folder: Path, key: str, value: object) -> None:
    rewrite(folder, summary() | {key: value})
    assert drawn(folder)["charts"]


def test_responses_stand_beside_closed_forms(folder: Path) -> None:
    text = re.sub(r"<[^>]*>", " ", page(folder))
    row = re.search(r"force\.z +−15\.0  N +−15\.0.*?ms", text, re.S)
    assert row is not None
    for words in ("0.500  N, 10 %", "0.123", "±0.300  N, 2 %", "31.0  ms", "−14.9"):
        assert words in row[0]
    assert "Contact was lost 2 times, for 15 ms in all." in text
    assert "40 of 600 ticks needed the program, 3 had no answer and held a safe torque" in text


def test_findings_and_misses_stand_at_their_lines(folder: Path) -> None:
    text = page(folder)
    assert NASTY not in text
    lines = re.findall(r'<div class="line">.*?</div>\s*(?:<p class="finding.*?</p>)*', text, re.S)
    assert len(lines) == 4
    assert f"warning[TS304]: open {ESCAPED}" in lines[0]
    assert "finding" not in lines[1]
    assert "missed: a &lt; b −3 N" in lines[2]
    assert "missed: c &lt; d −3 N" in lines[3]
    # What is about an override has no line.
    assert "info[TS999] in --set: aside" in text
    assert "1 warning, 1 info" in text


def test_old_runs_have_no_margins_and_no_breaks(folder: Path) -> None:
    old = summary()
    old["expectations"] = [{"text": "a < b", "passed": False, "explanation": "no"}]
    rewrite(folder, old)
    assert verdict(Run(folder)).sentence == ("The run reached its end, but missed its expectation.")
    assert page(folder)


def test_prose() -> None:
    assert prose("at -3 N in `a < -b`, 2-3 of x-1") == (
        "at −3 N in <code>a &lt; -b</code>, 2-3 of x-1"
    )
    assert prose("a ` b <c>") == "a ` b &lt;c&gt;"


def test_json_of_the_page_is_valid(folder: Path) -> None:
    found = re.search(r'id="run-data">(.*?)</script>', page(folder), re.S)
    assert found is not None
    assert json.loads(found[1])["charts"]
