"""`taskspec test`: many files as tests, what is told of them, and the plugin of pytest."""

from __future__ import annotations

import json
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from command_line import call
from short_tasks import TAP

from taskspec_runner.cli.testing.selection import chosen_by
from taskspec_runner.cli.validate import task_files
from taskspec_runner.errors import InputError

EXPECTED = TAP.index("expect:")
NAMED = """\
expect:
  pressed: last(hold.force.x) within press +- 0.5 N
  soft-touch: max(norm(force)) < BOUND
"""
REFUSED = "taskspec: 1\nrobot: {model: planar9}\nstages: {wait: {time: 1 s}}\n"
#: Ends in `fail`: it does not touch in time.
LATE = TAP.replace("within: {time: 0.4 s}", "within: {time: 20 ms}")


def named(bound: str) -> str:
    return TAP[:EXPECTED] + NAMED.replace("BOUND", bound)


@pytest.fixture
def tasks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Five files: two pass, one misses, one fails, one is refused."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "tasks"
    (folder / "deep").mkdir(parents=True)
    texts = {"a-good": TAP, "b-named": named("20 N"), "deep/hard": named("2 N"),
             "deep/late": LATE, "deep/refused": REFUSED}  # fmt: skip
    for name, text in texts.items():
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    return folder


def test_each_file_is_run_and_what_failed_is_told(tasks: Path) -> None:
    result = call("test", tasks, "--jobs", "1", "--durations", "1")
    assert result.exit_code == 2
    lines = [line.split() for line in result.stdout.splitlines()]
    assert [line[0] for line in lines[:5]] == ["passed", "passed", "FAILED", "FAILED", "FAILED"]
    assert "FAIL  soft-touch: max(norm(force)) < 2 N" in result.stdout
    assert "FAIL  ends well" in result.stdout
    assert "there is no robot 'planar9'" in result.stdout
    assert "slowest:" in result.stdout
    assert lines[-1][:4] == ["3", "failed,", "2", "passed"]
    # What passed leaves nothing, what failed its report.
    assert sorted(p.name for p in Path("runs/tests").iterdir()) == ["hard", "last.json", "late"]
    assert Path("runs/tests/hard/report.html").is_file()


def test_processes_tell_the_same(tasks: Path) -> None:
    """Two processes, begun anew, in the order of the files."""
    said = []
    for jobs in ("1", "2"):
        command = [sys.executable, "-m", "taskspec_runner", "test", str(tasks), "--jobs", jobs]
        done = subprocess.run(
            [*command, "--format", "json"], capture_output=True, text=True, check=False
        )
        assert done.returncode == 2, done.stderr
        found = json.loads(done.stdout)
        assert (found.pop("passed"), found.pop("failed")) == (2, 3)
        for each in (found, *found["files"]):
            del each["seconds"]
        said.append(found)
    assert said[0] == said[1]


def test_last_failed_first_failed_and_the_first_one(tasks: Path) -> None:
    def run(*options: str) -> list[str]:
        result = call("test", tasks, "--jobs", "1", *options)
        words = [line.split() for line in result.stdout.splitlines()]
        return [Path(w[1]).stem for w in words if w[:1] in (["passed"], ["FAILED"])]

    everything = ["a-good", "b-named", "hard", "late", "refused"]
    # Where nothing is known, all are run.
    assert run("--lf") == everything
    assert run("--lf") == everything[2:]
    assert run("--ff") == everything[2:] + everything[:2]
    assert run("-x") == everything[:3]
    (tasks / "deep" / "refused.yaml").write_text(TAP, encoding="utf-8")
    assert run("-k", "refused") == ["refused"]
    # What was not run stays as it was.
    assert run("--lf") == ["hard", "late"]


