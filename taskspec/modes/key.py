"""What a key of an axis is in a file: data, from which the language makes a field."""

from __future__ import annotations

from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.expression import ScopeKind
from taskspec.text.units import NUMBER, Dimension


@dataclass(frozen=True, slots=True)
class ModeKey:
    """A key of a file that belongs to a mode of axes.

    It is a constant, unless `scope`, `words`, `mechanism` or `switch` say otherwise.

    Attributes:
        name: the key, and the mode's argument of that name [SI units].
        title: for editors.
        dimension: what it measures along an axis; about one, moments and angles for forces and
            lengths.
        about: its title on rotations, where that differs.
        scope: of an expression.
        ramped: whether the ends and the time of a linear ramp may stand for the expression.
        words: of which it is one.
        mechanism: whether the name of a mechanism may stand in the place of an expression.
        switch: whether it is true or false.
        above: a constant has to be greater than this.
        least: a constant has to be at least this.
        only: `along` or `about`, for a key of translations or of rotations alone.
        companion: why it has no meaning without another key of its mode; empty for a mode's own.
        meaning: what it means, in a sentence that an editor shows.
        description: its form, for editors.
        examples: values that editors show.
    """

    name: str
    title: str
    dimension: Dimension = NUMBER
    about: str = ""
    scope: ScopeKind | None = None
    ramped: bool = False
    words: tuple[str, ...] = ()
    mechanism: bool = False
    switch: bool = False
    above: float | None = None
    least: float | None = None
    only: str = ""
    companion: str = ""
    meaning: str = ""
    description: str = ""
    examples: tuple[Any, ...] = ()

    def exists(self, *, rotation: bool) -> bool:
        """Whether a kind of axis has it."""
        return self.only in ("", "about" if rotation else "along")


@dataclass(frozen=True, slots=True)
class Misuse:
    """Why what stands at a key has no meaning there.

    Attributes:
        key: whose value it is.
        message: why.
        hint: what to write.
    """

    key: str
    message: str
    hint: str
