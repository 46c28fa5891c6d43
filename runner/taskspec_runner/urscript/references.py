"""What a stage commands: lines that make its references of time, and what they need before."""

from __future__ import annotations

from dataclasses import field
from typing import Protocol

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.expression.tree import Number
from taskspec.geometry.axis import AXES, Axis
from taskspec.modes import FollowsAxes, Move, OnPath, Position, Velocity
from taskspec.motion.path import PathShape
from taskspec.motion.paths import Line, TableFile, To
from taskspec.motion.profile import RISE_TIME, move
from taskspec.program.plan import StagePlan
from taskspec.spec import FILE
from taskspec_runner.urscript.losses import located
from taskspec_runner.urscript.script import Loss, NamedValues, listed, number

#: Distances of waypoints that are tried, the longest first [s], and how far a straight line between
#: two may be off the curve [m, rad].
_WAYPOINT_STEPS, _OFF_CURVE = (0.05, 0.02, 0.01, 0.004, 0.002), 5e-5


class Write(Protocol):
    """Writes an expression of the file; some of its names may mean something else."""

    def __call__(self, expression: Expression, **names: str) -> str: ...  # noqa: D102


@dataclass(slots=True)
class MotionLines:
    """The motion of a stage.

    Attributes:
        before: lines ahead of the stage's loop.
        each: lines in each period.
        after: lines at the end of each period, which integrate.
        value: of each axis: its coordinate, or its rate in a stage that goes by rates.
        ends: how long each of its moves lasts [s].
        path_lasts: duration of the path in the path's own time; empty without a path.
        path_time: variable of that time.
        losses: of its path.
    """

    before: list[str] = field(default_factory=list)
    each: list[str] = field(default_factory=list)
    after: list[str] = field(default_factory=list)
    value: dict[Axis, str] = field(default_factory=dict)
    ends: list[float] = field(default_factory=list)
    path_lasts: str = ""
    path_time: str = "t"
    losses: list[Loss] = field(default_factory=list)


def by_rates(stage: StagePlan) -> bool:
    """Whether a stage goes by rates: velocities, and axes that stand still."""
    moving = [plan for axis, plan in stage.plans.items() if _moves(stage, axis)]
    return bool(moving) and all(isinstance(plan.mode, Velocity) for plan in moving)


def stands(stage: StagePlan) -> bool:
    """Whether no axis of a stage moves by itself."""
    return not any(_moves(stage, axis) for axis in stage.plans)


def _moves(stage: StagePlan, axis: Axis) -> bool:
    plan = stage.plans[axis]
    moving = isinstance(plan.mode, Move | Velocity | Position | OnPath | FollowsAxes)
    return moving and not plan.set_point


