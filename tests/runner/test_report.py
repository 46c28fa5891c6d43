"""The report of a run and its picture."""

from __future__ import annotations

import base64
import json
import re
from contextlib import closing
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from sealed import seal_folder

from taskspec_runner.pages.decimate import broken, decimate, encode, simplify
from taskspec_runner.pages.html import highlighted
from taskspec_runner.pages.numbers import figure, quantity
from taskspec_runner.pages.samples import POINTS_BYTES
from taskspec_runner.record.log import Log
from taskspec_runner.report import Picture, overview_svg, write_report
from taskspec_runner.report.figures import differs
from taskspec_runner.report.tables import _resolved
from taskspec_runner.runs import Run
from taskspec_runner.verdict.outcome import verdict

NASTY = "<script>alert('&')</script>"
ESCAPED = "&lt;script&gt;alert(&#39;&amp;&#39;)&lt;/script&gt;"
NAN = float("nan")

Vector = NDArray[np.float64]


def log(folder: Path, stages: list[str], columns: dict[str, tuple[Vector, str]]) -> Path:
    """A log of 1 ms ticks in batches of 100; a stage that comes again is visited again."""
    rows = len(stages)
    new = [i == 0 or stages[i] != stages[i - 1] for i in range(rows)]
    since = np.arange(rows) - np.maximum.accumulate(np.where(new, np.arange(rows), 0))
    columns = {
        "clock": (1e-3 * np.arange(rows, dtype=float), "s"),
        "t": (1e-3 * since.astype(float), "s"),
        **columns,
    }
    fields = [
        pa.field(n, pa.float64(), metadata={"unit": unit}) for n, (_, unit) in columns.items()
    ]
    fields.append(pa.field("stage", pa.dictionary(pa.int32(), pa.string())))
    arrays = [pa.array(values) for values, _ in columns.values()]
    names = sorted(set(stages))
    codes = pa.array([names.index(s) for s in stages], pa.int32())
    arrays.append(pa.DictionaryArray.from_arrays(codes, names))
    schema = pa.schema(fields)
    path = folder / "log.arrow"
    path.unlink(missing_ok=True)
    with closing(Log(path, keep=False)) as writer:
        batch = pa.record_batch(arrays, schema=schema)
        for start in range(0, rows, 100):
            writer.write(batch.slice(start, 100))
    return path


def tiny_columns(rows: int = 400) -> dict[str, tuple[Vector, str]]:
    half = rows // 2
    t = np.arange(rows) * 1e-3
    force = np.where(np.arange(rows) < half, 0.0, -15.0 + 0.1 * np.sin(40 * t))
    wanted = np.where(np.arange(rows) < half, NAN, -15.0)
    return {
        "force.x": (0.5 * np.sin(9 * t), "N"),
        "force.z": (force, "N"),
        "force.x.ref": (np.full(rows, NAN), "N"),
        "force.z.ref": (wanted, "N"),
        "force.z.measured": (np.concatenate([[0.0], force[:-1]]), "N"),
        "position.x": (0.05 * np.sin(9 * t), "m"),
        "position.x.ref": (0.05 * np.sin(9 * t), "m"),
        "position.y": (0.03 * np.cos(9 * t), "m"),
        "error.x": (np.where(np.arange(rows) < half, 1e-5, NAN), "m"),
        "error.z": (np.full(rows, NAN), "m"),
        "table.gap": (np.linspace(0.01, -0.001, rows), "m"),
        "speed": (np.abs(np.sin(9 * t)) * 0.1, "m/s"),
        "power": (np.zeros(rows), "W"),
        "joint.1.torque": (30 * np.sin(9 * t), "N*m"),
        "joint.2.torque": (5 * np.cos(9 * t), "N*m"),
        "joint.1.position": (t, "rad"),
    }


