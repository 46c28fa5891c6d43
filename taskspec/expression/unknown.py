"""What to say about a name that means nothing where it stands."""

from __future__ import annotations

from taskspec import signals
from taskspec.expression.functions import FUNCTIONS, REDUCERS
from taskspec.expression.problem import Problem
from taskspec.expression.scope import (
    CONSTANTS,
    COORDINATES,
    Scope,
    ScopeKind,
    coordinate,
)
from taskspec.expression.tree import Name
from taskspec.geometry.axis import AXES, ROTATIONS
from taskspec.signals.table import REFERENCE
from taskspec.text.codes import register
from taskspec.text.suggest import closest, suggestion
from taskspec.text.units import UNITS

register(
    {
        "TS116": "a name that cannot be used here",
        "TS120": "an unknown name in an expression",
    }
)

_ONLY_HERE = {
    ScopeKind.CONSTANT: "a fixed value may use params and pi only",
    ScopeKind.WORLD: "the world may use params, pi and clock only",
    ScopeKind.EQUATION: "an equation may use x, y, z, rx, ry, rz or q1, q2, ..., clock, params "
    "and pi",
    ScopeKind.COUPLING: "a coupling may use the axes x, y, z, rx, ry, rz, params and pi only",
    ScopeKind.PLANNED: "a planned position may use params, pi, t and clock only",
}
_PREFIXES = {
    "force": ("f", "force"), "velocity": ("v", "vel", "velocity"),
    "position": ("p", "pos", "position"),
}  # fmt: skip
_OTHERS = {
    **{f"{word}{axis}": f"{signal}.{axis}"
       for signal, words in _PREFIXES.items() for word in words for axis in "xyz"},
    **{f"{word}{axis}": f"torque.r{axis}" for word in ("m", "t", "torque") for axis in "xyz"},
    "f": "force.z", "pos": "position.z", "vel": "velocity.z", "contact": "touching",
    "time": "t", "duration": "t", "elapsed": "t", "distance": "gap", "moment": "torque.rz",
    "wrench": "force.z",
}  # fmt: skip
"""What other systems call a signal."""
_LOGGED = ("command", "servo", "exerted", "measured", "friction")
"""Ends of columns of joints that the log has beside their signals."""
_TRUTH = ("yes", "no", "on", "off", "true", "false")


def explain_name(node: Name, scope: Scope) -> Problem:
    """Says why a name cannot be used: misspelt, out of scope, a unit, a function and so on."""
    path, start = node.path, node.start
    text = ".".join(path)
    end = start + len(text)
    head = path[0]
    if head == "params" and len(path) == 2:
        message = "params are used by their bare name"
        return Problem("TS120", message, start, end, f"write '{path[1]}'")
    if len(path) == 1:
        code, message, hint = _single(head, scope)
        return Problem(code, message, start, end, hint)
    if not scope.measures and (
        head in signals.VECTORS
        or head in scope.objects.keys() | scope.stages | {"joint", *_FAMILIES}
    ):
        message = f"'{text}' is not known here"
        return Problem("TS116", message, start, end, _instead(path, scope))
    if head in scope.stages:
        return _in_stage(node, scope, end)
    return _signal(path, start, end, scope)


def _instead(path: tuple[str, ...], scope: Scope) -> str:
    """What an expression that measures nothing may use in place of a signal."""
    if scope.kind is ScopeKind.EQUATION and len(path) > 1:
        if path[0] == "position" and path[1] in COORDINATES:
            return f"in an equation the tool tip's is '{path[1]}'"
        if path[0] == "joint" and path[1].isdigit():
            return f"in an equation it is 'q{path[1]}'"
    if scope.kind is ScopeKind.EQUATION and path == ("tilt",):
        return "in an equation it is angle(tool.z, -world.z), or of another frame"
    if scope.kind is ScopeKind.COUPLING and path[0] == "position" and path[-1] in scope.coordinates:
        return f"in a coupling the coordinate is '{path[-1]}'"
    return _ONLY_HERE.get(scope.kind, "")


