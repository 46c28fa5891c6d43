"""One task under several laws: who can do it, how the numbers come about, what is left behind."""

from __future__ import annotations

import json
import os
import re
import signal
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from short_tasks import TAP
from typer.testing import CliRunner, Result

from taskspec.compiler import compile_unchecked
from taskspec.laws import LAWS
from taskspec.stability.sampled_stage import loop_of
from taskspec_runner.cli import app
from taskspec_runner.cli.loading import load
from taskspec_runner.compare import read_comparison
from taskspec_runner.compare.attempt import AS_WRITTEN
from taskspec_runner.compare.gains import equal_bandwidth
from taskspec_runner.compare.overlay import COLOURS, overlay, role
from taskspec_runner.compare.ranking import ranks
from taskspec_runner.compare.summary import largest
from taskspec_runner.compare.tracking import best, force_axes, tracking
from taskspec_runner.record.log import read_log

#: Motion and force on one axis, which only the parallel laws can do.
BOTH = TAP.replace("{x: {force: press, ramp: 50 ms}}", "{x: {hold: start, force: press}}")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(*args: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    assert "Traceback" not in result.output
    return result


def compare(*args: str | Path) -> tuple[int, Any]:
    result = call("compare", *args, "--format", "json")
    return result.exit_code, json.loads(result.stdout)


#: What an arm that takes torques is compared under.
TORQUES = [kind for kind, facts in LAWS.items() if facts.commands == "torque"]


def laws(*names: str) -> list[str]:
    return [part for name in names for part in ("--law", name)]


def test_every_law_is_compared_where_none_is_named(tap: Path) -> None:
    code, data = compare(tap)
    assert code == data["exit_code"] == 0
    assert [law["law"] for law in data["laws"]] == [AS_WRITTEN, *TORQUES]
    assert data["folder"] == "runs/tap-compare"
    for law in data["laws"]:
        summary = json.loads(Path(data["folder"], law["folder"], "summary.json").read_text())
        assert {stage["law"] for stage in summary["stages"]} == {law["kind"]}
        assert law["duration"] == summary["duration"]
        assert Path(data["folder"], law["folder"], "report.html").is_file()


def test_table_names_laws_outcomes_and_errors(tap: Path) -> None:
    result = call("compare", tap, *laws("hybrid", "pd"), "--out", "out")
    assert result.exit_code == 0
    assert result.stderr == ""
    assert "\x1b" not in result.output
    lines = result.stdout.splitlines()
    assert lines[0].split() == [
        "law", "rank", "outcome", "met", "lasted", "peak", "force", "why"
    ]  # fmt: skip
    # The file names no law: as written it is the default, with designed gains, and shares a rank.
    assert re.match(r"as written +(\d) +passed +4 of 4 +0\.\d{3} s", lines[1])
    (own,) = (line for line in lines[2:4] if line.startswith("hybrid"))
    assert own.split()[1] == lines[1].split()[2]
    assert "stage hold: errors" in lines
    # Nothing is to be reached by force while the wall is approached.
    assert "stage approach: errors" not in lines
    assert lines[-1] == "page: out/compare.html"
    assert call("compare", tap, *laws("hybrid", "parallel"), "--quiet", "--out", "out").output == ""


def test_only_some_laws_can(tap: Path) -> None:
    tap.write_text(BOTH)
    code, data = compare(tap)
    # As written, under the default law, the file is refused.
    assert code == 2
    assert data["laws"][0]["outcome"] == "refused"
    able = {law["law"] for law in data["laws"] if law["outcome"] != "refused"}
    assert able == {law for law, facts in LAWS.items() if facts.shares}
    assert all((law["rank"] is None) is (law["law"] not in able) for law in data["laws"])
    line = 1 + BOTH[: BOTH.index("hold: start")].count("\n")
    for law in data["laws"]:
        if law["law"] not in able:
            assert law["reason"].startswith("TS203: axis 'x' has both")
            assert law["reason"].endswith(f"(line {line})")
            assert law["diagnostics"][0]["code"] == "TS203"
            assert not Path(data["folder"], law["law"]).exists()
    assert "refused, TS203" in Path(data["picture"]).read_text()


def test_fewer_than_two_laws_are_no_comparison(tap: Path) -> None:
    tap.write_text(BOTH)
    result = call("compare", tap, *laws("parallel", "pd"))
    assert result.exit_code == 2
    assert "only parallel can do this task, so there is nothing to compare" in result.stdout
    result = call("compare", tap, *laws("hybrid", "pd"), "--out", "none")
    assert result.exit_code == 2
    assert "none of these laws can do this task" in result.stdout
    assert not Path("none").exists()
    # One that is named alone is held against the file as written.
    tap.write_text(TAP)
    assert call("compare", tap, *laws("parallel")).exit_code == 0


@pytest.mark.parametrize("form", ["text", "json"])
def test_file_that_is_wrong_whatever_the_law(tap: Path, form: str) -> None:
    tap.write_text(BOTH.replace("velocity: 20 mm/s", "velocity: 20 mm"))
    result = call("compare", tap, *laws("hybrid", "parallel"), "--format", form)
    assert result.exit_code == 2
    if form == "json":
        found = [d["code"] for d in json.loads(result.stdout)["diagnostics"]]
    else:
        assert result.stdout == ""
        found = re.findall(r"error\[(TS\d+)\]", result.stderr)
    assert found == ["TS112"]
    assert not Path("runs").exists()


def test_wrong_usage(tap: Path) -> None:
    result = call("compare", tap, *laws("hybrid", "paralel"))
    assert result.exit_code == 2
    assert "there is no law 'paralel'; did you mean 'parallel'?" in result.stderr
    assert f"the laws are {', '.join(LAWS)}" in result.stderr
    assert call("compare", tap, "--law", "").exit_code == 2
    assert call("compare", "absent.yaml").exit_code == 2
    assert call("compare", tap, "--set", "press").exit_code == 2
    assert not Path("runs").exists()


def test_gain_that_a_law_does_not_have(tap: Path) -> None:
    _, data = compare(tap, *laws("hybrid", "pd", "parallel"), "--set", "law.bandwidth=4 Hz")
    outcomes = {law["law"]: (law["outcome"], law["codes"]) for law in data["laws"]}
    assert outcomes["pd"] == outcomes["parallel"] == ("refused", ["TS207"])
    assert outcomes["hybrid"][0] == "passed"


def test_stops_and_failures_are_results(tap: Path) -> None:
    code, data = compare(tap, *laws("hybrid", "pd"), "--set", "limits={force: 3 N}")
    # That of the file as written counts.
    assert code == 4
    for law in data["laws"]:
        assert law["outcome"] == "stopped"
        assert re.search(r"in stage hold at 0\.\d+ s: limit on force: 3 N, measured", law["reason"])
        assert not law["stages"]["hold"]["planned"]
    code, data = compare(
        tap, *laws("hybrid", "pd"), "--set", "stages.approach.within={time: 50 ms}"
    )
    assert (code, {law["outcome"] for law in data["laws"]}) == (6, {"failed"})


def test_notes_say_what_the_file_loses(tap: Path) -> None:
    own = "    time: 0.3 s\n    law: {kind: pd, stiffness: 1 kN/m}"
    text = TAP.replace("    time: 0.3 s", own).replace(
        "params:", "law: {kind: hybrid, bandwidth: 4 Hz}\nparams:"
    )
    tap.write_text(text)
    _, data = compare(tap, *laws("hybrid", "parallel"))
    assert data["notes"] == [
        "every law has designed gains; those that the file gives hybrid are in the row "
        "'as written' alone",
        "stage hold has a law of its own, which is replaced too, but not 'as written'",
    ]
    tap.write_text(TAP)
    assert compare(tap, *laws("hybrid", "parallel"))[1]["notes"] == [
        "'as written' and hybrid are the same run: the file gives no other gains"
    ]


def test_errors_are_those_of_the_log(tap: Path) -> None:
    _, data = compare(tap, *laws("pd", "hybrid"))
    for law in data["laws"]:
        history = read_log(Path(data["folder"], law["folder"], "log.arrow"))
        rows = history.window("hold")
        told = law["stages"]["hold"]
        force = (history.columns["force.x.ref"] - history.columns["force.x"])[rows]
        assert told["force"] == {
            "axis": "x",
            "rms_error": pytest.approx(np.sqrt(np.mean(force**2)), rel=1e-12),
            "max_error": pytest.approx(np.abs(force).max(), rel=1e-12),
            "final_error": pytest.approx(abs(force[-1]), rel=1e-12),
        }
        # Under pd the force comes from a reference in the wall; that is no motion to be followed.
        assert told["motion"]["axis"] == "y"
        motion = history.columns["error.y"][rows]
        assert told["motion"]["max_error"] == pytest.approx(np.abs(motion).max(), rel=1e-12)
        assert law["peak_force"] == pytest.approx(
            np.hypot(history.columns["force.x"], history.columns["force.y"]).max(), rel=1e-12
        )


def test_worst_axis_of_each_kind() -> None:
    def errors(rms: float, largest: float, final: float) -> dict[str, float]:
        return {"rms_error": rms, "max_error": largest, "final_error": final}

    visit = {"name": "a", "start": 1.0, "end": 3.0, "ended_by": {"kind": "done"}}
    closed = {
        "metrics": {"a": {"force.z": errors(1, 5, -4), "position.x": errors(2, 3, 0)}},
        "peaks": {"a": {"force": 9.0}},
        "stages": [visit, {**visit, "start": 4.0, "end": 4.5, "ended_by": {"kind": "limit"}}],
    }
    metrics = {"position.z": errors(50, 50, 50), "position.x": errors(2, 3, 0.1),
               "position.y": errors(1, 7, -0.2), "torque.rx": errors(1, 1, 1)}  # fmt: skip
    opened = {**closed, "metrics": {"a": metrics}}
    forces = force_axes([closed, opened])
    assert forces == {"a": ["z", "rx"]}
    told = tracking(opened, forces)["a"]
    assert told["motion"] == {"axis": "x", **errors(2, 7, 0.2)}
    assert told["force"] is told["rotation"] is None
    assert told["torque"]["axis"] == "rx"
    assert (told["duration"], told["planned"], told["peak_force"]) == (2.5, False, 9.0)
    assert tracking(closed, forces)["a"]["force"]["final_error"] == 4


def test_a_peak_that_is_not_finite_has_no_number() -> None:
    assert largest([1.0, 3.0, 2.0]) == 3.0
    assert largest([1.0, None, None]) is None
    assert largest([]) == 0.0


def test_least_is_sought_among_those_that_went_through() -> None:
    rows = {
        "a": {"planned": True, "force": {"rms_error": 2.0}},
        "b": {"planned": False, "force": {"rms_error": 1.0}},
        "c": {"planned": True, "force": {"rms_error": 3.0}},
        "d": {"planned": True, "force": None},
        "e": None,
    }
    assert best(rows, "force", "rms_error") == {"a"}
    assert best({law: rows[law] for law in "abd"}, "force", "rms_error") == set()


def test_runs_are_laid_over_each_other_where_the_force_begins(tap: Path) -> None:
    _, data = compare(tap, *laws("hybrid", "pd", "stiffness"))
    laid = overlay(read_comparison(Path(data["folder"])))
    assert laid is not None
    assert laid.origin == "hold"
    entered = set()
    for law, run in laid.runs.items():
        first = next((v.start for v in run.visits if v.stage == "hold"), None)
        if first is not None:
            assert laid.begins[law] + first == pytest.approx(0.0, abs=1e-12)
            entered.add(first)
    # Otherwise there would be nothing to shift.
    assert len(entered) > 1
    assert laid.start <= laid.begins[laid.lead] < 0 < laid.end


def test_page_is_offline_and_shows_every_law(tap: Path) -> None:
    tap.write_text(TAP.replace("Touch a wall", "Touch <b>a wall</b>"))
    _, data = compare(tap, *laws("hybrid", "pd", "parallel"))
    page = Path(data["page"]).read_text(encoding="utf-8")
    assert "Touch &lt;b&gt;a wall" in page
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", page)
    assert 'href="hybrid/report.html"' in page
    drawn = json.loads(re.search(r'id="run-data">(.*?)</script>', page, re.S)[1])
    assert re.findall(r'<figure data-chart="(.*?)">', page) == [
        "force.x.ref", "force.x.error", "motion error", "position.x"
    ]  # fmt: skip
    for key in ("force.x.ref", "motion error"):
        labels = [trace["label"] for trace in drawn["charts"][key]["traces"]]
        # Those without a force loop come last, and over the others.
        assert [label for label in labels if label != "reference"][-1] == "pd"
        assert {*labels} - {"reference"} == {AS_WRITTEN, "hybrid", "parallel", "pd"}
    assert drawn["charts"]["motion error"]["log"]
    assert not drawn["charts"]["force.x.ref"]["log"]


def test_picture_is_well_formed_and_has_a_line_a_law(tap: Path) -> None:
    _, data = compare(tap, *laws("hybrid", "pd"), "--set", "limits={force: 4 N}")
    root = ElementTree.parse(data["picture"]).getroot()
    lines = [e for e in root.iter() if e.tag.endswith("path") and "d" in e.attrib]
    for law in ("hybrid", "pd"):
        own = [e.attrib["class"] for e in lines if e.get("stroke") == f"var(--{role(law)})"]
        style = "line" if LAWS[law].force_loop else "loopless"
        # The legend, the force, its error and the motion error; a cross in each panel.
        assert own.count(style) == 4
        assert own.count("cross") == 3


def test_colours_of_page_and_picture_are_the_same(tap: Path) -> None:
    _, data = compare(tap, *laws("hybrid", "pd"))
    found = [
        re.findall(r"--law(\d): (#[0-9a-f]{6})", text.partition("</style>")[0])
        for text in (Path(data[key]).read_text(encoding="utf-8") for key in ("page", "picture"))
    ]
    assert found[0] == found[1]
    assert len(found[0]) == 2 * COLOURS
    assert len(TORQUES) <= COLOURS, "or two laws look alike"
    colours = [role(law) for law in LAWS if law not in TORQUES]
    assert len({*colours}) == len(colours) == len(LAWS) - len(TORQUES)


def test_folder_is_replaced_numbered_and_spared(tap: Path) -> None:
    assert compare(tap, *laws("hybrid", "pd"), "--out", "out")[0] == 0
    assert compare(tap, *laws("hybrid", "parallel"), "--out", "out")[0] == 0
    assert sorted(p.name for p in Path("out").iterdir()) == [
        "as-written", "compare.html", "compare.json", "compare.svg", "hybrid", "parallel"
    ]  # fmt: skip
    folders = [compare(tap, *laws("hybrid", "pd"))[1]["folder"] for _ in range(2)]
    assert folders == ["runs/tap-compare", "runs/tap-compare-2"]
    Path("other").mkdir()
    Path("other", "thesis.txt").write_text("")
    result = call("compare", tap, *laws("hybrid", "pd"), "--out", "other")
    assert result.exit_code == 2
    assert "holds no comparison" in result.stderr
    assert [p.name for p in Path("other").iterdir()] == ["thesis.txt"]


def test_same_bytes_and_rendered_again(tap: Path) -> None:
    for out in ("a", "b"):
        assert compare(tap, *laws("hybrid", "pd"), "--out", out)[0] == 0
    names = ("compare.json", "compare.svg", "compare.html")
    written = {name: Path("a", name).read_bytes() for name in names}
    assert all(Path("b", name).read_bytes() == content for name, content in written.items())
    Path("a", "compare.html").unlink()
    result = call("report", "a")
    assert (result.exit_code, result.stdout) == (0, "a/compare.html\n")
    assert Path("a", "compare.html").read_bytes() == written["compare.html"]
    Path("a", "compare.json").write_text("{}")
    assert call("report", "a").exit_code == 2
    assert call("validate", ".").stdout == "no errors in 1 file\n"


def test_internal_error_under_one_law_spares_the_others(
    tap: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from taskspec_runner import session

    usual = session.judge_run

    def broken(program: Any, *args: Any) -> Any:
        if program.context.loaded.task.law.kind == "pd":
            raise ZeroDivisionError("as a test")
        return usual(program, *args)

    monkeypatch.setattr("taskspec_runner.session.judge_run", broken)
    code, data = compare(tap, *laws("pd", "hybrid", "parallel"))
    assert code == 3
    outcomes = {law["law"]: law["outcome"] for law in data["laws"]}
    assert outcomes == {
        AS_WRITTEN: "passed", "pd": "crashed", "hybrid": "passed", "parallel": "passed"
    }  # fmt: skip
    assert "ZeroDivisionError: as a test" in data["laws"][1]["reason"]
    assert "pd/crash.txt" in data["laws"][1]["reason"]
    assert Path(data["page"]).is_file()


def test_interrupted_comparison_keeps_what_it_has(
    tap: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from taskspec_runner import session

    usual = session._watch

    def watch(interrupt: Any, progress: Any) -> Any:
        os.kill(os.getpid(), signal.SIGINT)
        return usual(interrupt, progress)

    monkeypatch.setattr("taskspec_runner.session._watch", watch)
    code, data = compare(tap, *laws("hybrid", "pd"))
    assert code == data["exit_code"] == 130
    assert [law["outcome"] for law in data["laws"]] == ["interrupted", "not run", "not run"]
    assert Path(data["page"]).is_file()


#: Holds its place along the wall too softly, which designed gains do not.
OWN_GAINS = TAP.replace("params:", "law: {kind: hybrid, bandwidth: 1 Hz}\nparams:")


def test_the_file_as_written_comes_first_with_its_own_gains(tap: Path) -> None:
    tap.write_text(OWN_GAINS)
    code, data = compare(tap, *laws("hybrid", "parallel"))
    assert code == data["exit_code"] == 1
    written, hybrid, _ = data["laws"]
    assert (written["law"], written["kind"], written["outcome"]) == (AS_WRITTEN, "hybrid", "missed")
    assert hybrid["outcome"] == "passed"
    # It is what `run` does with the file.
    alone = call("run", tap, "--out", "alone")
    assert alone.exit_code == 1
    told = json.loads(Path("alone", "summary.json").read_text())
    own = json.loads(Path(data["folder"], written["folder"], "summary.json").read_text())
    assert told["expectations"] == own["expectations"]

    def gain(law: Any) -> Any:
        found = law["gains"]["hold"]
        return next((g["value"], g["origin"]) for g in found if g["name"] == "bandwidth")

    assert gain(written)[1] == "file"
    assert gain(hybrid)[0] > gain(written)[0]
    assert gain(hybrid)[1] != "file"
    # With gains that reach it, the exit code is that of a file that passes.
    assert compare(tap, *laws("hybrid"), "--set", "law={kind: hybrid}")[0] == 0


def test_gains_stand_beside_results_and_those_that_differ_are_marked(tap: Path) -> None:
    tap.write_text(OWN_GAINS)
    _, data = compare(tap, *laws("hybrid", "pd"))
    page = Path(data["page"]).read_text(encoding="utf-8")
    table = re.search(r'<table class="laws gains cards">(.*?)</table>', page, re.S)
    assert table is not None
    rows = dict(re.findall(r"</svg>\s*([\w -]+)</td>(.*?)</tr>", table[1], re.S))
    assert set(rows) == {AS_WRITTEN, "hybrid", "pd"}
    marked = {law: re.findall(r'class="gain other">([\w.]+)', row) for law, row in rows.items()}
    assert marked[AS_WRITTEN] == []
    assert "bandwidth" in marked["hybrid"]
    assert "stiffness" in marked["pd"]
    for law in data["laws"]:
        assert f"{law['stages']['hold']['force']['rms_error']:.2g}"[:3] in rows[law["law"]]


def test_ranks_go_by_outcome_then_expectations_then_error() -> None:
    def law(outcome: str, met: int, error: float | None) -> dict[str, Any]:
        force = None if error is None else {"rms_error": error}
        stages = {"press": {"force": force, "motion": None}, "leave": {"force": {"rms_error": 99}}}
        return {"outcome": outcome, "met": met, "stages": stages}

    found = [
        law("missed", 2, 0.1), law("passed", 3, 0.5), law("passed", 3, 0.2), law("stopped", 3, 0.1),
        law("missed", 1, 0.0), {"outcome": "refused"}, law("passed", 3, 0.5),
        law("passed", 3, None),
    ]  # fmt: skip
    assert ranks(found, {"press": ["z"], "leave": []}) == [5, 2, 1, 7, 6, None, 2, 4]


def test_errors_within_five_percent_of_the_least_of_a_rank_share_it() -> None:
    def law(error: float, met: int = 1) -> dict[str, Any]:
        return {"outcome": "passed", "met": met, "stages": {"s": {"force": {"rms_error": error}}}}

    found = [law(0.2), law(0.198), law(0.207), law(0.209), law(0.198, met=0)]
    assert ranks(found, {"s": ["z"]}) == [1, 1, 1, 4, 5]


FREE = """\
taskspec: 1
name: free
robot: {model: panda, start: {xyz: [500 mm, 0, 400 mm]}}
stages:
  there:
    axes: {x: {move: 20 mm, speed: 50 mm/s}}
"""


def test_equal_bandwidth_puts_the_poles_of_all_laws_in_one_place(here: Path) -> None:
    """Six pairs of poles at 2 Hz with a ratio of 0.7, read off the sampled loop of the real arm.

    Sampling at 1 kHz moves them by w T / 2, less than a hundredth.
    """
    file, found = here / "free.yaml", {}
    file.write_text(FREE)
    for law in ("hybrid", "impedance", "parallel"):
        program = compile_unchecked(load(file, law=law, gains=equal_bandwidth(law)))
        loop = loop_of(program.plan, "there")
        assert loop is not None
        s = np.array([mode.s for mode in loop.modes() if mode.s.imag > 1])
        assert len(s) == 6, law
        found[law] = s
        assert np.abs(s) / (2 * np.pi) == pytest.approx(2.0, rel=0.01)
        assert -s.real / np.abs(s) == pytest.approx(0.7, rel=0.02)
    assert found["hybrid"] == pytest.approx(found["impedance"], rel=0.01)


def test_compared_with_equal_bandwidth(tap: Path) -> None:
    """The runs have these gains, and their folders say so: they are compiled again with them."""
    _, data = compare(tap, *laws("hybrid", "impedance"), "--equal", "bandwidth")
    assert data["equal"] == "bandwidth"
    hybrid = next(law for law in data["laws"] if law["law"] == "hybrid")
    of_y = [g["value"] for g in hybrid["gains"]["hold"] if g["name"] == "bandwidth"]
    assert of_y == [2.0]
    assert not data["notes"]
    read = read_comparison(Path(data["folder"]))
    assert read.runs["hybrid"].manifest["overrides"]["law.bandwidth"].startswith("{linear: 2 Hz")
    assert "bandwidth of 2 Hz" in Path(data["page"]).read_text()
    _, usual = compare(tap, *laws("hybrid", "impedance"))
    assert any("hybrid are the same run" in note for note in usual["notes"])
