"""Programs of the shipped tasks that map, and what docs/urscript.md shows of them.

Run this file to write them anew after a change; then read the difference.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path

from taskspec.planning import plan_task
from taskspec.spec import load_task
from taskspec_runner.urscript.exported import script_of
from taskspec_runner.urscript.refusals import NotMappedError
from taskspec_runner.urscript.script import Script

ROOT = Path(__file__).resolve().parents[2]
GOLDENS = Path(__file__).resolve().parent
PAGE = ROOT / "docs" / "urscript.md"
TASKS = sorted(path.stem for path in (ROOT / "tasks").glob("*.yaml"))
EXAMPLE = "wipe-table"


@dataclass(frozen=True)
class Outcome:
    """What became of a task: its program, or the reasons why it has none."""

    script: Script | None
    reasons: tuple[str, ...] = ()


@cache
def outcome(name: str) -> Outcome:
    """The program of a shipped task, or the reasons."""
    path = ROOT / "tasks" / f"{name}.yaml"
    try:
        return Outcome(script_of(plan_task(load_task(path))))
    except NotMappedError as error:
        return Outcome(None, error.reasons)


def plain(text: str) -> str:
    """A text without what depends on where the task lies, and on the version."""
    text = text.replace(str(ROOT / "tasks"), "tasks")
    return text.replace(f"taskspec {version('taskspec-robotics')}", "taskspec VERSION")


def golden(name: str) -> Path:
    return GOLDENS / f"{name}.script"


def row(name: str) -> str:
    """What the page's table has of a task."""
    found = outcome(name)
    if found.script is not None:
        return f"| `{name}` | yes, {len(found.script.all_losses)} lines on what is lost |"
    places = [plain(reason).partition(": ") for reason in found.reasons]
    short = [
        f"{place.rpartition('/')[2].partition('.yaml:')[2]} {text}" for place, _, text in places
    ]
    return f"| `{name}` | {'; '.join(short)} |"


def parts() -> Mapping[str, str]:
    """The generated parts of the page by their marks."""
    mapped = sum(outcome(name).script is not None for name in TASKS)
    head = f"{mapped} of the {len(TASKS)} shipped tasks map:\n\n| task | maps |\n| --- | --- |"
    script = outcome(EXAMPLE).script
    assert script is not None
    lost = "\n".join(plain(f"{loss.source}:{loss.line}:{loss.column}: lost: {loss.text}")
                     for loss in script.all_losses)  # fmt: skip
    return {
        "table": "\n".join([head, *map(row, TASKS)]),
        "losses": f"```text\n{lost}\n```",
        "program": f"```text\n{plain(script.text)}```",
    }


def page_with(text: str, found: Mapping[str, str]) -> str:
    """The page with its generated parts in their places."""
    for mark, part in found.items():
        place = re.compile(rf"(<!-- urscript: {mark} -->\n).*?(<!-- end -->)", re.S)
        here = place.search(text)
        assert here, f"{PAGE} has no place for {mark!r}"
        before, after = text[: here.end(1)], text[here.start(2) :]
        text = f"{before}{part}\n{after}"
    return text


if __name__ == "__main__":
    for stale in GOLDENS.glob("*.script"):
        stale.unlink()
    for task in TASKS:
        program = outcome(task).script
        if program is not None:
            golden(task).write_text(plain(program.own_text), encoding="utf-8")
    PAGE.write_text(page_with(PAGE.read_text(encoding="utf-8"), parts()), encoding="utf-8")