class MotionWriter:
    """Writes the references of a stage."""

    def __init__(self, stage: StagePlan, constants: NamedValues, prefix: str) -> None:
        """Of a stage.

        Args:
            stage: its plan.
            constants: of the stage.
            prefix: of their names.
        """
        self._stage, self._constants, self._prefix = stage, constants, prefix
        self._out = MotionLines()
        self._fades: dict[Axis, str] = {}
        self._on_path: dict[Axis, str] = {}

    def rates(self, write: Write) -> MotionLines:
        """Its rates along and about all axes, of a stage that goes by them."""
        for axis in AXES:
            self._out.value[axis] = "0.0"
            if _moves(self._stage, axis):
                self._out.value[axis] = self._rate(axis, write)
        return self._out

    def coordinates(self, write: Write) -> MotionLines:
        """Its coordinates, leaders first; those of axes that do not move are where it starts."""
        stage, out = self._stage, self._out
        for axis in AXES:
            out.value[axis] = "0.0" if axis.is_rotation else f"place[{axis.row}]"
        if stage.path is not None:
            self._path(stage.path, write)
        self._fade(write)
        for axis in stage.leaders_first:
            if not _moves(stage, axis):
                continue
            mode, start = stage.plans[axis].mode, out.value[axis]
            if isinstance(mode, Move):
                text = f"{start} + {self._moved(axis, mode)}"
            elif isinstance(mode, Velocity):
                out.before.append(f"local {axis}_travel = 0.0")
                step = f"{self._rate(axis, write)} * STEP"
                out.after.append(f"{axis}_travel = {axis}_travel + {step}")
                text = f"{start} + {axis}_travel"
            elif isinstance(mode, Position):
                text = write(mode.position)
            elif isinstance(mode, FollowsAxes):
                text = write(mode.follows)
            else:
                text = self._on_path[axis]
            fade = self._fades.get(axis)
            text += f" + {axis}_offset * (1.0 - smooth(t / {fade}))" if fade else ""
            out.each.append(f"local {axis} = {text.removeprefix('0.0 + ')}")
            out.value[axis] = str(axis)
        return out

    def _rate(self, axis: Axis, write: Write) -> str:
        mode = self._stage.plans[axis].mode
        assert isinstance(mode, Velocity)
        unit = "rad/s" if axis.is_rotation else "m/s"
        text = self._named(mode.velocity, f"{axis.upper()}_VELOCITY", unit, write)
        return f"{text} * ramp(t / RISE_TIME)"

    def _named(self, expression: Expression, name: str, unit: str, write: Write) -> str:
        """An expression in brackets, a number as a constant."""
        text = write(expression)
        tree = expression.tree
        if isinstance(getattr(tree, "x", tree), Number):
            return self._constants.add(f"{self._prefix}_{name}", text, f"{unit}, {expression}")
        return f"({text})" if " " in text else text

    def _moved(self, axis: Axis, mode: Move) -> str:
        unit = "rad" if axis.is_rotation else "m"
        name = f"{self._prefix}_{axis.upper()}"
        far = self._constants.add(f"{name}_MOVE", number(mode.move), unit)
        fast = self._constants.add(f"{name}_SPEED", number(mode.top), f"{unit}/s")
        self._out.ends.append(float(move(0.0, 0.0, abs(mode.move), mode.top).rests))
        return f"travel(t, {far}, {fast}, RISE_TIME)"

    def _fade(self, write: Write) -> None:
        """How axes with coordinates of their own come to these from where the stage starts."""
        stage, out, waits = self._stage, self._out, list[str]()
        for axis, plan in stage.plans.items():
            if not _moves(stage, axis):
                continue
            first, value = self._first(axis, write)
            starts_at_zero = axis.is_rotation or stage.frame.kind == "following"
            near = starts_at_zero and axis != Axis.Z and value is not None
            if first and not (near and abs(value or 0.0) < _OFF_CURVE):
                speed = "FADE_TURN" if axis.is_rotation else "FADE_SPEED"
                start = "0.0" if axis.is_rotation else f"place[{axis.row}]"
                offset = start if first == "0.0" else f"{start} - {first}"
                out.before += [
                    f"local {axis}_offset = {offset}",
                    f"local {axis}_fade = fade_time({axis}_offset, {speed})",
                ]
                self._fades[axis] = f"{axis}_fade"
                waits += [f"{axis}_fade"] if isinstance(plan.mode, Position) else []
        if any(isinstance(p.mode, Position) and _moves(stage, a) for a, p in stage.plans.items()):
            wait = waits[0] if waits else ""
            for each in waits[1:]:
                wait = f"larger({wait}, {each})"
            out.each.append(f"local own_time = from_rest(t{f' - {wait}' if wait else ''})")

    def _first(self, axis: Axis, write: Write) -> tuple[str, float | None]:
        """The coordinate at which an axis's own reference starts, and its value if that is known.

        Empty for one that starts where the stage does.
        """
        stage, mode = self._stage, self._stage.plans[axis].mode
        if isinstance(mode, Position):
            known = stage.known(mode.position, {"t": 0.0, "clock": 0.0})
            if known is not None:
                return number(known), known
            return f"({write(mode.position, own_time='0.0', t='0.0')})", None
        if isinstance(mode, FollowsAxes):
            start = {a: "0.0" if a.is_rotation else f"place[{a.row}]" for a in mode.leaders}
            return f"({write(mode.follows, **start)})", None
        if isinstance(mode, OnPath) and isinstance(mode.path.form, TableFile):
            first = mode.path.form.place(0.0, {}, axis)
            return number(first), first
        return "", None

    # Paths

    def _path(self, path: PathShape, write: Write) -> None:
        out = self._out
        fastest = ""
        if path.speed is not None:
            fastest = self._constants.add(f"{self._prefix}_SPEED", number(path.speed), "m/s")
        if path.slowed is not None:
            out.path_time = "path_t"
            out.before.append("local path_t = 0.0")
            share = f"clamp({write(path.slowed)} / {fastest}, 0.0, 1.0)"
            out.after.append(f"path_t = path_t + {share} * STEP")
        if isinstance(path.form, Line | To):
            self._straight(path, fastest)
        else:
            self._waypoints(path)

    def _straight(self, path: PathShape, speed: str) -> None:
        out, form = self._out, path.form
        assert isinstance(form, Line | To)
        targets = dict(zip(AXES, form.to if isinstance(form, To) else form.by, strict=False))
        driven = [a for a in path.axes if isinstance(form, To) or form.moves(a)]
        for axis in path.axes:
            self._on_path[axis] = out.value[axis]
        for axis in driven:
            unit = "rad" if axis.is_rotation else "m"
            what = "TO" if isinstance(form, To) else "BY"
            name = f"{self._prefix}_{axis.upper()}_{what}"
            target = self._constants.add(name, number(targets[axis]), unit)
            start = f" - {out.value[axis]}" if isinstance(form, To) else ""
            out.before.append(f"local {axis}_way = {target}{start}".removesuffix(" - 0.0"))
        for turns in (False, True):
            ways = [f"{axis}_way" for axis in driven if axis.is_rotation == turns]
            if not ways:
                continue
            length = f"path_length = length_of({', '.join([*ways, '0.0', '0.0'][:3])})"
            if any("path_length" in line for line in out.before):
                out.before += ["if path_length < NOWHERE:", f"  {length}", "end"]
            else:
                out.before.append(f"local {length}")
        rise = "RISE_TIME"
        if path.time is not None:
            rise = self._constants.add(
                f"{self._prefix}_RISE", number(min(RISE_TIME, path.time / 2)), "s"
            )
            lasts = self._constants.add(f"{self._prefix}_PATH_TIME", number(path.time), "s")
            speed = "path_speed"
            out.before.append(
                f"local path_speed = larger(path_length, NOWHERE) / ({lasts} - {rise})"
            )
        out.before.append(f"local path_lasts = travel_time(path_length, {speed}, {rise})")
        out.path_lasts = "path_lasts"
        out.each.append(
            f"local path_share = travel({out.path_time}, path_length, {speed}, {rise}) / "
            "larger(path_length, NOWHERE)"
        )
        for axis in driven:
            text = f"{out.value[axis]} + path_share * {axis}_way".removeprefix("0.0 + ")
            self._on_path[axis] = text

    def _waypoints(self, path: PathShape) -> None:
        out, stage = self._out, self._stage
        ready = stage.ready_path
        assert ready is not None
        start = dict.fromkeys(path.axes, 0.0)
        plan = ready.plan(start)
        lasts = float(plan.duration)

        def at(times: np.ndarray) -> np.ndarray:
            shares = [float(plan.timing(min(t, lasts))) for t in times]
            return np.array([[ready.form.place(s, start, a) for a in path.axes] for s in shares])

        for step in _WAYPOINT_STEPS:
            count = int(np.ceil(lasts / step - 1e-9)) + 1
            rows = at(step * np.arange(count))
            between = at(step * (np.arange(count - 1) + 0.5))
            off = float(np.abs(between - (rows[1:] + rows[:-1]) / 2).max())
            if off <= _OFF_CURVE:
                break
        every = self._constants.add(
            f"{self._prefix}_WAYPOINT_STEP", number(step), "s from one waypoint to the next"
        )
        many = self._constants.add(f"{self._prefix}_WAYPOINTS", str(count))
        out.path_lasts = self._constants.add(f"{self._prefix}_PATH_TIME", number(lasts), "s")
        for i, axis in enumerate(path.axes):
            table = self._constants.add(
                f"{self._prefix}_{axis.upper()}",
                listed(np.round(rows[:, i], 6)),
                "rad" if axis.is_rotation else "m",
            )
            base = out.value[axis] if ready.form.relative else "0.0"
            text = f"{base} + waypoint({table}, {many}, {every}, {out.path_time})"
            self._on_path[axis] = text.removeprefix("0.0 + ")
        text = (
            f"the curve of the {path.form.name}: {count} waypoints, {1e3 * step:g} ms apart, are "
            f"off it by up to {1e6 * off:.0f} um"
        )
        place = FILE.stages[stage.name].path
        out.losses.append(located(stage.context.loaded, place, text))
