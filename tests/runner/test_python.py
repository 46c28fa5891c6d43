"""A run in Python: signals with units, windows, pictures, and what a notebook shows."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from sealed import seal_folder
from short_tasks import TAP

from taskspec import load
from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError
from taskspec_runner import read, run
from taskspec_runner.diff import diff_runs
from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.record.log import read_log
from taskspec_runner.runs import Run
from taskspec_runner.signals import LoggedSignal

EXAMPLES = Path(__file__).resolve().parent.parent.parent / "examples"
#: What is not to be imported before a task is loaded or run.
HEAVY = ("mujoco", "pinocchio", "casadi", "scipy", "pyarrow", "pydantic", "numpy")


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Run:
    here = tmp_path_factory.mktemp("tap")
    (here / "tap.yaml").write_text(TAP, encoding="utf-8")
    return run(load(here / "tap.yaml"), here / "run", seed=2)


def test_result_tells_what_came_of_the_run(result: Run) -> None:
    assert result.passed
    assert result.verdict == "passed"
    assert result.reason.startswith("All 4 expectations held.")
    assert [e.passed for e in result.expectations] == [True] * 4
    assert result.expectations[0].text == "last(hold.force.x) within press +- 0.5 N"
    assert result.summary == json.loads((result.folder / "summary.json").read_text())
    assert (result.manifest["seed"], result.stages) == (2, ("approach", "hold"))
    assert result.metrics["hold"]["force.x"]["rms_error"] > 0
    assert result.report == result.folder / "report.html"
    assert re.fullmatch(
        r"<tap: passed, 4 of 4 expectations met, 0\.\d{3} s, in .*/run>", repr(result)
    )


_OPENED: list[tuple[str, str]] = []


def _note_opened(event: str, args: tuple[Any, ...]) -> None:
    if event == "open" and isinstance(args[0], str | Path):
        _OPENED.append((str(args[0]), str(args[1])))


def test_a_run_reads_nothing_back(tmp_path: Path) -> None:
    """What it wrote is in memory, for verdict, report, signals and pictures."""
    sys.addaudithook(_note_opened)
    _OPENED.clear()
    result = run(load_text(TAP, "tap.yaml"), tmp_path / "run")
    assert result.passed
    assert result.report is not None
    assert len(result.signals["force.x"]) == result.summary["ticks"]
    assert result.plot().svg
    assert result._repr_html_()
    assert result.manifest["status"] == "done"
    opened = [(Path(path).name, mode) for path, mode in _OPENED if str(tmp_path) in path]
    assert ("log.arrow", "x") in {(name, mode[:1]) for name, mode in opened}
    assert [(name, mode) for name, mode in opened if "r" in mode] == []


def test_a_run_is_saved_and_loaded(result: Run, tmp_path: Path) -> None:
    saved = result.save(tmp_path / "copy")
    for each in (saved, read(tmp_path / "copy")):
        assert each.folder == tmp_path / "copy"
        assert (each.damage, each.verdict) == ("", "passed")
        assert (each.task, each.summary) == (result.task, result.summary)
        assert diff_runs(result, each).equal
        assert each.stages == result.stages
        assert list(each.columns) == list(result.columns)
    with pytest.raises(OutputError, match="holds no run"):
        result.save(tmp_path)


def test_a_damaged_run_is_not_saved(result: Run, tmp_path: Path) -> None:
    copy = result.save(tmp_path / "copy").folder
    (copy / "log.arrow").write_bytes((copy / "log.arrow").read_bytes()[:-1000])
    with pytest.raises(InputError, match=r"log\.arrow was cut short"):
        read(copy).save(tmp_path / "other")


def test_signals_are_the_log_with_units(result: Run) -> None:
    history = read_log(result.folder / "log.arrow")
    assert set(result.signals) == set(history.columns)
    assert len(result.signals) == len(history.columns)
    for name, signal in result.signals.items():
        np.testing.assert_array_equal(np.asarray(signal), history.columns[name])
        assert (signal.name, signal.unit) == (name, history.units[name])
    assert result.stage.tolist() == history.stages.tolist()
    assert len(result) == len(result.clock) == len(history)
    with pytest.raises(KeyError, match=r"did you mean 'force\.x'"):
        result.signals["force.X"]


def test_unit_stays_with_parts_and_leaves_what_is_computed(result: Run) -> None:
    force = result.signals["force.x"]
    part = force[10:20]
    assert isinstance(part, LoggedSignal)
    assert (part.unit, part.name) == ("N", "force.x")
    computed: list[Any] = [force * 2, force - force, np.abs(force), np.sqrt(force**2)]
    assert [type(each) for each in computed] == [np.ndarray] * 4
    assert all(type(v) is np.float64 for v in (force.max(), np.mean(force), force[3]))


def test_signal_in_another_unit(result: Run) -> None:
    way = result.signals["position.x"]
    np.testing.assert_allclose(way.to("mm"), 1e3 * np.asarray(way), rtol=1e-15)
    assert way.to("mm").unit == "mm"
    np.testing.assert_allclose(
        result.signals["joint.1.position"].to("deg"),
        np.degrees(np.asarray(result.signals["joint.1.position"])),
    )
    with pytest.raises(ValueError, match=r"position\.x is in m, not in N"):
        way.to("N")
    with pytest.raises(ValueError, match="touching is in plain numbers, not in N"):
        result.signals["touching"].to("N")


def test_windows_are_parts_of_stages(result: Run) -> None:
    hold = result.during("hold")
    assert set(hold.stage) == {"hold"}
    assert len(hold) == np.count_nonzero(result.stage == "hold")
    t = result.during("hold", start=0.1, end=0.2).signals["t"]
    assert (round(float(t[0]), 9), round(float(t[-1]), 9), len(t)) == (0.1, 0.199, 100)
    assert len(hold.during("approach")) == 0
    assert len(result.during("hold", visit=1)) == len(hold)
    with pytest.raises(KeyError, match="never was in a stage 'holt'; did you mean 'hold'"):
        result.during("holt")
    with pytest.raises(KeyError, match="has 1 visits, not a visit 2"):
        result.during("hold", visit=2)


def test_each_visit_is_a_window_of_its_own(tmp_path: Path) -> None:
    onward = "    time: 0.1 s\n    next: again\n    attempts: 2\n"
    again = "  again: {axes: {x: {move: -3 mm}}, next: approach, attempts: 2}\nexpect:"
    text = TAP.replace("    time: 0.3 s\n", onward).replace("expect:", again, 1)
    (tmp_path / "tap.yaml").write_text(text)
    result = run(load(tmp_path / "tap.yaml"), tmp_path / "run", report=False)
    assert result.stages.count("hold") == 2
    first, second = (result.during("hold", visit=v) for v in (1, 2))
    assert len(first) + len(second) == len(result.during("hold"))
    assert first.clock.max() < second.clock.min()
    assert len(result.during("hold", end=0.05)) == 100


def test_pictures(result: Run, tmp_path: Path) -> None:
    for picture in (result.plot(), result.plot("force.x", "force.x.ref", "wall.gap", "touching")):
        ElementTree.fromstring(picture.svg)
        assert picture._repr_svg_() == picture.svg
    labels = re.findall(r"(?:—|- -) ([\w.]+)", picture.svg)
    assert labels == ["force.x", "force.x.ref", "wall.gap", "touching"]
    assert picture.save(tmp_path / "x.svg").read_text(encoding="utf-8") == picture.svg
    with pytest.raises(ValueError, match=r"saved as \.svg, not as \.png"):
        picture.save(tmp_path / "x.png")
    with pytest.raises(KeyError, match=r"did you mean 'force\.x'"):
        result.plot("forcex")
    with pytest.raises(KeyError, match=r"'force\.y\.ref' has no value in this run"):
        result.plot("force.y.ref")


def test_notebook_shows_verdict_expectations_and_picture(tmp_path: Path, result: Run) -> None:
    html = result._repr_html_()
    ElementTree.fromstring(html)
    for told in ("passed", "All 4 expectations held.", "max(abs(hold.error.y)) &lt; 1 mm", "<svg"):
        assert told in html
    (tmp_path / "tap.yaml").write_text(TAP.replace("within press", "within 6 N"))
    missed = run(load(tmp_path / "tap.yaml"), tmp_path / "<i>", report=False)
    assert not missed.passed
    assert missed.report is None
    html = missed._repr_html_()
    assert "missed" in html
    assert "<i>" not in html


def test_read_takes_a_run_that_was_killed_as_far_as_it_goes(result: Run, tmp_path: Path) -> None:
    for name in ("manifest.json", "task.yaml", "log.arrow"):
        (tmp_path / name).write_bytes((result.folder / name).read_bytes())
    seal_folder(tmp_path, status="running")
    partial = read(tmp_path)
    assert (partial.passed, partial.verdict) == (False, "unfinished")
    assert len(partial) == len(result)
    assert partial.summary == {}
    # Judged on the ticks that there are, which are all.
    assert [e.passed for e in partial.expectations] == [e.passed for e in result.expectations]
    assert "So far: 4 of 4 expectations met on the ticks that there are." in partial.reason
    assert "unfinished" in partial._repr_html_()
    (tmp_path / "log.arrow").unlink()
    assert len(read(tmp_path)) == 0
    assert read(tmp_path).damage == "log.arrow is missing"
    with pytest.raises(InputError, match="not the folder of a run"):
        read(tmp_path / "nothing")


def test_task_that_is_wrong_raises_everything_that_was_found(tmp_path: Path) -> None:
    (tmp_path / "tap.yaml").write_text(TAP.replace("time: 0.3 s", "tme: 0.3 s"))
    with pytest.raises(SpecError, match="TS020"):
        load(str(tmp_path / "tap.yaml"))
    with pytest.raises(SpecError, match="TS112"):
        load(tmp_path / "tap.yaml", set={"press": "5"})


def test_values_are_overridden_by_what_a_file_would_have(tmp_path: Path) -> None:
    (tmp_path / "tap.yaml").write_text(TAP)
    given = {"limits": {"force": "33 N"}, "robot.start.xyz": ["480 mm", 0, "320 mm"]}
    task = load(tmp_path / "tap.yaml", set=given).task
    assert task.limits is not None
    assert task.limits.force == 33.0
    assert task.robot.start.xyz == pytest.approx((0.48, 0.0, 0.32))
    with pytest.raises(SpecError, match="TS112"):
        load(tmp_path / "tap.yaml", set={"press": 5})
    with pytest.raises(TypeError, match="not JSON serializable"):
        load(tmp_path / "tap.yaml", set={"press": object()})


def test_export(result: Run, tmp_path: Path) -> None:
    assert result.export("csv", tmp_path / "x.csv").read_text().startswith("clock [s],")
    with pytest.raises(InputError, match="there is no format 'cvs'; did you mean 'csv'"):
        result.export("cvs")


@pytest.mark.parametrize("statement", ["import taskspec", "from taskspec import load",
                                       "from taskspec_runner import read, run"])  # fmt: skip
def test_import_is_light(statement: str) -> None:
    code = f"{statement}\nimport sys\nprint(*sorted(set(sys.modules) & {set(HEAVY)}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_loading_a_task_needs_no_simulator(tmp_path: Path) -> None:
    (tmp_path / "tap.yaml").write_text(TAP)
    code = (
        "import sys; from taskspec import load; load(sys.argv[1])\n"
        "print(*sorted({'mujoco', 'pinocchio', 'casadi'} & set(sys.modules)))"
    )
    command = [sys.executable, "-c", code, tmp_path / "tap.yaml"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


# examples


def test_example_script(tmp_path: Path) -> None:
    command = [sys.executable, EXAMPLES / "press.py", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    rows = re.findall(r"^ *(\d+) kN/m: passed, settled after (\d\.\d{3}) s$", done.stdout, re.M)
    assert [row[0] for row in rows] == ["5", "10", "20"]
    # The loop gain of a force integral is proportional to the stiffness that it acts on.
    assert float(rows[0][1]) > float(rows[1][1])
    assert (tmp_path / "press.svg").is_file()


def test_example_notebook(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    book = json.loads((EXAMPLES / "press.ipynb").read_text(encoding="utf-8"))
    (tmp_path / "examples").mkdir()
    (tmp_path / "tasks").symlink_to(EXAMPLES.parent / "tasks")
    monkeypatch.chdir(tmp_path / "examples")
    names: dict[str, Any] = {}
    cells = ["".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "code"]
    for source in cells:
        exec(compile(source, "press.ipynb", "exec"), names)
    assert names["result"].passed
    assert names["soft"].verdict == "missed"
    # A fresh notebook: outputs would go stale, and pictures make it large.
    assert all(not c["outputs"] for c in book["cells"] if c["cell_type"] == "code")
