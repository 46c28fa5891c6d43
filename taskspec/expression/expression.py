"""An expression of a task file: its text, its checked tree, its place."""

from __future__ import annotations

from dataclasses import field

from taskspec.deferred_methods import dataclass
from taskspec.expression.tree import Name, Node, walk
from taskspec.text.origin import Origin
from taskspec.text.source import Span
from taskspec.text.units import Dimension


@dataclass(frozen=True, slots=True)
class Expression:
    """A parsed and checked expression.

    Attributes:
        text: as written.
        tree: with every number in SI units and `norm(force)` written out.
        dimension: of its value; plain for a condition.
        span: the whole scalar in the file; None for an expression that stands in no file.
    """

    text: str
    tree: Node
    dimension: Dimension
    origin: Origin | None = field(default=None, compare=False, repr=False)

    @property
    def span(self) -> Span | None:
        """The place of the whole expression."""
        return self.origin.span if self.origin else None

    def uses(self, name: str) -> bool:
        """Whether a name stands in it."""
        return any(isinstance(node, Name) and str(node) == name for node in walk(self.tree))

    def where(self, node: Node) -> Span | None:
        """The place of a part of the tree."""
        return self.origin.at(node.start, node.end) if self.origin else None

    def __str__(self) -> str:
        return " ".join(self.text.split())
