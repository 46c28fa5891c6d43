"""What a key of a path is in a file: data, from which the language makes a field."""

from __future__ import annotations

from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.text.units import NUMBER, Dimension


@dataclass(frozen=True, slots=True)
class PathKey:
    """A key of a file that belongs to one kind of path.

    It is a constant, unless `words`, `entries`, `listed`, `rows` or `text` say otherwise.

    Attributes:
        name: the key, and the path's argument of that name [SI units].
        title: for editors.
        meaning: what it means, in a sentence that an editor shows.
        dimension: what it measures.
        entries: of a list of constants, what each measures.
        fewest: how many of those there have to be; None for all.
        listed: a list of constants of any length.
        rows: at least this many lists of `entries`; 0 for one.
        words: of which it is one.
        choice: what the words are, in the singular.
        text: any text.
        above: a constant has to be greater than this.
        least: a constant has to be at least this.
        default: where it is left out; without one it is needed.
        optional: whether it may be left out.
        description: its form, for editors.
        examples: values that editors show.
    """

    name: str
    title: str
    meaning: str
    dimension: Dimension = NUMBER
    entries: tuple[Dimension, ...] = ()
    fewest: int | None = None
    listed: bool = False
    rows: int = 0
    words: tuple[str, ...] = ()
    choice: str = ""
    text: bool = False
    above: float | None = None
    least: float | None = None
    default: Any = None
    optional: bool = False
    description: str = ""
    examples: tuple[Any, ...] = ()


@dataclass(frozen=True, slots=True)
class WrongPath:
    """What is wrong with the keys of a path, although each value for itself is right.

    Attributes:
        code: of the diagnostic.
        key: whose value it is.
        message: what is wrong.
        hint: what to write.
        row: of its list, from 0; None for the whole value.
    """

    code: str
    key: str
    message: str
    hint: str = ""
    row: int | None = None
