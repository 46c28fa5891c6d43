"""An expectation and what became of it, as it is judged and as the summary of a run keeps it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.spec.expectation import titled
from taskspec_runner.record.folder import Json, mapping, mappings, number

#: Name of what a condition with a share of ticks is measured by.
SHARE = "share of ticks"


@dataclass(frozen=True, slots=True)
class MeasuredValue:
    """One measured number: what it is, and its value in `unit`."""

    name: str
    value: float
    unit: str


@dataclass(frozen=True, slots=True)
class Margin:
    """How far inside its bound a measured value is.

    Attributes:
        name: of the measured part, as written.
        value: in `unit`, negative outside.
        unit: of it.
        left: share of what was allowed that was not used: 1 in the middle of a band, at zero under
            a bound, or where every tick was good; 0 on the bound. None under a bound of zero.
    """

    name: str
    value: float
    unit: str
    left: float | None


@dataclass(frozen=True, slots=True)
class Broken:
    """When an expectation was broken for good, and what was measured then.

    Attributes:
        clock: run time of the first tick that did it [s].
        text: in numbers.
        final: whether no tick more could have changed it, as a share of ticks may be.
    """

    clock: float
    text: str
    final: bool = True


@dataclass(frozen=True, slots=True)
class Judged:
    """An expectation and what became of it.

    Attributes:
        text: as written.
        passed: whether the run met it. A window without ticks, or a tick at which it cannot be
            told, fails. None if it needs what was not recorded: neither met nor missed.
        explanation: in one line, with the measured numbers.
        measured: those numbers.
        signals: the signals that it is about, with their stages.
        stage: that all of them belong to; None for the whole run, or where they differ.
        signal: the logged signal, if it is about one.
        band: (low, high) [SI] that the signal is to stay within, None on an open side; None
            altogether where it is about more than the size of one signal.
        margins: how far inside its bounds each of its conditions stayed.
        broken: when it was broken; None if it was met, or never had a tick.
        line: of the task file, from 1.
        unrecorded: columns that it needs and that were not recorded; empty for a run.
        name: that the file gives it; empty without one.
    """

    text: str
    passed: bool | None
    explanation: str
    measured: tuple[MeasuredValue, ...]
    signals: tuple[str, ...]
    stage: str | None
    signal: str | None
    band: tuple[float | None, float | None] | None
    margins: tuple[Margin, ...] = ()
    broken: Broken | None = None
    line: int | None = None
    unrecorded: tuple[str, ...] = ()
    name: str = ""

    @property
    def title(self) -> str:
        """The text, and the name before it."""
        return titled(self.name, self.text)

    @property
    def missed(self) -> bool:
        """Whether it was not met, which is more than that it could not be judged."""
        return self.passed is False

    def as_data(self) -> dict[str, Any]:
        """The entry of a summary: a name if it has one; nothing not recorded if it is of a run."""
        named = {"name": self.name} if self.name else {}
        lacking = {"not_recorded": list(self.unrecorded)} if self.unrecorded else {}
        return {
            **named,
            "text": self.text,
            "line": self.line,
            "passed": self.passed,
            "explanation": self.explanation,
            "measured": [asdict(each) for each in self.measured],
            "signals": list(self.signals),
            "stage": self.stage,
            "signal": self.signal,
            "band": list(self.band) if self.band else None,
            "margins": [asdict(margin) for margin in self.margins],
            "broken": asdict(self.broken) if self.broken else None,
            **lacking,
        }


def read_judged(entry: Json, *, whole: bool = True) -> Judged:
    """An expectation, of whatever a summary says of it.

    Args:
        entry: of the summary.
        whole: whether the run came to its end; else only what no further tick could have changed
            counts as broken.
    """
    broken = _broken(mapping(entry.get("broken")))
    band = entry.get("band")
    sides = None
    if isinstance(band, list) and len(band) == 2:
        sides = (number(band[0]), number(band[1]))
    stage, signal = entry.get("stage"), entry.get("signal")
    lacking = entry.get("not_recorded")
    unrecorded = tuple(map(str, lacking)) if isinstance(lacking, list) else ()
    return Judged(
        text=str(entry.get("text", "")),
        passed=None if unrecorded and entry.get("passed") is None else bool(entry.get("passed")),
        explanation=str(entry.get("explanation") or ""),
        measured=tuple(_measured(entry)),
        stage=str(stage) if stage else None,
        signal=str(signal) if signal else None,
        band=sides if sides not in (None, (None, None)) else None,
        signals=tuple(map(str, entry.get("signals") or ())),
        margins=tuple(_margins(entry)),
        broken=broken if broken is not None and (whole or broken.final) else None,
        line=entry["line"] if isinstance(entry.get("line"), int) else None,
        unrecorded=unrecorded,
        name=str(entry.get("name") or ""),
    )


def title_of(entry: Json) -> str:
    """The text of an entry of a summary, and its name before it."""
    return titled(str(entry.get("name") or ""), str(entry.get("text", "")))


def _measured(entry: Json) -> Iterator[MeasuredValue]:
    for each in mappings(entry.get("measured")):
        value = number(each.get("value"))
        if value is not None:
            yield MeasuredValue(str(each.get("name", "")), value, str(each.get("unit", "")))


def _margins(entry: Json) -> Iterator[Margin]:
    for each in mappings(entry.get("margins")):
        value = number(each.get("value"))
        if value is not None:
            words = str(each.get("name", "")), str(each.get("unit", ""))
            yield Margin(words[0], value, words[1], number(each.get("left")))


def _broken(entry: Json) -> Broken | None:
    clock = number(entry.get("clock"))
    text, final = str(entry.get("text", "")), bool(entry.get("final", True))
    return None if clock is None else Broken(clock, text, final)
