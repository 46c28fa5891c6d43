"""The picture of a comparison: force and motion error of all laws, for a README or a paper."""

from __future__ import annotations

from collections.abc import Sequence

from taskspec_runner.compare.charts import main_charts
from taskspec_runner.compare.comparison import Comparison, Json
from taskspec_runner.compare.overlay import CUT_SHORT, Overlay, overlay, role
from taskspec_runner.pages.picture import LegendEntry, picture_svg


def comparison_svg(comparison: Comparison) -> str:
    """The picture as text, 860 px wide, for light and dark pages."""
    laid = overlay(comparison)
    outcomes = [law["outcome"] for law in comparison.laws]
    facts = [
        comparison.summary["robot"],
        f"as written and {len(outcomes) - 1} laws: {counted(outcomes)}",
        f"stages {laid.under}" if laid else "",
    ]
    legend = [_entry(law) for law in comparison.laws]
    foot = [
        time_of(laid) if laid else "",
        "dashed laws have no force loop" if any(e.style == "loopless" for e in legend) else "",
    ]
    return picture_svg(
        str(comparison.summary["task"]),
        ", ".join(fact for fact in facts if fact),
        "",
        laid,
        main_charts(laid) if laid else [],
        legend=legend,
        cut={law["law"] for law in comparison.laws if law["outcome"] in CUT_SHORT},
        foot="; ".join(filter(None, foot)),
    )


def time_of(laid: Overlay) -> str:
    """What the common time counts from."""
    return f"time since {laid.origin} began" if laid.origin else "time since the run began"


def counted(words: Sequence[str]) -> str:
    """How often each word comes, such as `3 passed, 1 refused`."""
    return ", ".join(f"{words.count(word)} {word}" for word in dict.fromkeys(words))


def _entry(law: Json) -> LegendEntry:
    style = ("line" if law["force_loop"] else "loopless") if law["folder"] else ""
    outcome, reason = str(law["outcome"]), str(law["reason"])
    ending = outcome
    if outcome == "refused":
        ending = f"refused, {reason.partition(':')[0]}"
    elif outcome in ("stopped", "failed"):
        ending = f"{outcome} {reason.partition(' at ')[0].replace('stage ', '')}"
    elif law.get("expected"):
        ending = f"{outcome}, {law['met']} of {law['expected']}"
    return LegendEntry(law["law"], role(law["law"]), style, ending, outcome)
