"""What logs say of a task's world and arm: values with intervals, and what cannot be told apart."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.compiler import compile_unchecked
from taskspec.deferred_methods import dataclass
from taskspec.program.program import Program
from taskspec.spec import LoadedTask, Task
from taskspec.text.units import Dimension, si_unit
from taskspec_runner.identify.estimate import Estimate
from taskspec_runner.identify.fit import KNOWN, Fit, LogProblem, fit
from taskspec_runner.identify.held_out import predictions
from taskspec_runner.identify.logs import check_log, open_log
from taskspec_runner.identify.model import LogModel
from taskspec_runner.identify.outside import Outside
from taskspec_runner.identify.parameters import parameters_of
from taskspec_runner.identify.residual import ChannelResidual, residuals
from taskspec_runner.record.history import History

Vector = NDArray[np.float64]

#: What is nearer to each other than this shares of a deviation is not told apart.
_TOGETHER = 0.5
#: Of a combination, what is smaller than this share of the largest is left out.
_SMALL = 0.01
LEVEL = 0.9
#: Of how far a value may plausibly be off, what it is known to at best: logs without noise leave
#: what iterations end at and differences miss.
_ARITHMETIC = 1e-7
#: Of a tick, by which a delay is longer than those that are rounded up to the one before.
_PART = 1e-3


@dataclass(frozen=True, slots=True)
class Combination:
    """A sum of parameters that is known though they are not.

    Attributes:
        coefficients: by the names of the parameters [1/SI of the parameter, relative to the first].
        value, low, high: of the sum [SI of the first].
        dimension: of the first parameter.
    """

    coefficients: Mapping[str, float]
    value: float
    low: float
    high: float
    dimension: Dimension

    def as_data(self) -> dict[str, Any]:
        """For `--format json`, in SI."""
        own = {"value": self.value, "low": self.low, "high": self.high}
        return {"coefficients": dict(self.coefficients), **own, "unit": si_unit(self.dimension)}

    @property
    def text(self) -> str:
        """As a sum, in SI."""
        parts = [f"{c:+.4g} {name}" if c != 1 else name for name, c in self.coefficients.items()]
        return " ".join(parts)


@dataclass(frozen=True, slots=True)
class Group:
    """Parameters that logs do not tell apart.

    Attributes:
        names: of them.
        known: sums of them that are known all the same.
    """

    names: tuple[str, ...]
    known: tuple[Combination, ...]

    def as_data(self) -> dict[str, Any]:
        """For `--format json`."""
        return {"names": list(self.names), "known": [each.as_data() for each in self.known]}


@dataclass(frozen=True)
class Identification:
    """What logs say of a task.

    Attributes:
        program: of the file.
        level: of all intervals.
        estimates: of what is known, in the order of the file.
        covariance: (k, k) of these but the delay's, which is 0 [SI].
        unseen: names of the parameters that no log shows anything of.
        confounded: parameters that logs do not tell apart.
        residuals: of each channel.
        held_out: of each channel of logs that nothing was identified from.
        fit: the numbers behind it.
    """

    program: Program
    level: float
    estimates: tuple[Estimate, ...]
    covariance: Vector
    unseen: tuple[str, ...]
    confounded: tuple[Group, ...]
    residuals: tuple[ChannelResidual, ...]
    held_out: tuple[ChannelResidual, ...]
    fit: Fit

    @property
    def loaded(self) -> LoadedTask:
        """The file's task."""
        return self.program.context.loaded

    @cached_property
    def task(self) -> Task:
        """The file's task with the identified values."""
        return self.fit.task

    def estimate(self, name: str) -> Estimate:
        """One by its name.

        Raises:
            KeyError: logs do not decide it.
        """
        for each in self.estimates:
            if each.name == name:
                return each
        raise KeyError(name)

    def as_data(self) -> dict[str, Any]:
        """For `--format json`, in SI."""
        return {
            "task": self.loaded.task.name,
            "level": self.level,
            "logs": [log.name for log in self.fit.problem.logs],
            "estimates": [each.as_data() for each in self.estimates],
            "covariance": self.covariance.tolist(),
            "unseen": list(self.unseen),
            "confounded": [each.as_data() for each in self.confounded],
            "residuals": [each.as_data() for each in self.residuals],
            "held_out": [each.as_data() for each in self.held_out],
        }


