"""The table of signals, and how an entry is added to it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from enum import StrEnum
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import PAIRS, TRANSLATIONS, Axis, as_axis
from taskspec.text.units import NUMBER, Dimension


class Index(StrEnum):
    """What the members of an entry differ by: an axis, a joint, an object of the world, a stage.

    Those of a gain differ by the entry of its matrix, those of an estimate by the axis; energies,
    and those of a tank and a payload, have their whole names. A single signal has one member, and
    so have a clock and a figure of the link to a plant elsewhere.
    """

    SINGLE = "single"
    AXIS = "axis"
    JOINT = "joint"
    OBJECT = "object"
    STAGE = "stage"
    CLOCK = "clock"
    LINK = "link"
    GAIN = "gain"
    ENERGY = "energy"
    GRIP = "grip"
    TANK = "tank"
    PAYLOAD = "payload"
    ESTIMATE = "estimate"


#: What may differ from the truth: the wrench, which is zero while nothing is touched; objects.
WRENCH, WORLD = "wrench", "world"
#: What the log has beside a signal.
REFERENCE, MEASURED = "ref", "measured"

Formula = Callable[..., Any]


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """One signal, or a family of them that differ by axis, joint, object or stage.

    Attributes:
        name: of the signal; of a family the part that its members share.
        index: what its members differ by.
        dimensions: of the members, by axis or kind of the object; of others by "".
        meanings: of the members likewise, as the documentation has it.
        formula: the signal as an expression of a situation, given the member of a family of
            joints, objects or stages. A family of axes gives all of them at once: a vector, or a
            mapping of those that there are. None where it is not known.
        condition: whether it is true or false instead of a number.
        low: least value that its nature allows [SI].
        high: greatest value that its nature allows [SI].
        limit: the limit of the file that bounds its magnitude, if one does; of a family of axes
            that of its translations.
        framed: whether another frame shows it differently.
        anywhere: whether references and guards may use it in another frame.
        sensed: what the controller's value follows from that may differ from the truth, which is
            what the log has: the measured wrench, or where objects nominally are.
        beside: what the log has beside it: its reference, its measurement.
        group: the vector of six numbers that its axes are a part of.
        output: the controller's outputs that the log takes it from, where these have one for each
            member.
        counted: whether it takes whole numbers, which a value can meet exactly.
        reference: why no reference may use it, empty if one may.
        unmeasured: why neither references nor guards may use it, empty if they may.
        absent: why it may have no value in a stage.
        given: what in a file gives it, as it may be written; empty for what is always there.
        unit: of its values, where its dimension has another one as well.
    """

    name: str
    index: Index
    dimensions: Mapping[str, Dimension]
    meanings: Mapping[str, str]
    formula: Formula
    condition: bool = False
    low: float = -math.inf
    high: float = math.inf
    limit: str = ""
    framed: bool = False
    anywhere: bool = False
    sensed: str = ""
    beside: tuple[str, ...] = ()
    group: str = ""
    output: str = ""
    counted: bool = False
    reference: str = ""
    unmeasured: str = ""
    absent: str = ""
    given: str = ""
    unit: str = ""

    @property
    def dimension(self) -> Dimension:
        """Dimension of its first member."""
        return next(iter(self.dimensions.values()))

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes of a family of axes."""
        return tuple(map(Axis, self.dimensions)) if self.index is Index.AXIS else ()

    @property
    def bare(self) -> tuple[Axis, ...]:
        """The axes that its name alone means: translations, as far as it has any."""
        return tuple(a for a in self.axes if a in TRANSLATIONS) or self.axes

    @property
    def port(self) -> bool:
        """Whether the log takes it from the controller's outputs."""
        return self.index in (Index.SINGLE, Index.AXIS) and not self.sensed


@dataclass(frozen=True, slots=True)
class Entry:
    """A member of the table: the signal, and which axis, joint, object or stage it is about.

    Attributes:
        signal: the entry of the table.
        member: axis, number of the joint, name of the object or stage; empty for a single signal.
        dimension: of the member.
        beside: what the log has beside the signal is meant: `ref` for its reference.
    """

    signal: Signal
    member: str
    dimension: Dimension
    beside: str = ""


#: By name: families of axes, single signals in the order of the log, and clocks.
VECTORS: dict[str, Signal] = {}
SCALARS: dict[str, Signal] = {}
CLOCKS: dict[str, Signal] = {}
#: Of a joint, of a stage and of the link, by the last part of the name.
JOINT: dict[str, Signal] = {}
STAGE: dict[str, Signal] = {}
LINK: dict[str, Signal] = {}
#: Gains of a law that may vary, by their name.
GAIN: dict[str, Signal] = {}
#: Energies and powers of a law, by their whole name.
ENERGY: dict[str, Signal] = {}
#: Of the gripper, by the last part of the name.
GRIP: dict[str, Signal] = {}
#: Of the energy tank of a law, by their whole name.
TANK: dict[str, Signal] = {}
#: Of a payload that laws adapt to, by their whole name, in the order of the log.
PAYLOAD: dict[str, Signal] = {}
#: What laws estimate along axes, by name.
ESTIMATE: dict[str, Signal] = {}
#: Of an object, by its kind and what follows the object's name.
OBJECT: dict[str, dict[str, Signal]] = {}

