"""Signals of the language as a stage of a program reads them, and what it remembers of them."""

from __future__ import annotations

from dataclasses import field

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.expression.tree import Held, Name, Reduce
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.plan import StagePlan
from taskspec_runner.urscript.expressions import UntranslatableError, translated
from taskspec_runner.urscript.script import number

#: Signals that are one word in a program too.
_ALWAYS = {
    **{"pi": "PI", "t": "t", "clock": "clock", "path_done": "path_done"},
    **{"speed": "tool_speed()", "travel": "distance_from(began)"},
}
#: Signals of six axes, by the variables that have them.
_SIX = {"force": "applied", "torque": "applied", "velocity": "speed"}
_EXTREMES = {"max": ">", "min": "<"}


def sampled(kind: str, frame: str) -> str:
    """The variable with what is measured in a frame; that of the stage's own is short."""
    return kind if frame == "frame" else f"{kind}_in_{frame.lower()}"


@dataclass(slots=True)
class Reader:
    """Writes expressions of a stage, and collects what they need.

    Attributes:
        stage: whose they are.
        params: names of the task's params in the program.
        frames: names of fixed frames in the program.
        now: variables that are measured in each period, with their values.
        before: lines ahead of the loop.
        update: lines in each period, once `now` is measured.
    """

    stage: StagePlan
    params: dict[str, str]
    frames: dict[str, str]
    now: dict[str, str] = field(default_factory=dict)
    before: list[str] = field(default_factory=list)
    update: list[str] = field(default_factory=list)

    def condition(self, expression: Expression) -> str:
        """A guard; what it remembers is updated in each period."""

        def remember(node: Held | Reduce) -> str:
            return self._remembered(node, expression.text)

        return translated(expression.tree, self._signal, remember)

    def reference(self, expression: Expression, **names: str) -> str:
        """A reference; what it is of may have other names, such as a time of its own for t."""

        def lookup(name: Name) -> str:
            return names.get(str(name)) or self._signal(name)

        return translated(expression.tree, lookup)

    def measured(self, kind: str, frame: str = "frame") -> str:
        """A variable with six numbers in a frame: applied, where or speed."""
        functions = {"applied": "applied_in", "where": "tool_in", "speed": "speed_in"}
        name = sampled(kind, frame)
        self.now[name] = f"{functions[kind]}({frame})"
        return name

    def coordinate(self, axis: Axis, frame: str = "frame") -> str:
        """A measured coordinate; turns count from the stage's start in its own frame."""
        where = self.measured("where", frame)
        if not axis.is_rotation:
            return f"{where}[{axis.row}]"
        self.now["turned"] = f"turned_since(place, {where})"
        return f"turned[{axis.row}]"

    def _remembered(self, node: Held | Reduce, text: str) -> str:
        """A variable with the time for which a condition has held, or with an extreme."""

        def inside(inner: Held | Reduce) -> str:
            return self._remembered(inner, text)

        count = len(self.before) + 1
        if isinstance(node, Held):
            holds = translated(node.x, self._signal, inside)
            name = f"held_{count}"
            self.before.append(f"local {name} = 0.0")
            self.update += [
                f"# {name}: for how long {text[node.x.start : node.x.end]}",
                f"if {holds}:",
                f"  {name} = {name} + STEP",
                "else:",
                f"  {name} = 0.0",
                "end",
            ]
            return f"{name} > {number(node.amount.value_si)} - NOWHERE"
        if node.reducer not in _EXTREMES:
            raise UntranslatableError(node, f"'{node.reducer}' over a stage is not kept")
        value, name = translated(node.arg, self._signal, inside), f"{node.reducer}_{count}"
        self.before.append(f"local {name} = 0.0")
        self.update += [
            f"# {name}: {text[node.start : node.end]}, of the stage so far",
            f"if t < STEP / 2.0 or {value} {_EXTREMES[node.reducer]} {name}:",
            f"  {name} = {value}",
            "end",
        ]
        return name

    def _signal(self, name: Name) -> str:
        path, frame = name.path, "frame"
        if name.frame is not None:
            if name.frame not in self.frames:
                raise UntranslatableError(name, f"frame {name.frame!r} is no fixed frame")
            frame = self.frames[name.frame]
        text = str(name)
        if text in _ALWAYS or text in self.params:
            return self.params.get(text) or _ALWAYS[text]
        kind, _, axis = ".".join(path).partition(".")
        if axis in AXES and kind in _SIX:
            return f"{self.measured(_SIX[kind], frame)}[{Axis(axis).row}]"
        if axis in AXES and kind == "position":
            return self._position(name, Axis(axis), frame)
        if axis == "visits":
            return f"visits_{kind}"
        if text == "touching":
            force = self.measured("applied")
            return f"(length_of({force}[0], {force}[1], {force}[2]) > TOUCHING)"
        raise UntranslatableError(name, f"the program does not measure '{name}'")

    def _position(self, name: Name, axis: Axis, frame: str) -> str:
        if axis.is_rotation and frame != "frame":
            raise UntranslatableError(name, "turns count from the stage's start in its own frame")
        return self.coordinate(axis, frame)
