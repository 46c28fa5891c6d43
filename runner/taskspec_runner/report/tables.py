"""The tables of a report: how each stage was tracked, and how it came to its set points."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from markupsafe import Markup

from taskspec_runner.pages.document import Heading, dot, in_unit, note, right, table
from taskspec_runner.pages.html import code, joined
from taskspec_runner.pages.numbers import figure, quantity
from taskspec_runner.pages.timeline import tints
from taskspec_runner.record.folder import Json, mapping, number
from taskspec_runner.report.rest_levels import rest_value
from taskspec_runner.runs import Run
from taskspec_runner.verdict.limit_effects import sentences
from taskspec_runner.verdict.remarks import remarks

#: Columns of a response; see the note below the table.
_RESPONSES = [
    "set point",
    "closed form",
    "rest",
    "overshoot",
    "settled after",
    "within",
    "time constant",
]
_STATISTICS = ("rms_error", "max_error", "final_error", "mean", "min", "max")
#: Words for the columns of tracking.
_WORDS = {"rms_error": "RMS error", "max_error": "peak error"}


#: No encoder of a robot has more counts a turn, which are some 0.4 urad, or 0.4 um at 1 m [rad, m].
RESOLUTION = 2 * math.pi / 2**24


def _resolved(value: float | None, unit: str) -> tuple[str, str]:
    """A place or an angle with its unit; of less than any encoder resolves, no more than that."""
    text = quantity(value, unit)
    if value is None or text[0] == "0" or unit not in ("m", "rad") or abs(value) >= RESOLUTION:
        return text
    figures, shown = quantity(RESOLUTION, unit, 1)
    return f"< {figures}", shown


def tracking(run: Run) -> Iterator[Markup]:
    """Per stage: statistics as columns, signals as rows, each value in its own scale."""
    for stage, signals in mapping(run.summary.get("metrics")).items():
        rows = {name: mapping(values) for name, values in mapping(signals).items()}
        rows = {name: values for name, values in rows.items() if values}
        seen = {key for values in rows.values() for key in values}
        columns = [key for key in _STATISTICS if key in seen] + sorted(seen - {*_STATISTICS})
        cells = {
            name: [_resolved(number(values.get(key)), _unit(run, name)) for key in columns]
            for name, values in rows.items()
        }
        words = [_WORDS.get(key, key.replace("_", " ")) for key in columns]
        yield _of_stage(run, stage, words, cells)


def responses(run: Run) -> Iterator[Markup]:
    """Per stage: the way to each set point, and the contact that was lost on it."""
    found, contact = (mapping(run.summary.get(key)) for key in ("responses", "contact"))
    for stage in dict.fromkeys([*found, *contact]):
        rows = {
            name: _response(run, stage, name, mapping(values))
            for name, values in mapping(found.get(stage)).items()
        }
        yield _of_stage(run, stage, _RESPONSES, rows, " wide")
        remark = _contact(mapping(contact.get(stage)))
        yield note(remark if rows or not remark else f"{stage}: {remark}")


def _of_stage(
    run: Run,
    stage: str,
    columns: Sequence[str],
    rows: Mapping[str, Sequence[tuple[str, str]]],
    look: str = "",
) -> Markup:
    """A table with a row for each signal of a stage."""
    title = Heading(joined(dot(tints(run).get(stage, 0)), stage))
    cells = ([code(name), *map(in_unit, values)] for name, values in rows.items())
    return table([title, *map(right, columns)], cells, f"metrics{look}")


def _response(run: Run, stage: str, name: str, values: Json) -> list[tuple[str, str]]:
    unit = _unit(run, name)
    sides = [number(values.get(key)) for key in ("below", "above")]
    overshoot, step = number(values.get("overshoot")), number(values.get("step"))
    over = quantity(overshoot, unit)
    if overshoot and step:
        over = (over[0], f"{over[1]}, {figure(100 * overshoot / abs(step), 2)} %")
    settled, constant = (number(values.get(key)) for key in ("settling_time", "time_constant"))
    wanted = number(values.get("set_point")) if values.get("target") != "closed form" else None
    return [
        quantity(wanted, unit),
        quantity(rest_value(run, stage, name), unit),
        quantity(number(values.get("rest")), unit),
        over,
        ("never", "") if settled is None else (f"{settled:.3f}", "s"),
        _within(sides, unit, str(values.get("settled_within") or "")),
        _milliseconds(constant),
    ]


def _milliseconds(value: float | None) -> tuple[str, str]:
    return ("–", "") if value is None else (figure(1e3 * value), "ms")


def _within(sides: list[float | None], unit: str, by: str) -> tuple[str, str]:
    below, above = sides
    if below is None or above is None:
        return "–", ""
    value, shown = quantity(max(below, above), unit)
    sign = "±" if abs(below - above) <= 1e-9 * max(below, above) else "≤"
    return f"{sign}{value}", f"{shown}, {by}"


def _contact(values: Json) -> str:
    losses, time = number(values.get("losses")), number(values.get("time"))
    if losses is None or time is None:
        return ""
    if not losses:
        return "Contact was never lost."
    times = "once" if losses == 1 else f"{losses:.0f} times"
    return f"Contact was lost {times}, for {1e3 * time:.0f} ms in all."


def solver(run: Run) -> Iterator[str]:
    """What the solver of limits did in each stage, a line each."""
    for stage, values in mapping(run.summary.get("solver")).items():
        ticks, solved, relaxed, held = (
            int(number(mapping(values).get(key)) or 0)
            for key in ("ticks", "solved", "relaxed", "held")
        )
        parts = [f"{solved} of {ticks} ticks needed the program"]
        if solved:
            parts.append(f"{held} had no answer and held a safe torque")
            parts.append(f"{relaxed} had limits that collided")
            worst = number(mapping(values).get("worst"))
            parts.append(f"worst residual {figure(worst or 0.0, 2)}")
        yield f"Limits of {stage}: {', '.join(parts)}."


def given_up(run: Run) -> list[str]:
    """What limits and contacts took, and the remarks of the parts of a run, in sentences.

    A summary of another version has none.
    """
    try:
        return [*sentences(run.summary), *remarks(run.summary)]
    except (AttributeError, KeyError, TypeError, ValueError):
        return []


def _unit(run: Run, signal: str) -> str:
    return run.units.get(signal, "")