def _axis(word: str, scope: Scope) -> tuple[str, str, str]:
    """About the bare name of an axis or a joint, which only an equation uses."""
    joint = word.startswith("q")
    what = f"'{word}' is {'a joint' if joint else 'an axis'}"
    if not scope.measures:
        return "TS116", what, _ONLY_HERE[scope.kind]
    name = f"joint.{word[1:]}" if joint else ""
    hint = f"write {name}.position" if joint else f"write position.{word} or velocity.{word}"
    return "TS120", what, hint


def _single(word: str, scope: Scope) -> tuple[str, str, str]:
    """Code, message and hint for a name without dots."""
    if word in UNITS:
        return "TS120", f"'{word}' is a unit", f"a unit follows its number without a '*': 1 {word}"
    if word in FUNCTIONS or word in REDUCERS:
        return "TS120", f"'{word}' is a function", f"write its argument: {word}(…)"
    if word in signals.words() or word in signals.CLOCKS:
        return "TS116", f"'{word}' is not known here", _instead((word,), scope)
    if word in scope.stages:
        return "TS120", f"'{word}' is a stage, not a value", f"add a signal: {word}.force.z"
    if word in scope.objects:
        first = next(iter(signals.OBJECT[scope.objects[word]]))
        return "TS120", f"'{word}' is an object, not a value", f"add a signal: {word}.{first}"
    if word in AXES or coordinate(word) is not None:
        return _axis(word, scope)
    if word[:1] == "q" and word[1:].isdigit():
        return "TS120", f"there is no joint '{word}'", "joints are counted from 1: q1, q2, ..."
    unknown = f"unknown name '{word}'"
    if word.lower() in _TRUTH:
        return "TS120", unknown, "a condition compares: gap < 1 mm"
    known = {*signals.CLOCKS, *CONSTANTS, *scope.params, *scope.coordinates}
    if scope.measures:
        known |= {*signals.words(), *scope.stages, *scope.objects}
        other = _OTHERS.get(word.lower().replace("_", ""))
        if other is not None and closest(word, scope.params) is None:
            return "TS120", unknown, f"did you mean '{other}'?"
    return "TS120", unknown, suggestion(word, known) or _last_hint(word, scope)


def _in_stage(node: Name, scope: Scope, end: int) -> Problem:
    rest = node.path[1:]
    if scope.kind is not ScopeKind.EXPECT:
        return Problem(
            "TS116",
            "only an expectation may ask for a signal of a named stage",
            node.start,
            end,
            f"give the stage a rate of its own: rate: {{{node.path[0]}: ..}}"
            if scope.kind is ScopeKind.REWARD
            else f"write '{'.'.join(rest)}' for this stage, or move it to 'expect'",
        )
    start = node.start + len(node.path[0]) + 1
    return _signal(rest, start, end, scope, after_stage=True)


def _signal(
    path: tuple[str, ...], start: int, end: int, scope: Scope, *, after_stage: bool = False
) -> Problem:
    head = path[0]
    if path[-1] == REFERENCE and (of := signals.find(path[:-1], scope.objects)) is not None:
        return _reference(of.signal, path, start, end)
    if path[-1] in (*FUNCTIONS, *REDUCERS) and len(path) > 1 and path[-1] != "angle":
        inner = ".".join(path[:-1])
        message, hint = f"'{path[-1]}' is a function", f"it comes first: {path[-1]}({inner})"
        return Problem("TS120", message, start, end, hint)
    if head in signals.VECTORS:
        axes = list(signals.VECTORS[head].dimensions)
        return Problem("TS120", f"'{head}' has no '{'.'.join(path[1:])}'", start, end,
                       _axis_hint(head, path[1], axes))  # fmt: skip
    if head in scope.objects:
        name = ".".join(path[1:])
        has = signals.OBJECT[scope.objects[head]]
        hint = suggestion(name, has, f"signals of '{head}'")
        return Problem("TS120", f"the object '{head}' has no signal '{name}'", start, end, hint)
    if head == "joint":
        logged = f"the log alone has it; in expressions: {'.'.join(path[:-1])}"
        form = "write joint.1.position, joint.1.velocity or joint.1.torque, counted from 1"
        hint = logged if path[-1] in _LOGGED else form
        return Problem("TS120", f"'{'.'.join(path)}' is not a joint's signal", start, end, hint)
    if head in _FAMILIES:
        return _of_family(path, start, end)
    if head in (*signals.SCALARS, *signals.CLOCKS, *scope.params):
        return Problem("TS120", f"'{head}' has no parts", start, end, f"write '{head}'")
    families = {"joint", *_FAMILIES}
    options = {*signals.VECTORS, *scope.objects, *families}
    if scope.kind is ScopeKind.EXPECT or path[-1] == "visits":
        options |= scope.stages
    if after_stage:
        options = {
            *signals.VECTORS,
            *scope.objects,
            *families,
            *signals.words(),
            *signals.CLOCKS,
            "visits",
        }
        hint = suggestion(head, options, "signals")
        if head in scope.stages:
            hint = f"'{head}' is a stage too; one name of a stage is enough: {'.'.join(path)}"
        elif (other := _OTHERS.get(head.lower())) is not None and closest(head, options) is None:
            hint = f"did you mean '{other}'?"
        return Problem("TS120", f"unknown signal '{head}'", start, start + len(head), hint)
    what = "stage, object or signal" if scope.kind is ScopeKind.EXPECT else "signal or object"
    hint = (
        suggestion(head, options, "known are") if len(path) > 1
        else suggestion(head, signals.words(), "signals")
    )  # fmt: skip
    return Problem("TS120", f"unknown {what} '{head}'", start, start + len(head), hint)


