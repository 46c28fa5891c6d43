"""Faults of a run whatever its file expects: oscillations and saturation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, tree
from taskspec.geometry.axis import ROTATIONS, TRANSLATIONS
from taskspec.program.program import Program
from taskspec.program.stages.stage import CompiledStage
from taskspec.spec import Sensor, Task
from taskspec.spec.stage import OSCILLATION, SATURATION
from taskspec.text.units import FORCE, MOMENT, VELOCITY, Dimension, show
from taskspec_runner.record.file_array import blocks, empty
from taskspec_runner.record.history import History, Visit
from taskspec_runner.verdict.metrics import set_points
from taskspec_runner.verdict.oscillation import (
    LEAST_FORCE,
    LEAST_MOMENT,
    LEAST_SPEED,
    OF_SET_POINT,
    OF_TORQUE,
    Oscillation,
    References,
    amid_noise,
    judged,
    oscillation,
)
from taskspec_runner.verdict.run_finding import RunFinding
from taskspec_runner.verdict.saturation import LASTS, torque_share, velocity_share

Vector = NDArray[np.float64]

#: What references may be made of to be known beforehand.
_CLOCKS = ("t", "clock", "pi")
_MORE = 3


def findings(program: Program, history: History, true: Task) -> tuple[RunFinding, ...]:
    """Of every visited stage the worst visit with an oscillation, and with a saturation.

    Args:
        program: that ran.
        history: what it recorded, as far as it came.
        true: the task with the world and the robot as they were.
    """
    stages = {stage.name: stage for stage in program.stages}
    visits: dict[str, int] = {}
    worst: dict[tuple[str, str], tuple[float, RunFinding]] = {}
    for visit in history.visits():
        number = visits[visit.stage] = visits.get(visit.stage, 0) + 1
        if not judged(visit.last + 1 - visit.first):
            continue
        look = _Look(program, stages[visit.stage], history, visit, number, true.robot.sensor)
        for size, found in (*look.oscillations(), *look.saturations()):
            key = (found.kind, found.stage)
            if key not in worst or size > worst[key][0]:
                worst[key] = (size, found)
    return tuple(sorted((found for _, found in worst.values()), key=lambda each: each.start))


@dataclass(frozen=True, slots=True)
class _Watched:
    """A signal that is analysed.

    Attributes:
        name: of its column.
        dimension: its own.
        least: amplitude from which it counts [SI].
        rank: 0 of efforts on the work, 1 of speeds, 2 of joints.
    """

    name: str
    dimension: Dimension
    least: float
    rank: int = 0


class _VisitColumns(Mapping[str, Vector]):
    """The columns of a visit; of a world of a sweep, each is made at its first use."""

    def __init__(self, columns: Mapping[str, Vector], rows: slice) -> None:
        self._columns, self._rows = columns, rows

    def __getitem__(self, name: str) -> Vector:
        return self._columns[name][self._rows]

    def __contains__(self, name: object) -> bool:
        return name in self._columns

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)


class _Look:
    """One visit of a stage."""

    def __init__(
        self,
        program: Program,
        stage: CompiledStage,
        history: History,
        visit: Visit,
        number: int,
        sensor: Sensor,
    ) -> None:
        self._program, self._stage, self._visit, self._number = program, stage, visit, number
        self._columns = _VisitColumns(history.columns, visit.rows)
        self._clock = self._columns["clock"]
        self._noise = sensor.noise
        self._amid = amid_noise(sensor, program.context.period, judged(len(self._clock)))

    def oscillations(self) -> Iterator[tuple[float, RunFinding]]:
        """The oscillation of this visit, if any, and how many times its bound it is."""
        found: list[tuple[float, _Watched, Oscillation]] = []
        references: References | None = None
        for watched in self._watched():
            values = self._columns.get(watched.name)
            if values is None or np.ptp(values[-judged(len(values)) :]) < watched.least:
                continue
            references = References(self._references()) if references is None else references
            noisy = self._noise is not None
            period, least = self._program.context.period, watched.least
            made = oscillation(values, period, least, references, noisy=noisy)
            if made is not None:
                found.append((made.amplitude / least, watched, made))
        if found:
            size = max(ratio for ratio, *_ in found)
            # What acts on the work is named before the speed, and that before a joint.
            _, watched, made = min(found, key=lambda each: (each[1].rank, -each[0]))
            beside = tuple(each.name for _, each, _ in found if each is not watched)
            yield (
                size,
                self._finding(
                    OSCILLATION,
                    watched.name,
                    beside,
                    _oscillates(watched, made, beside),
                    frequency=made.frequency,
                    amplitude=made.amplitude,
                    growth=made.growth,
                ),
            )

    def saturations(self) -> Iterator[tuple[float, RunFinding]]:
        """The saturation of this visit, if any, and the share of ticks that it takes."""
        shares = {name: share for name, share in self._at_limits() if share > LASTS}
        if shares:
            most_often = max(shares, key=lambda name: shares[name])
            share, beside = shares[most_often], tuple(n for n in shares if n != most_often)
            text = (
                f"{most_often} is at its limit in {100 * share:.0f} % of the last half of the stage"
                f"{_so_do(beside, 'is', 'are')}"
            )
            yield share, self._finding(SATURATION, most_often, beside, text, share=share)

    def _at_limits(self) -> Iterator[tuple[str, float]]:
        """Names of joints' torques and velocities, and the share of ticks they are at limits."""
        robot, columns = self._program.context.robot, self._columns
        resolution, codes = self._stage.resolution, columns.get("limits")
        limits = zip(robot.torque_limit, robot.velocity_limit, strict=True)
        for i, (torque_limit, velocity_limit) in enumerate(limits):
            torque = columns.get(f"joint.{i + 1}.torque")
            if torque is not None:
                yield f"joint.{i + 1}.torque", torque_share(torque, torque_limit)
            command = columns.get(f"joint.{i + 1}.velocity.command")
            if command is not None:
                share = torque_share(command, self._program.context.drives.most[i])
                yield f"joint.{i + 1}.velocity.command", share
            v = columns.get(f"joint.{i + 1}.velocity")
            if resolution is not None and codes is not None and v is not None:
                share = velocity_share(resolution, i, codes, v, velocity_limit)
                yield f"joint.{i + 1}.velocity", share

    def _finding(
        self, kind: str, signal: str, beside: tuple[str, ...], text: str, **numbers: float
    ) -> RunFinding:
        half = self._clock[-judged(len(self._clock)) :]
        allowed = kind in self._stage.plan.spec.allow
        start, end = float(half[0]), float(half[-1]) + self._program.context.period
        name = self._stage.name
        return RunFinding(
            kind, name, self._number, signal, beside, start, end, text, allowed, **numbers
        )

    def _watched(self) -> Iterator[_Watched]:
        least_force, least_moment = self._amid
        forces = [f"force.{axis}" for axis in TRANSLATIONS]
        moments = [f"torque.{axis}" for axis in ROTATIONS]
        least = max(LEAST_FORCE, OF_SET_POINT * self._largest(forces))
        least = max(least, least_force)
        yield from (_Watched(name, FORCE, least) for name in forces)
        least = max(LEAST_MOMENT, OF_SET_POINT * self._largest(moments))
        least = max(least, least_moment)
        yield from (_Watched(name, MOMENT, least) for name in moments)
        for name in set_points(self._columns):
            turns = name.endswith(".torque")
            least = LEAST_MOMENT if turns else LEAST_FORCE
            least = max(least, OF_SET_POINT * self._largest([name]))
            yield _Watched(name, MOMENT if turns else FORCE, least)
        speeds = [f"velocity.{axis}" for axis in TRANSLATIONS]
        least = max(LEAST_SPEED, OF_SET_POINT * self._largest(speeds))
        yield from (_Watched(name, VELOCITY, least, 1) for name in speeds)
        for i, most in enumerate(self._program.context.robot.torque_limit):
            if np.isfinite(most):
                yield _Watched(f"joint.{i + 1}.torque", MOMENT, OF_TORQUE * float(most), 2)

    def _largest(self, names: Sequence[str]) -> float:
        """The greatest size of these signals' references in the half that is analysed [SI]."""
        half = judged(len(self._clock))
        columns = [self._columns[f"{n}.ref"][-half:] for n in names if f"{n}.ref" in self._columns]
        return max((float(np.nanmax(np.abs(c), initial=0.0)) for c in columns), default=0.0)

    def _references(self) -> list[Vector]:
        """(n,) each: what moves the stage by intention, and is not made of what was measured."""
        plan, found = self._stage.plan, []
        for axis, planned in plan.plans.items():
            if not all(self._is_known(e) for e, _ in planned.axis.expressions()):
                continue
            found += [f"position.{axis}", f"velocity.{axis}"]
            # A program replaces set points that contacts do not return.
            if not np.any(self._columns.get("force_inconsistent", 0.0) > 0):
                found.append(f"{axis.effort}.{axis}")
        for name, point in plan.spec.constraints.items():
            if all(map(self._is_known, point.expressions)):
                found += [n for n in set_points(self._columns) if n.startswith(f"{name}.")]
        columns = [self._columns[f"{n}.ref"] for n in found if f"{n}.ref" in self._columns]
        return [*columns, *self._moving()]

    def _is_known(self, expression: Expression) -> bool:
        known = (*_CLOCKS, *self._program.context.loaded.task.params)
        names = (n for n in tree.walk(expression.tree) if isinstance(n, tree.Name))
        return all(len(name.path) == 1 and name.path[0] in known for name in names)

    def _moving(self) -> Iterator[Vector]:
        """(n,) each: the numbers of objects that move by themselves."""
        ticks = len(self._clock)
        for base in self._program.context.moving_bases.values():
            for number in range(2):
                rows: Vector | None = None
                for part in blocks(ticks):
                    clock = np.asarray(self._clock[part])
                    values = base.numbers.map(len(clock))(clock[np.newaxis])[number]
                    found = np.array(values).reshape(-1, len(clock), order="F")
                    rows = empty((len(found), ticks), float) if rows is None else rows
                    rows[:, part] = found
                yield from () if rows is None else rows


def _oscillates(watched: _Watched, made: Oscillation, beside: Sequence[str]) -> str:
    size, bound = (show(x, watched.dimension, 3) for x in (made.amplitude, watched.least))
    trend = "grows" if made.growth > 1 / 0.9 else "does not decay"
    return (
        f"{watched.name} oscillates at {made.frequency:.3g} Hz with an amplitude of {size}, which "
        f"{trend} ({bound} would pass){_so_do(beside, 'does', 'do')}"
    )


def _so_do(beside: Sequence[str], one: str, several: str) -> str:
    """The other signals, as the end of a sentence; empty without any."""
    if not beside:
        return ""
    named = ", ".join(beside[:_MORE])
    more = f" and {len(beside) - _MORE} more" if len(beside) > _MORE else ""
    return f"; so {one if len(beside) == 1 else several} {named}{more}"
