"""What a model's fields know while they are read: names, params, and where to report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

from taskspec.deferred_methods import dataclass
from taskspec.expression import Problem, Scope, ScopeKind
from taskspec.text import nodes
from taskspec.text.codes import register
from taskspec.text.data import Items, Map, Real, Text, TruthValue, Whole
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.source import Span
from taskspec.text.units import Quantity

register({"TS090": "part of the language, but not supported yet"})


@dataclass(slots=True)
class ParseContext:
    """The context of one pass over a file.

    Attributes:
        diagnostics: where findings go.
        data: the whole file.
        params: the params that could be evaluated.
        broken: params that could not; using them is no further mistake.
        stages: names of all stages, in order.
        objects: names of all objects of the world, with their kind (`signals.OBJECT`).
        held: what a robot may hold: handles and loose bodies.
        loose: loose bodies.
        targets: where a stage may lead: stages, `end` and `fail`.
        frames: every name that is a frame.
        quiet: ids of mappings in which missing keys are no further mistake.
        keys: id of a mapping to the place of the key that it hangs on.
        truth: what is read is the true world, not the nominal one of the controller.
        level_of: where a key belongs that a model does not have (`levels.level_of`).
    """

    diagnostics: Diagnostics
    data: Map
    params: dict[str, Quantity] = field(default_factory=dict)
    broken: set[str] = field(default_factory=set)
    stages: dict[str, None] = field(default_factory=dict)
    objects: dict[str, str] = field(default_factory=dict)
    held: dict[str, None] = field(default_factory=dict)
    loose: dict[str, None] = field(default_factory=dict)
    targets: dict[str, None] = field(default_factory=dict)
    frames: dict[str, None] = field(default_factory=dict)
    quiet: set[int] = field(default_factory=set)
    keys: dict[int, Span] = field(default_factory=dict)
    truth: bool = False
    level_of: Callable[[str, type], str] = lambda _key, _model: ""
    _scopes: dict[ScopeKind, Scope] = field(default_factory=dict)

    def scope(self, kind: ScopeKind) -> Scope:
        """The names that an expression of this kind may use."""
        if kind not in self._scopes:
            self._scopes[kind] = Scope(
                kind,
                self.params,
                self.stages.keys(),
                self.objects,
                self.frames.keys(),
                self.broken,
            )
        return self._scopes[kind]

    @property
    def still_params(self) -> tuple[str, ...]:
        """Names of params that keep their values while a stage runs."""
        return tuple(name for name, param in self.params.items() if not param.live)

    def of_kind(self, *kinds: str) -> dict[str, None]:
        """The names of the objects of some kinds."""
        return {name: None for name, kind in self.objects.items() if kind in kinds}

    def key_of(self, data: Map) -> Span:
        """The place of the key that a mapping hangs on, or of its first character."""
        return self.keys.get(id(data.node)) or nodes.pointer(data.node)

    def error(self, code: str, message: str, span: Span | None, hint: str = "") -> None:
        """Reports an error."""
        self.diagnostics.error(code, message, span, hint)

    def unsupported(self, word: str, span: Span | None) -> None:
        """Reports a word of the language that this version does not read yet."""
        self.error("TS090", f"'{word}' is part of the language but not supported yet", span)

    def problems(self, value: object, problems: tuple[Problem, ...]) -> None:
        """Reports what is wrong inside a scalar."""
        assert isinstance(value, Text | Whole | Real)
        origin = value.node.origin
        for problem in problems:
            hint = problem.hint
            if value.node.comment and problem.code == "TS101" and not hint:
                hint = "text after ' #' is a comment"
            report = self.diagnostics.warning if problem.warning else self.diagnostics.error
            report(problem.code, problem.message, origin.at(problem.start, problem.end), hint)


def span_of(value: object) -> Span | None:
    """The place to point at for a value."""
    if isinstance(value, Text | Whole | Real | TruthValue | Items | Map):
        return nodes.pointer(value.node)
    return None


def kind_of(value: object) -> str:
    """What a value is, in words."""
    if isinstance(value, Map):
        return "a mapping"
    if isinstance(value, Items):
        return "a list"
    if isinstance(value, TruthValue):
        return "true or false"
    if isinstance(value, Whole | Real):
        return "a number"
    return "a text"
