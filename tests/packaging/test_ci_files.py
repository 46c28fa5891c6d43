"""The action, the hook and the workflows: they read, and what they call exists and runs."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

import forked
from taskspec_runner.cli.formats import DiagnosticFormat

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "how-to" / "ci.md").read_text(encoding="utf-8")
ACTION = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
(HOOK,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text(encoding="utf-8"))
GOOD, WARNED, BAD = "tasks/robots.yaml", "tasks/a b/warned.yaml", "tasks/bad.yaml"


@pytest.fixture(scope="module")
def taskspec(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The command in a shell's words."""
    with forked.command(tmp_path_factory.mktemp("command")) as words:
        yield words


@pytest.fixture
def repository(tmp_path: Path, taskspec: str) -> Path:
    """A repository with tasks, and the command `taskspec` in its folder `bin`."""
    task = (ROOT / "tasks" / "press-stiffness.yaml").read_text(encoding="utf-8")
    loose = (ROOT / "tasks" / "press-impedance-natural.yaml").read_text(encoding="utf-8")
    for name, text in ((GOOD, task), (WARNED, loose), (BAD, task + "nmae: x\n")):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    command = tmp_path / "bin" / "taskspec"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec {taskspec} "$@"\n')
    command.chmod(0o755)
    return tmp_path


def run(repository: Path, script: str, **env: str) -> subprocess.CompletedProcess[str]:
    paths = [str(repository / "bin"), os.environ["PATH"]]
    given = {**os.environ, "PATH": os.pathsep.join(paths), **env}
    command = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", script]
    return subprocess.run(
        command, cwd=repository, env=given, capture_output=True, text=True, check=False
    )


def step(name: str) -> dict[str, Any]:
    (found,) = (s for s in ACTION["runs"]["steps"] if s["name"] == name)
    return dict(found)


def validated(repository: Path, **inputs: str) -> subprocess.CompletedProcess[str]:
    """What the action's last step does with its inputs."""
    values = {name: given["default"] for name, given in ACTION["inputs"].items()} | inputs
    env = {
        variable: values[re.fullmatch(r"\$\{\{ inputs\.([\w-]+) \}\}", expression)[1]]  # type: ignore[index]
        for variable, expression in step("Validate")["env"].items()
    }
    return run(repository, step("Validate")["run"], **env)


def test_the_action_uses_every_input() -> None:
    text = (ROOT / "action.yml").read_text(encoding="utf-8")
    assert set(re.findall(r"inputs\.([\w-]+)", text)) == ACTION["inputs"].keys()
    for part in ACTION["runs"]["steps"]:
        assert "${{" not in part.get("run", ""), "an input is not pasted into a script"


def test_the_action_annotates_and_fails(repository: Path) -> None:
    done = validated(repository)
    assert done.returncode == 2
    (line,) = (line for line in done.stdout.splitlines() if line.startswith("::error"))
    assert line.startswith(f"::error file={BAD},line=")
    assert "title=TS020::" in line


def test_the_action_takes_its_inputs(repository: Path) -> None:
    assert validated(repository, ignore="TS020").returncode == 0
    assert validated(repository, ignore="TS020", strict="true").returncode == 2
    assert validated(repository, paths=f"{GOOD}\n{GOOD}").returncode == 0
    assert validated(repository, paths="tasks/[b]ad.yaml", select="TS3").returncode == 0
    assert validated(repository, format="concise").stdout.endswith("of 3 files\n")
    assert validated(repository, select="TS8").returncode == 2
    assert validated(repository, paths="--help").returncode == 2


def test_the_action_writes_sarif(repository: Path) -> None:
    done = validated(repository, sarif="out.sarif")
    assert done.returncode == 2
    assert "::error" in done.stdout
    log = json.loads((repository / "out.sarif").read_text(encoding="utf-8"))
    assert {r["ruleId"] for r in log["runs"][0]["results"]} == {"TS020", "TS304"}


def test_nothing_in_an_input_is_run(repository: Path) -> None:
    evil = '$(touch mine); `touch mine` "; touch mine; "'
    done = validated(repository, paths=evil, ignore=evil, select=evil, sarif=evil, format=evil)
    assert done.returncode == 2
    assert not (repository / "mine").exists()


@pytest.mark.parametrize(("version", "what"), [("", "HERE"), ("1.2", "taskspec-robotics==1.2")])
def test_the_action_installs_itself_or_a_version(repository: Path, version: str, what: str) -> None:
    python = repository / "bin" / "python"
    python.write_text('#!/bin/sh\necho "$@"\n')
    python.chmod(0o755)
    env = {"VERSION": version, "GITHUB_ACTION_PATH": "HERE"}
    done = run(repository, step("Install taskspec")["run"], **env)
    assert done.stdout == f"-m pip install --quiet {what}\n"


