"""Gains that are matrices, or that vary: whether they couple what there is, and are positive."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

from taskspec.expression import Expression
from taskspec.expression.tree import Name, walk
from taskspec.geometry.axis import PAIRS, Axis, axes_of, coupled, entry_dimension
from taskspec.laws import ControlLaw
from taskspec.laws.coupled import least_eigenvalue
from taskspec.laws.gains import MATRICES, Gain, Gains, pairs_of, rows
from taskspec.laws.law import commanding, gain_named
from taskspec.program.plan import StagePlan
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.spec import KeyPath
from taskspec.stability.gain_paths import gain_path
from taskspec.text.units import Dimension, number, scaled, show

#: An eigenvalue below this part of the greatest entry is none.
_NONE = 1e-9


@rule(
    {
        "TS217": "a gain that couples axes which are not coupled there",
        "TS257": "a gain that varies under a law whose gains are constant",
    },
    phase=Phase.AXES,
)
def misplaced_entries(stage: StagePlan) -> Iterator[Finding]:
    """Entries off the diagonal, and expressions, where a stage cannot have them."""
    law = stage.law.control_law
    for name, entries in stage.law.by_entry.items():
        for on, given in entries.items():
            place = _place(stage, name, on)
            if isinstance(given, Expression) and (law.selects or on not in (*stage.axes, *PAIRS)):
                if law.selects:
                    yield error(
                        "TS257",
                        f"the gains of {law.kind!r} are constants, and {name!r} varies",
                        place,
                        _with_springs(law, "laws whose gains may vary", "write a number"),
                        unless=("TS257",),
                    )
                continue
            if on not in PAIRS:
                continue
            missing = [axis for axis in PAIRS[on] if axis not in stage.axes]
            loose = [axis for axis in PAIRS[on] if not stage.plans[axis].force] if (
                not missing and name.startswith("force.")
            ) else []  # fmt: skip
            if law.selects:
                reason = f"{law.kind!r} has its gains axis by axis"
                hint = _with_springs(law, "laws with matrices of gains", "leave the entry out")
            elif missing:
                reason = f"stage {stage.name!r} has no axis {missing[0]!r}"
                hint = f"its axes: {', '.join(stage.axes)}"
            elif loose:
                reason = f"no force loop is on {loose[0]!r} in stage {stage.name!r}"
                hint = "give the axis a force, or leave the entry out"
            else:
                continue
            yield error(
                "TS217", f"{on!r} couples nothing: {reason}", place, hint, unless=("TS217",)
            )


def _with_springs(law: ControlLaw, these: str, otherwise: str) -> str:
    """The laws that have springs in place of this one, or what to do where there are none."""
    having = ", ".join(commanding(law.commands, lambda each: not each.selects))
    return f"{these}: {having}" if having else otherwise


@rule(
    {
        "TS216": "a matrix of gains that is not positive definite",
        "TS218": "a gain that varies to where it is not positive",
    },
    phase=Phase.PATH,
    predicts=("TS218",),
)
def indefinite_gains(stage: StagePlan) -> Iterator[Finding]:
    """Matrices of gains that are not positive definite, in the numbers and ranges of the file."""
    law = stage.law
    if law.control_law.selects or not law.matrices:
        return
    for name in MATRICES:
        gains = stage.gains.get(name, {})
        yield from _not_positive(stage, name, gains)
        for group in coupled([*pairs_of(stage.gains, name)]):
            yield from _indefinite(stage, name, group)


def _not_positive(stage: StagePlan, name: str, gains: dict[str, Gain]) -> Iterator[Finding]:
    """Entries of the diagonal that vary to zero or below."""
    first = stage.name == next(iter(stage.context.loaded.task.stages))
    for on, gain in gains.items():
        formula, ranges = gain.formula, stage.gain_range
        if formula is None or on in PAIRS:
            continue
        least, begins = ranges.of(formula), ranges.at_start(formula)
        dimension = entry_dimension(gain_named(name).dimension, on)
        place = _place(stage, name, on)
        if least.high <= 0:
            text = f"the {name} on {on!r} is never positive in stage {stage.name!r}"
            text += f": at most {_value(least.high, dimension)}"
            yield error("TS218", text, place, _bound(dimension), unless=("TS218",))
        elif first and _depends_on_start(formula) and begins <= 0:
            text = f"the {name} on {on!r} is {_value(begins, dimension)} at the start"
            yield error("TS218", text, place, _bound(dimension), unless=("TS218",))
        elif least.low < 0 and least.low > -float("inf"):
            text = (
                f"the {name} on {on!r} may come to {_value(least.low, dimension)} in stage "
                f"{stage.name!r}, where the run stops"
            )
            yield warning("TS218", text, place, _bound(dimension), unless=("TS218",))


def _depends_on_start(formula: Expression) -> bool:
    """Whether the value at the start pose is that of the first tick: of clocks and gaps alone."""
    names = [str(node) for node in walk(formula.tree) if isinstance(node, Name)]
    return all(n.endswith("gap") or "." not in n for n in names)


def _bound(dimension: Dimension) -> str:
    least = show(100.0, dimension) if dimension != gain_named("mass").dimension else "1 kg"
    return f"bound it from below: max(.., {least})"


def _value(value: float, dimension: Dimension) -> str:
    return scaled(value, dimension)


def _indefinite(stage: StagePlan, name: str, group: Sequence[Axis]) -> Iterator[Finding]:
    """One block of a matrix, at its nominal entries and at the corners of their ranges."""
    gains = stage.gains
    pairs = [on for on in pairs_of(gains, name) if {*axes_of(on)} <= {*group}]
    given = [on for on in pairs if gains[name][on].origin == "file"]
    if not given:
        return  # What is designed is.
    place = _place(stage, name, given[0])
    for corner in _corners(stage, gains, name, group):
        block = rows(corner, name, group)
        least, direction = least_eigenvalue(block, group)
        largest = max(abs(x) for row in block for x in row)
        if least > _NONE * largest:
            continue
        mixed = len({axis.is_rotation for axis in group}) > 1
        dimension = gain_named(name).dimension.on(rotation=group[0].is_rotation and not mixed)
        text = (
            f"the {name} of {', '.join(group)} is not positive definite: its least eigenvalue is "
            f"{_value(least, dimension)}, along {_along(direction)}"
        )
        hint = _smaller(corner, name, pairs)
        hint = _smaller(corner, name, pairs)
        varies = any(gains[name][on].formula is not None for on in (*group, *pairs))
        if varies:
            yield warning(
                "TS218", f"{text}, at an end of its range", place, hint, unless=("TS218",)
            )
        else:
            yield replace(error("TS216", text, place, hint, unless=("TS216",)), stops=True)
        return


def _corners(
    stage: StagePlan, gains: Gains, name: str, group: Sequence[Axis]
) -> Iterator[dict[str, dict[str, Gain]]]:
    """The nominal entries of a block, and all ends of those whose range is bounded.

    A matrix that is positive definite at all corners of a box is so everywhere in it.
    """
    within = {}
    for on, gain in gains[name].items():
        if gain.formula is not None and {*axes_of(on)} <= {*group}:
            bounds = stage.gain_range.of(gain.formula)
            if abs(bounds.low) < float("inf") and abs(bounds.high) < float("inf"):
                within[on] = (bounds.low, bounds.high)
    for ends in itertools.product(*within.values()):
        at = dict(zip(within, ends, strict=True))
        yield {
            name: {
                on: Gain(at.get(on, gain.value), gain.origin) for on, gain in gains[name].items()
            }
        }


def _smaller(gains: Gains, name: str, pairs: Sequence[str]) -> str:
    """What would make a block definite."""
    if len(pairs) > 1:
        return "make its entries off the diagonal smaller, or those on it larger"
    [pair] = pairs
    first, second = (gains[name][axis].value for axis in PAIRS[pair])
    if min(first, second) <= 0:
        return "an axis without a gain of its own cannot be coupled"
    most = (first * second) ** 0.5
    dimension = entry_dimension(gain_named(name).dimension, pair)
    a, b = PAIRS[pair]
    return f"{pair!r} has to be smaller than sqrt({a} {b}) = {scaled(most, dimension)} in size"


def _along(direction: dict[Axis, float]) -> str:
    """A direction in words, such as `0.71 x - 0.71 z`."""
    text = ""
    for axis, part in direction.items():
        sign = "-" if part < 0 else "+" if text else ""
        text += f" {sign} " if text else sign
        text += f"{number(abs(part), 2)} {axis}"
    return text


def _place(stage: StagePlan, name: str, on: str) -> KeyPath:
    return gain_path(stage.context, stage.name, name, on)
