"""The place of a cursor in a text that is half written, in block style and between braces."""

from __future__ import annotations

import pytest

from taskspec_runner.editor.cursor import cursor_at

KEYS = {
    "|": ((), ""),
    "rob|\nname: x": ((), "rob"),
    "stages:\n  press:\n    ti|": (("stages", "press"), "ti"),
    "stages:\n  press:\n    |\n    time: 1 s": (("stages", "press"), ""),
    "stages:\n  press:\n    |": (("stages", "press"), ""),
    "stages:\n  press: {time: 1 s}\n|": ((), ""),
    "stages:\n  press: {axes: {z: {fo|": (("stages", "press", "axes", "z"), "fo"),
    "a: {b: 1, | }\nc: 2": (("a",), ""),
    "stages:\n  press: {axes: {z: {force: -10 N}}, ti|}": (("stages", "press"), "ti"),
    "stages:\n  a:\n    axes: {x: {force: 1 N},\n           y: {po|": (
        ("stages", "a", "axes", "y"), "po",
    ),
    "# robot: {model: x}\nlimits: {|": (("limits",), ""),
    'about: "a: {b"\nlimits: {|': (("limits",), ""),
}  # fmt: skip
VALUES = {
    "law: |": (("law",), ""),
    "law: {kind: hy|}": (("law", "kind"), "hy"),
    "robot: {model: |, start: {xyz: [1, 2, 3]}}": (("robot", "model"), ""),
    "stages:\n  a:\n    next: li|\n    time: 1 s": (("stages", "a", "next"), "li"),
    "stages:\n  a:\n    until: force.z < -2 N and |": (
        ("stages", "a", "until"), "force.z < -2 N and ",
    ),
    "a: {path: {line: {by: [60 |": (("a", "path", "line", "by", 0), "60 "),
    "a: [1, 2, 3|]": (("a", 2), "3"),
    "a: [1, [2, |": (("a", 1, 1), ""),
    "expect: [b, c|]": (("expect", 1), "c"),
}  # fmt: skip


@pytest.mark.parametrize(("text", "place"), KEYS.items())
def test_a_key_is_being_written(text: str, place: tuple[tuple[str, ...], str]) -> None:
    found = cursor_at(text.replace("|", "", 1), text.index("|"))
    assert (found.at_key, found.path, found.prefix) == (True, *place)


@pytest.mark.parametrize(("text", "place"), VALUES.items())
def test_a_value_is_being_written(text: str, place: tuple[tuple[str, ...], str]) -> None:
    found = cursor_at(text.replace("|", "", 1), text.index("|"))
    assert (found.at_key, found.path, found.prefix) == (False, *place)


def test_an_entry_of_a_block_list_may_become_a_key_or_a_value() -> None:
    text = "expect:\n  - press.force.z < 1 N\n  - pr"
    found = cursor_at(text, len(text))
    assert (found.path, found.prefix) == (("expect", 1), "pr")


@pytest.mark.parametrize(
    "text",
    ["a:\n  b: 1\n  |\n  c: 2\nd: 3", "a: {b: 1, |, c: 2}\nd: 3", "a: {b: 1, |\n   c: 2}\nd: 3"],
)
def test_keys_before_and_after_the_cursor_are_taken(text: str) -> None:
    found = cursor_at(text.replace("|", "", 1), text.index("|"))
    assert set(found.others) - {""} == {"b", "c"}


@pytest.mark.parametrize("end", [0, 40, 400])
def test_every_place_of_a_task_has_a_cursor(end: int) -> None:
    text = "robot: {model: panda}\nstages:\n  a:\n    axes: {z: {force: -10 N}}\n    time: 1 s\n"
    for offset in range(min(end, len(text)) + 1):
        assert cursor_at(text, offset).start <= offset
