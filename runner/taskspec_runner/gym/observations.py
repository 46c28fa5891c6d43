"""Observations: named signals of the newest ticks, each with its bounds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.expression import Meaning, Scope, ScopeKind, resolve
from taskspec.expression.tree import Name
from taskspec.expression.unknown import explain_name
from taskspec.program.ports import HEALTHY
from taskspec.program.program import Program
from taskspec.signals import CLOCKS, SCALARS, VECTORS
from taskspec.spec import Task
from taskspec.text.suggest import suggestion
from taskspec.text.units import si_unit
from taskspec_runner.errors import InputError
from taskspec_runner.gym.true_values import TrueValues, Values, values_of
from taskspec_runner.record.bus import Bus
from taskspec_runner.record.layout import LogLayout
from taskspec_runner.record.named import column_of, scope_of

Vector = NDArray[np.float64]

#: What the end of a name means: as it truly is.
TRUE = ".true"
#: Which stage it is: one number for each stage, 1 for the current one.
STAGE = "stage"
#: What has no bound is no larger than this in a sane run [SI].
UNBOUNDED = math.sqrt(HEALTHY)
_LIVE = "param"


@dataclass(frozen=True, slots=True)
class Observed:
    """One number of an observation.

    Attributes:
        name: of the signal, as an observation names it.
        unit: empty for plain numbers.
        low, high: its bounds, infinite where it has none.
        ticks: how many of its newest values there are, one beside the other.
        place: where a tick has it; None where it is worked out.
        column: what is worked out, as the log names it.
        true: whether it is the truth, of a world.
        stage: number of the stage for which it is 1; None of any other.
    """

    name: str
    unit: str
    low: float
    high: float
    ticks: int = 1
    place: int | None = None
    column: str = ""
    true: bool = False
    stage: int | None = None


class Observations:
    """What an episode shows of its newest ticks.

    Attributes:
        observed: in their order.
        names: of every number, in the order of the vector; of several ticks the oldest first.
        space: of the vector.
        ticks: how many of the newest ticks are needed.
    """

    def __init__(
        self, program: Program, wanted: Sequence[str] | Mapping[str, int] | None, longest: float
    ) -> None:
        """Finds the signals.

        Args:
            program: of the task.
            wanted: their names, or a mapping of names to how many of the newest ticks are shown;
                None for the usual ones.
            longest: an episode lasts no longer [s]; infinite where nothing bounds it.

        Raises:
            InputError: there is no such signal, or the robot does not measure it.
        """
        task, robot = program.context.loaded.task, program.context.robot
        self._program, self._task = program, task
        self._layout = LogLayout.of(program, task)
        self._bounds = _Bounds(program, longest)
        if isinstance(wanted, str):
            raise InputError(f"observe is a list or a mapping: observe=[{wanted!r}]")
        if not isinstance(wanted, Iterable | None):
            raise InputError(f"observe is a list or a mapping: observe=['force'], not {wanted!r}")
        named = usual(program) if wanted is None else wanted
        ticks = named if isinstance(named, Mapping) else dict.fromkeys(named, 1)
        self.observed = tuple(self._all(ticks))
        if not self.observed:
            raise InputError("an observation needs a signal: such as observe=['force', 'position']")
        self.ticks = max(each.ticks for each in self.observed)
        self.names = tuple(
            each.name if each.ticks == 1 else f"{each.name}[{k - each.ticks + 1}]"
            for each in self.observed
            for k in range(each.ticks)
        )
        counts = [each.ticks for each in self.observed]
        bounds = np.array([(each.low, each.high) for each in self.observed])
        bounds = np.clip(bounds, -UNBOUNDED, UNBOUNDED).astype(np.float32)
        low, high = np.repeat(bounds, counts, axis=0).T
        self.space = spaces.Box(low, high, dtype=np.float32)
        self._low, self._high = low, high
        fields = Bus(robot.n, task).slices
        self._stage = fields["stage"].start
        self._fields = max(each.stop for each in fields.values())
        self._measured = tuple(dict.fromkeys(self._worked_out(true=False)))
        self._true = tuple(dict.fromkeys(self._worked_out(true=True)))
        self._values = (
            values_of(program, task, self._measured, measured=True) if self._measured else None
        )
        self._of_world = TrueValues(program, self._true)
        self._at = self._places()
        self._row_of: dict[int, NDArray[np.intp]] = {}

    def _worked_out(self, *, true: bool) -> Iterator[str]:
        return (each.column for each in self.observed if each.column and each.true is true)

    def _places(self) -> NDArray[np.intp]:
        """Where each number is among a tick's: those of the bus, then those worked out."""
        shown = {name: self._fields + i for i, name in enumerate(self._measured)}
        true = {name: self._fields + len(shown) + i for i, name in enumerate(self._true)}
        stages = self._fields + len(shown) + len(true)
        found = []
        for each in self.observed:
            if each.stage is not None:
                place = stages + each.stage
            elif each.place is not None:
                place = each.place
            else:
                place = (true if each.true else shown)[each.column]
            found += [place] * each.ticks
        return np.array(found)

    def _rows(self, ticks: int) -> NDArray[np.intp]:
        """Which of some ticks each number is of."""
        found = self._row_of.get(ticks)
        if found is None:
            back = [k - each.ticks for each in self.observed for k in range(each.ticks)]
            found = self._row_of[ticks] = np.array(back) + ticks
        return found

    def of_world(self, task: Task) -> ObservedTicks:
        """What shows the ticks of an episode in the world of a task."""
        return ObservedTicks(self, self._of_world.of(task))

    def _all(self, named: Mapping[str, int]) -> Iterator[Observed]:
        there: set[str] = set()
        for written, ticks in named.items():
            if not isinstance(written, str):
                raise InputError(f"observe: {written!r} is no name of a signal, such as 'force'")
            if not isinstance(ticks, int) or ticks < 1:
                raise InputError(f"observe: {written!r} is of one tick or more, not {ticks!r}")
            for each in self._named(written, ticks):
                if each.name not in there:
                    there.add(each.name)
                    yield each

    def _named(self, written: str, ticks: int) -> Iterator[Observed]:
        """The numbers that a name means: a bare vector means all of its components."""
        if written == STAGE:
            for i, stage in enumerate(self._program.stages):
                yield Observed(f"{STAGE}.{stage.name}", "", 0.0, 1.0, 1, stage=i)
            return
        name, true = written.removesuffix(TRUE), written.endswith(TRUE)
        for path in self._members(tuple(name.split("."))):
            yield self._one(path, ticks, true=true)

    def _members(self, path: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
        columns, robot = self._layout.units, self._program.context.robot
        match path:
            case (vector,) if vector in VECTORS:
                axes = [a for a in VECTORS[vector].axes if f"{vector}.{a}" in columns]
                yield from ((vector, str(axis)) for axis in axes)
            case (vector, "ref") if vector in VECTORS:
                axes = [a for a in VECTORS[vector].axes if f"{vector}.{a}.ref" in columns]
                yield from ((vector, str(axis), "ref") for axis in axes)
            case ("joint", kind) if not kind.isdigit():
                yield from (("joint", str(i + 1), kind) for i in range(robot.n))
            case ("param",):
                yield from ((_LIVE, name) for name in self._task.live)
            case _:
                yield path

    def _one(self, path: tuple[str, ...], ticks: int, *, true: bool) -> Observed:
        name, column = ".".join(path), ".".join(path)
        places = self._layout.fields_of_columns
        if path[0] == _LIVE and len(path) == 2:
            live = self._task.live
            if path[1] not in live:
                hint = suggestion(path[1], live, "live params")
                raise InputError(f"observe: there is no live param {path[1]!r}; {hint}")
            found = live[path[1]]
            unit = si_unit(found.dimension)
            return Observed(name, unit, found.low, found.high, ticks, places[column])
        meaning = self._meaning(path, name, true=true)
        low, high = self._bounds.of(meaning)
        unit = si_unit(meaning.dimension)
        column = column_of(meaning)
        shown = f"{name}{TRUE}" if true else name
        place = self._place(column, true=true)
        worked_out = "" if place is not None else column
        return Observed(shown, unit, low, high, ticks, place, worked_out, true)

    def _place(self, column: str, *, true: bool) -> int | None:
        """Where a tick has a signal as it is; None where it is worked out."""
        measured = f"{column}.measured"
        known = measured if measured in self._layout.units and not true else column
        return self._layout.place(known)

    def _unknown(self, path: tuple[str, ...], name: str, scope: Scope) -> str:
        """Why a name is no signal of a tick."""
        if path[0] in self._task.stages and len(path) > 1:
            rest = ".".join(path[1:])
            instead = f"'{STAGE}' is which one it is"
            own = "visits are for guards" if rest == "visits" else f"write '{rest}'"
            return f"{name!r} names a stage: {own}, and {instead}"
        if len(path) == 1:
            known = [*VECTORS, *SCALARS, *CLOCKS, STAGE, "param", "joint.position"]
            if name in self._task.live:
                return f"{name!r} is a live param: write '{_LIVE}.{name}'"
            return f"unknown signal {name!r}; {suggestion(name, known, 'signals')}"
        problem = explain_name(Name(path, start=0, end=len(name)), scope)
        return problem.message + (f"; {problem.hint}" if problem.hint else "")

    def _meaning(self, path: tuple[str, ...], name: str, *, true: bool) -> Meaning:
        """What a name means, which is a number of a tick."""
        # Set points are the controller's: it knows them as they are.
        scope = scope_of(self._task, ScopeKind.REWARD)
        meaning = resolve(path, scope)
        if meaning is None or meaning.kind in ("param", "constant", "link"):
            raise InputError(f"observe: {self._unknown(path, name, scope)}")
        signal, column = meaning.signal, column_of(meaning)
        if column not in self._layout.units:
            raise InputError(f"observe: {name!r} is not among the columns of this task's log")
        unmeasured = signal.unmeasured if signal is not None else ""
        if meaning.subject in self._task.mechanisms:
            unmeasured = "the robot does not measure mechanisms"
        if unmeasured and not true and meaning.kind != "gain":
            text = f"observe: {name!r} is not measured: {unmeasured}"
            raise InputError(f"{text}; as it truly is: '{name}{TRUE}'")
        return meaning


class ObservedTicks:
    """Shows the ticks of one episode."""

    def __init__(self, what: Observations, true: Values | None) -> None:
        self._what, self._true = what, true

    def __call__(self, rows: Vector) -> NDArray[np.float32]:
        """The observation, of the newest ticks (n, fields), which `ticks` says how many are.

        What has no value at a tick is 0; a value beyond its bounds is at the nearest one.
        """
        what = self._what
        parts = [rows]
        if what._values is not None:
            parts.append(what._values(rows))
        if self._true is not None:
            parts.append(self._true(rows))
        number = len(what._program.stages)
        if any(each.stage is not None for each in what.observed):
            parts.append(np.equal(rows[:, what._stage, np.newaxis], np.arange(number)))
        whole = np.hstack(parts) if len(parts) > 1 else rows
        found = whole[what._rows(len(rows)), what._at].astype(np.float32)
        np.nan_to_num(found, copy=False, nan=0.0)
        return np.clip(found, what._low, what._high, out=found)


class _Bounds:
    """The bounds of signals, as the file and the robot have them."""

    def __init__(self, program: Program, longest: float) -> None:
        self._task, self._robot = program.context.loaded.task, program.context.robot
        self._longest = longest

    def of(self, meaning: Meaning) -> tuple[float, float]:
        """From the least to the greatest value [SI]; infinite where there is no bound."""
        signal = meaning.signal
        if signal is None:
            return -math.inf, math.inf
        if meaning.kind == "clock":
            return 0.0, self._longest
        if meaning.kind == "joint":
            return self._of_joint(meaning.name, int(meaning.subject or 1) - 1)
        low, high = signal.low, signal.high
        turns = meaning.axis is not None and meaning.axis.startswith("r")
        # A limit of the file bounds a vector's translations; that of a moment all of it.
        if signal.limit and (not turns or signal.limit == "torque"):
            most = self._limit(signal.limit)
            low, high = max(low, -most), min(high, most)
        return low, high

    def _limit(self, name: str) -> float:
        """The greatest of a limit over all stages; infinite where one has none."""
        task = self._task
        found = [getattr(task.limits_of(stage), name) for stage in task.stages.values()]
        return max(math.inf if each is None else float(each) for each in found)

    def _of_joint(self, name: str, i: int) -> tuple[float, float]:
        robot = self._robot
        if name == "position":
            return float(robot.lower[i]), float(robot.upper[i])
        most = robot.velocity_limit if name == "velocity" else robot.torque_limit
        return -float(most[i]), float(most[i])


def usual(program: Program) -> tuple[str, ...]:
    """What is shown where nothing is named: force, motion, live params and the stage."""
    task = program.context.loaded.task
    live = ("param",) if task.live else ()
    return ("force", "torque", "position", "velocity", *live, STAGE, "t")
