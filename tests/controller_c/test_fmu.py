"""FMUs of tasks: what FMPy and a checker of another make find, and the bytes of their runs."""

from __future__ import annotations

import math
import shutil
import subprocess
import zipfile
from pathlib import Path

import pytest
from typer.testing import CliRunner

from controller_samples import LIVE, MOVES, TOUCH, recorded
from controller_samples import program as sample_program
from taskspec.compiler import compile_unchecked
from taskspec.program.program import Program
from taskspec.spec import load_text
from taskspec_runner.cli.app import app
from taskspec_runner.controller_c import fmu as exported
from taskspec_runner.errors import InputError
from taskspec_runner.link.fmu import InFmu
from taskspec_runner.session import execute_program

fmpy = pytest.importorskip("fmpy")
pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")

#: Under another name, for a shorter time.
TASK = (
    TOUCH.replace("touch", "touch-it", 1)
    .replace("50 ms, tare", "20 ms, tare")
    .replace("0.3 s", "0.1 s")
)
RUNNING, BAD_SAMPLE, BAD_STAMP, LOST = 0, 8, 9, 10
VERSIONS = (2, 3)


@pytest.fixture(scope="module")
def program() -> Program:
    return compile_unchecked(load_text(TASK, "touch.yaml"))


@pytest.fixture(scope="module")
def fmus(program, tmp_path_factory):
    """The file of the FMU of each version."""
    folder = tmp_path_factory.mktemp("fmu")
    paths = {}
    for fmi in VERSIONS:
        made = exported.fmu_of(program, fmi)
        paths[fmi] = folder / f"touch{fmi}.fmu"
        paths[fmi].write_bytes(made.to_bytes(made.binary()))
    return paths


class Instance:
    """An instance in FMPy, by names."""

    def __init__(self, path: Path, folder: Path, fmi: int, **given) -> None:
        about = fmpy.read_model_description(path)
        self.references = {v.name: v.valueReference for v in about.modelVariables}
        self.names = [v.name for v in about.modelVariables]
        slave = pytest.importorskip(f"fmpy.fmi{fmi}")
        token = about.guid if fmi == 2 else about.instantiationToken
        facts = {"guid": token, "modelIdentifier": about.coSimulation.modelIdentifier} | given
        unzipped = fmpy.extract(path, folder)
        self.slave = getattr(slave, f"FMU{fmi}Slave")(unzipDirectory=unzipped, **facts)
        self.messages: list[str] = []
        self.numbers, self.wholes = ("Real", "Integer") if fmi == 2 else ("Float64", "Int64")
        self.slave.instantiate(loggingOn=True)
        self.fmi = fmi

    def set(self, name: str, value: float) -> None:
        kind = self.wholes if name == "lost_samples" else self.numbers
        getattr(self.slave, f"set{kind}")([self.references[name]], [value])

    def get(self, name: str):
        kind = {"event": "String", "reason": "String"}.get(name, self.numbers)
        kind = self.wholes if name in ("state", "stage", "lost_samples") else kind
        value = getattr(self.slave, f"get{kind}")([self.references[name]])[0]
        return value.decode() if isinstance(value, bytes) else value

    def torques(self) -> list[float]:
        return [self.get(name) for name in self.names if name.startswith("torque.")]

    def initialize(self, start: float = 0.0) -> None:
        if self.fmi == 2:
            self.slave.setupExperiment(startTime=start)
            self.slave.enterInitializationMode()
        else:
            self.slave.enterInitializationMode(startTime=start)
        self.slave.exitInitializationMode()

    def step(self, first: int, last: int, periods: int = 1) -> None:
        for k in range(first, last, periods):
            self.slave.doStep(k * 1e-3, periods * 1e-3)


@pytest.fixture(params=VERSIONS)
def instance(request, fmus, tmp_path):
    made = Instance(fmus[request.param], tmp_path, request.param)
    yield made
    made.slave.freeInstance()