def identify(
    task: LoadedTask | Program,
    logs: Sequence[Path | History],
    what: Sequence[str] | None = None,
    level: float = LEVEL,
    columns: Path | None = None,
    progress: Callable[[str], None] = lambda _: None,
    held_out: Sequence[Path | History] = (),
) -> Identification:
    """Identifies values of a task's world and arm from logs, with intervals.

    Args:
        task: the file; its `truth` is not used.
        logs: folders of runs, CSV, Parquet or MCAP files, or the ticks themselves.
        what: paths, or beginnings of paths; None for all that the logs show.
        level: of the intervals.
        columns: the column map of files, or the name of a ready one.
        progress: is called with what is being done.
        held_out: logs that are not identified from, and of which it is predicted what they read.

    Raises:
        SpecError: the task does not compile.
        InputError: a log cannot be used, or a path names nothing.
    """
    program = task if isinstance(task, Program) else compile_unchecked(task)
    wanted = parameters_of(program, what)
    used, kept = (
        [_model(program, log, f"{word} {i}", columns, progress) for i, log in enumerate(given, 1)]
        for word, given in (("log", logs), ("held-out log", held_out))
    )
    found = fit(LogProblem(program, used, wanted), progress)
    predicted = tuple(each for log in kept for each in predictions(found, log))
    return _identification(program, found, level, predicted)


def _model(
    program: Program,
    log: Path | History,
    name: str,
    columns: Path | None,
    progress: Callable[[str], None],
) -> LogModel:
    """A log with its model, named by its path where it has one."""
    name = name if isinstance(log, History) else str(log)
    progress(f"reading {name}")
    if isinstance(log, History):
        check_log(program, log, name)
    history = log if isinstance(log, History) else open_log(program, log, columns)
    return LogModel(program, history, name)


def _identification(
    program: Program, found: Fit, level: float, held_out: tuple[ChannelResidual, ...]
) -> Identification:
    problem = found.problem
    count = len(problem.continuous)
    scales = problem.scales
    inverse, _ = found.posterior()
    known = found.known[:count]
    own = 1 / np.sqrt(np.maximum(np.diag(found.information)[:count], 1e-300))
    unseen = ~known & (own > KNOWN)
    mixed = ~known & ~unseen
    outside = Outside(problem, found, known)
    slopes = outside.slopes
    inside = (inverse * np.outer(scales, scales))[:count, :count]
    of_noise, arithmetic = slopes @ inside @ slopes.T, _ARITHMETIC * scales[:count]
    covariance = of_noise + np.diag(arithmetic**2)
    quantile = NormalDist().inv_cdf(0.5 + level / 2)
    estimates = []
    for i, parameter in enumerate(problem.continuous):
        if known[i]:
            noise = max(float(of_noise[i, i]), 0.0) ** 0.5
            estimates.append(outside.estimate(i, parameter, noise, float(arithmetic[i]), quantile))
    rows = np.flatnonzero(known)
    kept = covariance[np.ix_(rows, rows)]
    late = [] if problem.delay is None else [problem.delay.name]
    if found.delay is not None and problem.delay is not None:
        span = (max(found.delays) - min(found.delays)) * problem.period
        if span / 2 < KNOWN * problem.delay.scale:
            estimates.append(_delay(problem, found))
            kept, late = np.pad(kept, (0, 1)), []
    order = [p.name for p in problem.parameters]
    ranked = sorted(range(len(estimates)), key=lambda i: _rank(order, estimates[i]))
    names = outside.names
    return Identification(
        program,
        level,
        tuple(estimates[i] for i in ranked),
        kept[np.ix_(ranked, ranked)],
        (*(names[i] for i in np.flatnonzero(unseen)), *late),
        tuple(_groups(mixed, inverse, outside, problem, quantile)),
        tuple(
            each
            for block, noises in zip(found.blocks, found.noises, strict=True)
            for each in residuals(found.task, problem.logs[block.log], block, noises)
        ),
        held_out,
        found,
    )


