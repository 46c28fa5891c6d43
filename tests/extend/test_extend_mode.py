"""A new mode of an axis, defined here and nowhere else, in every command.

Modes are registered before the language is imported, so this module is also the program that does
so: it is run once, in a process of its own, and its outputs are looked at here.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from taskspec.deferred import ca
from taskspec.geometry.axis import Axis
from taskspec.modes import (
    AxisMode,
    HandOver,
    Known,
    ModeKey,
    OwnReference,
    ReferenceInputs,
    StageStart,
    from_start,
    register,
)
from taskspec.text.units import LENGTH, show

#: Of the sine [rad/s].
RATE = 2 * math.pi * 0.5


@dataclass(frozen=True, slots=True)
class Sway(AxisMode):
    """A slow sine about where the stage starts."""

    sway: float

    name = "sway"
    keys = (
        ModeKey(
            "sway",
            "Amplitude",
            LENGTH,
            above=0,
            meaning="A slow sine about where the stage starts.",
            examples=("10 mm",),
        ),
    )
    bends = True

    def reference(self, at: ReferenceInputs) -> OwnReference:
        return at.in_time(at.start + self.sway * ca.sin(RATE * at.clock.t))

    def hand_over(self, at: StageStart) -> HandOver:
        return from_start(at)

    def displacement(self, known: Known, start: float) -> Callable[[float], float]:  # noqa: ARG002
        return lambda time: self.sway * math.sin(RATE * time)

    def constraint(self, axis: Axis, rate: str, *, turns: bool) -> str:  # noqa: ARG002
        return f"{axis} sways by {show(self.sway, axis.of(LENGTH))}"


SWAYING = """\
taskspec: 1
name: swaying
robot: {model: panda, start: {xyz: [500 mm, 0, 340 mm]}}
stages:
  aside: {axes: {y: {velocity: 10 mm/s}}, time: 0.3 s}
  sway: {axes: {x: {sway: 10 mm}, rz: {sway: 5 deg}}, time: 1.4 s}
expect: [max(sway.position.x) within 505 mm .. 515 mm, max(norm(sway.force)) < 1 N]
"""

COMMANDS = {
    "validate": ("validate", "task.yaml"),
    "explain": ("explain", "task.yaml"),
    "run": ("run", "task.yaml", "--out", "run"),
    "report": ("report", "run"),
    "compare": ("compare", "task.yaml", "--law", "hybrid", "--law", "impedance", "--out", "other"),
    "schema": ("schema",),
}

WRONG = {
    "x: {sway: 10 deg}": ("TS112", "a length (m) is needed here"),
    "x: {sway: 0 mm}": ("TS118", "more than 0"),
    "x: {swy: 10 mm}": ("TS020", "did you mean 'sway'?"),
    "x: {sway: 10 mm, velocity: 1 mm/s}": ("TS202", "'velocity' and 'sway' on one axis"),
    "x: {sway: 10 mm, speed: 1 mm/s}": ("TS204", "it is the speed of a 'move'"),
    "x: {sway: 10 mm, force: 1 N}": ("TS203", "both a sway and a force"),
    "x: {contact: wall}": ("TS201", "hold, free, position, velocity, move, follows, sway, force"),
    "x: {sway: 3 m}": ("TS421", "the motion leads"),
}


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str]]:
    """Exit codes and outputs of all commands, and of `validate` for each wrong axis."""
    folder = tmp_path_factory.mktemp("swaying")
    subprocess.run([sys.executable, __file__, folder], check=True, cwd=folder)
    return {name: tuple(of) for name, of in json.loads((folder / "said.json").read_text()).items()}


def main(folder: Path) -> None:
    """Makes the mode part of the language, then gives all commands."""
    register(Sway)
    from typer.testing import CliRunner

    from taskspec_runner.cli.app import app

    said = {}

    def call(name: str, *words: str) -> None:
        done = CliRunner().invoke(app, list(words))
        said[name] = (done.exit_code, done.output)

    Path("task.yaml").write_text(SWAYING, encoding="utf-8")
    for name, words in COMMANDS.items():
        call(name, *words)
    for wrong in WRONG:
        Path("wrong.yaml").write_text(SWAYING.replace("x: {sway: 10 mm}", wrong), encoding="utf-8")
        call(wrong, "validate", "wrong.yaml")
    (folder / "said.json").write_text(json.dumps(said))


@pytest.mark.parametrize(
    ("command", "text"),
    [
        ("validate", "no errors in 1 file\n"),
        ("explain", "x sways by 10 mm"),
        ("explain", "rz sways by 5 deg"),
        ("run", "2 of 2 expectations met"),
        ("report", "report.html"),
        ("compare", "impedance"),
        ("schema", "A slow sine about where the stage starts."),
    ],
)
def test_every_command(said: dict[str, tuple[int, str]], command: str, text: str) -> None:
    code, output = said[command]
    assert code == 0, output
    assert text in output


@pytest.mark.parametrize("wrong", WRONG)
def test_findings(said: dict[str, tuple[int, str]], wrong: str) -> None:
    code, text = WRONG[wrong]
    assert f"[{code}]" in said[wrong][1], said[wrong][1]
    assert text in " ".join(said[wrong][1].split())


def test_what_is_not_stated_is_refused() -> None:
    class Still(AxisMode):
        keys = Sway.keys

    with pytest.raises(TypeError, match="Still"):
        register(Still)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