@pytest.mark.parametrize("fmi", VERSIONS)
def test_descriptions_are_valid(fmi, fmus) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(fmus[fmi])) == []
    about = fmpy.read_model_description(fmus[fmi], validate=True)
    assert about.fmiVersion == f"{fmi}.0"
    assert {v.unit for v in about.modelVariables if v.causality == "input"} == {
        *("rad", "rad/s", "N", "N.m")
    }
    declared = {t.name: [item.name for item in t.items] for t in about.typeDefinitions}
    assert declared["Stage"] == ["tare", "approach", "hold"]
    assert declared["State"][BAD_SAMPLE] == "bad_sample"
    wrench = next(v for v in about.modelVariables if v.name == "wrench.force.x")
    assert "axes of the tip frame" in wrench.description


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_tool_of_another_make_reads_it_without_complaint(fmi, fmus, caplog) -> None:
    operations = pytest.importorskip("fmu_manipulation_toolbox.operations")
    checker = pytest.importorskip("fmu_manipulation_toolbox.checker")
    read = operations.FMU(str(fmus[fmi]))
    checks = [checker.OperationGenericCheck(), checker.OperationSemanticCheck()]
    with caplog.at_level("INFO", logger="fmu_manipulation_toolbox"):
        for check in checks:
            read.apply_operation(check)
    assert checks[0].compliant_with_version == f"{fmi}.0"
    assert checks[1].errors == []
    assert [r for r in caplog.records if r.levelname in ("WARNING", "ERROR")] == []


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_run_on_the_fmu_has_the_bytes_of_any_other(fmi, fmus, program, tmp_path) -> None:
    plain = execute_program(program, tmp_path / "plain", report=False)
    link = InFmu(fmus[fmi], program)
    driven = execute_program(program, tmp_path / "driven", report=False, link=link)
    assert len(plain.history.columns["t"]) > 150
    logs = [(run.folder / "log.arrow").read_bytes() for run in (plain, driven)]
    assert logs[0] == logs[1]


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_gripper_is_commanded_and_reports(fmi, tmp_path) -> None:
    """Its command is an output, its reports are inputs; the run has the bytes of any other."""
    from fmpy.validation import validate_fmu

    grips, path = sample_program("grip"), tmp_path / "pick.fmu"
    made = exported.fmu_of(grips, fmi)
    path.write_bytes(made.to_bytes(made.binary()))
    assert validate_fmu(str(path)) == []
    found = {v.name: v for v in fmpy.read_model_description(path, validate=True).modelVariables}
    kinds = {name: (v.causality, v.unit) for name, v in found.items() if "gripper" in name}
    assert kinds == {
        "gripper.force": ("input", "N"),
        "gripper.slip": ("input", "m"),
        "gripper.command": ("output", "N"),
    }
    runs = [
        execute_program(grips, tmp_path / name, report=False, link=link)
        for name, link in (("plain", None), ("driven", InFmu(path, grips)))
    ]
    assert runs[0].history.columns["grip.load"].max() == pytest.approx(0.2)
    logs = [(run.folder / "log.arrow").read_bytes() for run in runs]
    assert logs[0] == logs[1]


def test_a_state_goes_back_to_what_it_was(instance) -> None:
    instance.initialize()
    instance.step(0, 5)
    state, before = instance.slave.getFMUState(), instance.torques()
    instance.set("position.joint1", instance.get("position.joint1") + 1e-3)
    instance.step(5, 25)
    after = instance.torques()
    assert instance.get("stage") == 1
    instance.slave.setFMUState(state)
    assert (instance.torques(), instance.get("stage")) == (before, 0)
    instance.set("position.joint1", instance.get("position.joint1") + 1e-3)
    instance.step(5, 25)
    assert instance.torques() == after
    instance.slave.freeFMUState(state)


def test_it_starts_where_the_sample_of_the_initialization_is(instance) -> None:
    at_start = instance.get("position.joint1")
    instance.set("position.joint1", at_start + 0.1)
    instance.initialize(start=3.0)
    first = instance.torques()
    assert math.isfinite(sum(first))
    assert instance.get("state") == RUNNING
    instance.slave.doStep(3.0, 1e-3)
    assert instance.get("state") == RUNNING
    if instance.fmi == 3:
        assert instance.get("time") == 3.001
    instance.slave.reset()
    assert instance.get("position.joint1") == at_start


def test_a_sample_that_is_no_number_ends_the_task_by_name(instance, capfd) -> None:
    instance.initialize()
    instance.step(0, 5)
    assert (instance.get("event"), instance.get("reason")) == ("", "the task goes on")
    instance.set("velocity.joint2", math.nan)
    instance.step(5, 7)
    assert instance.get("state") == BAD_SAMPLE
    assert instance.get("reason") == "a number of a sample is not finite"
    assert math.isfinite(sum(instance.torques()))
    said = capfd.readouterr().out
    assert said.count("a number of a sample is not finite") == 1


def test_a_time_that_runs_back_ends_the_task_by_name(instance) -> None:
    instance.initialize()
    instance.step(0, 5)
    instance.step(2, 3)
    assert instance.get("state") == BAD_STAMP