#: Words that begin the names of a family, each with its members and what it is called.
_FAMILIES = {
    str(signals.Index.LINK): (tuple(signals.LINK), "the link has no signal"),
    str(signals.Index.GRIP): (tuple(signals.GRIP), "the gripper has no signal"),
    **{
        head: (
            tuple(
                n.partition(".")[2]
                for n in (*signals.ENERGY, *signals.TANK)
                if n.startswith(f"{head}.")
            ),
            f"no {head} of a law is called",
        )
        for head in ("energy", "power", "tank")
    },
    str(signals.Index.PAYLOAD): (
        tuple(name.partition(".")[2] for name in signals.PAYLOAD),
        "nothing of a payload is called",
    ),
    str(signals.Index.ESTIMATE): (tuple(f"{n}.z" for n in signals.ESTIMATE), "no law estimates"),
    str(signals.Index.GAIN): (tuple(f"{name}.z" for name in signals.GAIN), "there is no gain"),
}


def _of_family(path: tuple[str, ...], start: int, end: int) -> Problem:
    """About a member that a family does not have."""
    members, lacks = _FAMILIES[path[0]]
    hint = suggestion(".".join(path), [f"{path[0]}.{name}" for name in members], "known are")
    return Problem("TS120", f"{lacks} '{'.'.join(path[1:])}'", start, end, hint)


def _reference(of: signals.Signal, path: tuple[str, ...], start: int, end: int) -> Problem:
    """About the reference of a signal that has none, or where it is no signal."""
    name = ".".join(path[:-1])
    if REFERENCE in of.beside:
        message = f"the reference '{'.'.join(path)}' is a signal of expectations only"
        return Problem("TS116", message, start, end, "write the set point itself")
    having = [each.name for each in signals.VECTORS.values() if REFERENCE in each.beside]
    hint = f"signals with a reference: {', '.join(having)}"
    return Problem("TS120", f"'{name}' has no reference", start, end, hint)


def _axis_hint(name: str, axis: str, axes: list[str]) -> str:
    if axis == REFERENCE and REFERENCE in signals.VECTORS[name].beside:
        return f"the axis comes first: {name}.{axes[-1]}.{REFERENCE}"
    if name == "force" and axis in ROTATIONS:
        return f"moments are 'torque.{axis}'"
    if name == "torque" and f"r{axis}" in axes:
        return f"moments are about an axis: 'torque.r{axis}'"
    near = closest(axis, axes)
    return f"did you mean '{name}.{near}'?" if near else f"axes of {name}: {', '.join(axes)}"


def _last_hint(word: str, scope: Scope) -> str:
    if word == "visits" and scope.measures and scope.stages:
        return f"visits are counted of a stage: {min(scope.stages)}.visits"
    return f"params: {', '.join(scope.params)}" if scope.params else "there are no params"
