"""Texts with values changed in place: trees as overrides make them, all else as it was."""

from __future__ import annotations

from pathlib import Path

import pytest

from taskspec.spec import load_text
from taskspec.spec.overrides import Overrides
from taskspec.spec.patch import PatchError, patched, without
from taskspec.spec.task import Task
from taskspec.text import nodes
from taskspec.text.data import TruthValue, to_data
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.source import Source
from taskspec.text.yaml import read

ROOT = Path(__file__).parents[2]
FILES = sorted((*ROOT.glob("tasks/*.yaml"), *ROOT.glob("tests/corpus/ok/*.yaml")))

TEXT = """\
# what the cell is
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 320 mm]}}   # the arm

world:
  table:            # of steel
    shape: plane
    stiffness: 20 kN/m   # a guess

  peg: {shape: sphere, diameter: 10 mm}

law: hybrid         # the usual one
stages:
  press:
    axes: {z: {force: -10 N}}   # down

    time: 2 s
  # then up
  retreat:
    law:
      kind: hybrid
      # stiff
      bandwidth: 6 Hz
    axes: {z: {move: 50 mm}}
expect:
  - max(norm(force)) < 40 N
"""

#: Paths of a file that are tried: each takes three readings of the text.
_OF_A_FILE = 6


def plain(data: object) -> object:
    """Data whose truth values are texts, which compare."""
    if isinstance(data, dict):
        return {key: plain(value) for key, value in data.items()}
    if isinstance(data, list):
        return [plain(each) for each in data]
    return f"truth {data.value}" if isinstance(data, TruthValue) else data


def tree(text: str) -> object:
    root = read(Source("", text), Diagnostics(""))
    assert isinstance(root, nodes.Mapping), text
    return plain(to_data(root, Diagnostics("")))


def overridden(text: str, changes: dict[str, str]) -> object:
    root = read(Source("", text), Diagnostics(""))
    found = Diagnostics("")
    assert isinstance(root, nodes.Mapping)
    changed = Overrides(changes, tuple(Task.model_fields), found)
    changed.apply(root, templates=True)
    changed.apply(root, templates=False)
    assert not found.has_errors, found.sorted()
    return plain(to_data(root, Diagnostics("")))


