from __future__ import annotations

import json
import os
import re
import resource
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console
from short_tasks import TAP
from typer.testing import CliRunner, Result

import forked
from taskspec import __version__
from taskspec.compiler import compile_task
from taskspec.program.execution.transition import Transition
from taskspec.program.program import Program
from taskspec.schema import FILE_NAME, schema_text
from taskspec.spec import load_task
from taskspec_runner import exit_codes
from taskspec_runner.cli import app
from taskspec_runner.cli import new as template_command
from taskspec_runner.verdict.summary import transition_text

SHIPPED = Path(__file__).resolve().parent.parent.parent / "tasks"
COMMAND = [sys.executable, "-c", "from taskspec_runner.cli import main; main()"]
SPOILED = TAP.replace("velocity: 20 mm/s", "velocity: 20 mm").replace("time: 0.3 s", "tme: 0.3 s")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def call(*args: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    assert "Traceback" not in result.output
    return result


def in_a_process(*args: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *map(str, args)], capture_output=True, text=True, check=False)


# run


def test_run_tells_what_was_expected_and_how_it_went(tap: Path) -> None:
    result = call("run", tap, "--out", "out")
    assert result.exit_code == 0
    assert "pass  max(abs(hold.error.y)) < 1 mm" in result.stdout
    assert "4 of 4 expectations met" in result.stdout
    assert result.stdout.endswith("report: out/report.html\n")
    assert Path("out/report.html").is_file()
    assert "\x1b" not in result.output
    assert result.stderr == ""


def test_run_missed(tap: Path) -> None:
    tap.write_text(TAP + "  - max(force.x) < 1 N\n")
    result = call("run", tap, "--quiet")
    assert result.exit_code == 1
    assert "FAIL  max(force.x) < 1 N" in result.stdout
    assert "pass" not in result.stdout
    assert "4 of 5 expectations met" in result.stdout


def test_quiet_run_that_goes_well_says_nothing(tap: Path) -> None:
    result = call("run", tap, "--quiet")
    assert (result.exit_code, result.output) == (0, "")
    assert Path("runs/tap/report.html").is_file()


def test_run_stopped_by_a_limit(tap: Path) -> None:
    result = call("run", tap, "--set", "limits={force: 3 N}")
    assert result.exit_code == 4
    assert "stopped" in result.stdout
    assert "limit on force: 3 N, measured 3.0" in result.stdout


UNSTABLE = """\
taskspec: 1
name: rings
robot: {model: planar2, start: {xyz: [300 mm, 0, 0]}}
world: {wall: {shape: plane, xyz: [300 mm, 0, 0], rpy: [0, -90 deg, 0], stiffness: 20 kN/m}}
law: {kind: hybrid, force: {integral: 900 /s}}
stages: {press: {axes: {x: {force: 5 N}}, time: 50 ms}}
"""


@pytest.mark.parametrize("form", ["text", "json"])
def test_a_stage_that_is_predicted_to_be_unstable_is_run_by_force_alone(
    here: Path, form: str
) -> None:
    (here / "rings.yaml").write_text(UNSTABLE, encoding="utf-8")
    refused = call("run", "rings.yaml", "--out", "out", "--format", form)
    assert refused.exit_code == 2
    assert "TS501" in refused.output
    assert "--force runs it all the same" in refused.output
    assert not Path("out").exists()
    forced = call("run", "rings.yaml", "--out", "out", "--format", form, "--force")
    assert "TS501" in forced.output
    assert "--force" not in forced.output
    assert Path("out/summary.json").is_file()


def test_a_world_of_vary_that_is_unstable_keeps_nothing_from_running(here: Path) -> None:
    text = UNSTABLE.replace("900 /s", "12 /s")
    text += "vary: {world.wall.stiffness: 20..100000 kN/m}\ncontrol: {plant_rate: 20 kHz}\n"
    (here / "rings.yaml").write_text(text, encoding="utf-8")
    result = call("run", "rings.yaml", "--out", "out")
    assert "TS501" not in result.output
    assert Path("out/summary.json").is_file()


def test_the_simulator_leaves_no_log_of_its_own(here: Path) -> None:
    """What MuJoCo warns of is a stop with a name; it wrote a file where the run was begun."""
    gone = "motion: {z: 2 mm * sqrt(1 - clock/(20 ms))}"
    text = UNSTABLE.replace("900 /s", "12 /s").replace("stiffness: 20 kN/m", gone)
    (here / "gone.yaml").write_text(text, encoding="utf-8")
    result = call("run", "gone.yaml", "--out", "out")
    assert result.exit_code == 4
    assert "TS117" in result.stderr
    assert not list(here.glob("MUJOCO*"))