def _rank(order: Sequence[str], estimate: Estimate) -> int:
    name = estimate.path if estimate.index is None else f"{estimate.path}.{estimate.index}"
    return order.index(name)


def _delay(problem: LogProblem, found: Fit) -> Estimate:
    """The delay, which is counted in ticks: all delays that are rounded up to them read alike."""
    assert problem.delay is not None
    assert found.delay is not None
    period = problem.period
    # A delay is rounded up to ticks: a whole number of them is the longest that reads so.
    low = max(min(found.delays) - 1 + _PART, 0.0) * period
    return Estimate(
        problem.delay.path, None, "", found.delay * period, low, max(found.delays) * period,
        period / 12**0.5, problem.delay.declared, problem.delay.dimension, len(found.delays) == 1,
    )  # fmt: skip


def _groups(
    mixed: NDArray[np.bool_],
    inverse: Vector,
    outside: Outside,
    problem: LogProblem,
    quantile: float,
) -> list[Group]:
    """Parameters that are not known, in groups that what is known of them ties together."""
    rows = [int(i) for i in np.flatnonzero(mixed)]
    size = np.sqrt(np.diag(inverse))
    groups: list[Group] = []
    while rows:
        group, waiting = [], [rows.pop(0)]
        while waiting:
            at = waiting.pop()
            group.append(at)
            tied = [r for r in rows if abs(inverse[at, r]) > _TOGETHER * size[at] * size[r]]
            rows = [r for r in rows if r not in tied]
            waiting += tied
        group.sort()
        names = tuple(outside.names[i] for i in group)
        groups.append(
            Group(names, tuple(_combinations(group, inverse, outside, problem, quantile)))
        )
    return groups


def _combinations(
    group: Sequence[int], inverse: Vector, outside: Outside, problem: LogProblem, quantile: float
) -> list[Combination]:
    """Sums of parameters of a group that are known, each in echelon form."""
    part = inverse[np.ix_(group, group)]
    shares, directions = np.linalg.eigh(part)
    known = directions[:, shares < KNOWN**2].T
    made = _echelon(known)
    found = []
    for row in made:
        scales = problem.scales[list(group)]
        # In units of the scales sum c_i x_i; in SI c_i / s_i.
        si = row / scales
        first = int(np.argmax(np.abs(row) > _SMALL * np.abs(row).max()))
        si = si / si[first]
        deviation = float(np.sqrt(row @ part @ row)) * abs(scales[first] / row[first])
        names = [outside.names[i] for i in group]
        used = np.abs(row) > _SMALL * np.abs(row).max()
        value = float(
            sum(c * outside.found[i] for c, i, u in zip(si, group, used, strict=True) if u)
        )
        found.append(
            Combination(
                {n: float(c) for n, c, u in zip(names, si, used, strict=True) if u},
                value, value - quantile * deviation, value + quantile * deviation,
                problem.continuous[group[first]].dimension,
            )
        )  # fmt: skip
    return found


def _echelon(rows: Vector) -> Vector:
    """Reduced row echelon form, by the largest pivots."""
    made, at = rows.copy(), 0
    for column in range(made.shape[1]):
        if at >= len(made):
            break
        pivot = at + int(np.argmax(np.abs(made[at:, column])))
        if abs(made[pivot, column]) < _SMALL:
            continue
        made[[at, pivot]] = made[[pivot, at]]
        made[at] /= made[at, column]
        for other in range(len(made)):
            if other != at:
                made[other] -= made[other, column] * made[at]
        at += 1
    return made[:at]
