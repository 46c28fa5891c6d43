"""Worlds that a run may have: the true one, random ones of `vary` about it, and its corners."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import field, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec.program.components import (
    Component,
    bounded,
    components,
    nominal,
    otherwise,
    true_task_with,
    value_of,
)
from taskspec.program.context import Context
from taskspec.spec import LoadedTask, Task, Variation
from taskspec.spec.truth import DeclaredTruth
from taskspec.spec.vary import CUT, Draw
from taskspec.text.units import Dimension, scaled, show

_NORMAL = NormalDist()
#: Corners of more random numbers than this are not all of them: one varies at a time.
MOST_CORNERS = 12
#: Bits of a random number in (0, 1).
_BITS = 53


@dataclass(frozen=True, slots=True)
class World:
    """What the plant of a run is.

    Attributes:
        task: whose world and robot are the true ones.
        draws: the random numbers that it follows from, by name.
        values: of the components of `vary` [SI].
        seed: of everything random.
        number: of a random world under the seed; None of any other.
        label: what to call it; empty for the true one.
    """

    task: Task
    draws: Mapping[str, float] = field(default_factory=dict)
    values: Mapping[Component, float] = field(default_factory=dict)
    seed: int = 0
    number: int | None = None
    label: str = ""

    @property
    def noise_seed(self) -> int:
        """Of the sensor's noise: every random world has its own."""
        return self.seed if self.number is None else _noise_seed(self.seed, self.number)

    def as_data(self) -> dict[str, Any]:
        """What it is made of again, by `world_from`."""
        return {"label": self.label, "number": self.number, "draws": dict(self.draws)}


def true_world(context: Context, seed: int = 0) -> World:
    """The world as `truth` has it, nothing of `vary` changed."""
    return World(context.loaded.true_task, seed=seed)


def world_of(
    context: Context,
    draws: Mapping[str, float],
    seed: int = 0,
    number: int | None = None,
    label: str = "",
) -> World:
    """The world of some random numbers; what follows from none of them is as `truth` has it."""
    values = {}
    for part, variation in components(context):
        if all(draw.name in draws for draw in variation.draws):
            target = context.loaded.task.target_of(part[0])
            value = variation.value(nominal(context, *part), draws)
            values[part] = bounded(target, value)
    return World(true_task_with(context, values), dict(draws), values, seed, number, label)


def world_from(context: Context, data: Mapping[str, Any], seed: int) -> World:
    """The world that `World.as_data` describes.

    Raises:
        KeyError, TypeError, ValueError: it describes none.
    """
    draws = {str(name): float(value) for name, value in data["draws"].items()}
    number = None if data["number"] is None else int(data["number"])
    if not draws and number is None:
        return true_world(context, seed)
    return world_of(context, draws, seed, number, str(data["label"]))


def random_world(context: Context, seed: int, number: int) -> World:
    """World `number` (from 0) under a seed: the same wherever and however many are drawn.

    Every random number has a stream of its own, whose key is made of the seed and of its name, and
    of which the world's number is the counter: an entry that is added to `vary` leaves the draws of
    all others as they are.
    """
    found = {}
    for draw, share in draws_of(context).items():
        low, high = (_probability(end, draw) for end in _ends(context, draw, share))
        u = low + _uniform(f"{seed} {draw.name}", number) * (high - low)
        found[draw.name] = _quantile(u, draw)
    return world_of(context, found, seed, number, f"world {number}")


def as_file(loaded: LoadedTask, world: World) -> LoadedTask:
    """A task whose file says that a world is the true one, and that nothing varies.

    Faults are left out: they are no part of a world.
    """
    paths = dict.fromkeys((*loaded.task.truth.paths, *(path for path, _ in world.values)))
    truth = {"truth": DeclaredTruth(tuple(paths)), "vary": {}}
    return replace(
        loaded,
        task=loaded.task.model_copy(update=truth),
        true_task=world.task.model_copy(update={"vary": {}}),
    )


def corner_count(context: Context) -> int:
    """How many corners there are: worlds in which every random number is at an end.

    Of many numbers, one at a time is.
    """
    count = len(draws_of(context))
    return 2**count if count <= MOST_CORNERS else 2 * count