def test_run_as_data(tap: Path) -> None:
    result = call("run", tap, "--format", "json", "--seed", "5")
    data = json.loads(result.stdout)
    assert (data["exit_code"], data["seed"], data["status"]) == (0, 5, "done")
    assert data["report"] == str(Path(data["folder"]) / "report.html")
    assert data["real_time_factor"] > 0


@pytest.mark.parametrize("form", ["text", "json"])
def test_run_of_a_spoiled_file(tap: Path, form: str) -> None:
    tap.write_text(SPOILED)
    result = call("run", tap, "--format", form)
    assert result.exit_code == 2
    assert not Path("runs").exists()
    if form == "json":
        codes = {d["code"] for d in json.loads(result.stdout)["diagnostics"]}
    else:
        assert result.stdout == ""
        codes = {code for code in ("TS112", "TS020") if f"[{code}]" in result.stderr}
    assert {"TS112", "TS020"} <= codes


def test_override_of_what_is_not_there(tap: Path) -> None:
    result = call("run", tap, "--set", "pres=20N")
    assert result.exit_code == 2
    assert "--set:1:1: error[TS027]" in result.stderr
    assert "did you mean 'press'?" in result.stderr
    assert call("run", tap, "--set", "press").exit_code == 2


def test_overrides_reach_the_run(tap: Path) -> None:
    result = call("run", tap, "--set", "press=4N", "--set", "stages.hold.time=0.1 s", "--out", "a")
    assert result.exit_code == 0, result.output
    assert json.loads(Path("a/manifest.json").read_text())["overrides"] == {
        "press": "4N", "stages.hold.time": "0.1 s"
    }  # fmt: skip


def test_law_replaces_every_law(tap: Path) -> None:
    tap.write_text(TAP.replace("    time: 0.3 s", "    time: 0.3 s\n    law: {kind: hybrid}"))
    result = call("run", tap, "--law", "parallel", "--format", "json")
    assert {s["law"] for s in json.loads(result.stdout)["stages"]} == {"parallel"}
    result = call("run", tap, "--law", "PARALEL")
    assert result.exit_code == 2
    assert "did you mean 'parallel'?" in result.stderr
    assert result.stderr.count("--law:1:1: error[TS206]") == 1
    assert "--set" not in result.stderr
    result = call("run", tap, "--law", "")
    assert result.exit_code == 2
    assert "--law needs the name of a law: impedance" in result.stderr


def test_override_without_a_unit_is_pointed_at(tap: Path) -> None:
    result = call("run", tap, "--set", "press=20")
    assert result.exit_code == 2
    assert "--set:1:1: note: 'press' is given here" in result.stderr


@pytest.mark.parametrize("value", ["null", "{}"])
def test_vary_is_not_replaced_as_a_whole(tap: Path, value: str) -> None:
    result = call("run", tap, "--set", f"vary={value}")
    assert result.exit_code == 2
    assert "cannot replace the whole of 'vary'" in result.stderr


def test_run_that_fails_says_what_did_not_happen(tap: Path) -> None:
    result = call("run", tap, "--set", "stages.approach.within={time: 50 ms}")
    assert result.exit_code == 6
    assert "0.05 s passed without `force.x > 1 N`; so far: 1 of 4 " in result.stdout
    assert "expectations met until it failed" in result.stdout
    assert "so far  approach.visits <= 1" in result.stdout
    result = call("run", tap, "--set", "stages.approach.within={travel: 0.5 mm}", "--out", "out")
    assert "travelled 0.5 mm without `force.x > 1 N`" in result.stdout
    page = Path("out/report.html").read_text()
    assert "travelled 0.5 mm without" in page
    assert "So far: 1 of 4 expectations met until it failed." in page
    assert '<table class="judged expectations pale">' in page
    result = call("run", tap, "--set", "stages.approach.fail_if=t > 20 ms")
    assert "`t > 20 ms` held, which fails the stage" in result.stdout


def test_joint_limit_is_linewith_its_numbers(tap: Path) -> None:
    program = compiled(tap)
    end = Transition(0.1, "approach", "limit", "joint_position", "position limit of joint 1 (a)",
                     4.0, "")  # fmt: skip
    assert "deg to " in transition_text(end, program.stages[0], program.context.robot)
    assert transition_text(end, program.stages[0], program.context.robot).endswith(
        ", measured 229.18 deg"
    )


