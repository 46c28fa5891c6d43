"""Live params of exported controllers: set in C, they are those of `run --live` to the bit."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

from controller_samples import LIVE, MOVES, program, recorded
from taskspec_runner.cli.app import app
from taskspec_runner.controller_c.source import controller_of

HERE = Path(__file__).resolve().parent
STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wno-unused-function")
DONE = 1

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")


def compiled(folder: Path, *what: str) -> None:
    done = subprocess.run(["gcc", *STRICT, *what], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_host_that_sets_params_has_the_torques_of_the_machine(tmp_path) -> None:
    samples, torques, ended = recorded("live")
    controller_of(program("live")).write(tmp_path)
    checked = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-I.")
    compiled(tmp_path, *checked, str(HERE / "set.c"), "touch_live.c", "-o", "set", "-lm")
    done = subprocess.run([tmp_path / "set"], input=samples.tobytes(), capture_output=True)
    assert done.returncode == 0, done.stderr
    found = memoryview(done.stdout).cast("d", (len(samples), torques.shape[1] + 2)).tolist()
    assert [row[:-2] for row in found] == torques.tolist()
    assert (ended, found[-1][-2]) == ("end", DONE)
    values = [row[-1] for row in found]
    # Down from 5 N by 20 N/s, up again from 4 N at 0.2 s for 50 ms, then down to 3 N.
    assert values[0] == 5.0
    assert values[51:200] == [4.0] * 149
    assert max(values) == pytest.approx(4 + 20 * 0.05, abs=0.021)
    assert values[-1] == 3.0


def test_a_run_on_a_library_is_set_as_any_other(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("touch.yaml").write_text(LIVE)
    run = CliRunner()
    done = run.invoke(app, ["export", "touch.yaml", "--c", "c"])
    assert done.exit_code == 0, done.output
    compiled(tmp_path, "-O1", "-shared", "-fPIC", "c/touch_live.c", "-o", "c/touch.so", "-lm")
    lines = [word for move in MOVES for word in ("--live", move)]
    for out, given in (
        ("own", lines),
        ("by-c", [*lines, "--on", "lib:c/touch.so"]),
        ("still", ["--on", "lib:c/touch.so"]),
    ):
        done = run.invoke(app, ["run", "touch.yaml", *given, "--out", out, "--quiet"])
        assert done.exit_code == 0, done.output
    own, driven, still = (
        (tmp_path / out / "log.arrow").read_bytes()
        for out in (
            *("own", "by-c"),
            "still",
        )
    )
    assert own == driven
    assert own != still