def tiny_summary() -> dict[str, Any]:
    until = {
        "kind": "until",
        "name": "until",
        "text": "force.z < -2 N",
        "value": 0.2,
        "to": "press",
    }
    done = {"kind": "done", "name": "done", "text": "its time is over", "value": 0.2, "to": "end"}
    return {
        "task": "tiny",
        "about": f"About {NASTY}",
        "status": "done",
        "exit_code": 0,
        "ending": {"reason": "end", "text": "its time is over", "stage": "press", "clock": 0.4},
        "duration": 0.4,
        "period": 0.001,
        "stages": [
            {"name": "touch", "start": 0.0, "end": 0.2, "law": "hybrid", "ended_by": until},
            {"name": "press", "start": 0.2, "end": 0.4, "law": "hybrid", "ended_by": done},
        ],
        "expectations": [
            {
                "text": f"press.force.z within -15 N +- 0.5 N {NASTY}",
                "passed": True,
                "explanation": "100 % of ticks & more",
                "stage": "press",
                "signal": "force.z",
                "band": [-15.5, -14.5],
            }
        ],
        "metrics": {"press": {"force.z": {"rms_error": 0.0707, "max_error": 0.1}}},
        "limits": {"force": 60.0},
        "stage_limits": {"touch": {"force": 20.0}, "press": {"force": 60.0}},
        "joint_limits": [87.0, None],
        "robot": {"name": "panda"},
        "objects": ["table"],
    }


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    log(tmp_path, ["touch"] * 200 + ["press"] * 200, tiny_columns())
    (tmp_path / "task.yaml").write_text(f"name: tiny # {NASTY}\n", encoding="utf-8")
    seal_folder(tmp_path, versions={"mujoco": NASTY})
    rewrite(tmp_path, tiny_summary())
    return tmp_path


