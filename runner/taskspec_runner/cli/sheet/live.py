"""Live params in the sheet of a task: where each begins, what bounds it, and how fast it goes."""

from __future__ import annotations

from collections.abc import Mapping

from taskspec.deferred_methods import dataclass
from taskspec.spec import Task
from taskspec.text.units import scaled, si_unit


@dataclass(frozen=True, slots=True)
class LiveRow:
    """A param that may be set while a stage runs.

    Attributes:
        name: of the param.
        value, interval, rate: in words; `at once` where it has no rate.
        numbers: `value`, `low`, `high` and `rate` [SI]; no rate is 0.
        unit: that of the first three.
    """

    name: str
    value: str
    interval: str
    rate: str
    numbers: Mapping[str, float]
    unit: str


def live_rows(task: Task) -> tuple[LiveRow, ...]:
    """The live params of a task, in their order."""
    return tuple(
        LiveRow(
            name=name,
            value=scaled(param.value, param.dimension),
            interval=f"{scaled(param.low, param.dimension)} to "
            f"{scaled(param.high, param.dimension)}",
            rate=param.pace or "at once",
            numbers={k: getattr(param, k) for k in ("value", "low", "high", "rate")},
            unit=si_unit(param.dimension),
        )
        for name, param in task.live.items()
    )
