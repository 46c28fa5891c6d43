"""Tasks as people write them first: how many edits each takes, and what says which.

Six are those of an engineer who had read the README alone, and two, a drum and a peg, are written
again from the notes of that hour. Eight more are two for each robot. An edit is one value or one
key with its value. Each is what a message of the first pass says, unless it stands under `later`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import pytest

from taskspec.compiler import admit
from taskspec.examined import Examination
from taskspec.spec import load_text
from taskspec.text.diagnostic import Diagnostic, Severity, SpecError
from taskspec_runner.cli.loading import load
from taskspec_runner.trial.check import check
from taskspec_runner.trial.trial import trial

FOLDER = Path(__file__).parent.parent / "corpus" / "first"


@dataclass(frozen=True)
class Edit:
    """A change that a message proposes.

    Attributes:
        said: code of the message, then words of it and of its hint.
        old: text of the file.
        new: text in its place.
    """

    said: tuple[str, ...]
    old: str
    new: str


@dataclass(frozen=True)
class Written:
    """A file as it is first written.

    Attributes:
        robot: model of it.
        edits: that its first pass proposes.
        later: edits that only show when those are done.
    """

    robot: str
    edits: tuple[Edit, ...] = ()
    later: tuple[tuple[str, str], ...] = field(default=())

    @property
    def count(self) -> int:
        """How many edits it takes."""
        return len(self.edits) + len(self.later)


CURVE = ("TS020", "a curve stands beside 'axes'")

WORDS = {
    "first-press": Written("panda"),
    "sand-panel": Written(
        "ur5e",
        (
            Edit(
                CURVE,
                "    axes:\n"
                "      x: {lissajous: {amplitude: 50 mm, frequency: 0.25 Hz}}\n"
                "      z: {force: -30 N}\n"
                "    time: 8 s\n",
                "    path: {lissajous: {amplitude: [50 mm, 0], turns: [2, 0]}, time: 8 s}\n"
                "    axes:\n"
                "      z: {force: -30 N}\n",
            ),
            Edit(("TS101", "write max(norm(force)) < 60 N"), "peak force", "max(norm(force))"),
        ),
    ),
    # Its start is level with the top of the part, beside which it is to push.
    "deburr-edge": Written(
        "ur5e",
        (Edit(("TS611", "`until` did not hold: force.y was 0 N"), "300 mm]}", "290 mm]}"),),
    ),
    "planar-ramp": Written(
        "planar3",
        (
            Edit(
                ("TS412", "the arm reaches 0.750 m from its first joint"),
                "model: planar3",
                "model: planar3, base: {xyz: [450 mm, 250 mm, 0]}",
            ),
        ),
    ),
    "own-arm-press": Written("own"),
    "drive-screw": Written(
        "panda",
        (
            Edit(("TS025", "write mechanism: screw"), "shape: screw", "mechanism: screw"),
            Edit(("TS020", "stands at robot.grasp: NAME.handle"), ", held: true", ""),
            Edit(("TS120", "torque.rz"), "abs(torque.z)", "abs(torque.rz)"),
            Edit(("TS120", "torque.rz"), "drive.torque.z", "drive.torque.rz"),
        ),
        (
            ("start: {xyz: [500 mm, 0, 300 mm]}", "grasp: screw.handle"),
            ("friction: 0.2 N*m", "friction: 0.2 N*m, stop: -60 .. 60 deg"),
        ),
    ),
    "polish-drum": Written(
        "ur5e",
        (
            Edit(
                ("TS020", "it belongs at robot.sensor"),
                "sensor: {noise: 0.1 N, filter: 100 Hz}\n",
                "  sensor: {noise: 0.1 N, filter: 100 Hz}\n",
            ),
        ),
    ),
    "peg-in-hole": Written(
        "panda",
        (
            Edit(
                CURVE,
                "    axes:\n"
                "      z: {force: -8 N}\n"
                "      spiral: {pitch: 0.8 mm, radius: 6 mm, speed: 15 mm/s}\n",
                "    axes: {z: {force: -8 N}}\n"
                "    path: {spiral: {pitch: 0.8 mm, radius: 6 mm}, speed: 15 mm/s}\n",
            ),
            Edit(
                ("TS101", "write last(position.z) < -20 mm"),
                "final position.z <",
                "last(position.z) <",
            ),
            Edit(("TS101", "write max(norm(force)) < 50 N"), "peak force", "max(norm(force))"),
        ),
        # The guard ends the stage as soon as it is 20 mm deep; the tip then gives way by 0.02 mm.
        (("last(position.z) < -20 mm", "last(position.z) < -19 mm"),),
    ),
    "panda-rod": Written("panda"),
    "panda-drawer": Written(
        "panda", (Edit(("TS025", "write mechanism: slide"), "shape: slide", "mechanism: slide"),)
    ),
    "ur5e-wall": Written(
        "ur5e",
        (Edit(("TS101", "write max(norm(force)) < 30 N"), "max force", "max(norm(force))"),),
    ),
    "ur5e-rub": Written(
        "ur5e",
        (
            Edit(
                CURVE,
                "      lissajous: {amplitude: [40 mm, 20 mm], turns: [2, 4]}\n    time: 8 s\n",
                "    path: {lissajous: {amplitude: [40 mm, 20 mm], turns: [2, 4]}, time: 8 s}\n",
            ),
        ),
    ),
    "planar-push": Written(
        "planar3",
        (
            Edit(
                ("TS101", "write last(push.force.z) < -28 N"),
                "push.force.z < -28 N at end",
                "last(push.force.z) < -28 N",
            ),
        ),
    ),
    "planar-sine": Written(
        "planar3",
        (
            Edit(
                ("TS020", "it belongs at stages.NAME.until"),
                "      until: force.z",
                "    until: force.z",
            ),
        ),
    ),
    "arm6-ball": Written("own"),
    "arm6-bolt": Written(
        "own", (Edit(("TS025", "write mechanism: screw"), "shape: screw", "mechanism: screw"),)
    ),
}


def found_in(path: Path) -> tuple[Diagnostic, ...]:
    """What `validate` finds about a file."""
    try:
        return check(load(path)).findings
    except SpecError as error:
        return error.diagnostics


def edited(name: str) -> Examination:
    """A file after all of its edits, as `validate` examines it."""
    text = (FOLDER / f"{name}.yaml").read_text(encoding="utf-8")
    written = WORDS[name]
    for old, new in (*((each.old, each.new) for each in written.edits), *written.later):
        assert text.count(old) == 1, (name, old)
        text = text.replace(old, new)
    return check(load_text(text, f"{name}.yaml", base=FOLDER))


def test_every_file_is_here():
    assert {path.stem for path in FOLDER.glob("*.yaml")} == WORDS.keys()
    assert len(WORDS) == 16
    assert {each.robot for each in WORDS.values()} == {"panda", "ur5e", "planar3", "own"}


def test_most_are_right_at_once_or_after_one_edit():
    assert sum(each.count <= 1 for each in WORDS.values()) >= 13


@pytest.mark.parametrize("name", WORDS)
def test_one_pass_says_every_edit(name: str):
    """Each edit is proposed, and nothing else is an error."""
    found = found_in(FOLDER / f"{name}.yaml")
    proposed = WORDS[name].edits
    for edit in proposed:
        code, words = edit.said
        assert any(d.code == code and words in f"{d.message}; {d.hint}" for d in found), edit
    errors = [d for d in found if d.severity is Severity.ERROR]
    assert len(errors) == sum(edit.said[0] != "TS611" for edit in proposed)


@pytest.mark.parametrize("name", WORDS)
def test_after_its_edits_it_runs_well(name: str):
    examined = edited(name)
    ran = trial(admit(examined))
    assert ran.good, (ran.outcome, [e.explanation for e in ran.judged], examined.findings)
