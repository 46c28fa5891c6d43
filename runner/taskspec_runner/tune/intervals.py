"""What varies, with other ends: as narrow as gains can bear, or a margin wider."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from taskspec.deferred_methods import dataclass
from taskspec.program.components import Component
from taskspec.program.context import Context
from taskspec.program.worlds import component_name, draws_of
from taskspec.spec import LoadedTask, Variation
from taskspec.spec.vary import Draw
from taskspec.text.units import Dimension, scaled

Ends = tuple[float, float]

#: Stability is wanted of contacts that are so much stiffer, and softer, than any that varies: the
#: gain of a force loop is in proportion to its contact's stiffness.
STIFFNESS_MARGIN = 1.25


@dataclass(frozen=True, slots=True)
class VariedNumber:
    """A random number of `vary`, as a file has it.

    Attributes:
        name: of the component that it is, such as `world.table.xyz.z`, or its own.
        draw: the number.
        anchor: of its values the one that the file's own world has, or the nearest.
        offset, unit: its value [SI] is offset + unit times the number.
        dimension: of the value; None of a number with a name.
    """

    name: str
    draw: Draw
    anchor: float
    offset: float = 0.0
    unit: float = 1.0
    dimension: Dimension | None = None

    def text(self, ends: Ends) -> str:
        """Ends of the number, such as `8 N/mm..90 N/mm`."""
        return f"{self.value(ends[0])}..{self.value(ends[1])}"

    def value(self, drawn: float) -> str:
        """A value of it with its unit."""
        value = self.offset + self.unit * drawn
        return f"{value:.4g}" if self.dimension is None else scaled(value, self.dimension, 3)


def intervals(context: Context) -> list[VariedNumber]:
    """The random numbers of a task, in the order of its file."""
    found = []
    for draw, own in draws_of(context).items():
        if own is None:
            middle = (draw.low + draw.high) / 2
            found.append(VariedNumber(draw.name, draw, middle))
            continue
        (path, index), variation = own
        found.append(_interval(context, (path, index), variation, draw))
    return found


def _interval(context: Context, part: Component, variation: Variation, draw: Draw) -> VariedNumber:
    from taskspec.program.components import nominal

    path, index = part
    middle = nominal(context, path, index)
    zero, one = (variation.value(middle, {draw.name: drawn}) for drawn in (0.0, 1.0))
    anchor = min(max(variation.drawn(middle, middle), draw.low), draw.high)
    dimension = context.loaded.task.target_of(path).dimensions[index or 0]
    name = path if index is None else f"{path}.{component_name(path, index)}"
    return VariedNumber(name, draw, anchor, zero, one - zero, dimension)


def narrowed(loaded: LoadedTask, ends: Mapping[str, Ends]) -> LoadedTask:
    """A task whose random numbers have other ends, by name; between them all are as likely."""
    if not ends:
        return loaded
    vary = {
        path: tuple(None if each is None else _within(each, ends) for each in entry)
        for path, entry in loaded.task.vary.items()
    }
    return replace(loaded, task=loaded.task.model_copy(update={"vary": vary}))


def _within(variation: Variation, ends: Mapping[str, Ends]) -> Variation:
    draws = tuple(
        Draw(draw.name, *ends[draw.name]) if draw.name in ends else draw for draw in variation.draws
    )
    if draws == variation.draws:
        return variation
    if variation.formula is not None:
        return replace(variation, draws=draws)
    return replace(variation, low=draws[0].low, high=draws[0].high, draws=draws)


def with_margin(loaded: LoadedTask, context: Context) -> LoadedTask:
    """A task in which the stiffness of each contact varies by `STIFFNESS_MARGIN` more."""
    vary = dict(loaded.task.vary)
    for name, contact in context.compliances.items():
        path = f"world.{name}.stiffness"
        if contact.exact or contact.stiffness <= 0:
            continue
        own = vary.get(path, (None,))[0]
        low, high = own.ends(contact.stiffness) if own is not None else (contact.stiffness,) * 2
        low, high = low / STIFFNESS_MARGIN, high * STIFFNESS_MARGIN
        if low > 0 and (own is None or own.formula is None):
            draw = Draw(path, low, high)
            vary[path] = (Variation(low, high, relative=False, draws=(draw,)),)
    return replace(loaded, task=loaded.task.model_copy(update={"vary": vary}))
