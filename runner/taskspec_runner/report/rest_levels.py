"""Where a law has its forces come to rest in closed form, drawn beside what was measured."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from taskspec_runner.pages.chart import Level
from taskspec_runner.record.folder import mapping, number
from taskspec_runner.runs import Run

ROLE = "predicted"


def rest_value(run: Run, stage: str, signal: str) -> float | None:
    """The closed form of a force or moment at rest [N, N m]; None where there is none."""
    of_stage = mapping(mapping(run.summary.get("rest_values")).get(stage))
    return number(mapping(of_stage.get(signal)).get("value"))


def rest_levels(run: Run, signals: Iterable[str], factor: float) -> Iterator[Level]:
    """Where forces and moments come to rest; `factor` makes the chart's unit."""
    for name in signals:
        for visit in run.visits:
            value = rest_value(run, visit.stage, name)
            if value is not None:
                text = "at rest by the law"
                yield Level(visit.start, visit.end, factor * value, ROLE, text, "rest")
