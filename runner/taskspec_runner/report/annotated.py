"""A task file line by line, with what was found about it and what became of what it expects."""

from __future__ import annotations

from collections.abc import Iterator

from markupsafe import Markup

from taskspec.deferred_methods import dataclass
from taskspec_runner.record.folder import Json, mappings
from taskspec_runner.report.highlight import highlighted
from taskspec_runner.runs import Run


@dataclass(frozen=True, slots=True)
class Remark:
    """A remark on a line: `kind` is error, warning, info, passed or missed."""

    kind: str
    text: str
    hint: str = ""


@dataclass(frozen=True, slots=True)
class AnnotatedLine:
    """A line of the task file, marked up, and the remarks on it."""

    text: Markup
    findings: tuple[Remark, ...]


def task_lines(run: Run) -> list[AnnotatedLine]:
    """The task file of a run; empty where there is none."""
    if not run.task:
        return []
    remarks: dict[int, list[Remark]] = {}
    for line, finding in (*_placed(run), *_judged(run)):
        remarks.setdefault(line, []).append(finding)
    lines = str(highlighted(run.task)).split("\n")
    return [
        AnnotatedLine(Markup(text), tuple(remarks.get(i, ()))) for i, text in enumerate(lines, 1)
    ]


def elsewhere(run: Run) -> list[Remark]:
    """Findings about what the task file itself does not hold, such as an override."""
    return [_finding(d) for d in _diagnostics(run) if not isinstance(d.get("line"), int)]


def counted(run: Run) -> str:
    """How many findings there are, such as `2 warnings`; empty without any."""
    kinds = [str(d.get("severity")) for d in _diagnostics(run)]
    each = ((kind, kinds.count(kind)) for kind in dict.fromkeys(kinds))
    return ", ".join(f"{n} {kind}{'s' if n > 1 else ''}" for kind, n in each)


def _diagnostics(run: Run) -> list[Json]:
    return mappings(run.summary.get("diagnostics"))


def _placed(run: Run) -> Iterator[tuple[int, Remark]]:
    for each in _diagnostics(run):
        if isinstance(each.get("line"), int):
            yield each["line"], _finding(each)


def _finding(each: Json) -> Remark:
    kind, code = str(each.get("severity")), each.get("code")
    where = f" in {each['source']}" if each.get("source") else ""
    return Remark(
        kind, f"{kind}[{code}]{where}: {each.get('message')}", str(each.get("hint") or "")
    )


def _judged(run: Run) -> Iterator[tuple[int, Remark]]:
    for each in run.expectations:
        if each.line is not None and each.missed:
            yield each.line, Remark("missed", f"missed: {each.explanation}")
