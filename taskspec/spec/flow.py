"""The graph of stages: what can be reached, and what can go on for ever."""

from __future__ import annotations

from taskspec.spec.model import mapping
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.words import ENDS
from taskspec.text.codes import register
from taskspec.text.data import Map
from taskspec.text.source import Span

register(
    {
        "TS604": "a cycle of stages without `attempts`",
        "TS605": "a stage that is never reached",
    }
)

Edges = dict[str, list[tuple[str, Span]]]


def check_flow(stages: Map, context: ParseContext) -> None:
    """Reports cycles without `attempts`, and stages that nothing leads to."""
    edges = _edges(stages)
    if edges is None:
        return
    _check_reached(stages, edges, context)
    _check_cycles(stages, edges, context)


def _edges(stages: Map) -> Edges | None:
    """Where each stage may lead and what says so; None if that cannot be known."""
    names = list(stages)
    edges: Edges = {}
    for index, (name, value) in enumerate(stages.items()):
        stage = mapping(value)
        after = names[index + 1] if index + 1 < len(names) else "end"
        edges[name] = []
        for key, default in (("next", after), ("on_fail", "fail")):
            target = stage.get(key, default)
            if target in ENDS:
                continue
            if isinstance(target, str) and target in stages:
                span = (stage.node.entries[key][1].span if key in stage
                        else stages.node.key_span(name))  # fmt: skip
                edges[name].append((str(target), span))
            else:
                return None
    return edges


def _check_reached(stages: Map, edges: Edges, context: ParseContext) -> None:
    waiting = [next(iter(stages))] if stages else []
    reached = set(waiting)
    while waiting:
        for target, _ in edges[waiting.pop()]:
            if target not in reached:
                reached.add(target)
                waiting.append(target)
    for name in stages:
        if name not in reached and name not in ENDS:
            context.diagnostics.warning(
                "TS605",
                f"the stage '{name}' is never reached",
                stages.node.key_span(name),
                "lead to it with 'next' or 'on_fail', or delete it",
            )


def _check_cycles(stages: Map, edges: Edges, context: ParseContext) -> None:
    """Reports circles of stages without `attempts`, each at the edge that closes it.

    The walk keeps its own stack: there may be thousands of stages.
    """
    free = {name for name in stages if "attempts" not in mapping(stages[name])}
    done: set[str] = set()
    for root in stages:
        if root not in free or root in done:
            continue
        trail = {root: iter(edges[root])}
        while trail:
            name = next(reversed(trail))
            target, span = next(trail[name], (None, None))
            if target is None:
                del trail[name]
                done.add(name)
            elif target in trail:
                _report_circle(list(trail), target, span, context)
            elif target in free and target not in done:
                trail[target] = iter(edges[target])


def _report_circle(trail: list[str], target: str, span: Span | None, context: ParseContext) -> None:
    circle = [*trail[trail.index(target) :], target]
    context.error(
        "TS604",
        f"stages in a circle without 'attempts': {' -> '.join(circle)}",
        span,
        f"add 'attempts: 3' to one of them, such as '{target}'",
    )