def corner_world(context: Context, index: int, seed: int = 0) -> World:
    """One of the corners, by its number from 0."""
    ends = {draw.name: (draw.low, draw.high) for draw in draws_of(context)}
    names, count = list(ends), len(ends)
    if count <= MOST_CORNERS:
        digits = _digits(index, 2, count)
        draws = {name: ends[name][digit] for name, digit in zip(names, digits, strict=True)}
    else:
        name = names[index // 2]
        draws = {name: ends[name][index % 2]}
    return world_of(context, draws, seed, None, f"corner {index}")


def grid_count(context: Context, points: int) -> int:
    """How many worlds a grid of so many values of every random number has."""
    return int(points ** len(draws_of(context)))


def grid_world(context: Context, points: int, index: int, seed: int = 0) -> World:
    """One world of the grid of `points` values of every random number, from end to end."""
    found = list(draws_of(context))
    draws = {
        draw.name: float(np.linspace(draw.low, draw.high, points)[digit])
        for draw, digit in zip(found, _digits(index, points, len(found)), strict=True)
    }
    return world_of(context, draws, seed, None, f"grid point {index}")


def _digits(number: int, base: int, count: int) -> list[int]:
    """The digits of a number, the last one counts the ones."""
    found = []
    for _ in range(count):
        number, digit = divmod(number, base)
        found.append(digit)
    return found[::-1]


def draws_of(context: Context) -> dict[Draw, tuple[Component, Variation] | None]:
    """The random numbers of `vary`, in the order of the file, and the component of each.

    None is the component of a number that has a name.
    """
    found: dict[Draw, tuple[Component, Variation] | None] = {}
    for part, variation in components(context):
        for draw in variation.draws:
            found[draw] = (part, variation) if variation.formula is None else None
    return found


@dataclass(frozen=True, slots=True)
class Deviation:
    """A value of the world or the robot that differs from the nominal one.

    Attributes:
        name: path and component, such as `world.table.xyz.z`.
        nominal: that of the controller [SI]; None of what is no number.
        true: what is so [SI]; None of what is no number.
        written: both as text, with their unit.
    """

    name: str
    nominal: float | None
    true: float | None
    written: tuple[str, str]


def component_name(path: str, index: int) -> str:
    """What the component of a value is called: its axis, or its number from 1."""
    names = _COMPONENTS.get(path.rpartition(".")[2], ())
    return names[index] if index < len(names) else str(index + 1)


def component_dimension(task: Task, name: str) -> Dimension:
    """The dimension of a component, by the name that `deviations` gives it.

    Raises:
        KeyError: the task has no such value.
    """
    try:
        return task.target_of(name).dimensions[0]
    except KeyError:
        path, _, component = name.rpartition(".")
        dimensions = task.target_of(path).dimensions
        names = [component_name(path, i) for i in range(len(dimensions))]
        return dimensions[names.index(component)]


_COMPONENTS = {
    "xyz": ("x", "y", "z"),
    "handle": ("x", "y", "z"),
    "rpy": ("roll", "pitch", "yaw"),
    "bias": AXES,
}


def deviations(context: Context, world: World) -> tuple[Deviation, ...]:
    """Where a world differs from the nominal one."""
    parts = dict.fromkeys((*otherwise(context, lambda _: True), *world.values))
    declared = context.loaded.task
    found = []
    for path, index in parts:
        was, now = (value_of(context, task, path, index) for task in (declared, world.task))
        dimension = declared.target_of(path).dimensions[index or 0]
        name = path if index is None else f"{path}.{component_name(path, index)}"
        written = scaled(was, dimension, 5), scaled(now, dimension, 5)
        found.append(Deviation(name, was, now, written))
    return (*found, *_otherwise_in_words(declared, world.task))


def _otherwise_in_words(declared: Task, true: Task) -> Iterator[Deviation]:
    """What is otherwise and no number: motions, and the rate of the sensor."""
    for name, shape in true.shapes.items():
        moves, was = shape.motion, declared.shapes[name].motion
        axes = {} if moves is None else moves.axes
        before = {} if was is None else was.axes
        for axis in dict.fromkeys((*before, *axes)):
            both = tuple(str(each[axis]) if axis in each else "0" for each in (before, axes))
            if both[0] != both[1]:
                yield Deviation(f"world.{name}.motion.{axis}", None, None, (both[0], both[1]))
    rates = declared.robot.sensor.rate, true.robot.sensor.rate
    if rates[0] != rates[1]:
        was_rate, now_rate = (
            "the controller's" if rate is None else show(rate, "Hz") for rate in rates
        )
        yield Deviation("robot.sensor.rate", None, None, (was_rate, now_rate))


def _ends(
    context: Context, draw: Draw, own: tuple[Component, Variation] | None
) -> tuple[float, float]:
    """Between which a random number is drawn: none that no world can have, if it is normal."""
    if own is None or not draw.normal:
        return draw.low, draw.high
    part, variation = own
    middle, target = nominal(context, *part), context.loaded.task.target_of(part[0])
    low, high = (variation.drawn(bounded(target, v), middle) for v in variation.ends(middle))
    return low, high


def _probability(value: float, draw: Draw) -> float:
    """That a random number is below a value: of a normal one without its cut."""
    if draw.normal:
        return _NORMAL.cdf(CUT * value / draw.high) if draw.high else 0.5
    return (value - draw.low) / (draw.high - draw.low) if draw.high > draw.low else 0.0


def _quantile(u: float, draw: Draw) -> float:
    if not draw.normal:
        return draw.low + u * (draw.high - draw.low)
    return _NORMAL.inv_cdf(u) * draw.high / CUT if draw.high else 0.0


def _uniform(stream: str, counter: int) -> float:
    """A random number in (0, 1) of a stream, the same on every machine."""
    digest = hashlib.sha256(stream.encode()).digest()
    key = int.from_bytes(digest[:16], "little")
    raw = np.random.Philox(key=key, counter=counter << 64).random_raw()
    return ((int(raw) >> (64 - _BITS)) + 0.5) / (1 << _BITS)


def _noise_seed(seed: int, number: int) -> int:
    return int.from_bytes(hashlib.sha256(f"noise {seed} {number}".encode()).digest()[:8], "little")
