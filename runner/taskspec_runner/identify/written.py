"""Estimates as people and files write them: numbers with units, `--set` lines, entries of `vary`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from taskspec.program.components import value_of
from taskspec.text.units import Dimension, in_unit, number, suited
from taskspec_runner.identify.identification import Estimate, Identification

#: Digits of a value beyond the first one of its deviation.
_BEYOND = 2
_MOST_DIGITS = 9


def digits_of(value: float, deviation: float) -> int:
    """How many digits of a value its deviation leaves meaning to."""
    if not value or not deviation or math.isinf(value):
        return _BEYOND + 1
    return min(max(math.floor(math.log10(abs(value) / deviation)) + 1 + _BEYOND, 2), _MOST_DIGITS)


def shown(value: float, dimension: Dimension, unit: str, deviation: float) -> str:
    """A value [SI] in a unit, with as many digits as mean something."""
    del dimension
    if math.isinf(value):
        return "none"
    if deviation and abs(value) < 0.05 * deviation:
        value = 0.0
    return f"{number(in_unit(value, unit), digits_of(value, deviation))} {unit}".rstrip()


def unit_of(estimate: Estimate) -> str:
    """The unit that suits a value and its interval."""
    ends = [abs(x) for x in (estimate.low, estimate.high) if not math.isinf(x)]
    return suited(max(ends, default=0.0), estimate.dimension)


def values(found: Identification) -> dict[str, str]:
    """What a file would have, by paths, as it is written: `world.table.stiffness`: `21.97 kN/m`.

    A list has all of its components, those that are not identified as in the file.
    """
    made: dict[str, str] = {}
    by_path: dict[str, list[Estimate]] = {}
    for each in found.estimates:
        by_path.setdefault(each.path, []).append(each)
    for path, estimates in by_path.items():
        if estimates[0].index is None:
            each = estimates[0]
            if not math.isinf(each.value):
                made[path] = shown(each.value, each.dimension, unit_of(each), each.deviation)
            continue
        made[path] = _listed(found, path, estimates)
    return made


def _listed(found: Identification, path: str, estimates: list[Estimate]) -> str:
    context = found.program.context
    dimensions = found.loaded.task.target_of(path).dimensions
    deviation = {e.index: e.deviation for e in estimates}
    least = min(deviation.values())
    parts = []
    for i, dimension in enumerate(dimensions):
        value = value_of(context, found.task, path, i)
        if i not in deviation and not any(e.along for e in estimates):
            value = value_of(context, found.loaded.task, path, i)
        unit = suited(max(abs(value), least), dimension)
        parts.append(shown(value, dimension, unit, deviation.get(i, least)))
    return f"[{', '.join(parts)}]"


def set_lines(found: Identification) -> Iterator[str]:
    """The options that give a command the identified values."""
    for path, value in values(found).items():
        yield f"--set '{key_of(path)}={value}'"


def key_of(path: str) -> str:
    """The key of a file that a value stands at: a payload is the truth's alone."""
    return f"truth.{path}" if path.startswith("robot.payload") else path


def tolerances(found: Identification) -> Mapping[str, str]:
    """Entries of `vary` that have the intervals about the identified values, by paths."""
    made: dict[str, str] = {}
    by_path: dict[str, list[Estimate]] = {}
    for each in found.estimates:
        by_path.setdefault(each.path, []).append(each)
    for path, estimates in by_path.items():
        dimensions = found.loaded.task.target_of(path).dimensions
        if any(e.along for e in estimates):
            continue
        half = {e.index: (e, max(e.high - e.value, e.value - e.low)) for e in estimates}
        parts = []
        for i in range(len(dimensions)):
            entry = half.get(i if len(dimensions) > 1 else None)
            if entry is None or math.isinf(entry[1]):
                parts.append("0")
                continue
            each, width = entry
            unit = suited(width, each.dimension)
            parts.append(f"+- {number(in_unit(width, unit), 3)} {unit}".rstrip())
        made[path] = parts[0] if len(dimensions) == 1 else f"[{', '.join(parts)}]"
    return made