@pytest.mark.parametrize(
    ("words", "chosen"),
    [
        ("press", [True, True, False]),
        ("press and not qp", [True, False, False]),
        ("not (press or wipe)", [False, False, False]),
        ("WIPE or qp", [False, True, True]),
        ("not press and not qp", [False, False, True]),
    ],
)
def test_words_choose_paths(words: str, chosen: list[bool]) -> None:
    paths = ["tasks/press.yaml", "tasks/press-qp.yaml", "tasks/Wipe.yaml"]
    assert [chosen_by(words)(Path(path)) for path in paths] == chosen


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "needed at the end"),
        ("a or", "needed at the end"),
        ("(a or b", "a '\\)' is missing"),
        ("a b", "'b' is one too many"),
        ("and a", "needed before 'and'"),
    ],
)
def test_words_that_are_no_expression_are_told(words: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        chosen_by(words)


def test_bad_usage_is_told(tasks: Path) -> None:
    for options, said in (
        (("-k", "nothing"), "chooses none of 5 task files"),
        (("--set", "press"), "--set needs KEY=VALUE"),
    ):
        result = call("test", tasks, *options)
        assert (result.exit_code, said in result.output) == (2, True)
    assert call("test", "-").exit_code == 2
    assert call("test", tasks / "none.yaml").exit_code == 2


def test_files_of_one_name_have_folders_of_their_own(tasks: Path) -> None:
    (tasks / "deep" / "a-good.yaml").write_text(TAP, encoding="utf-8")
    assert call("test", tasks, "-k", "a-good", "--keep", "--jobs", "1").exit_code == 0
    assert Path("runs/tests/tasks-a-good/report.html").is_file()
    assert Path("runs/tests/deep-a-good/report.html").is_file()


def test_junit_has_a_suite_for_a_file_and_a_case_for_an_expectation(tasks: Path) -> None:
    result = call("test", tasks, "--jobs", "1", "--junit", "out.xml", "--format", "junit")
    assert result.stdout.strip() == Path("out.xml").read_text().strip()
    root = ET.fromstring(result.stdout)
    assert {k: root.attrib[k] for k in ("tests", "failures", "errors", "skipped")} == {
        "tests": "17", "failures": "6", "errors": "0", "skipped": "1",
    }  # fmt: skip
    cases = {
        (suite.attrib["name"].rpartition("/")[2], case.attrib["name"]): [e.tag for e in case]
        for suite in root
        for case in suite
    }
    assert cases["b-named.yaml", "soft-touch"] == []
    assert cases["hard.yaml", "soft-touch"] == ["failure"]
    assert cases["hard.yaml", "pressed"] == []
    assert cases["a-good.yaml", "approach.visits <= 1"] == []
    assert cases["refused.yaml", "ends well"] == ["failure"]
    # What had held so far of a run that failed is not called good.
    assert cases["late.yaml", "approach.visits <= 1"] == ["skipped"]
    failure = root.find(".//testcase[@name='soft-touch']/failure")
    assert failure is not None
    assert failure.attrib["type"] == "missed"
    assert "hard.yaml:19: soft-touch: max(norm(force)) < 2 N" in str(failure.text)


def test_github_shows_what_was_missed_at_its_line(tasks: Path) -> None:
    result = call("test", tasks, "--jobs", "1", "--format", "github", "-k", "hard or refused")
    missed, refused = result.stdout.splitlines()
    assert missed.startswith("::error file=")
    assert "deep/hard.yaml,line=19,title=soft-touch::max(norm(force)) < 2 N: " in missed
    assert "refused.yaml,line=2,col=16,endColumn=23,title=TS401::" in refused


@pytest.mark.parametrize("form", ["junit", "github"])
def test_one_run_is_told_in_the_same_form(tasks: Path, form: str) -> None:
    for name, code in (("hard", 1), ("refused", 2)):
        alone = call("run", tasks / "deep" / f"{name}.yaml", "--format", form, "--out", "out")
        many = call("test", tasks, "-k", name, "--jobs", "1", "--format", form)
        assert alone.exit_code == many.exit_code == code
        cases = [
            [line for line in each.stdout.splitlines() if "<failure" in line or "::error" in line]
            for each in (alone, many)
        ]
        assert cases[0] == cases[1] != []


def test_names_of_expectations_are_shown_and_can_be_set(tasks: Path) -> None:
    file = tasks / "b-named.yaml"
    result = call("run", file, "--out", "out", "--set", "expect.soft-touch=max(norm(force)) < 2 N")
    assert result.exit_code == 1
    assert "soft-touch: max(norm(force)) < 2 N" in result.stdout
    summary = json.loads(Path("out/summary.json").read_text())
    assert [each["name"] for each in summary["expectations"]] == ["pressed", "soft-touch"]
    assert "<b>soft-touch</b>" in Path("out/report.html").read_text()
    assert call("judge", "out").exit_code == 1
    diff = call("diff", "out", "out", "--format", "json").stdout
    assert [each["name"] for each in json.loads(diff)["expectations"]] == ["pressed", "soft-touch"]
    refused = call("run", file, "--set", "expect.soft-toch=max(norm(force)) < 2 N")
    assert "did you mean 'soft-touch'?" in refused.output
    assert call("explain", file).exit_code == 0


def collected(tasks: Path, *options: str) -> subprocess.CompletedProcess[str]:
    plugin = ["-p", "no:cacheprovider"]
    if not entry_points(group="pytest11", name="taskspec"):
        # The package was installed before it had the plugin.
        plugin += ["-p", "taskspec_runner.pytest_plugin"]
    return subprocess.run(
        [sys.executable, "-m", "pytest", *plugin, *options],
        cwd=tasks.parent,
        capture_output=True,
        text=True,
        check=False,
    )


def test_pytest_collects_a_folder(tasks: Path) -> None:
    done = collected(tasks, "-v", "--taskspec", "tasks", "-k", "not a-good")
    assert done.returncode == 1, done.stdout + done.stderr
    for line in (
        "tasks/b-named.yaml::soft-touch PASSED",
        "tasks/deep/hard.yaml::pressed PASSED",
        "tasks/deep/hard.yaml::soft-touch FAILED",
        "tasks/deep/late.yaml::ends well FAILED",
        "tasks/deep/refused.yaml::ends well FAILED",
    ):
        assert line in done.stdout, line
    # An expectation without a name is named by its text, dots and all.
    assert "tasks/deep/late.yaml::last(hold.force.x) within press" in done.stdout
    assert "_ hard.yaml: soft-touch _" in done.stdout
    assert "hard.yaml:19: soft-touch: max(norm(force)) < 2 N" in done.stdout
    assert "there is no robot 'planar9'" in done.stdout
    assert "Traceback" not in done.stdout


def test_pytest_takes_folders_from_its_settings_and_leaves_other_yaml_alone(tasks: Path) -> None:
    (tasks.parent / "other").mkdir()
    (tasks.parent / "other" / "data.yaml").write_text("a: 1\n")
    (tasks.parent / "pytest.ini").write_text("[pytest]\ntaskspec_paths = tasks\n")
    done = collected(tasks, "--collect-only", "-q", ".")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "b-named.yaml::soft-touch" in done.stdout
    assert "data.yaml" not in done.stdout
    missing = collected(tasks, "--taskspec", "nowhere")
    assert (missing.returncode, "there is no" in missing.stderr) == (4, True)


@pytest.mark.parametrize("marker", ["manifest.json", "compare.json", "sweep.json"])
def test_copies_in_folders_of_results_are_no_tests(tasks: Path, marker: str) -> None:
    results = tasks / "runs" / "press"
    results.mkdir(parents=True)
    (results / marker).write_text("{}")
    (results / "task.yaml").write_text(TAP)
    (results.parent / "own.yaml").write_text(TAP)
    files = [path.relative_to(tasks).as_posix() for path in task_files([tasks]).files]
    assert "runs/own.yaml" in files
    assert "runs/press/task.yaml" not in files
    done = collected(tasks, "--collect-only", "-q", "--taskspec", "tasks/runs")
    assert "own.yaml" in done.stdout
    assert "task.yaml" not in done.stdout
    # Who names such a file means it.
    assert task_files([results / "task.yaml"]).files == [results / "task.yaml"]
