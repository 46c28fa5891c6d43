"""When a fault of `truth` was in a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec_runner.record.folder import mapping, mappings, number


@dataclass(frozen=True, slots=True)
class FaultTime:
    """A fault of a run.

    Attributes:
        text: the fault in words.
        start, end: run time [s]; None of one that never came, and of one that did not end.
    """

    text: str
    start: float | None
    end: float | None

    def as_data(self) -> dict[str, object]:
        """The entry of a summary."""
        return {"fault": self.text, "start": self.start, "end": self.end}

    @property
    def when(self) -> str:
        """Its time in words."""
        if self.start is None:
            return "never came"
        if self.end is None:
            return f"from {self.start:.3f} s on"
        return f"{self.start:.3f} to {self.end:.3f} s"


def fault_times(summary: Mapping[str, Any]) -> tuple[FaultTime, ...]:
    """The faults that a summary has, in the order of the file."""
    found = mappings(mapping(summary.get("world")).get("faults"))
    return tuple(
        FaultTime(str(each.get("fault")), number(each.get("start")), number(each.get("end")))
        for each in found
    )