@pytest.mark.parametrize(("periods", "state"), [(5, RUNNING), (6, LOST)])
def test_a_longer_communication_step_holds_the_sample_as_long_as_is_borne(
    periods, state, instance
) -> None:
    instance.set("lost_samples", 3)
    instance.initialize()
    instance.step(0, periods, periods)
    assert instance.get("state") == state
    if state == RUNNING:
        long = instance.torques()
        instance.slave.reset()
        instance.initialize()
        instance.step(0, periods)
        assert instance.torques() == long


@pytest.mark.parametrize("size", [0.0, -1e-3, 1.5e-3, math.nan])
def test_a_step_that_is_no_multiple_of_the_period_is_refused(size, instance, capfd) -> None:
    from fmpy.fmi1 import FMICallException

    instance.initialize()
    with pytest.raises(FMICallException, match=r"status 3"):
        instance.slave.doStep(0.0, size)
    assert "must be a multiple of the control period, 0.001 s" in capfd.readouterr().out


def test_what_cannot_be_set_is_refused(instance) -> None:
    from fmpy.fmi1 import FMICallException

    with pytest.raises(FMICallException):
        instance.set("torque.joint1", 1.0)
    with pytest.raises(FMICallException):
        instance.set("lost_samples", -1)
    instance.initialize()
    with pytest.raises(FMICallException):
        instance.set("lost_samples", 5)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_an_instance_of_another_state_of_the_task_is_refused(fmi, fmus, tmp_path, capfd) -> None:
    with pytest.raises(Exception, match=r"[Ii]nstantiate"):
        Instance(fmus[fmi], tmp_path, fmi, guid="{another}")
    assert "the token is not the one of this FMU" in capfd.readouterr().out


@pytest.mark.parametrize("fmi", VERSIONS)
def test_sources_compile_with_the_headers_of_an_importer(fmi, fmus, tmp_path) -> None:
    """FMPy's headers are the standard's: functions are checked against their declarations."""
    with zipfile.ZipFile(fmus[fmi]) as archive:
        archive.extractall(tmp_path)
    headers = Path(fmpy.__file__).parent / "c-code"
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wno-unused-parameter"]
    command = ["gcc", *strict, f"-I{headers}", "-c", f"fmi{fmi}.c", "-o", "fmi.o"]
    subprocess.run(command, cwd=tmp_path / "sources", check=True)
    made = next((tmp_path / "binaries").glob("*/*"))
    listed = subprocess.run(
        ["nm", "-D", "--defined-only", made], capture_output=True, text=True, check=True
    )
    names = [line.split()[-1] for line in listed.stdout.splitlines() if " T " in line]
    assert len(names) > 30
    assert {name[:4] for name in names} == {f"fmi{fmi}"}