_TABLES = {
    Index.SINGLE: SCALARS,
    Index.AXIS: VECTORS,
    Index.JOINT: JOINT,
    Index.STAGE: STAGE,
    Index.CLOCK: CLOCKS,
    Index.LINK: LINK,
    Index.GAIN: GAIN,
    Index.ENERGY: ENERGY,
    Index.GRIP: GRIP,
    Index.TANK: TANK,
    Index.PAYLOAD: PAYLOAD,
    Index.ESTIMATE: ESTIMATE,
}


def signal(
    name: str,
    dimension: Dimension | None = None,
    *,
    of: Index | Mapping[str, Dimension] = Index.SINGLE,
    meanings: Mapping[str, str] | None = None,
    **facts: Any,
) -> Callable[[Formula], Formula]:
    """Enters a signal into the table; decorates its formula, whose docstring is its meaning.

    Args:
        name: of the signal.
        dimension: of it, where all members have the same.
        of: what its members differ by; where they are axes or objects of several kinds, their
            dimensions by axis, entry or kind.
        meanings: by axis or kind, where one docstring does not do.
        facts: the other attributes of `Signal`.
    """

    def enter(formula: Formula) -> Formula:
        if isinstance(of, Index):
            index, dimensions = of, {"": dimension or NUMBER}
        else:
            index = Index.AXIS if all(map(as_axis, of)) else Index.OBJECT
            index = Index.GAIN if {*of} & {*PAIRS} else index
            dimensions = dict(of)
        text = " ".join((formula.__doc__ or "").split()).removesuffix(".")
        text = text[:1].lower() + text[1:]
        entered = Signal(
            name, index, dimensions, meanings or dict.fromkeys(dimensions, text), formula,
            **{"group": name, **facts} if index is Index.AXIS else facts,
        )  # fmt: skip
        if index is Index.OBJECT:
            for kind in dimensions:
                OBJECT.setdefault(kind, {})[name] = entered
        else:
            _TABLES[index][name] = entered
        return formula

    return enter


def condition(name: str, **facts: Any) -> Callable[[Formula], Formula]:
    """Enters a signal that is true or false, 1 or 0; else as `signal`."""
    return signal(name, NUMBER, condition=True, low=0.0, high=1.0, **facts)


def words() -> tuple[str, ...]:
    """The names of all signals that are about nothing else, those of families of axes first."""
    numbers = sorted(SCALARS, key=lambda name: SCALARS[name].condition)
    return (*VECTORS, *numbers)


_BY_WHOLE_NAME = (ENERGY, TANK, PAYLOAD)
_BY_LAST_NAME: dict[str, dict[str, Signal]] = {Index.LINK: LINK, Index.GRIP: GRIP}


def find(
    path: tuple[str, ...], objects: Mapping[str, str], stages: Iterable[str] = ()
) -> Entry | None:
    """The member of the table that a dotted name means, None where it means none.

    Args:
        path: the parts of the name.
        objects: kind by name.
        stages: names.
    """
    if len(path) > 1 and path[-1] == REFERENCE:
        of = find(path[:-1], objects, stages)
        known = of is not None and REFERENCE in of.signal.beside
        return replace(of, beside=REFERENCE) if of is not None and known else None
    match path:
        case (name,):
            single = SCALARS.get(name) or CLOCKS.get(name)
            return Entry(single, "", single.dimension) if single else None
        case (stage, name) if stage in stages and name in STAGE:
            return Entry(STAGE[name], stage, STAGE[name].dimension)
        case (name, axis) if name in VECTORS and axis in VECTORS[name].dimensions:
            return Entry(VECTORS[name], axis, VECTORS[name].dimensions[axis])
        case ("joint", number, name) if number.isdigit() and name in JOINT:
            if int(number) < 1 or number.startswith("0"):
                return None
            return Entry(JOINT[name], number, JOINT[name].dimension)
        case (owner, *parts) if owner in objects and parts:
            kind = objects[owner]
            found = OBJECT[kind].get(".".join(parts))
            return Entry(found, owner, found.dimensions[kind]) if found else None
        case (Index.GAIN, *words, on) if (name := ".".join(words)) in GAIN:
            gain = GAIN[name]
            return Entry(gain, on, gain.dimensions[on]) if on in gain.dimensions else None
        case (Index.ESTIMATE, name, axis) if name in ESTIMATE and as_axis(axis) in TRANSLATIONS:
            return Entry(ESTIMATE[name], axis, ESTIMATE[name].dimension)
        case (head, last):
            by_last = _BY_LAST_NAME.get(head, {})
            named = [by_last.get(last), *(by.get(f"{head}.{last}") for by in _BY_WHOLE_NAME)]
            return next((Entry(each, "", each.dimension) for each in named if each), None)
        case _:
            return None
