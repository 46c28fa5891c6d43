"""Between which bounds the signals of a stage stay while it runs.

The bounds are those that end the stage or the run at the latest: limits are looked at before
guards, and guards before `within`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.program.interval import ANY, Interval
from taskspec.program.passage import End, Instant, Passage
from taskspec.program.plan import StagePlan
from taskspec.program.signals import constant, entry_of, natural
from taskspec.signals import Entry, Index
from taskspec.text.expression.tree import Call, Name, Node, walk
from taskspec.text.units import LENGTH, TIME, show

#: How far a mechanism may go beyond its stop, and the belief of its place beyond that, as a share
#: of its range.
_BEYOND_STOP = 0.1
#: Faster than any arm's tip [m/s]: by as much a stage may go beyond `within.travel` in a period.
_FASTEST = 10.0
#: A mechanism may be driven farther than its velocity says, by this share and by play [m, rad]: it
#: leads by 2 % or 0.8 mm at most (measured from 0.3 s on in 30 random files, of eight laws).
_DRIVEN = 1.04
_SLACK = {"angle": math.radians(1.0), "travel": 1e-3}


class Ranges:
    """Intervals of the names in the guards of one stage.

    Args:
        stage: whose guards they are.
        known: intervals that replace those found here, by full name.
    """

    def __init__(self, stage: StagePlan, known: Mapping[str, Interval] | None = None) -> None:
        self._plan, self._context, self._stage = stage, stage.context, stage.spec
        self._limits = stage.limits.stopping()
        self._known = dict(known or {})

    def __call__(self, node: Name) -> Interval:
        """The interval [SI] of a name."""
        if str(node) in self._known:
            return self._known[str(node)]
        found = entry_of(self._context.loaded.task, node.path)
        if found is None:
            return constant(self._context, node) or ANY
        return natural(found).meet(self._bounds(found))

    def _bounds(self, found: Entry) -> Interval:
        """What the file sets to a signal while the stage runs."""
        signal, member = found.signal, found.member
        match signal.index, signal.name:
            case Index.CLOCK, "t":
                return Interval(0.0, self._plan.longest)
            case Index.STAGE, _:
                return self._visits(member)
            case Index.JOINT, _:
                return self._joint(int(member) - 1, signal.name)
            case Index.OBJECT, _ if member in self._context.loaded.task.mechanisms:
                return self._mechanism(member, signal.name)
            case Index.SINGLE, "travel":
                return self._travel()
            case Index.AXIS, "position":
                moved = self._moved(Axis(member))
                return ANY if moved is None else moved.interval
        bound = getattr(self._limits, signal.limit) if self._limited(found) else None
        return _within(bound)

    def _limited(self, found: Entry) -> bool:
        """Whether a limit of the file bounds a signal."""
        if found.signal.limit != "speed" or not found.signal.axes:
            return bool(found.signal.limit)
        # Limits on speed are those of the tip, along and not about.
        own = self._plan.frame.at_origin
        return not own and not Axis(found.member).is_rotation

    def magnitudes(self, node: Node) -> dict[Node, Interval]:
        """Intervals of `norm(force)` and `norm(torque)` in an expression, which limits bound."""
        found: dict[Node, Interval] = {}
        for call in walk(node):
            if not isinstance(call, Call) or call.function != "norm":
                continue
            kinds = {a.path[0] if isinstance(a, Name) else "" for a in call.args}
            if kinds in ({"force"}, {"torque"}):
                found[call] = _within(getattr(self._limits, kinds.pop()))
        return found

    def why(self, node: Name) -> str:
        """What bounds a name, in words; empty where nothing of the file does."""
        head, last, limits = node.path[0], node.path[-1], self._limits
        task, within = self._context.loaded.task, self._stage.within
        if str(node) == "t" and math.isfinite(self._plan.longest):
            bound = self._stage.time if within is None else within.time
            return f"the stage ends after {show(bound or 0.0, TIME)} at the latest"
        if str(node) == "travel" and within is not None and within.travel is not None:
            return f"the stage ends after {show(within.travel, LENGTH)} of travel at the latest"
        if last == "visits" and head in task.stages and math.isfinite(self._visits(head).high):
            return f"{head!r} is entered {self._visits(head).high:g} times at the most"
        found = entry_of(task, node.path)
        limit = "" if found is None else found.signal.limit
        if last == "force" and head == self._context.held:
            limit = "force"
        if found is not None and limit and getattr(limits, limit) is not None:
            text = show(getattr(limits, limit), found.signal.dimension)
            return f"the limit on {limit}, {text}, stops the run before that"
        moved = self._why_moved(node)
        if moved:
            return moved
        if head == "joint":
            return f"joint {node.path[1]} has limits"
        return self._why_held(head, last) if head in task.mechanisms else ""

    def _why_moved(self, node: Name) -> str:
        head, last = node.path[0], node.path[-1]
        moved = self._moved(Axis(last)) if head == "position" and node.frame is None else None
        if moved is None:
            return ""
        unit = Axis(last).of(LENGTH)
        lasts, way = show(moved.lasts, TIME, 3), show(moved.way, unit, 3)
        return f"in {lasts} this stage moves {last!r} by {way}"

    def _why_held(self, name: str, signal: str) -> str:
        driven, stop = self._driven(name, signal), self._stop(name, signal)
        if driven is None or driven.interval.meet(stop) != driven.interval:
            return f"{name!r} has a stop"
        way = show(driven.way, LENGTH.on(rotation=signal != "travel"), 3)
        return f"in {show(driven.lasts, TIME, 3)} this stage moves {name!r} by {way}"

    def _travel(self) -> Interval:
        within = self._stage.within
        if within is None or within.travel is None:
            return ANY
        return Interval(0.0, within.travel + _FASTEST * self._context.period)

    def _visits(self, stage: str) -> Interval:
        attempts = self._context.loaded.task.stages[stage].attempts
        least = 1.0 if stage == self._plan.name else 0.0
        repeat = self._context.loaded.task.stages[stage].repeat
        return Interval(least, math.inf if attempts is None else float(attempts * repeat))

    def _joint(self, i: int, signal: str) -> Interval:
        robot = self._context.robot
        if not 0 <= i < robot.pin.nv:
            return ANY  # Told of by itself.
        if signal == "position":
            return Interval(float(robot.lower[i]) - 1e-3, float(robot.upper[i]) + 1e-3)
        most = robot.velocity_limit if signal == "velocity" else robot.torque_limit
        return _within(float(most[i]))

    def _mechanism(self, name: str, signal: str) -> Interval:
        if signal == "force" and name == self._context.held:
            return _within(self._limits.force)  # It is a part of the force on the tool.
        if signal not in _SLACK:
            return ANY
        driven = self._driven(name, signal)
        return self._stop(name, signal).meet(ANY if driven is None else driven.interval)

    def _stop(self, name: str, signal: str) -> Interval:
        mechanism = self._context.loaded.task.mechanisms[name]
        if mechanism.stop is None:
            return ANY
        low, high = mechanism.stop
        slack = _BEYOND_STOP * (high - low)
        lead = self._context.mechanisms[name].lead
        factor = lead if mechanism.angular and signal == "travel" else 1.0
        ends = sorted((factor * (low - slack), factor * (high + slack)))
        return Interval(*ends)

    @property
    def _passage(self) -> Passage | None:
        """What the arm goes through until the stage's bounds end it, where that is known."""
        passage = self._plan.nominal.passage if self._plan.followed else None
        return None if passage is None or passage.end is not End.BOUND else passage

    def _driven(self, name: str, signal: str) -> Gone | None:
        """How far the mechanism that the robot holds goes."""
        passage = self._passage
        if passage is None or name != self._context.held or signal not in _SLACK:
            return None
        model = self._context.mechanisms[name]
        factor = model.lead if model.angular and signal == "travel" else 1.0
        if passage.last.coordinate is None:
            return None
        return _gone(passage, lambda i: factor * (i.coordinate or 0.0), _SLACK[signal])

    def _moved(self, axis: Axis) -> Gone | None:
        """How far an axis goes whose motion is controlled."""
        passage, plan = self._passage, self._plan.plans.get(axis)
        if passage is None or plan is None or not plan.motion or plan.axis.has_force:
            return None
        frame = self._plan.frame
        if (axis.is_rotation or self._context.held) and (not frame.still or frame.at_origin):
            return None
        if axis.is_rotation:
            return self._turned(passage, axis)
        start = self._start(axis)
        if start is None:
            return None
        return _gone(passage, lambda i: start + i.moved[axis], _SLACK["travel"])

    def _turned(self, passage: Passage, axis: Axis) -> Gone | None:
        """How far a rotation goes; None where it is not the only one, or more than half a turn."""
        for instant in passage.instants:
            turned = {a: x for a, x in instant.moved.items() if a.is_rotation and x}
            if turned.keys() - {axis} or abs(instant.moved[axis]) >= math.pi:
                return None
        return _gone(passage, lambda i: i.moved[axis], _SLACK["angle"])

    def _start(self, axis: Axis) -> float | None:
        """Coordinate of a translation as the stage starts [m]."""
        frame, passage = self._plan.frame, self._passage
        assert passage is not None
        if not frame.still:
            return 0.0 if axis is not Axis.Z or frame.kind == "tool" else None
        rotation, origin = self._context.placed(frame)
        first = origin if frame.at_origin else passage.instants[0].p
        return float(rotation[:, axis.column] @ (first - origin))


@dataclass(frozen=True, slots=True)
class Gone:
    """How far a stage takes a signal before its bounds end it.

    Attributes:
        way: what its references come to by then [rad, m].
        lasts: how long that takes [s].
        interval: of the signal, with what it may go beyond that.
    """

    way: float
    lasts: float
    interval: Interval


def _gone(passage: Passage, at: Callable[[Instant], float], slack: float) -> Gone:
    values = [at(instant) for instant in passage.instants]
    beyond = (_DRIVEN - 1.0) * (max(values) - min(values)) + slack
    reached = Interval(min(values) - beyond, max(values) + beyond)
    return Gone(values[-1] - values[0], passage.last.time, reached)


def _within(most: float | None) -> Interval:
    return ANY if most is None else Interval(-most, most)
