"""Mistakes as people make them, and places at which they type, in twelve tasks that are shipped."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from taskspec.text.diagnostic import Diagnostic, Severity
from taskspec_runner.editor.completion import proposals
from taskspec_runner.editor.fixes import fixes
from taskspec_runner.editor.opened import OpenedFile

ROOT = Path(__file__).resolve().parents[2]
#: A task of templates and files, which no shipped one has.
REUSE = ROOT / "tests" / "corpus" / "ok" / "reuse.yaml"

#: File, what stands there, what is written in its place with « where the finding begins, its code.
MISTAKES = [
    ("wipe-table", "limits: {force: 60 N,", "limits: {force: «60,", "TS110"),
    ("wipe-table", "model: panda", "model: «pnada", "TS401"),
    ("wipe-table", "ramp: 0.3 s}", "ramp: «0.3 mm}", "TS112"),
    ("wipe-table", "sin(2*pi*t/(4 s))", "«sinus(2*pi*t/(4 s))", "TS121"),
    ("wipe-table", "  world.table.friction:", "  «world.tabel.friction:", "TS123"),
    ("wipe-table", "[+- 3 deg, +- 3", "[«+- 3 mm, +- 3", "TS112"),
    ("wipe-table", "expect: success", "expect: «succes", "TS712"),
    ("wipe-table", "    time: 8 s\n", "   «time: 8 s\n", "TS001"),
    ("wipe-table", "  table: {shape", "«  - table: {shape", "TS022"),
    ("peg-in-hole", "shape: hole", "shape: «hol", "TS025"),
    ("peg-in-hole", "on_fail: insert", "on_fail: «inser", "TS124"),
    ("peg-in-hole", "attempts: 3", "attempts: «0", "TS118"),
    ("peg-in-hole", "thickness: 40 mm, ", "thickness: «40, ", "TS110"),
    ("door-handle", "grasp: door.handle", "grasp: «door", "TS128"),
    ("door-handle", "rz: {follows: door}", "rz: {«follow: door}", "TS020"),
    ("door-handle", "stop: 0..90 deg", "stop: «0..90", "TS112"),
    ("door-handle", "inertia: 0.8 kg*m^2", "inertia: «0.8 kg", "TS112"),
    ("raster-polish", "surface: pipe", "surface: «pip", "TS123"),
    ("raster-polish", "pitch: 10 mm}", "«pich: 10 mm}", "TS020"),
    ("raster-polish", "z: {hold: force}", "z: {hold: «forc}", "TS025"),
    ("raster-polish", "heading: [1, 0, 0]", "heading: «1", "TS022"),
    ("sand-panel", "at: wrist", "at: «wirst", "TS025"),
    ("sand-panel", "tare: true", "tare: «yes", "TS022"),
    ("sand-panel", "com: [0, 60 mm", "com: [0, «60", "TS110"),
    ("fold-out-and-press", "  unfold:\n    path:", "  unfold:\n«\tpath:", "TS003"),
    ("fold-out-and-press", "    time: 3 s\n", "    «time 3 s\n", "TS001"),
    ("fold-out-and-press", "within: {time: 10 s,", "within: {time: «10 Hz,", "TS112"),
    ("linkage-in-joints", "hybrid-multipliers,", "«hybrid-multiplier,", "TS206"),
    ("linkage-in-joints", "{bars: {generalised: [1.5", "{«bar: {generalised: [1.5", "TS123"),
    ("exact-ring", "frame: rail\nlaw", "frame: «rial\nlaw", "TS122"),
    ("exact-ring", "frame: rail\nlaw: ", "frame: rail\n«frame: rail\nlaw: ", "TS004"),
    ("deburr", "most: 16 N}", "most: 16 N, «unused: 1 N}", "TS130"),
    ("deburr", "-press}}\n    time", "-«pres}}\n    time", "TS120"),
    ("unknown-normal", "estimate: touch", "estimate: «tuch", "TS124"),
    ("unknown-normal", "norm(force) > 1 N for", "norm(force) > «1 for", "TS110"),
    ("press-qp", "solve: qp", "solve: «pq", "TS025"),
    ("press-qp", "max(force_inconsistent)", "max(«force_inconsistant)", "TS120"),
    ("press-qp", "xyz: [0, 0, 300 mm]", "xyz: «[0, 300 mm]", "TS023"),
    ("reuse", "[../parts/cell.yaml]", "[«../parts/cel.yaml]", "TS133"),
    ("reuse", "first: {use: press}", "first: {use: «pres}", "TS131"),
    ("reuse", "with: {level: soft", "with: {«levl: soft", "TS020"),
    ("reuse", "lift.visits < 3", "«lft.visits < 3", "TS120"),
]
#: What is found, but has no fix: which numbers, names or lines are meant only its author knows.
UNFIXED = {"TS023", "«  - table: {shape"}

#: File, what stands there, what is being typed in its place at |, what has to be proposed and what
#: must not be.
PLACES = [
    ("wipe-table", "model: panda  ", "model: |  ", {"panda", "ur5e", "planar3"}, {"table"}),
    ("wipe-table", "friction: 0.2}", "fr|}", {"friction: "}, {"shape: ", "radius: "}),
    ("wipe-table", "frame: task  ", "frame: |  ", {"task", "world", "tool", "table"}, {"wipe"}),
    ("wipe-table", "  kind: hybrid\n", "  kind: |\n", {"hybrid", "parallel"}, {"panda", "qp"}),
    ("wipe-table", "torque: 8 N*m,", "torque: 8 |,", {"N*m"}, {"N", "mm"}),
    ("wipe-table", "    time: 8 s\n", "    |\n",
     {"time: ", "until: ", "next: "}, {"axes: ", "vary: "}),
    ("wipe-table", "rms(wipe.error.x)", "rms(|)", {"wipe", "force.z", "norm("}, {"panda"}),
    ("peg-in-hole", "shape: hole", "shape: |", {"hole", "slot", "plane"}, {"hinge"}),
    ("peg-in-hole", "depth: 25 mm,", "depth: 25 |,", {"mm", "m"}, {"N"}),
    ("peg-in-hole", "on_fail: insert", "on_fail: |", {"insert", "lift", "end", "fail"}, {"socket"}),
    ("peg-in-hole", "to: end}, {to: lift}]", "to: end}, {to: |}]", {"lift", "end"}, {"socket"}),
    ("peg-in-hole", "attempts: 3", "|", {"attempts: ", "time: "}, {"axes: ", "next: "}),
    ("peg-in-hole", "spiral: {pitch: 1 mm,", "spiral: {|,", {"pitch: "}, {"diameter: ", "speed: "}),
    ("door-handle", "grasp: door.handle,", "grasp: |,", {"door.handle"}, {"open"}),
    ("door-handle", "frame: door.handle", "frame: |", {"door.handle", "door", "world"}, {"open"}),
    ("door-handle", "    damping: 2 N*m*s/rad", "    |",
     {"damping: ", "knob: "}, {"friction: ", "pitch: "}),
    ("door-handle", "inertia: 0.8 kg*m^2", "inertia: 0.8 |", {"kg*m^2"}, {"kg"}),
    ("door-handle", "rz: {follows: door}", "rz: {|}",
     {"follows: ", "torque: ", "hold: "}, {"force: "}),
    ("door-handle", "      z: {force: 0}", "      |", {"z: "}, {"x: ", "rx: "}),
    ("raster-polish", "surface: pipe", "surface: |", {"pipe"}, {"polish"}),
    ("raster-polish", "z: {hold: force}", "z: {hold: |}", {"force", "world", "start"}, {"free"}),
    ("raster-polish", "      spiral: {pitch: 4 mm, radius: 12 mm}\n", "      |\n",
     {"spiral: ", "arc: "}, {"speed: ", "axes: "}),
    ("raster-polish", "params: {press: 12 N, pace", "|\nparams: {press: 12 N, pace",
     {"templates: "}, {"vary: "}),
    ("sand-panel", "    at: wrist\n", "    at: |\n", {"wrist", "contact"}, {"panel"}),
    ("sand-panel", "    filter: 60 Hz", "    filter: 60 |", {"Hz", "kHz"}, {"s"}),
    ("sand-panel", "    radius: 62 mm\n", "    |\n",
     {"radius: ", "diameter: "}, {"mass: ", "friction: "}),
    ("sand-panel", "{tare: true,", "{tare: |,", {"true", "false"}, {"press"}),
    ("fold-out-and-press", "      speed: 60 deg/s\n  approach", "      |\n  approach",
     {"speed: ", "time: "}, {"joints: "}),
    ("fold-out-and-press", "time: 10 s, travel", "time: 10 |, travel", {"s", "ms"}, {"mm"}),
    ("linkage-in-joints", "{kind: hybrid-multipliers, bandwidth", "{kind: |, bandwidth",
     {"hybrid-multipliers", "pd-joint"}, {"qp"}),
    ("linkage-in-joints", "bandwidth: 8 Hz", "bandwidth: 8 |", {"Hz"}, {"N"}),
    ("exact-ring", "{arc: {center: [0, 0], turns: 1}", "{arc: {center: [0, 0], |}",
     {"turns: "}, {"center: ", "pitch: "}),
    ("exact-ring", "frame: rail\nlaw", "frame: |\nlaw", {"rail", "world"}, {"rim", "press"}),
    ("deburr", "on: chip", "on: |", {"chip"}, {"edge", "press"}),
    ("deburr", "axes: {z: {force: -press}}\n    time", "axes: {z: {force: -|}}\n    time",
     {"press", "most"}, {"edge"}),
    ("unknown-normal", "    until: norm(force) > 1 N for 0.4 s", "    until: norm(|",
     {"force", "velocity"}, {"board:"}),
    ("unknown-normal",
     "    frame: felt\n    axes: {z: {force", "    frame: |\n    axes: {z: {force",
     {"felt", "board"}, {"slide"}),
    ("press-qp", "solve: qp,", "solve: |,", {"qp", "closed-form"}, {"hybrid"}),
    ("press-qp", "integral: 12 /s,", "|,",
     {"integral: ", "proportional: "}, {"damping: ", "kind: "}),
    ("press-qp", "  - max(norm(force)) < 30 N", "  - |",
     {"slide", "force_inconsistent", "max("}, {"panda"}),
    ("reuse", "first: {use: press}", "first: {use: |}", {"press", "meet"}, {"lift"}),
    ("reuse", "travel: most}", "|}", {"travel: "}, {"time: "}),
]  # fmt: skip


@cache
def text_of(name: str) -> tuple[Path, str]:
    path = REUSE if name == "reuse" else ROOT / "tasks" / f"{name}.yaml"
    return path, path.read_text(encoding="utf-8")


def changed(name: str, old: str, new: str, mark: str) -> tuple[OpenedFile, int]:
    """A file that was whole before its text became this, and the place of the mark in it."""
    path, text = text_of(name)
    assert text.count(old) == 1, old
    opened = OpenedFile(path, text)
    start = text.index(old)
    opened.change(text[:start] + new.replace(mark, "", 1) + text[start + len(old) :])
    return opened, start + new.index(mark)


@cache
def error_codes(name: str) -> frozenset[str]:
    """What is found in a file as it is shipped."""
    return codes(OpenedFile(*text_of(name)))


def codes(opened: OpenedFile) -> frozenset[str]:
    return frozenset(each.code for each in opened.examined(stability=False))


def finding_at(opened: OpenedFile, offset: int, code: str) -> Diagnostic:
    found = opened.examined(stability=False)
    for each in found:
        span = each.span
        if each.code == code and span is not None and not span.source:
            line, column = opened.source.place(offset)
            # A section that is a list is found at its key, the line above.
            if (span.line, span.column) == (line, column) or (
                code == "TS022" and span.line == line - 1
            ):
                return each
    raise AssertionError([(each.code, each.span, each.message) for each in found])


def applies(opened: OpenedFile, finding: Diagnostic, known: frozenset[str]) -> bool:
    """Whether a fix is offered after which nothing is found that was not there before."""
    text = opened.source.text
    for fix in fixes(finding, opened.source):
        mended = OpenedFile(opened.path, text[: fix.start] + fix.text + text[fix.end :])
        found = mended.examined(stability=False)
        if {d.code for d in found if d.severity is not Severity.INFO} <= known:
            return True
    return False


def test_twelve_files_have_forty_mistakes_and_forty_places() -> None:
    assert len(MISTAKES) >= 40
    assert len(PLACES) >= 40
    assert len({name for name, *_ in MISTAKES}) == len({name for name, *_ in PLACES}) == 12
    flow = [old for _, old, *_ in PLACES if "{" in old or "," in old]
    assert 15 <= len(flow) <= len(PLACES) - 15


@pytest.mark.parametrize(("name", "old", "new", "code"), MISTAKES)
def test_a_mistake_is_found_at_its_place_and_a_fix_leaves_none(
    name: str, old: str, new: str, code: str
) -> None:
    opened, offset = changed(name, old, new, "«")
    finding = finding_at(opened, offset, code)
    assert finding.severity is not Severity.INFO
    assert applies(opened, finding, error_codes(name)) == (not {code, new} & UNFIXED)


@pytest.mark.parametrize(("name", "old", "new", "wanted", "unwanted"), PLACES)
def test_what_can_be_written_is_proposed(
    name: str, old: str, new: str, wanted: set[str], unwanted: set[str]
) -> None:
    found = [each.text for each in proposals(*changed(name, old, new, "|"))]
    assert wanted <= set(found), found
    assert not unwanted & set(found), found
    assert len(found) == len(set(found))