def rewrite(folder: Path, summary: dict[str, Any]) -> None:
    (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    seal_folder(folder, status=summary["status"] or "running")


def page(folder: Path) -> str:
    path = write_report(Run(folder))
    assert path == folder / "report.html"
    return path.read_text(encoding="utf-8")


def drawn(folder: Path) -> Any:
    """What the page's script is given to draw."""
    found = re.search(r'<script type="application/json"[^>]*>(.*?)</script>', page(folder), re.S)
    assert found is not None
    data = json.loads(found.group(1))
    for chart in data["charts"].values():
        for trace in chart["traces"]:
            trace |= data["samples"][trace["sample"]]
    return data


def decoded(trace: dict[str, Any]) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    values = np.frombuffer(base64.b64decode(trace["values"]), dtype="<f4")
    if trace["kind"] == "all":
        return np.arange(len(values)), values
    steps = np.frombuffer(base64.b64decode(trace["rows"]), dtype=f"<{trace['kind']}")
    return np.cumsum(steps.astype(np.int64)), values


class TestPage:
    def test_escapes_everything_from_outside(self, folder: Path) -> None:
        text = page(folder)
        assert NASTY not in text
        assert f'within <span class="whole">-15</span> N +- 0.5 N {ESCAPED}' in text
        assert f"About {ESCAPED}" in text
        assert "100 % of ticks &amp; more" in text
        assert text.count(ESCAPED) >= 4

    def test_needs_nothing_from_outside(self, folder: Path) -> None:
        text = page(folder)
        assert not re.search(r"(?:src|href)\s*=", text)
        assert not re.search(r"@import|(?<!Object)url\(|<link|<iframe|\bcdn\b", text, re.I)

    def test_is_the_same_each_time(self, folder: Path) -> None:
        assert write_report(Run(folder)).read_bytes() == write_report(Run(folder)).read_bytes()

    def test_says_what_a_reader_wants_first(self, folder: Path) -> None:
        text = page(folder)
        for words in ("passed", "panda", "hybrid", "0.400 s", "its time is over", ">0.0707 <"):
            assert words in text

    def test_numbers_visits(self, folder: Path) -> None:
        summary = tiny_summary()
        touch, press = summary["stages"]
        summary["stages"] = [touch, press, touch | {"start": 0.4, "end": 0.5}]
        rewrite(folder, summary)
        names = [stage["name"] for stage in drawn(folder)["stages"]]
        assert names == ["touch 1", "press", "touch 2"]


class TestCharts:
    def test_band_stands_where_its_stage_is(self, folder: Path) -> None:
        (band,) = drawn(folder)["charts"]["force.z.ref"]["bands"]
        assert (band["low"], band["high"]) == (-15.5, -14.5)
        assert (band["start"], band["end"]) == (0.2, 0.4)
        assert band["passed"]

    def test_open_band(self, folder: Path) -> None:
        summary = tiny_summary()
        below = {"text": "table.gap < 1 mm", "passed": False, "signal": "table.gap"}
        summary["expectations"].append(below | {"band": [None, 1e-3]})
        rewrite(folder, summary)
        (band,) = drawn(folder)["charts"]["gap"]["bands"]
        assert (band["start"], band["low"], band["high"]) == (0.0, None, 1.0)
        assert band["end"] == pytest.approx(0.4)

    def test_limits_follow_the_stages(self, folder: Path) -> None:
        limits = drawn(folder)["charts"]["force"]["levels"]
        assert {x["kind"] for x in limits} == {"limit"}
        assert {(x["start"], x["end"], abs(x["value"])) for x in limits} == {
            (0.0, 0.2, 20.0),
            (0.2, 0.4, 60.0),
        }

    def test_joint_torques_are_shares_of_their_limits(self, folder: Path) -> None:
        chart = drawn(folder)["charts"]["joint torques"]
        assert [t["label"] for t in chart["traces"]] == ["J1"]
        peak = np.abs(tiny_columns()["joint.1.torque"][0]).max()
        assert np.abs(decoded(chart["traces"][0])[1]).max() == pytest.approx(100 * peak / 87)

    def test_gaps_stay_gaps(self, folder: Path) -> None:
        data = drawn(folder)["charts"]
        reference = data["force.z.ref"]["traces"][1]
        rows, values = decoded(reference)
        assert np.isnan(values[rows < 200]).all()
        assert np.isfinite(values[rows > 200]).all()
        assert [t["label"] for t in data["position error"]["traces"]] == ["x"]

    def test_lines_break_between_stages(self, folder: Path) -> None:
        charts = drawn(folder)["charts"]
        assert charts["position"]["traces"][-1]["gaps"] == [200]
        # The size of the force runs on.
        assert charts["force"]["traces"][0]["gaps"] == []

    def test_zero_throughout_is_told_not_drawn(self, folder: Path) -> None:
        assert "power" not in drawn(folder)["charts"]
        assert "Zero throughout and not drawn: Power." in page(folder)

    def test_stop_is_marked(self, folder: Path) -> None:
        summary = tiny_summary()
        summary["status"] = "stopped"
        summary["stages"][1]["ended_by"] = {"kind": "limit", "text": "limit on force: 60 N"}
        rewrite(folder, summary)
        assert [e["kind"] for e in drawn(folder)["events"]] == ["event", "stop"]

    def test_long_runs_are_thinned_but_keep_their_peaks(self, tmp_path: Path) -> None:
        rows = 900_000
        force = np.random.default_rng(1).normal(size=rows)
        force[12_345], force[23_456] = -50.0, 70.0
        log(tmp_path, ["press"] * rows, {"force.z": (force, "N")})
        (trace,) = drawn(tmp_path)["charts"]["force"]["traces"]
        at, values = decoded(trace)
        # Every tick of the last 0.1 s is drawn besides.
        assert POINTS_BYTES / 16 < len(at) <= POINTS_BYTES / 8 + 110
        assert (values.min(), values.max()) == (-50.0, 70.0)
        assert {12_345, 23_456} <= set(at.tolist())
        assert "the lowest and the highest value are drawn" in page(tmp_path)
        assert (tmp_path / "report.html").stat().st_size < 5_000_000


class TestPatience:
    def test_empty_folder(self, tmp_path: Path) -> None:
        text = page(tmp_path)
        assert "manifest.json is missing" in text
        assert "nothing to draw" in text

    def test_log_alone(self, tmp_path: Path) -> None:
        log(tmp_path, ["a"] * 60 + ["b"] * 40, tiny_columns(100))
        stages = drawn(tmp_path)["stages"]
        assert [(s["name"], s["start"]) for s in stages] == [("a", 0.0), ("b", 0.06)]

    def test_log_that_was_cut_short(self, folder: Path) -> None:
        path = folder / "log.arrow"
        path.write_bytes(path.read_bytes()[:-3000])
        run = Run(folder)
        assert 100 <= len(run.clock) < 400
        assert drawn(folder)["charts"]

    @pytest.mark.parametrize("content", ["", "[1, 2]", "{", '{"stages": 3, "metrics": [1]}'])
    def test_summary_that_is_none(self, folder: Path, content: str) -> None:
        (folder / "summary.json").write_text(content)
        assert drawn(folder)["charts"]

    def test_one_tick(self, tmp_path: Path) -> None:
        log(tmp_path, ["a"], {n: (v[:1], u) for n, (v, u) in tiny_columns().items()})
        assert drawn(tmp_path)["stages"]
        ElementTree.parse(Picture(overview_svg(Run(tmp_path))).save(tmp_path / "run.svg"))

    def test_no_forces(self, tmp_path: Path) -> None:
        columns = {n: c for n, c in tiny_columns().items() if not n.startswith("force")}
        log(tmp_path, ["a"] * 400, columns)
        assert "force" not in drawn(tmp_path)["charts"]


class TestVerdict:
    @pytest.mark.parametrize(
        ("changes", "kind", "words"),
        [
            ({}, "passed", "The expectation held."),
            ({"expectations": []}, "done", "states no expectations"),
            ({"status": "stopped"}, "stopped", "In stage press at 0.400 s: its time is over."),
            ({"status": "failed", "ending": {"text": "too slow"}}, "failed", "too slow."),
            ({"status": ""}, "unfinished", "did not finish"),
        ],
    )
    def test_kinds(self, folder: Path, changes: dict[str, Any], kind: str, words: str) -> None:
        rewrite(folder, tiny_summary() | changes)
        found = verdict(Run(folder))
        assert found.kind == kind
        assert words in found.sentence

    def test_missed(self, folder: Path) -> None:
        summary = tiny_summary()
        summary["expectations"].append({"text": "a < b", "passed": False})
        rewrite(folder, summary)
        found = verdict(Run(folder))
        assert (found.kind, "1 of 2" in found.sentence) == ("missed", True)

    def test_crash_names_its_reason(self, tmp_path: Path) -> None:
        told = {"status": "crashed", "reason": "disk full"}
        seal_folder(tmp_path, **told)
        assert "The run crashed: disk full." in verdict(Run(tmp_path)).sentence


class TestDecimation:
    @given(
        st.lists(st.one_of(st.floats(-1e3, 1e3), st.just(NAN)), min_size=1, max_size=300),
        st.integers(4, 60),
        st.lists(st.integers(1, 299), max_size=3, unique=True),
    )
    def test_keeps_extremes_and_gaps(self, signal: list[float], limit: int, at: list[int]) -> None:
        values = np.array(signal)
        breaks = np.array(sorted(b for b in at if b < len(values)), dtype=np.int64)
        rows = decimate(values, breaks, limit)
        assert (np.diff(rows) > 0).all()
        kept, finite = values[rows], np.isfinite(values)
        if finite.any():
            assert np.nanmin(kept) == np.nanmin(values)
            assert np.nanmax(kept) == np.nanmax(values)
        for first, second in pairwise(rows):
            if finite[first] and finite[second]:
                assert finite[first : second + 1].all()
        shown_rows, shown = broken(rows, values, breaks)
        assert len(shown_rows) == len(shown)

    def test_all_of_a_short_run(self) -> None:
        assert decimate(np.arange(50.0), np.array([], dtype=np.int64), 50).tolist() == list(
            range(50)
        )

    def test_wide_steps(self) -> None:
        rows = np.array([0, 1, 70_000])
        found, values = decoded(dict(encode(rows, np.array([1.0, NAN, 2.0]))))
        assert found.tolist() == rows.tolist()
        assert values[2] == 2.0

    def test_simplify_stays_near(self) -> None:
        x = np.linspace(0, 10, 500)
        points = np.column_stack([x, np.sin(x)])
        kept = simplify(points, 1e-2)
        assert len(kept) < 60
        assert np.abs(np.interp(x, kept[:, 0], kept[:, 1]) - np.sin(x)).max() < 2e-2


def test_measurement_one_tick_late_is_no_difference() -> None:
    truth = np.sin(np.arange(300) / 10)
    late = np.concatenate([[0.0], truth[:-1]])
    assert not differs(truth, late, 1.0)
    assert differs(truth, late + 0.01, 1.0)


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (0.0123, "m", ("12.3", "mm")),
        (4.1e-6, "m", ("4.10", "µm")),
        (-15.02, "N", ("−15.0", "N")),
        (0.0017, "N", ("1.70", "mN")),
        (0.5, "rad", ("28.6", "deg")),
        (1e-14, "m", ("0", "")),
        (None, "m", ("–", "")),
        (3.0, "", ("3.00", "")),
    ],
)
def test_quantities(value: float | None, unit: str, shown: tuple[str, str]) -> None:
    assert quantity(value, unit) == shown