def leaves(node: nodes.Node, path: tuple[str, ...] = ()) -> list[str]:
    if isinstance(node, nodes.Scalar):
        return [".".join(path)]
    below = (
        enumerate(node.items)
        if isinstance(node, nodes.Sequence)
        else ((key, value) for key, (_, value) in node.entries.items())
    )
    own = [".".join(path)] if path else []
    return own + [each for key, value in below for each in leaves(value, (*path, str(key)))]


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_every_value_of_a_file_changes_as_an_override_changes_it(file: Path) -> None:
    """Scalars, lists and blocks; of a scalar in one line no other line changes.

    Of each file some paths, others in each.
    """
    text = file.read_text(encoding="utf-8")
    root = read(Source("", text), Diagnostics(""))
    assert isinstance(root, nodes.Mapping)
    paths = [p for p in leaves(root) if p.split(".")[0] not in ("vary", "truth")]
    assert len(paths) >= 5
    apart = max(len(paths) // _OF_A_FILE, 1)
    for path in paths[FILES.index(file) % apart :: apart]:
        new = patched(text, {path: "7 N"})
        assert tree(new) == overridden(text, {path: "7 N"}), path
        node = nodes.find(root, tuple(int(s) if s.isdigit() else s for s in path.split(".")))[0]
        if isinstance(node, nodes.Scalar) and node.span.line == node.span.end_line:
            lines, before = new.split("\n"), text.split("\n")
            assert len(lines) == len(before)
            assert sum(a != b for a, b in zip(lines, before, strict=True)) == 1, path


@pytest.mark.parametrize(
    ("path", "value", "line"),
    [
        ("world.table.stiffness", "8 kN/m", "    stiffness: 8 kN/m   # a guess"),
        ("world.table.damping", "5 N*s/m", "    damping: 5 N*s/m"),
        ("world.peg.radius", "4 mm", "  peg: {shape: sphere, radius: 4 mm}"),
        (
            "robot.start.xyz.2",
            "0.3 m",
            "robot: {model: panda, start: {xyz: [500 mm, 0, 0.3 m]}}   # the arm",
        ),
        ("law.bandwidth", "4 Hz", "law: {kind: hybrid, bandwidth: 4 Hz}         # the usual one"),
        ("stages.press.law", "{kind: parallel}", "    law: {kind: parallel}"),
        ("stages.press.law.force.integral.z", "3 /s", "    law: {force: {integral: {z: 3 /s}}}"),
        ("stages.retreat.law.damping_ratio", "0.8", "      damping_ratio: 0.8"),
        ("stages.retreat.law", "pd", "    law: pd"),
        (
            "stages.press.axes.z.force",
            "min(-3 N, -4 N)",
            '    axes: {z: {force: "min(-3 N, -4 N)"}}   # down',
        ),
        (
            "stages.press.axes.y",
            "velocity: 5 mm/s",
            "    axes: {z: {force: -10 N}, y: {velocity: 5 mm/s}}   # down",
        ),
        ("vary.world.table.stiffness", "8..90 N/mm", "  world.table.stiffness: 8..90 N/mm"),
        ("limits.speed", "100 mm/s", "  speed: 100 mm/s"),
        ("expect.0", "max(force.z) < 4 N", "  - max(force.z) < 4 N"),
    ],
)
def test_what_is_written_where(path: str, value: str, line: str) -> None:
    new = patched(TEXT, {path: value})
    assert line in new.split("\n"), new
    assert tree(new) == overridden(TEXT, {path: value})
    comments = [each.split("#")[1] for each in TEXT.split("\n") if "#" in each]
    kept = [each.split("#")[1] for each in new.split("\n") if "#" in each]
    inside = [" stiff"] if path == "stages.retreat.law" else []
    assert kept == [each for each in comments if each not in inside]


def test_a_new_section_stands_among_its_neighbours_and_takes_further_entries() -> None:
    changes = {
        "vary.world.table.stiffness": "8..90 N/mm",
        "vary.world.table.friction": "0.1..0.3",
        "law.bandwidth": "4 Hz",
        "law.force.damping": "300 N*s/m",
    }
    new = patched(TEXT, changes)
    assert new.endswith(
        "  - max(norm(force)) < 40 N\nvary:\n  world.table.stiffness: 8..90 N/mm\n"
        "  world.table.friction: 0.1..0.3\n"
    )
    assert "law: {kind: hybrid, bandwidth: 4 Hz, force: {damping: 300 N*s/m}}" in new
    assert tree(new) == overridden(TEXT, changes)


def test_line_ends_and_marks_stay() -> None:
    new = patched("\ufeff" + TEXT.replace("\n", "\r\n"), {"world.table.stiffness": "8 kN/m"})
    assert new == "\ufeff" + TEXT.replace("20 kN/m", "8 kN/m").replace("\n", "\r\n")


def test_a_bare_name_is_a_param() -> None:
    text = "taskspec: 1\nparams: {press: 12 N}  # how hard\n"
    assert patched(text, {"press": "9 N"}) == text.replace("12", "9")


def test_a_file_without_a_last_line_end() -> None:
    text = TEXT.rstrip("\n")
    new = patched(text, {"vary.world.table.stiffness": "8..90 N/mm"})
    assert new == f"{text}\nvary:\n  world.table.stiffness: 8..90 N/mm"


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("world.wall.stiffness", "no 'wall'"),
        ("frames.tilted.xyz", "no 'frames'"),
        ("no.such.key", "no 'no'"),
        ("stages.press.time.x", "no place"),
        ("expect.3", "no place"),
        ("stages.second.axes.z.force", "stands in a template"),
    ],
)
def test_what_has_no_place_is_an_error(path: str, message: str) -> None:
    text = TEXT.replace("  # then up", "  second: {use: push}\n  # then up")
    with pytest.raises(PatchError, match=message):
        patched(text, {path: "1 m"})


def test_a_stage_of_a_template_takes_a_whole_key() -> None:
    """Keys of the stage replace those of its template one by one."""
    file = ROOT / "tests/corpus/ok/reuse.yaml"
    text = file.read_text(encoding="utf-8")
    new = patched(text, {"stages.first.law": "{kind: hybrid, bandwidth: 3 Hz}"})
    before, after = (load_text(each, file.name, base=file.parent).task for each in (text, new))
    assert before.stages["first"].law is None
    law = after.stages["first"].law
    assert law is not None
    assert law.bandwidth is not None
    assert law.bandwidth.x == 3.0
    with pytest.raises(PatchError, match="template"):
        patched(text, {"stages.first.axes.z.force": "-3 N"})


def test_what_an_included_file_brings_is_an_error() -> None:
    """The text itself does not have it; whoever shares the file decides about that."""
    text = (ROOT / "tests/corpus/ok/reuse.yaml").read_text(encoding="utf-8")
    with pytest.raises(PatchError, match="no 'world'"):
        patched(text, {"world.table.stiffness": "9 kN/m"})


def test_sections_are_left_out_with_what_stands_below_them() -> None:
    new = without(TEXT, ["stages", "law"])
    assert list(tree(new)) == ["taskspec", "robot", "world", "expect"]  # type: ignore[call-overload]
    assert new.startswith("# what the cell is\n")
    assert "# a guess" in new
    assert "# then up" not in new
