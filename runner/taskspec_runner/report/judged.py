"""Expectations as the summary of a run has them, read with patience."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from taskspec_runner.report.values import Json, mapping, mappings, number
from taskspec_runner.verdict.margin import Broken, Margin


@dataclass(frozen=True, slots=True)
class Expectation:
    """A judged expectation.

    Attributes:
        text: as written. passed: whether it held. explanation: in numbers.
        stage: it is about, None for the whole run. signal: it bounds, None if it has no plain one.
        band: lowest and highest value [SI], None on an open side; None if it is no band.
        signals: all that it is about, with their stages. margins: of its conditions.
        broken: when it was broken. line: of the task file, from 1.
    """

    text: str
    passed: bool
    explanation: str
    stage: str | None
    signal: str | None
    band: tuple[float | None, float | None] | None
    signals: tuple[str, ...] = ()
    margins: tuple[Margin, ...] = ()
    broken: Broken | None = None
    line: int | None = None


def read_expectation(entry: Json, *, whole: bool = True) -> Expectation:
    """An expectation, of whatever a summary says of it.

    Args:
        entry: of the summary.
        whole: whether the run came to its end; else only what no further tick could have mended
            counts as broken.
    """
    broken = _broken(mapping(entry.get("broken")))
    band = entry.get("band")
    sides = None
    if isinstance(band, list) and len(band) == 2:
        sides = (number(band[0]), number(band[1]))
    stage, signal = entry.get("stage"), entry.get("signal")
    return Expectation(
        text=str(entry.get("text", "")),
        passed=bool(entry.get("passed")),
        explanation=str(entry.get("explanation") or ""),
        stage=str(stage) if stage else None,
        signal=str(signal) if signal else None,
        band=sides if sides not in (None, (None, None)) else None,
        signals=tuple(map(str, entry.get("signals") or ())),
        margins=tuple(_margins(entry)),
        broken=broken if broken is not None and (whole or broken.final) else None,
        line=entry["line"] if isinstance(entry.get("line"), int) else None,
    )


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
