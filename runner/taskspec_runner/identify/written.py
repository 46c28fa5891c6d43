"""Estimates as people and files write them: numbers with units, `--set` lines, and `vary`."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from taskspec.geometry.rotation import from_rpy
from taskspec.program.components import value_of
from taskspec.text.units import in_unit, number, suited
from taskspec_runner.identify.estimate import Estimate
from taskspec_runner.identify.identification import Identification
from taskspec_runner.identify.parameters import PAYLOAD

#: Digits of a value beyond the first one of its deviation.
_BEYOND = 2
_MOST_DIGITS = 9


def digits_of(value: float, deviation: float) -> int:
    """How many digits of a value its deviation leaves meaning to."""
    if not value or not deviation or math.isinf(value):
        return _BEYOND + 1
    return min(max(math.floor(math.log10(abs(value) / deviation)) + 1 + _BEYOND, 2), _MOST_DIGITS)


def shown(value: float, unit: str, deviation: float) -> str:
    """A value [SI] in a unit, with as many digits as mean something."""
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

    A list has all of its components, those that are not identified as in the file. What the file
    has as 0, or not at all, stays so where it cannot be told from that.
    """
    made: dict[str, str] = {}
    by_path: dict[str, list[Estimate]] = {}
    for each in found.estimates:
        by_path.setdefault(each.path, []).append(each)
    for path, estimates in by_path.items():
        if estimates[0].index is None:
            each = estimates[0]
            same = each.settled == 0 == each.declared
            if not same and not math.isinf(each.high):
                made[path] = shown(each.value, unit_of(each), each.deviation)
            continue
        made[path] = _listed(found, path, estimates)
    return made


def _listed(found: Identification, path: str, estimates: list[Estimate]) -> str:
    context = found.program.context
    dimensions = found.loaded.task.target_of(path).dimensions
    own = {e.index: e.value for e in estimates}
    turned = any(e.along for e in estimates)
    deviation = {e.index: e.deviation for e in estimates}
    nothing = {e.index for e in estimates if e.settled == 0}
    least = min(deviation.values())
    parts = []
    for i, dimension in enumerate(dimensions):
        task = found.task if turned else found.loaded.task
        value = value_of(context, task, path, i)
        # Of a pose, what is not identified stays as in the file, and the rest goes with that.
        value = value if turned else own.get(i, value)
        unit = suited(max(abs(value), least), dimension)
        text = shown(value, unit, deviation.get(i, least))
        parts.append("0" if text.startswith("0 ") or i in nothing else text)
    return f"[{', '.join(parts)}]"


def set_lines(found: Identification) -> Iterator[str]:
    """The options that give a command the identified values."""
    for path, value in values(found).items():
        yield f"--set '{key_of(path)}={value}'"


def key_of(path: str) -> str:
    """The key of a file that a value stands at: a payload is the truth's alone."""
    return f"truth.{path}" if path.startswith(PAYLOAD) else path


def tolerances(found: Identification) -> dict[str, str]:
    """Entries of `vary` that have the intervals, by paths.

    Of a single number they are its ends, of a list what its components may be off. What is known
    exactly does not vary.
    """
    made: dict[str, str] = {}
    by_path: dict[str, list[Estimate]] = {}
    for each in found.estimates:
        by_path.setdefault(each.path, []).append(each)
    for path, estimates in by_path.items():
        dimensions = found.loaded.task.target_of(path).dimensions
        if len(dimensions) == 1:
            entry = _ends(estimates[0])
        elif estimates[0].along:
            entry = _turned(found, path, estimates)
        else:
            parts = {e.index: _off(e) for e in estimates}
            listed = [parts.get(i, "0") for i in range(len(dimensions))]
            entry = f"[{', '.join(listed)}]" if any(p != "0" for p in listed) else ""
        if entry:
            made[path] = entry
    return made


def _ends(each: Estimate) -> str:
    if each.exact or math.isinf(each.high) or each.low == each.high:
        return ""
    unit = unit_of(each)
    low, high = (
        number(in_unit(x, unit), digits_of(x, each.deviation)) for x in (each.low, each.high)
    )
    return f"{low}..{high} {unit}".rstrip()


def _off(each: Estimate) -> str:
    return _tolerance(_half(each, each.settled), each)


def _half(each: Estimate, about: float) -> float:
    """How far an interval goes from a value; 0 where the value is known exactly."""
    return 0.0 if each.exact else max(each.high - about, about - each.low)


def _tolerance(width: float, each: Estimate) -> str:
    if math.isinf(width) or not width:
        return "0"
    unit = suited(width, each.dimension)
    return f"+- {number(in_unit(width, unit), 3)} {unit}".rstrip()


def _turned(found: Identification, path: str, estimates: list[Estimate]) -> str:
    """Tolerances along the axes of the file of what is known along those of an object."""
    if path.endswith(".rpy"):
        return ""
    name = path.split(".")[1]
    R = from_rpy(found.loaded.task.shapes[name].rpy)
    half = np.zeros(3)
    for each in estimates:
        half += np.abs(R[:, each.index or 0]) * _half(each, each.value)
    parts = [_tolerance(float(width), estimates[0]) for width in half]
    return f"[{', '.join(parts)}]" if any(part != "0" for part in parts) else ""


def file_values(found: Identification) -> dict[str, str]:
    """All that a file gets: values, and the intervals of `vary`, by paths of overrides."""
    plain = values(found)
    made = {path: value for path, value in plain.items() if not path.startswith(PAYLOAD)}
    load = {path: value for path, value in plain.items() if path.startswith(PAYLOAD)}
    if load:
        inner = ", ".join(f"{path.rpartition('.')[2]}: {value}" for path, value in load.items())
        made[f"truth.{PAYLOAD}"] = f"{{{inner}}}"
    made |= {f"vary.{path}": value for path, value in tolerances(found).items()}
    return made
