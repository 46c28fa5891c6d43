"""A task file line by line, with what was found about it and what became of what it expects."""

from __future__ import annotations

from markupsafe import Markup

from taskspec_runner.pages.document import fold
from taskspec_runner.pages.html import element, highlighted, joined, prose
from taskspec_runner.record.folder import Json, mappings
from taskspec_runner.runs import Run


def annotated_task(run: Run) -> Markup:
    """The task file of a run to unfold, with remarks on its lines; nothing where there is none."""
    if not run.task:
        return Markup("")
    remarks: dict[object, list[Markup]] = {}
    for each in _diagnostics(run):
        # What is about an override stands before the first line.
        at = each["line"] if isinstance(each.get("line"), int) else None
        where = f" in {each['source']}" if each.get("source") else ""
        kind = str(each.get("severity"))
        text = f"{kind}[{each.get('code')}]{where}: {each.get('message')}"
        remarks.setdefault(at, []).append(_remark(kind, text, str(each.get("hint") or "")))
    for judged in run.expectations:
        if judged.line is not None and judged.missed:
            text = f"missed: {judged.explanation}"
            remarks.setdefault(judged.line, []).append(_remark("missed", text))
    lines = []
    for i, text in enumerate(highlighted(run.task).split("\n"), 1):
        number = element("span", i, class_="number")
        lines.append(element("div", number, element("code", text), class_="line"))
        lines += remarks.get(i, ())
    task = element("div", *lines, class_="task", tabindex=0)
    found = counted(run)
    content = (*remarks.get(None, ()), task)
    return element("section", fold("The task file", found, *content, shut=not found))


def counted(run: Run) -> str:
    """How many findings there are, such as `2 warnings`; empty without any."""
    kinds = [str(d.get("severity")) for d in _diagnostics(run)]
    each = ((kind, kinds.count(kind)) for kind in dict.fromkeys(kinds))
    return ", ".join(f"{n} {kind}{'s' if n > 1 else ''}" for kind, n in each)


def _diagnostics(run: Run) -> list[Json]:
    return mappings(run.summary.get("diagnostics"))


def _remark(kind: str, text: str, hint: str = "") -> Markup:
    more = joined(element("br"), prose(hint)) if hint else None
    return element("p", prose(text), more, class_=f"finding {kind}")