def test_run_that_cannot_be_written(tap: Path) -> None:
    result = call("run", tap, "--out", tap / "run")
    assert result.exit_code == 2
    assert "cannot write" in result.stderr
    assert "Not a directory" in result.stderr


def test_internal_error_is_linein_two_lines(tap: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("as a test")

    monkeypatch.setattr("taskspec_runner.session.judge_run", broken)
    result = call("run", tap, "--out", "out")
    assert result.exit_code == 3
    assert "internal error: ZeroDivisionError: as a test" in result.stderr
    assert "out/crash.txt" in result.stderr
    monkeypatch.setattr("taskspec_runner.cli.loading.load_task", broken)
    result = call("run", tap)
    assert result.exit_code == 3
    trace = Path(result.stderr.strip().rsplit(" ", 1)[1])
    assert "ZeroDivisionError" in trace.read_text()
    trace.unlink()


def compiled(task: Path) -> Program:
    return compile_task(load_task(task))


@pytest.mark.parametrize(
    ("number", "code", "reason", "text"),
    [
        (signal.SIGINT, 130, "interrupted", "interrupted by the user"),
        (signal.SIGTERM, 143, "terminated", "terminated by SIGTERM"),
        (signal.SIGHUP, 129, "terminated", "terminated by SIGHUP"),
    ],
)
def test_interrupted_run_is_readable_and_judged(
    tap: Path, number: signal.Signals, code: int, reason: str, text: str
) -> None:
    tap.write_text(TAP.replace("time: 0.3 s", "time: 1000 s"))
    process = subprocess.Popen(
        [*COMMAND, "run", str(tap), "--out", "out"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # Under nohup the end of a session is ignored.
        preexec_fn=lambda: signal.signal(number, signal.SIG_DFL),
    )
    log = Path("out/log.arrow")
    deadline = time.monotonic() + 60
    while not (log.exists() and log.stat().st_size > 300_000) and process.poll() is None:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(number)
    stdout, stderr = process.communicate(timeout=60)
    assert process.returncode == code, stderr
    assert "stopped at" in stdout
    assert text in stdout
    assert "expectations met until it stopped" in stdout
    said = json.loads(Path("out/manifest.json").read_text())
    assert (said["status"], said["reason"], said["exit_code"]) == ("stopped", reason, code)
    assert "damaged" not in Path("out/report.html").read_text().split("<style>")[0]
    assert Path("out/report.html").is_file()


def test_termination_outside_the_simulation(tap: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "taskspec_runner.session.judge_run", lambda *_: os.kill(os.getpid(), signal.SIGTERM)
    )
    usual = signal.getsignal(signal.SIGTERM)
    result = call("run", tap, "--out", "out")
    assert result.exit_code == 143
    assert "terminated by SIGTERM" in result.stderr
    said = json.loads(Path("out/manifest.json").read_text())
    assert (said["status"], said["reason"], said["exit_code"]) == ("stopped", "terminated", 143)
    assert signal.getsignal(signal.SIGTERM) == usual


# validate


def test_validate_finds_everything_in_one_pass(tap: Path, here: Path) -> None:
    (here / "more").mkdir()
    (here / "more" / "b.yml").write_text(SPOILED)
    (here / "more" / ".hidden.yaml").write_text("nonsense: [")
    (here / "more" / "notes.txt").write_text("")
    result = call("validate", here, tap)
    assert result.exit_code == 2
    assert "error[TS112]" in result.stdout
    assert "did you mean 'time'?" in result.stdout
    assert result.stdout.endswith("errors in 1 of 2 files\n")
    assert result.stderr == ""


def test_validate_under_overrides(tap: Path, here: Path) -> None:
    """What `run` takes as an override, `validate` takes; the findings are those of `run`."""
    options = ("--set", "stages.hold.time=2 mm", "--set", "limits={force: 3 N}", "--law", "pd")
    # The law is the first line.
    (validated,) = json.loads(call("validate", tap, *options, "--format", "json").stdout)[
        "diagnostics"
    ]
    assert (validated["code"], validated["file"], validated["line"]) == ("TS112", "--set", 2)
    assert json.loads(call("run", tap, *options, "--format", "json").stdout)["diagnostics"] == [
        validated
    ]
    (here / "b.yaml").write_text(TAP)
    several = call("validate", here, "--set", "stages.hold.tme=2 s", "--format", "concise").stdout
    assert [line.partition(": ")[0] for line in several.splitlines()[:-1]] == [
        f"{here / name} --set:1:1" for name in ("b.yaml", "tap.yaml")
    ]
    assert call("validate", tap, "--law", "pd").exit_code == 0
    wrong = call("validate", here, "--law", "pdd")
    assert f"{tap} --law:1:1: error[TS206]: unknown law 'pdd'" in wrong.stdout
    for usage in (("--set", "press"), ("--law", " ")):
        result = call("validate", here, *usage)
        assert (result.exit_code, len(result.stderr.splitlines())) == (2, 1)


def test_standard_input() -> None:
    """`-` is a task for whatever reads one; it is in the working folder and has no path."""

    def fed(text: str | bytes, *args: str) -> Result:
        return CliRunner().invoke(app, args, input=text)

    assert fed(TAP, "validate", "-").stdout == "no errors in 1 file\n"
    spoiled = fed(SPOILED, "validate", "-", "--format", "concise")
    assert spoiled.exit_code == 2
    assert spoiled.stdout.startswith("<stdin>:")
    assert fed(SPOILED, "explain", "-").exit_code == 2
    # Under another law the text is needed twice.
    explained = fed(TAP, "explain", "-", "--law", "pd").stdout
    assert re.search(r"law +pd, equations", explained)
    assert fed(TAP, "run", "-", "--out", "out").exit_code == 0
    assert Path("out/task.yaml").read_text() == TAP
    assert json.loads(Path("out/manifest.json").read_text())["file"] is None
    assert "error[TS009]" in fed("# ä" * 200_000, "validate", "-").stdout
    assert fed(TAP, "validate", "-", "-").exit_code == 2
    assert fed(b"\xff", "validate", "-").exit_code == 2


@pytest.fixture(scope="module")
def forked_command(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[str]]:
    """The command in processes that need not load its libraries."""
    with forked.command(tmp_path_factory.mktemp("forked")) as words:
        yield shlex.split(words)


def test_completion(forked_command: list[str]) -> None:
    """Commands, options and their values, by what the shell is given to source."""

    def completed(typed: str) -> set[str]:
        words = {"COMP_WORDS": f"taskspec {typed}", "COMP_CWORD": str(len(typed.split(" ")))}
        done = subprocess.run(
            forked_command,
            env={**os.environ, **words, "_TASKSPEC_COMPLETE": "complete_bash"},
            capture_output=True,
            text=True,
            check=True,
        )
        return set(done.stdout.split())

    assert completed("va") == {"validate"}
    assert completed("validate a.yaml --st") == {"--static", "--strict"}
    assert completed("run a.yaml --law pd") == {"pd", "pd-joint"}
    assert completed("explain TS32") >= {"TS320", "TS325"}
    assert "wipe-table" in completed("new wipe")
    # A path is what the shell completes where nothing else is.
    assert completed("validate a") == set()
    shown = in_a_process("--show-completion", "bash")
    assert shown.returncode == 0
    assert "complete -o default -F" in shown.stdout


def test_validate_passes_over_runs(tap: Path, here: Path) -> None:
    call("run", tap, "--out", "runs/one")
    result = call("validate", here)
    assert (result.exit_code, result.stdout) == (0, "no errors in 1 file\n")


def test_validate_concise_and_as_data(tap: Path) -> None:
    tap.write_text(SPOILED)
    lines = call("validate", tap, "--format", "concise").stdout.splitlines()
    data = json.loads(call("validate", tap, "--format", "json").stdout)
    assert len(lines) == data["errors"] + data["warnings"] + 1
    first = data["diagnostics"][0]
    place = f"{first['file']}:{first['line']}:{first['column']}"
    assert lines[0] == f"{place}: error[{first['code']}]: {first['message']}"
    assert (data["files"], data["exit_code"]) == (1, 2)


def test_a_missing_unit_hides_no_robot_and_no_start(tap: Path) -> None:
    """All in one pass: what does not read, and what is wrong with the part that does."""
    wrong = TAP.replace("time: 0.3 s", "time: 0.3")
    tap.write_text(wrong.replace("planar2", "planar9"))
    result = call("validate", tap)
    assert result.exit_code == 2
    assert {"TS110", "TS401"} == set(re.findall(r"error\[(TS\d+)\]", result.stdout))
    tap.write_text(wrong.replace("xyz: [400 mm, 100 mm, 0]", "xyz: [4 m, 0, 0]"))
    for command in ("validate", "run", "explain"):
        result = call(command, tap)
        assert result.exit_code == 2
        codes = re.findall(r"error\[(TS\d+)\]", result.output)
        assert codes == ["TS412", "TS110"], command
    # Where the start itself does not read, nothing is said of how far it is.
    tap.write_text(wrong.replace("xyz: [400 mm, 100 mm, 0]", "xyz: [4, 0, 0]"))
    assert re.findall(r"error\[(TS\d+)\]", call("validate", tap).stdout) == ["TS110", "TS110"]


def test_exit_codes_tell_missed_failed_stopped_and_wrong_apart(tap: Path) -> None:
    def code(*sets: str) -> int:
        options = [word for text in sets for word in ("--set", text)]
        return call("run", tap, "--quiet", "--out", "out", *options).exit_code

    assert code() == exit_codes.WELL == 0
    assert code("expect.0=max(norm(force)) < 1 N") == exit_codes.MISSED == 1
    assert code("press=5") == exit_codes.WRONG == 2
    assert code("limits.force=3 N") == exit_codes.STOPPED == 4
    assert code("stages.approach.within.time=50 ms") == exit_codes.FAILED == 6


def test_validate_looks_at_the_robot(tap: Path) -> None:
    tap.write_text(TAP.replace("xyz: [400 mm, 100 mm, 0]", "xyz: [4 m, 0, 0]"))
    result = call("validate", tap)
    assert result.exit_code == 2
    assert "[TS41" in result.stdout


def test_validate_of_what_cannot_be_read(tap: Path, here: Path) -> None:
    (here / "latin.yaml").write_bytes("name: größe".encode("latin-1"))
    result = call("validate", here / "latin.yaml", "absent.yaml", tap)
    assert result.exit_code == 2
    assert "latin.yaml: it is not UTF-8" in result.stderr
    assert "cannot read absent.yaml: No such file or directory" in result.stderr
    assert result.stdout == "no errors in 3 files, 2 unreadable\n"
    (here / "empty").mkdir()
    assert call("validate", here / "empty").exit_code == 2
    assert call("run", "absent.yaml").exit_code == 2
    assert call("run", here / "latin.yaml").exit_code == 2
    assert call("run", here).exit_code == 2


def test_validate_survives_an_internal_error(
    tap: Path, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "spoiled.yaml").write_text(SPOILED)

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("as a\ntest")

    monkeypatch.setattr("taskspec_runner.trial.check.examine", broken)
    result = call("validate", tap, here / "spoiled.yaml")
    assert result.exit_code == 3
    assert f"{tap}: internal error: ZeroDivisionError: as a test; please report" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert "error[TS112]" in result.stdout
    assert "1 not validated for an internal error" in result.stdout
    data = json.loads(call("validate", tap, "--format", "json").stdout)
    assert (data["exit_code"], len(data["internal_errors"])) == (3, 1)
    for line in (result.stderr.strip(), data["internal_errors"][0]):
        Path(line.rsplit(" ", 1)[1]).unlink()


def test_validate_is_quick(tap: Path) -> None:
    """It takes little more than to import the libraries that it needs."""
    start = _used_by_children()
    assert in_a_process("validate", tap).returncode == 0
    middle = _used_by_children()
    libraries = "import casadi, mujoco, numpy, pinocchio, pydantic, typer"
    subprocess.run([sys.executable, "-c", libraries], check=True)
    # 2.0 to 2.7 times were measured; shared cores differ by a factor of two.
    assert middle - start < 5.4 * (_used_by_children() - middle)


def _used_by_children() -> float:
    """Processor time of the processes that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def test_codes_of_the_trial_are_chosen_before_one_is_made(tap: Path) -> None:
    """Each layer registers its codes, and this process has not imported the last one yet."""
    done = in_a_process("validate", tap, "--static", "--select", "TS508")
    assert (done.returncode, done.stderr) == (0, "")


def test_validate_imports_nothing_that_it_does_not_need(tap: Path) -> None:
    code = (
        "import sys; from taskspec_runner.cli import app; app(['validate', sys.argv[1]],"
        "standalone_mode=False); heavy = {'pyarrow', 'scipy', 'markupsafe', 'rich'};"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tap)], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"


# explain


def test_explain_shows_frames_axes_gains_and_defaults(tap: Path) -> None:
    result = call("explain", tap)
    assert result.exit_code == 0
    for text in (
        "wall   fixed on plane",
        "law          hybrid, equations section 4.3.3, (4.123)",
        "contact      wall, nominal 10 kN/m, frictionless",
        "until -> hold",
        "x     v_x = 0 (wall, pushes only)  f_x = press, reached in 0.05 s  force control",
        "S_f          diag(1 0)",
        "S_v          diag(0 1)",
        "K_P",
        "designed: 5 Hz",
        "control.rate",
    ):
        assert text in result.stdout, result.stdout
    assert not any(line.endswith(" ") for line in result.stdout.splitlines())


def test_explain_says_where_a_gain_came_from(tap: Path) -> None:
    tap.write_text(TAP + "law: {kind: hybrid, bandwidth: 3 Hz, force: {damping: 200 N*s/m}}\n")
    lines = call("explain", tap).stdout.splitlines()
    assert any(line.split() == ["bandwidth", "x", "y", "3", "Hz", "file"] for line in lines)
    assert any(line.split()[:5] == ["force.damping", "x", "200", "N*s/m", "file"] for line in lines)


@pytest.mark.parametrize(
    ("task", "row"),
    [
        ("press-pd-joint", "joint_damping joint.1"),
        ("ring", "force.damping rim 265.7 N*s/m"),
        ("linkage", "force.integral bars"),
        ("exact-ring", "force.damping rim level 0 N*s/m designed: 0 along an exact equation"),
    ],
)
def test_explain_gains_of_joints_and_equations(task: str, row: str) -> None:
    result = call("explain", SHIPPED / f"{task}.yaml")
    assert result.exit_code == 0, result.stderr
    assert any(" ".join(line.split()).startswith(row) for line in result.stdout.splitlines())


@pytest.mark.parametrize(
    ("law", "says", "default"),
    [
        ("pd", "posture", True),
        (
            "{kind: pd, null_space: [joint-limits, manipulability]}",
            "joint-limits, manipulability",
            False,
        ),
        ("pd-joint", "free: the law leaves it alone", False),
    ],
)
def test_explain_the_null_space(tmp_path: Path, law: str, says: str, default: bool) -> None:
    task = tmp_path / "rest.yaml"
    task.write_text(
        f"taskspec: 1\nrobot: {{model: panda}}\nlaw: {law}\nstages: {{a: {{time: 1 s}}}}\n"
    )
    lines = [" ".join(line.split()) for line in call("explain", task).stdout.splitlines()]
    assert f"null space {says}" in lines
    assert ("robot.posture the start configuration" in lines) == default
    task.write_text(task.read_text().replace("panda", "ur5e"))
    assert "null space" not in call("explain", task).stdout


@pytest.mark.parametrize(
    ("task", "rows"),
    [
        (
            "ring",
            [
                "rim x^2 + y^2 = (90 mm)^2 in rail, holds both ways, 50 kN/m, 100 N*s/m",
                "contact constraints rim, level",
                "stages.round.constraints.rim.ramp 0.2 s",
                "control.plant_rate 1 kHz",
            ],
        ),
        (
            "exact-ring",
            ["rim x^2 + y^2 = (90 mm)^2 in rail, holds both ways, exactly, by a multiplier"],
        ),
        (
            "linkage",
            ["bars q1 + q2 + q3 = 0 on joints, holds both ways, 2000 N*m/rad, 5 N*m*s/rad"],
        ),
        (
            "crank",
            [
                "holds crank.handle, by a grip of 50 kN/m and 500 N*m/rad",
                "crank hinge, inertia 0.05 kg*m^2, damping 0.2 N*m*s/rad, free knob",
                "crank axes of the hinge as declared; they do not turn with it",
                "robot.start.xyz where the tip takes hold of crank.handle",
                "world.crank.friction 0",
                "world.crank.stop none",
            ],
        ),
        (
            "screw",
            [
                "cap screw, pitch 4 mm/turn, inertia 0.001 kg*m^2, mass 0.2 kg, damping 0.05 "
                "N*m*s/rad, friction 0.1 N*m, stops at -5 deg and 200 deg, fixed knob",
                "world.cap.handle at the origin of its axes",
            ],
        ),
        ("vibrating-table", ["table moves with plane"]),
        ("wrist-sensor", ["tare what the sensor shows here on average becomes its zero"]),
    ],
)
def test_explain_tells_equations_mechanisms_and_sensing(task: str, rows: list[str]) -> None:
    result = call("explain", SHIPPED / f"{task}.yaml")
    lines = [" ".join(line.split()) for line in result.stdout.splitlines()]
    for row in rows:
        assert any(line.startswith(row) for line in lines), result.stdout
    # A frame is told once, also where an equation is written in it.
    frames = lines[lines.index("frames") + 1 : lines.index("", lines.index("frames"))]
    assert len({line.split()[0] for line in frames}) == len(frames)


def test_explain_tells_the_defaults_of_equations_and_mechanisms(tap: Path) -> None:
    tap.write_text(
        """taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 350 mm]}, sensor: {delay: 2 ms}}
