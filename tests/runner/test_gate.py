"""What refuses a task refuses it everywhere: on the command line and from Python."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from typer.testing import CliRunner

import taskspec_runner
from taskspec import compiler, examination, load
from taskspec.examination import Examination
from taskspec.program.program import Program
from taskspec.rules import RULES
from taskspec.spec import LoadedTask, load_text
from taskspec.text.diagnostic import SpecError
from taskspec_runner import session
from taskspec_runner.cli import app
from taskspec_runner.cli.formats import OutcomeFormat
from taskspec_runner.cli.options import RecordOptions, WorldOptions
from taskspec_runner.cli.run import run_task

sys.path.insert(0, str(Path(__file__).parent.parent / "corpus"))

from golden import ERRORS, examined, expected, of_files, overrides_of

Codes = list[str]
ADMIT = compiler.admit
#: Worlds that `vary` allows are not that of a run.
OF_OTHER_WORLDS = "TS503"


def against(path: Path) -> Codes:
    return [c for severity, c in expected(path) if severity == "error" and c != OF_OTHER_WORLDS]


REFUSED = [path for path in ERRORS if against(path)]


@dataclass
class Gate:
    """What the gate makes of a file by force."""

    forced: Program | SpecError | None = None


@pytest.fixture
def gate(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Gate:
    """Every file is examined once, and none is run: one that comes through is an error."""
    gate = Gate()

    def examine(loaded: LoadedTask) -> Examination:
        assert loaded.path is not None
        assert loaded.overrides == overrides_of(loaded.path)
        return examined(loaded.path)

    def admit(examined: Examination, *, force: bool = False) -> Program:
        try:
            program = ADMIT(examined, force=force)
        except SpecError as error:
            gate.forced = error if force else None
            raise
        gate.forced = program if force else None
        return program

    def never(program: Program, *_: object, **__: object) -> None:
        raise AssertionError(f"{program.context.loaded.source.name} is run")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(session, "execute_program", never)
    for module, name, replaced in (
        (examination, "examine", examine),
        (compiler, "admit", admit),
    ):
        monkeypatch.setattr(module, name, replaced)
    return gate


@of_files(REFUSED)
def test_what_python_refuses_the_command_line_refuses(
    path: Path, gate: Gate, capsys: pytest.CaptureFixture[str]
) -> None:
    codes = [code for _, code in expected(path)]
    overrides = overrides_of(path)
    with pytest.raises(SpecError) as caught:
        taskspec_runner.run(load(path, overrides))
    assert [d.code for d in caught.value.diagnostics] == codes
    sets = ["=".join(pair) for pair in overrides.items()]
    exit_code = run_task(
        path, WorldOptions(sets), RecordOptions(quiet=True, form=OutcomeFormat.JSON)
    )
    output = capsys.readouterr()
    data = json.loads(output.out)
    assert (exit_code, data["exit_code"]) == (2, 2)
    assert [d["code"] for d in data["diagnostics"]] == codes
    compiles = isinstance(gate.forced, Program)
    assert compiles == ("--force" in output.err)
    if isinstance(gate.forced, Program):
        assert [d.code for d in gate.forced.findings] == codes
        assert gate.forced.forced == tuple(dict.fromkeys(against(path)))
    elif isinstance(gate.forced, SpecError):
        assert [d.code for d in gate.forced.diagnostics] == codes


def test_there_are_enough_of_them() -> None:
    assert len(REFUSED) >= 250


PRESS = """\
taskspec: 1
name: press
robot: {model: planar2, start: {xyz: [300 mm, 0, 0]}}
world: {wall: {shape: plane, xyz: [300 mm, 0, 0], rpy: [0, -90 deg, 0], stiffness: 20 kN/m}}
law: LAW
stages: {press: {axes: {x: {force: 5 N}}, time: 20 ms}}
"""
UNSTABLE = PRESS.replace("LAW", "{kind: hybrid, force: {integral: 900 /s}}")
NEVER = PRESS.replace("LAW", "hybrid") + "expect: [max(norm(force)) < -1 N]\n"


@pytest.mark.parametrize(("text", "code"), [(UNSTABLE, "TS501"), (NEVER, "TS722")])
def test_force_lifts_a_finding_and_the_run_says_so(text: str, code: str, tmp_path: Path) -> None:
    task = load_text(text, "press.yaml")
    with pytest.raises(SpecError, match=code):
        taskspec_runner.run(task, tmp_path / "run")
    assert not (tmp_path / "run").exists()
    result = taskspec_runner.run(task, tmp_path / "run", force=True)
    assert result.summary["forced"] == [code]
    assert code in [d["code"] for d in result.summary["diagnostics"]]
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert re.search(rf"Run in spite of</dt>\s*<dd>{code}</dd>", page)
    file = tmp_path / "press.yaml"
    file.write_text(text, encoding="utf-8")
    told = CliRunner().invoke(app, ["run", str(file), "--force", "--out", str(tmp_path / "cli")])
    assert f"run in spite of {code}" in told.stdout


@pytest.mark.parametrize("code", [code for rule in RULES if rule.bars for code in rule.titles])
def test_force_does_not_lift_what_no_plant_can_be_built_behind(code: str, tmp_path: Path) -> None:
    file = next(path for path in ERRORS if path.name.startswith(code))
    with pytest.raises(SpecError, match=code):
        taskspec_runner.run(load(file), tmp_path / "run", force=True)


def test_a_run_without_force_says_that_nothing_was_lifted(tap: Path, tmp_path: Path) -> None:
    result = taskspec_runner.run(load(tap), tmp_path / "run", force=True)
    assert result.summary["forced"] == []
    assert "Run in spite of" not in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