def test_the_hook_runs(repository: Path) -> None:
    assert (HOOK["language"], HOOK["types"]) == ("python", ["yaml"])
    for files, code in (([GOOD, WARNED], 0), ([GOOD, BAD], 2)):
        assert all(re.search(HOOK["files"], file) for file in files)
        assert run(repository, shlex.join([*HOOK["entry"].split(), *files])).returncode == code
    assert not re.search(HOOK["files"], ".github/workflows/ci.yml")


def shown_file(name: str) -> Any:
    match = re.search(rf"<!-- file: {re.escape(name)} -->\n```yml\n(.*?)^```", PAGE, re.M | re.S)
    assert match is not None
    return yaml.safe_load(match[1])


def test_the_page_uses_the_action_as_it_is(repository: Path) -> None:
    (job,) = shown_file(".github/workflows/tasks.yml")["jobs"].values()
    (use,) = (s for s in job["steps"] if "taskspec@" in s["uses"])
    (upload,) = (s for s in job["steps"] if "sarif" in s["uses"])
    assert upload["with"]["sarif_file"] == use["with"]["sarif"]
    assert use["with"].keys() <= ACTION["inputs"].keys()
    inputs = {k: json.dumps(v) if isinstance(v, bool) else v for k, v in use["with"].items()}
    (repository / BAD).unlink()
    assert validated(repository, **inputs).returncode == 0


def test_the_page_uses_the_hook_as_it_is(repository: Path) -> None:
    ((used,),) = (repo["hooks"] for repo in shown_file(".pre-commit-config.yaml")["repos"])
    assert used["id"] == HOOK["id"]
    assert re.search(used["files"], GOOD)
    command = [*HOOK["entry"].split(), *used["args"], GOOD, WARNED]
    assert run(repository, shlex.join(command)).returncode == 0


def test_the_page_names_every_input_and_format() -> None:
    (table,) = re.findall(r"<!-- table: inputs -->\n((?:\|.*\n)+)", PAGE)
    rows = [row.split(" | ")[:2] for row in table.splitlines()[2:]]
    assert {n for names, _ in rows for n in re.findall(r"`([\w-]+)`", names)} == ACTION[
        "inputs"
    ].keys()
    for names, default in rows:
        for name in re.findall(r"`([\w-]+)`", names):
            if default.startswith("`"):
                assert default.strip("`") == ACTION["inputs"][name]["default"]
            else:
                assert ACTION["inputs"][name]["default"] == ""
    assert set(DiagnosticFormat) <= set(
        re.findall(r"`(\w+)`", PAGE.partition("## Anything else")[2])
    )


def test_the_page_uses_gitlab_as_it_runs(repository: Path) -> None:
    (job,) = shown_file(".gitlab-ci.yml").values()
    install, validate = job["script"]
    assert install == "pip install --quiet taskspec-robotics"
    assert run(repository, validate).returncode == 2
    report = ElementTree.parse(repository / job["artifacts"]["reports"]["junit"])
    assert report.getroot().tag == "testsuites"


def test_the_page_runs_tasks_as_it_says(repository: Path) -> None:
    (job,) = shown_file(".github/workflows/run-tasks.yml")["jobs"].values()
    (command,) = (s["run"] for s in job["steps"] if s.get("run", "").startswith("taskspec"))
    for name in (WARNED, BAD):
        (repository / name).unlink()
    assert run(repository, command).returncode == 0
    assert ElementTree.parse(repository / "tests.xml").getroot().attrib["failures"] == "0"
    (repository / BAD).write_text((repository / GOOD).read_text() + "nmae: x\n")
    found = run(repository, command)
    assert found.returncode == 2
    assert "title=TS" in found.stdout
    assert ElementTree.parse(repository / "tests.xml").getroot().attrib["failures"] == "1"


def test_the_page_says_how_pytest_is_set_up() -> None:
    (text,) = re.findall(r"^```toml\n(.*?)^```", PAGE, re.M | re.S)
    assert tomllib.loads(text)["tool"]["pytest"]["ini_options"]["taskspec_paths"] == ["tasks"]


def test_the_page_tests_tasks_as_it_says(repository: Path) -> None:
    (repository / BAD).unlink()
    lines = re.findall(r"^taskspec test .*?(?=\s+#|$)", PAGE, re.M)
    assert len(lines) == 5
    for line in lines:
        done = run(repository, line)
        # The words of the page choose none of these files.
        assert done.returncode == 0 or "chooses none" in done.stderr, (line, done.stderr)


def test_the_workflow_runs_what_exists() -> None:
    workflow = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))
    steps = [s for job in workflow["jobs"].values() for s in job["steps"]]
    runs = [s["run"] for s in steps if "run" in s]
    # Beside what draws without a screen nothing is installed by hand.
    assert [run for run in runs if "apt-get" not in run] == ["bash .ci/run"]
    assert (ROOT / ".ci/run").is_file()
    (own,) = (s for s in steps if s.get("uses") == "./")
    assert own["with"].keys() <= ACTION["inputs"].keys()
