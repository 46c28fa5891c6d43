"""The graph of stages: what can be reached, and what can go on for ever."""

from __future__ import annotations

import re
from collections.abc import Iterator

from taskspec.deferred_methods import dataclass
from taskspec.expression import ScopeKind
from taskspec.spec import values
from taskspec.spec.model import mapping
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.words import ENDS
from taskspec.text import nodes
from taskspec.text.codes import register
from taskspec.text.data import Items, Map, Text
from taskspec.text.source import Span

register(
    {
        "TS604": "a cycle of stages without `attempts`",
        "TS605": "a stage that is never reached",
    }
)

#: A condition that a number of visits bounds: it, or a part of an `and`.
_BOUND = re.compile(r"\(?\s*([A-Za-z]\w*)\.visits\s*<=?(?!\s*[-=])[^<>]*\Z")
_AND = re.compile(r"\band\b")


@dataclass(frozen=True, slots=True)
class Edge:
    """A transition from a stage to another.

    Attributes:
        to: the stage.
        span: what says so.
        bound: a stage whose visits bound how often it is taken; empty for none.
    """

    to: str
    span: Span
    bound: str = ""


Edges = dict[str, list[Edge]]


def check_flow(stages: Map, context: ParseContext) -> None:
    """Reports cycles without `attempts`, and stages that nothing leads to."""
    edges = _edges(stages, context)
    if edges is None:
        return
    _check_reached(stages, edges, context)
    _check_cycles(stages, edges, context)


def _edges(stages: Map, context: ParseContext) -> Edges | None:
    """Where each stage may lead and what says so; None if that cannot be known."""
    names = list(stages)
    edges: Edges = {}
    for index, (name, value) in enumerate(stages.items()):
        stage = mapping(value)
        after = names[index + 1] if index + 1 < len(names) else "end"
        own = stages.node.key_span(name)
        edges[name] = []
        limits = [mapping(owner.get("limits")) for owner in (context.data, stage)]
        good = _good(stage, after, own, context)
        for target, span, bound in (*good, *_failing(stage, own), *_reacting(name, *limits)):
            if target in ENDS:
                continue
            if isinstance(target, str) and target in stages:
                edges[name].append(Edge(str(target), span, bound))
            else:
                return None
    return edges


Target = tuple[object, Span, str]


def _good(stage: Map, after: str, own: Span, context: ParseContext) -> Iterator[Target]:
    """Where a stage leads that ends well: a target, what says so, and what bounds it.

    A branch that does not read has no target.
    """
    given = stage.get("next")
    if not isinstance(given, Items):
        yield (given, nodes.pointer(stage.node.entries["next"][1]), "") if given else (
            after, own, "")  # fmt: skip
        return
    for entry in given:
        if isinstance(entry, Text):
            yield entry, nodes.pointer(entry.node), ""
            continue
        branch = mapping(entry)
        if branch and not _reads(branch, context):
            yield None, own, ""
            return
        when = branch.get("when")
        bound = ""
        for part in _AND.split(when) if isinstance(when, Text) and " or " not in when else ():
            found = _BOUND.match(part.strip())
            bound = found.group(1) if found else bound
        to = branch.node.get("to") if isinstance(entry, Map) else None
        yield branch.get("to"), own if to is None else nodes.pointer(to), bound


def _reads(branch: Map, context: ParseContext) -> bool:
    """Whether a branch can be read as a whole.

    An unknown key may be its condition, and a condition with a mistake in it may bound a cycle.
    """
    if branch.node.broken or not branch.keys() <= {"when", "to"}:
        return False
    when = branch.get("when")
    return when is None or values.expression(when, None, ScopeKind.GUARD, context) is not None


def _failing(stage: Map, own: Span) -> Iterator[Target]:
    target = stage.get("on_fail", "fail")
    yield target, nodes.pointer(stage.node.entries["on_fail"][1]) if "on_fail" in stage else own, ""


def _reacting(name: str, common: Map, own: Map) -> Iterator[Target]:
    """Where limits lead; in the stage to which one leads it stops the run."""
    for key in common | own:
        limits = own if key in own else common
        given = mapping(limits[key])
        if "then" in given and given["then"] != name:
            yield given["then"], nodes.pointer(given.node.entries["then"][1]), ""


def _check_reached(stages: Map, edges: Edges, context: ParseContext) -> None:
    waiting = [next(iter(stages))] if stages else []
    reached = set(waiting)
    while waiting:
        new = _targets(edges, waiting.pop()) - reached
        reached |= new
        waiting += new
    for name in stages:
        if name not in reached and name not in ENDS:
            context.diagnostics.warning(
                "TS605",
                f"the stage '{name}' is never reached",
                stages.node.key_span(name),
                "lead to it with 'next' or 'on_fail', or delete it",
            )


def _targets(edges: Edges, name: str) -> set[str]:
    return {edge.to for edge in edges[name]}


def _is_bounded(name: str, edge: Edge, edges: Edges) -> bool:
    """Whether every cycle over a transition goes through the stage whose visits bound it."""
    if edge.bound not in edges:
        return False
    reached, waiting = {edge.bound, edge.to}, [edge.to]
    if edge.bound in (name, edge.to):
        return True
    while waiting:
        new = _targets(edges, waiting.pop()) - reached
        reached |= new
        waiting += new
    return name not in reached


def _check_cycles(stages: Map, edges: Edges, context: ParseContext) -> None:
    """Reports circles of stages without `attempts`, each at the edge that closes it.

    The walk keeps its own stack: there may be thousands of stages.
    """
    free = {name for name in stages if "attempts" not in mapping(stages[name])}
    edges = {
        name: [edge for edge in found if not (edge.bound and _is_bounded(name, edge, edges))]
        for name, found in edges.items()
    }
    done: set[str] = set()
    for root in stages:
        if root not in free or root in done:
            continue
        trail = {root: iter(edges[root])}
        while trail:
            name = next(reversed(trail))
            edge = next(trail[name], None)
            if edge is None:
                del trail[name]
                done.add(name)
            elif edge.to in trail:
                _report_circle(list(trail), edge, context)
            elif edge.to in free and edge.to not in done:
                trail[edge.to] = iter(edges[edge.to])


def _report_circle(trail: list[str], edge: Edge, context: ParseContext) -> None:
    target = edge.to
    circle = [*trail[trail.index(target) :], target]
    hint = f"add 'attempts: 3' to one of them, such as '{target}'"
    if edge.bound:
        hint += f"; the visits of '{edge.bound}', which the circle leaves out, do not bound it"
    message = f"stages in a circle without 'attempts': {' -> '.join(circle)}"
    context.error("TS604", message, edge.span, hint)
