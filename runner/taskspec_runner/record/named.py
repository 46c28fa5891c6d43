"""What names of expressions mean in a log."""

from __future__ import annotations

from taskspec.expression import Meaning, Scope, ScopeKind
from taskspec.spec import Task


def scope_of(task: Task, kind: ScopeKind = ScopeKind.EXPECT) -> Scope:
    """The names that the expectations of a task may use, or expressions of another kind."""
    return Scope(
        kind,
        task.params,
        frozenset(task.stages),
        {name: thing.kind for name, thing in task.world.items()},
        frozenset(
            ("world", "tool", *task.world, *task.frames, *(f"{m}.handle" for m in task.mechanisms))
        ),
    )


def column_of(meaning: Meaning) -> str:
    """The log's name of a signal, or of what it has beside it."""
    name = _signal_of(meaning)
    return f"{name}.{meaning.beside}" if meaning.beside else name


def _signal_of(meaning: Meaning) -> str:
    if meaning.kind == "joint":
        return f"joint.{meaning.subject}.{meaning.name}"
    if meaning.kind == "object":
        return f"{meaning.subject}.{meaning.name}"
    if meaning.kind in ("gain", "estimate"):
        return f"{meaning.kind}.{meaning.name}.{meaning.subject}"
    if meaning.kind in ("link", "grip"):
        return f"{meaning.kind}.{meaning.name}"
    # An energy has its whole name.
    return f"{meaning.name}.{meaning.axis}" if meaning.axis else meaning.name


def param_column(name: str) -> str:
    """The column of a param that may be set while a stage runs."""
    return f"param.{name}"