world:
  rim: {equation: x^2 + y^2 <= (600 mm)^2, stiffness: rigid}
  bars: {equation: q1 + q2 <= 90 deg}
  cap: {mechanism: screw, pitch: 2 mm/turn, detent: {at: 2 deg, force: 3 N*m, width: 1 deg}}
stages: {go: {time: 1 s}}
"""
    )
    lines = [" ".join(line.split()) for line in call("explain", tap).stdout.splitlines()]
    told = lines[lines.index("defaults taken") + 1 :]
    for row in (
        "robot.sensor.rate that of the controller",
        "world.rim.frame world",
        # As docs/language/equations.md has them: 20 kN/m, on joints 2 kN m/rad, and
        # 0.1 * 2 sqrt(k h) with 1 kg and 0.05 kg m^2.
        "world.bars.stiffness 2000 N*m/rad",
        "world.bars.damping 2 N*m*s/rad",
        "world.cap.knob fixed",
        "world.cap.inertia 0.001 kg*m^2",
        "world.cap.mass 0.1 kg",
        "world.cap.damping 0",
        "world.cap.stop none",
    ):
        assert row in told, told
    assert not any(row.startswith(("world.rim.stiffness", "world.cap.detent")) for row in told)
    assert any("snaps at 2 deg +- 1 deg with 3 N*m" in line for line in lines)


def test_explain_under_overrides(tap: Path) -> None:
    text = call(
        "explain", tap, "--set", "stages.hold.axes.x.ramp=70 ms", "--law", "parallel"
    ).stdout
    assert "law          parallel" in text
    assert "reached in 0.07 s" in text
    assert "its tip where the last link ends" in text
    assert "100 mm" not in text.split("defaults taken")[1]


def test_explain_a_code(monkeypatch: pytest.MonkeyPatch) -> None:
    page = (SHIPPED.parent / "docs" / "diagnostics" / "TS221.md").read_text(encoding="utf-8")
    assert "](" not in page
    assert call("explain", "ts221").stdout == page
    # Other pages of the documents are not beside an installed command.
    assert "](" in (SHIPPED.parent / "docs/diagnostics/TS501.md").read_text(encoding="utf-8")
    linked = call("explain", "TS501").stdout
    assert "](" not in linked
    assert "in predicted stability." in linked
    screen = StringIO()
    terminal = Console(file=screen, force_terminal=True, width=80)
    monkeypatch.setattr("taskspec_runner.cli.explain.console", lambda: terminal)
    assert call("explain", "TS203").stdout == ""
    assert "TS203: a motion and a force on one axis" in screen.getvalue()
    assert "##" not in screen.getvalue(), "laid out"
    result = call("explain", "TS999")
    assert result.exit_code == 2
    assert "there is no diagnostic TS999" in result.stderr
    assert call("explain", "absent.yaml").exit_code == 2


# the small ones


def test_schema(here: Path) -> None:
    assert call("schema").stdout == schema_text()
    assert call("schema", "--check", here).exit_code == 1
    assert call("schema", "--write", here).exit_code == 0
    assert (here / FILE_NAME).read_text() == schema_text()
    assert call("schema", "--check", here / FILE_NAME).exit_code == 0
    (here / FILE_NAME).write_text("{}")
    result = call("schema", "--check", here)
    assert result.exit_code == 1
    assert "not up to date" in result.stdout


def test_robots() -> None:
    result = call("robots")
    assert result.exit_code == 0
    assert [line.split()[0] for line in result.stdout.splitlines()[1:5]] == [
        "planar2", "planar3", "ur5e", "panda"
    ]  # fmt: skip


def test_new_begins_a_task(here: Path) -> None:
    listed = call("new")
    assert listed.exit_code == 0
    assert "wipe-table" in listed.stdout
    result = call("new", "wipe-table")
    assert result.stdout == "my-wipe-table.yaml\n"
    assert "name: my-wipe-table\n" in (here / "my-wipe-table.yaml").read_text()
    assert call("validate", "my-wipe-table.yaml").exit_code == 0
    again = call("new", "wipe-table")
    assert again.exit_code == 2
    assert "exists already" in again.stderr
    assert "did you mean 'wipe-table'?" in call("new", "wipe-tabel").stderr


def test_new_brings_what_the_template_needs(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shelf = here / "shelf" / "tasks"
    (shelf / "data").mkdir(parents=True)
    (shelf / "data" / "points.csv").write_text("x [mm], y [mm]\n400, 100\n400, 110\n")
    (here / "shelf" / "schemas").mkdir()
    (here / "shelf" / "schemas" / FILE_NAME).write_text(schema_text())
    (shelf / "trace.yaml").write_text(
        f"# yaml-language-server: $schema=../schemas/{FILE_NAME}\n"
        "taskspec: 1\nname: trace   # of the shelf\n"
        "robot: {model: planar2, start: {xyz: [400 mm, 100 mm, 0]}}\n"
        "stages:\n  go: {path: {file: data/points.csv, speed: 50 mm/s}}\n"
    )
    monkeypatch.setattr(template_command, "_folders", lambda: iter([shelf]))
    result = call("new", "trace", "--out", "mine/My Trace.yaml")
    assert result.exit_code == 0, result.output
    text = (here / "mine" / "My Trace.yaml").read_text()
    assert "name: my-trace   # of the shelf\n" in text
    assert text.startswith("taskspec: 1\n"), "the schema is not below the new file"
    assert "taskspec schema --write" in result.stderr
    result = call("new", "trace", "--out", "here.yaml")
    text = (here / "here.yaml").read_text()
    assert text.startswith(f"# yaml-language-server: $schema=shelf/schemas/{FILE_NAME}\ntaskspec")
    assert "taskspec schema --write" not in result.stderr
    assert (here / "mine" / "data" / "points.csv").is_file()
    assert call("validate", here / "mine").exit_code == 0


def test_report_renders_anew(tap: Path) -> None:
    call("run", tap, "--out", "out")
    Path("out/report.html").unlink()
    result = call("report", "out")
    assert (result.exit_code, result.stdout) == (0, "out/report.html\n")
    assert Path("out/report.html").is_file()
    assert call("report", "absent").exit_code == 2


@pytest.mark.parametrize("module", ["taskspec", "taskspec_runner"])
def test_both_packages_start_the_command_line(module: str) -> None:
    by_module = [sys.executable, "-m", module, "--version"]
    ran = subprocess.run(by_module, capture_output=True, text=True, timeout=60)
    assert (ran.stdout, ran.returncode) == (f"taskspec {__version__}\n", 0)


def test_version_and_usage() -> None:
    assert call("--version").stdout == f"taskspec {__version__}\n"
    assert call("no-such-command").exit_code == 2
    assert call("run").exit_code == 2
    assert call("validate", "x", "--format", "xml").exit_code == 2


@pytest.mark.parametrize("harm", ["missing", "changed"])
def test_report_of_a_damaged_log(tap: Path, harm: str) -> None:
    call("run", tap, "--out", "out")
    log = Path("out/log.arrow")
    if harm == "missing":
        log.unlink()
    else:
        log.write_bytes(log.read_bytes()[:-100])
    result = call("report", "out")
    assert result.exit_code == 1
    said = "log.arrow is missing" if harm == "missing" else "log.arrow was cut short"
    assert said in result.stderr
    page = Path("out/report.html").read_text()
    assert 'class="verdict damaged"' in page
    assert said in page
    assert "verdict passed" not in page


@pytest.mark.parametrize("encoding", ["ascii", "cp1252"])
def test_streams_that_know_few_characters(tap: Path, encoding: str) -> None:
    tap.write_text(TAP.replace("Touch a wall", "Touch a wall → \u4e2d"), encoding="utf-8")
    done = subprocess.run(
        [*COMMAND, "explain", str(tap)],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": encoding},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert b"Touch a wall" in done.stdout


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is full")
@pytest.mark.parametrize("command", ["robots", "schema", "--help"])
def test_output_that_is_full(command: str) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*COMMAND, command], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 2
    assert done.stderr.startswith("taskspec: cannot write to standard output: ")
    assert len(done.stderr.splitlines()) == 1


def test_reader_that_goes_away(tap: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [*COMMAND, "explain", str(tap)],
        stdout=writer,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    os.close(writer)
    assert "Traceback" not in done.stderr
    assert "internal" not in done.stderr
