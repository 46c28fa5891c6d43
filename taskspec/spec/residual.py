"""Residuals: what is added to an axis while a stage runs, as live params of the task."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.geometry.axis import Axis
from taskspec.spec.axis import FORCES, AxisEntry
from taskspec.spec.load import LoadedTask, reread
from taskspec.spec.task import Task
from taskspec.text.nodes import Mapping, Node, Scalar, pointer
from taskspec.text.origin import Origin
from taskspec.text.source import Span
from taskspec.text.spliced import joined

#: Keys of an axis that hold what a residual may be added to.
RESIDUAL_KEYS = (*FORCES, "velocity", "position")


@dataclass(frozen=True, slots=True)
class Residual:
    """What may be added to the reference of an axis, wherever a stage gives it one of its kind.

    Attributes:
        axis: of the stages' frames.
        key: force, torque, velocity or position.
        interval: of its values, as a file writes it: `+- 5 N`.
        rate: how fast it may change, as a file writes it; empty where it jumps.
    """

    axis: Axis
    key: str
    interval: str
    rate: str = ""

    def param_of(self, task: Task) -> str:
        """The name of the live param that it is: one that the task does not have."""
        name = f"residual_{self.key}_{self.axis}"
        while name in task.params:
            name += "_"
        return name

    def stages_of(self, task: Task) -> tuple[str, ...]:
        """The stages in which it is added to something."""
        return tuple(name for name, _ in self._references(task))

    def _references(self, task: Task) -> Iterator[tuple[str, Expression]]:
        for name, stage in task.stages.items():
            entry = stage.axes.get(self.axis)
            found = None if entry is None else self._reference(entry)
            if found is not None:
                yield name, found

    def _reference(self, entry: AxisEntry) -> Expression | None:
        """What an axis follows; None where it follows nothing of this kind."""
        if self.key in FORCES:
            point = entry.set_point
            return None if point is None or point.kept else point.wanted
        given = entry.given
        found: Expression | None = getattr(given, self.key, None)
        return found if given is not None and given.name == self.key else None


def with_residuals(loaded: LoadedTask, residuals: Sequence[Residual]) -> LoadedTask:
    """A task whose axes have residuals, each a live param that begins with 0.

    Raises:
        SpecError: one of them does not fit, such as an interval of another dimension.
    """
    root, task = loaded.root, loaded.task
    place = pointer(root)
    for residual in residuals:
        param = residual.param_of(task)
        entries = {"value": "0", "live": residual.interval}
        entries |= {"rate": residual.rate} if residual.rate else {}
        declared = Mapping(place, flow=True)
        declared.entries.update(
            {key: (_scalar(key, place), _scalar(text, place)) for key, text in entries.items()}
        )
        root = _with(root, ("params", param), declared, place)
        for stage, expression in residual._references(task):
            text = Scalar(expression.text, True, expression.origin or Origin(place, "", ""))
            added = joined(("(", text, f") + {param}"), expression.span or place)
            root = _with(root, ("stages", stage, "axes", residual.axis, residual.key), added, place)
    return reread(loaded, root)


def _scalar(text: str, place: Span) -> Scalar:
    return Scalar(text, True, Origin(place, text, text))


def _with(owner: Node | None, steps: Sequence[str], value: Node, place: Span) -> Mapping:
    """A copy of a mapping with one value below it put in."""
    step, *rest = steps
    old = owner if isinstance(owner, Mapping) else Mapping(place, flow=True)
    entry = old.entries.get(step)
    key = entry[0] if entry else _scalar(step, place)
    below = _with(entry[1] if entry else None, rest, value, place) if rest else value
    entries = {**old.entries, step: (key, below)}
    return Mapping(old.span, old.flow, entries, old.broken, dict(old.written))