def test_figures() -> None:
    assert [figure(v) for v in (0.0, 1234.5, NAN, 1e-9, 9.9999)] == [
        *("0", "1234", "–", "1.00e−09", "10.0")
    ]


def test_highlight() -> None:
    marked = str(highlighted('a: "x # y" # <z>\n  - b.c: 1'))
    assert marked == "<b>a</b>: &#34;x # y&#34; <i># &lt;z&gt;</i>\n  - <b>b.c</b>: 1"


class TestOverview:
    def test_is_well_formed_and_small(self, folder: Path, tmp_path: Path) -> None:
        rewrite(folder, tiny_summary() | {"task": NASTY})
        path = Picture(overview_svg(Run(folder))).save(tmp_path / "run.svg")
        root = ElementTree.parse(path).getroot()
        assert root.get("width") == "860"
        text = path.read_text(encoding="utf-8")
        assert 'class="area"' in text
        assert NASTY not in text
        assert len(text) < 30_000
        assert "NaN" not in text
        assert "nan" not in text

    def test_shows_the_path(self, folder: Path, tmp_path: Path) -> None:
        path = Picture(overview_svg(Run(folder))).save(tmp_path / "run.svg")
        assert "Path in" in path.read_text(encoding="utf-8")

    def test_a_press_without_a_set_point_shows_the_axis_that_bears_the_force(
        self, folder: Path, tmp_path: Path
    ) -> None:
        history = {n: c for n, c in tiny_columns().items() if not n.endswith("force.z.ref")}
        log(folder, ["a"] * 400, history)
        text = (
            Picture(overview_svg(Run(folder)))
            .save(tmp_path / "run.svg")
            .read_text(encoding="utf-8")
        )
        assert "Force z" in text
        assert "|force|" not in text

    def test_every_colour_is_defined(self, folder: Path, tmp_path: Path) -> None:
        text = (
            Picture(overview_svg(Run(folder)))
            .save(tmp_path / "run.svg")
            .read_text(encoding="utf-8")
        )
        light, dark = text.split("prefers-color-scheme:dark")
        defined = set(re.findall(r"(--\w+):", light))
        # Objects and equations have the colours of joints, of which there are seven.
        assert {f"--j{i}" for i in range(7)} <= defined
        assert {f"--j{i}" for i in range(7)} <= set(re.findall(r"(--\w+):", dark))
        assert set(re.findall(r"var\((--\w+)\)", text)) <= defined | {"--mark"}


def test_what_no_encoder_resolves_is_said_to_be_less_than_that() -> None:
    """2 pi / 2^24 is 0.37 urad, and 0.37 um at 1 m; forces have no such floor."""
    assert _resolved(-1.9e-9, "m") == ("< 0.4", "µm")
    assert _resolved(1.9e-7, "rad") == ("< 21", "µdeg")
    assert _resolved(5e-6, "m") == quantity(5e-6, "m")
    assert _resolved(1e-7, "N") == quantity(1e-7, "N")
    assert _resolved(0.0, "m") == quantity(0.0, "m")
