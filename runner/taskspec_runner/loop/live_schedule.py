"""Live params that are set at times which are known beforehand: `press = 8 N @ 1 s`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from taskspec.deferred_methods import dataclass
from taskspec.expression import ExpressionError, FloatAlgebra, Scope, ScopeKind, check, evaluate
from taskspec.expression.parse import parse
from taskspec.expression.scope import CONSTANTS
from taskspec.expression.tree import Name
from taskspec.program.execution.live_params import LiveParams
from taskspec.spec import Task
from taskspec.spec.params import slots_of
from taskspec.text.suggest import suggestion
from taskspec.text.units import TIME, Dimension, describe, fitting, show, si_unit
from taskspec_runner.errors import InputError
from taskspec_runner.record.folder import is_manifest, read_json
from taskspec_runner.record.names import MANIFEST

_FORM = "such as 'press = 8 N @ 1 s'"
#: Of a period: a time that is so little before a tick is that of the tick.
_AT_A_TICK = 1e-6


@dataclass(frozen=True, slots=True)
class LiveMove:
    """A live param that is set.

    Attributes:
        name: of the param.
        value: what it is set to [SI].
        clock: run time of the first tick that knows it [s].
        dimension: of the param.
    """

    name: str
    value: float
    clock: float
    dimension: Dimension

    def __str__(self) -> str:
        """As `read_move` takes it, to the last bit."""
        unit = si_unit(self.dimension)
        return f"{self.name} = {f'{self.value!r} {unit}'.rstrip()} @ {self.clock!r} s"

    def tick(self, period: float) -> int:
        """The number of the first tick that knows it, by the period of control [s]."""
        return math.ceil(self.clock / period - _AT_A_TICK)


def read_move(text: str, task: Task) -> LiveMove:
    """The move that a line says.

    Args:
        text: a name, `=`, a value, `@`, and a run time; it may use params of the task.
        task: that has the param.

    Raises:
        InputError: it says none, or one that the task does not allow.
    """
    name, equals, rest = (part.strip() for part in text.partition("="))
    value, at, clock = (part.strip() for part in rest.rpartition("@"))
    if not (equals and at and name and value and clock):
        raise InputError(f"--live {text!r} does not say what is set to what, and when; {_FORM}")
    if name not in task.live:
        raise InputError(f"--live {text!r}: {name!r} cannot be set: {_why_not(name, task)}")
    param = task.live[name]
    found = LiveMove(
        name,
        read_value(f"--live {text!r}", value, param.dimension, task),
        read_value(f"--live {text!r}", clock, TIME, task),
        param.dimension,
    )
    if not param.low <= found.value <= param.high:
        unit = next(iter(fitting(param.dimension)), "")
        bounds = f"{show(param.low, unit)} to {show(param.high, unit)}"
        raise InputError(f"--live {text!r}: {name!r} may be {bounds}")
    if found.clock < 0:
        raise InputError(f"--live {text!r}: a run begins at 0 s")
    return found


def _why_not(name: str, task: Task) -> str:
    """Why a name is none of a live param."""
    if name not in task.params:
        known = suggestion(name, task.live, "live are") if task.live else "it has none"
        return f"the task has no live param of that name; {known}"
    if task.params[name].live:
        used = slots_of(task.params, Name((name,)))
        return f"it follows from {' and '.join(sorted(used))}, which can be"
    return f"its value is fixed; write {name}: {{value: .., live: a..b}} in 'params'"


def read_value(place: str, text: str, dimension: Dimension, task: Task) -> float:
    """The value of a part of a line or of a request [SI].

    Args:
        place: where it stands, for the message.
        text: an expression of numbers and params.
        dimension: that it has to have.
        task: that has the params.

    Raises:
        InputError: it is none.
    """
    try:
        node = parse(text, "sum")
    except ExpressionError as error:
        raise InputError(f"{place}: {error}") from None
    checked = check(node, Scope(ScopeKind.CONSTANT, task.params), dimension)
    if checked.problems:
        first = checked.problems[0]
        hint = f"; {first.hint}" if first.hint else ""
        raise InputError(f"{place}: {first.message}{hint}")

    def lookup(name: Name) -> float:
        named = str(name)
        return task.params[named].value if named in task.params else CONSTANTS[named][0]

    value = evaluate(checked.tree, FloatAlgebra(), lookup)
    if not math.isfinite(value):
        raise InputError(f"{place}: {text!r} is not {describe(dimension)}")
    return value


class LiveSchedule:
    """Sets live params at times that are known before the run.

    Attributes:
        moves: in the order in which they come; of two at one tick the later line counts.
    """

    def __init__(self, moves: Iterable[LiveMove], period: float) -> None:
        """Takes the moves; `period` is that of control [s]."""
        self.moves: Sequence[LiveMove] = sorted(moves, key=lambda move: move.tick(period))
        self._ticks = [move.tick(period) for move in self.moves]
        self._next = 0

    def set(self, live: LiveParams, ticks: int) -> int | None:
        """Sets what is due before the tick after `ticks` ones; see `Hand`."""
        while self._next < len(self.moves) and self._ticks[self._next] <= ticks:
            move = self.moves[self._next]
            live.set(move.name, move.value)
            self._next += 1
        return None if self._next == len(self.moves) else self._ticks[self._next] - ticks

    @property
    def lines(self) -> tuple[str, ...]:
        """Those that have been made, as they are read."""
        return tuple(map(str, self.moves[: self._next]))

    @property
    def left(self) -> tuple[str, ...]:
        """Those that have not."""
        return tuple(map(str, self.moves[self._next :]))


def scheduled(lines: Sequence[str], task: Task, period: float) -> LiveSchedule | None:
    """The schedule of some lines; None where there are none.

    Args:
        lines: each a move, or the folder of a run whose moves are to be made again.
        task: that has the params.
        period: of control [s].

    Raises:
        InputError: as `read_move`, or a run has kept no moves.
    """
    if not lines:
        return None
    known = [each for line in lines for each in ([line] if "=" in line else _kept(line))]
    return LiveSchedule([read_move(each, task) for each in known], period)


def _kept(folder: str) -> list[str]:
    """The lines of a run's folder."""
    path = Path(folder) / MANIFEST
    if not is_manifest(path):
        raise InputError(f"--live {folder!r} is neither the folder of a run nor a move, {_FORM}")
    found = read_json(path).get("live")
    if not isinstance(found, list) or not all(isinstance(line, str) for line in found):
        raise InputError(f"--live {folder!r}: no live params were set in that run")
    return found