def test_the_command_line_exports_the_same_bytes_and_judges(fmus, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("touch.yaml").write_text(TASK, encoding="utf-8")
    run = CliRunner()
    done = run.invoke(app, ["export", "touch.yaml", "--fmu", "made"])
    assert done.exit_code == 0, done.output
    assert "FMI 3.0, co-simulation: sources, binaries/" in done.output
    assert Path("made/touch_it.fmu").read_bytes() == fmus[3].read_bytes()
    done = run.invoke(app, ["run", "touch.yaml", "--on", "fmu:made/touch_it.fmu", "--quiet"])
    assert done.exit_code == 0, done.output
    changed = ["--set", "stages.hold.time=0.2 s"]
    done = run.invoke(app, ["run", "touch.yaml", *changed, "--on", "fmu:made/touch_it.fmu"])
    assert done.exit_code == 2
    assert "another state of the task" in done.output
    done = run.invoke(app, ["export", "touch.yaml", "--fmu", "a.fmu", "--csv"])
    assert done.exit_code == 2
    assert "--fmu of a task file" in done.output


def test_without_a_compiler_there_are_sources_alone(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(exported.shutil, "which", lambda _: None)
    (tmp_path / "touch.yaml").write_text(TASK, encoding="utf-8")
    path = tmp_path / "touch.fmu"
    done = CliRunner().invoke(app, ["export", str(tmp_path / "touch.yaml"), "--fmu", str(path)])
    assert done.exit_code == 0, done.output
    assert "has no binary: there is no C compiler" in done.output
    assert "fmpy compile" in done.output
    assert fmpy.supported_platforms(str(path)) == ["c-code"]


def test_what_is_no_fmu_is_an_error(tmp_path, program) -> None:
    (tmp_path / "a.fmu").write_text("no zip\n")
    with pytest.raises(InputError, match="is no FMU for co-simulation"):
        InFmu(tmp_path / "a.fmu", program)
    made = exported.fmu_of(program)
    (tmp_path / "b.fmu").write_bytes(made.to_bytes())
    with pytest.raises(InputError, match="has no binary that can be loaded here"):
        InFmu(tmp_path / "b.fmu", program)


@pytest.fixture(scope="module")
def live_fmus(tmp_path_factory):
    """The file of the FMU of each version, of a task with params that may be set."""
    folder = tmp_path_factory.mktemp("live")
    paths = {}
    for fmi in VERSIONS:
        made = exported.fmu_of(sample_program("live"), fmi)
        paths[fmi] = folder / f"live{fmi}.fmu"
        paths[fmi].write_bytes(made.to_bytes(made.binary()))
    return paths


@pytest.fixture(params=VERSIONS)
def live_instance(request, live_fmus, tmp_path):
    made = Instance(live_fmus[request.param], tmp_path, request.param)
    yield made
    made.slave.freeInstance()


@pytest.mark.parametrize("fmi", VERSIONS)
def test_params_are_inputs_with_units_and_ranges(fmi, live_fmus, caplog) -> None:
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(live_fmus[fmi])) == []
    about = fmpy.read_model_description(live_fmus[fmi], validate=True)
    found = {v.name: v for v in about.modelVariables}
    push, sway = found["set.push"], found["set.sway"]
    assert (push.causality, push.variability, push.unit) == ("input", "continuous", "N")
    assert [float(x) for x in (push.start, push.min, push.max)] == [5.0, 2.0, 8.0]
    assert "at 20 N per second" in push.description
    assert (float(sway.max), sway.unit) == (0.01, "m")
    assert (found["param.push"].causality, found["param.push"].unit) == ("output", "N")
    test_a_tool_of_another_make_reads_it_without_complaint(fmi, live_fmus, caplog)


def test_params_that_are_set_at_communication_points_are_those_of_a_run(live_instance) -> None:
    samples, torques, _ = recorded("live")
    inputs = [name for name in live_instance.names if name.startswith(("position.", "velocity."))]
    inputs += [name for name in live_instance.names if name.startswith("wrench.")]
    assert len(inputs) == 10
    moves = {0: [("push", 4.0), ("sway", 3e-3)], 31: [("sway", 7e-3)], 200: [("push", 8.0)]}
    moves |= {tick: [("push", 3.0)] for tick in range(250, len(samples))}
    state, states = None, []
    for tick, sample in enumerate(samples):
        for name, value in zip(inputs, sample, strict=False):
            live_instance.set(name, value)
        if tick == 0:
            live_instance.initialize()
        for name, value in moves.get(tick, []):
            live_instance.set(f"set.{name}", value)
        if tick == 215:
            state = live_instance.slave.getFMUState()
        live_instance.step(tick, tick + 1)
        assert live_instance.torques() == torques[tick].tolist()
        states.append(live_instance.get("param.push"))
    assert 4.0 < states[215] < states[216] < 5.0
    # On its way to 8 N, at the value and the time that it had then.
    live_instance.slave.setFMUState(state)
    assert live_instance.get("set.push") == 8.0
    assert live_instance.get("param.push") == states[214]
    live_instance.step(215, 216)
    assert live_instance.get("param.push") == states[215]
    live_instance.slave.freeFMUState(state)


def test_params_are_bounded_and_begin_with_what_is_set_before(live_instance) -> None:
    from fmpy.fmi1 import FMICallException

    live_instance.set("set.push", 7.0)
    assert live_instance.get("param.push") == 7.0
    live_instance.initialize()
    live_instance.step(0, 1)
    assert live_instance.get("param.push") == 7.0
    live_instance.set("set.push", math.inf)
    assert live_instance.get("set.push") == 8.0
    with pytest.raises(FMICallException):
        live_instance.set("set.push", math.nan)
    with pytest.raises(FMICallException):
        live_instance.set("param.push", 5.0)
    assert live_instance.get("set.push") == 8.0
    live_instance.step(1, 2)
    assert live_instance.get("param.push") == pytest.approx(7.02, abs=1e-12)
    live_instance.slave.reset()
    assert (live_instance.get("set.push"), live_instance.get("param.push")) == (5.0, 5.0)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_run_on_the_fmu_is_set_as_any_other(fmi, live_fmus, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("touch.yaml").write_text(LIVE)
    lines = [word for move in MOVES for word in ("--live", move)]
    for out, on in (("own", []), ("by-fmu", ["--on", f"fmu:{live_fmus[fmi]}"])):
        given = ["run", "touch.yaml", *lines, *on, "--out", out, "--quiet"]
        done = CliRunner().invoke(app, given)
        assert done.exit_code == 0, done.output
    logs = [(tmp_path / out / "log.arrow").read_bytes() for out in ("own", "by-fmu")]
    assert logs[0] == logs[1]
