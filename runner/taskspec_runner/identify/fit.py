"""Maximum likelihood of a world's parameters, given what logs have: Gauss and Newton's iterations.

What is left of each channel beside the model is an autoregression (`noise`), estimated with the
parameters in turn. With e the residuals of a channel made white, of unit size, and J their
derivatives by the parameters, the information that the logs have is M = sum J'J over all ticks and
channels. Parameters go by their scale: what a direction of them is known to, less exactly than a
share of the scales, stays as the file has it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.rotation import from_rpy
from taskspec.program.program import Program
from taskspec.program.sensor import SensorModel
from taskspec.spec import Task
from taskspec.spec.robot import Payload
from taskspec_runner.identify.joints import FreeJoints
from taskspec_runner.identify.model import LogModel, mobility
from taskspec_runner.identify.noise import ChannelNoise
from taskspec_runner.identify.parameters import (
    BIAS,
    DELAY,
    FILTER,
    PAYLOAD,
    Parameter,
    owner_of,
)
from taskspec_runner.identify.poses import placed

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: A direction that is known to less than this share of the parameters' scales is not known.
KNOWN = 0.3
#: What the file says counts as one measurement, with so many scales for its deviation.
WEAK = 3.0
#: With so many times the deviation for what the file says, what logs decide changes by no more.
_WEAKER, _BY_LOGS = 10.0, 1.1
_MOST_STEPS, _FEW_STEPS = 60, 12
#: Steps that are this share of the deviations end the iterations.
_SMALL = 1e-3
#: Of a parameter's scale, by which differences are taken.
_DIFFERENCE = 1e-6
#: What changes readings by less than this share of the largest is a matter of their last digits.
_UNSEEN = 1e-5
#: The longest delay that is tried [s], in addition to the declared one.
_LONGEST_DELAY = 0.1
WRENCH, JOINT = "wrench", "joint"
#: Beginnings of the paths that the torques of joints say something of.
OF_JOINTS = (PAYLOAD, "robot.joint_")


@dataclass(frozen=True)
class Channels:
    """Channels of one log.

    Attributes:
        log: number of the log.
        of: `wrench`, what the sensor shows, or `joint`, what moves the joints.
        measured: (n, channels).
        predicted: (n, channels).
        slopes: (parameters, n, channels) derivatives of what is predicted.
        present: (n, channels).
        rows: (n,) ticks of the log.
    """

    log: int
    of: str
    measured: Vector
    predicted: Vector
    slopes: Vector
    present: Mask
    rows: NDArray[np.int64]

    @property
    def left(self) -> Vector:
        """(n, channels) what the model does not explain."""
        return np.where(self.present, self.measured - self.predicted, 0.0)


@dataclass(frozen=True)
class TareZero:
    """What a tare left as the sensor's zero: a number that no file has.

    Attributes:
        log: number of the log.
        epoch: number of tares before it.
        component: of the six.
    """

    log: int
    epoch: int
    component: int


class LogProblem:
    """Logs, and the parameters that they are to decide.

    Attributes:
        program: of the task, as the file has it.
        logs: with their models.
        parameters: that are wanted.
        zeros: nuisance parameters, one for each tare and component.
        joints: of each log, once it is known where nothing touches; None without.
        metric: the world by whose inertia torques are weighed, and by whose friction joints slide;
            None for that of the values.
    """

    def __init__(
        self, program: Program, logs: Sequence[LogModel], parameters: Sequence[Parameter]
    ) -> None:
        self.program, self.logs = program, tuple(logs)
        self.metric: Task | None = None
        self.joints: list[FreeJoints | None] = [None] * len(self.logs)
        self._mobilities: dict[Payload | None, float] = {}
        self.parameters = tuple(parameters)
        self.zeros = tuple(
            TareZero(number, epoch, component)
            for number, log in enumerate(self.logs)
            for epoch in range(1, log.epochs + 1)
            for component in range(6)
        )
        self.delay = next((p for p in parameters if p.path == DELAY), None)
        self.continuous = tuple(p for p in parameters if p.path != DELAY)

    def mobility(self, task: Task) -> float:
        """The tool's, as MuJoCo counts it, with what it carries in a world [1/kg]."""
        load = task.robot.payload
        if load not in self._mobilities:
            self._mobilities = {load: mobility(self.program, task)}
        return self._mobilities[load]

    @cached_property
    def scales(self) -> Vector:
        """(p,) of all continuous parameters and zeros."""
        zeros = [5.0 if z.component < 3 else 0.5 for z in self.zeros]
        return np.array([p.scale for p in self.continuous] + zeros)

    @cached_property
    def least(self) -> Vector:
        """(p,) what values are at least."""
        found = np.full(len(self.scales), -np.inf)
        for i, parameter in enumerate(self.continuous):
            if parameter.path.endswith(".stiffness"):
                found[i] = max(1e-3 * abs(parameter.declared), 1.0)
            elif parameter.path.endswith(".friction") or parameter.path == FILTER:
                found[i] = 0.0
        return found

    @cached_property
    def declared(self) -> Vector:
        """(p,) what the file has."""
        return np.array([p.declared for p in self.continuous] + [0.0] * len(self.zeros))

    def task(self, values: Vector, delay: float | None = None) -> Task:
        """The world of some values."""
        task = self.program.context.loaded.task
        for parameter, value in zip(self.continuous, values, strict=False):
            if not parameter.moves and value != parameter.declared:
                task = parameter.put(task, float(value))
        for name in self.moving:
            task = self._placed(task, name, values)
        if self.delay is not None and delay is not None:
            task = self.delay.put(task, delay)
        return task

    def _placed(self, task: Task, name: str, values: Vector) -> Task:
        """A task with one object where some values have it."""
        by = np.zeros(6)
        for row, number in self.moving[name].items():
            by[row] = values[number]
        return placed(task, name, by) if by.any() else task

    def _but(self, task: Task, values: Vector, number: int, value: float) -> Task:
        """The world of some values, with one of them changed."""
        parameter = self.continuous[number]
        if not parameter.moves:
            return parameter.put(task, value)
        other = values.copy()
        other[number] = value
        nominal = self.program.context.loaded.task
        name = owner_of(parameter)
        own, declared = task.shapes[name], nominal.shapes[name]
        back = own.model_copy(update={"xyz": declared.xyz, "rpy": declared.rpy})
        at_home = task.model_copy(update={"world": {**task.world, name: back}})
        return self._placed(at_home, name, other)

    @cached_property
    def moving(self) -> dict[str, dict[int, int]]:
        """Of each object that is placed anew: row of its displacement -> number of a parameter."""
        found: dict[str, dict[int, int]] = {}
        for number, parameter in enumerate(self.continuous):
            if parameter.moves:
                row = (parameter.index or 0) + 3 * parameter.path.endswith(".rpy")
                found.setdefault(owner_of(parameter), {})[row] = number
        return found

    def taken(self, words: Sequence[str], *, zeros: bool) -> Mask:
        """(p,) the parameters in whose path one of some words is; with or without all zeros."""
        found = [any(word in each.path for word in words) for each in self.continuous]
        return np.array(found + [zeros] * len(self.zeros), dtype=bool)

    @property
    def period(self) -> float:
        """Of control [s]."""
        return self.program.context.period

    @property
    def weighed(self) -> bool:
        """Whether the sensor measures what the tool weighs."""
        return self.program.context.loaded.task.robot.sensor.at == "wrist"

    def blocks(
        self,
        values: Vector,
        delay: float | None,
        *,
        by: Mask | None = None,
        of: Sequence[str] = (WRENCH, JOINT),
    ) -> list[Channels]:
        """What logs have beside what a world makes of them.

        Args:
            values: (p,) of parameters and zeros.
            delay: of the sensor [s]; None for the declared one.
            by: (p,) the parameters whose derivatives are wanted; None for none.
            of: which channels.
        """
        task = self.task(values, delay)
        by = np.zeros(len(self.scales), dtype=bool) if by is None else by
        found = []
        for number, log in enumerate(self.logs):
            if WRENCH in of:
                found.append(self._wrench(number, log, task, values, by))
            joints = self.joints[number] if JOINT in of else None
            if joints is not None:
                found.append(self._joints(number, joints, task, values, by))
        return found

    def _wrench(self, number: int, log: LogModel, task: Task, values: Vector, by: Mask) -> Channels:
        tool = self.mobility(task)
        contacts = log.contacts(task, tool)
        total = sum(contacts.values(), np.zeros((log.ticks, 6)))
        own = log.own(total, task)
        alone = log.shown(own, task)
        constants = self._constants(number, log)
        shown = alone + self._fixed_bias(log)
        for i, constant in constants:
            shown = shown + values[i] * constant
        slopes = np.zeros((int(by.sum()), log.ticks, 6))
        rows = {int(i): row for row, i in enumerate(np.flatnonzero(by))}
        for i, constant in constants:
            if by[i]:
                slopes[rows[i]] = constant
        for i, parameter in enumerate(self.continuous):
            heeded = self.weighed or not parameter.path.startswith(PAYLOAD)
            if parameter.path != BIAS and by[i] and heeded:
                step = _DIFFERENCE * max(self.scales[i], abs(values[i]))
                changed = self._but(task, values, i, values[i] + step)
                other = self._changed(log, changed, task, total, contacts, own, parameter)
                if other is not None:
                    slopes[rows[i]] = self._heeded((other - alone) / step, i, alone)
        readings = log.readings
        present = np.isfinite(readings)
        late = SensorModel.of(task.robot.sensor, log.period)
        present[: 2 + late.delay_ticks + late.hold_ticks] = False
        if late.hold_ticks > 1:
            at = np.arange(log.ticks) + 1 - late.delay_ticks
            present &= (at % late.hold_ticks == 0)[:, None]
        return Channels(number, WRENCH, readings, shown, slopes, present, np.arange(log.ticks))

    def _joints(
        self, number: int, log: FreeJoints, task: Task, values: Vector, by: Mask
    ) -> Channels:
        sliding, n = None, log.exerted.shape[1]
        if self.slides:
            known = (task if self.metric is None else self.metric).robot.joint_friction
            sliding = log.sliding(np.broadcast_to(np.abs(known), n))
        world = log.world(task)
        metric = world[0] if self.metric is None else log.world(self.metric)[0]
        accelerated = log.accelerated(world, sliding)
        slopes = np.zeros((int(by.sum()), *accelerated.shape))
        for row, i in enumerate(np.flatnonzero(by)):
            if i < len(self.continuous) and self.continuous[i].path.startswith(OF_JOINTS):
                step = _DIFFERENCE * max(self.scales[i], abs(values[i]))
                other = log.world(self._but(task, values, int(i), values[i] + step))
                change = log.accelerated(other, sliding) - accelerated
                slope = (metric @ (change / step)[..., None])[..., 0]
                slopes[row] = self._heeded(slope, int(i), log.exerted)
        predicted = log.exerted - log.left(metric, accelerated)
        there = np.ones_like(predicted, dtype=bool) if sliding is None else sliding
        return Channels(number, JOINT, log.exerted, predicted, slopes, there, log.rows)

    def _heeded(self, slope: Vector, number: int, of: Vector) -> Vector | float:
        """A derivative; nothing where all that a parameter may plausibly be off hardly shows."""
        seen = np.abs(slope).max(initial=0.0) * self.scales[number]
        return slope if seen > _UNSEEN * np.abs(of).max(initial=0.0) else 0.0

    @cached_property
    def joints_wanted(self) -> bool:
        """Whether torques of the joints say something of what is wanted."""
        return any(p.path.startswith(OF_JOINTS) for p in self.continuous)

    @cached_property
    def slides(self) -> bool:
        """Whether joints have friction, or may have."""
        nominal = np.any(self.program.context.loaded.task.robot.joint_friction)
        return bool(nominal) or any(p.path == "robot.joint_friction" for p in self.continuous)

    def _changed(
        self,
        log: LogModel,
        changed: Task,
        task: Task,
        total: Vector,
        contacts: dict[str, Vector],
        own: Vector,
        parameter: Parameter,
    ) -> Vector | None:
        """(ticks, 6) readings with one parameter changed; None where they are the same."""
        tool = self.mobility(changed)
        if parameter.path.startswith("world."):
            owner = owner_of(parameter)
            difference = log.contact(owner, changed, tool) - contacts[owner]
            if not difference.any():
                return None
            return log.shown(log.own(total + difference, task), task)
        if parameter.path.startswith(PAYLOAD):
            moved = sum(log.contacts(task, tool).values(), np.zeros((log.ticks, 6)))
            return log.shown(log.own(moved, changed), changed)
        return log.shown(own, changed) if parameter.path == FILTER else None

    def _constants(self, number: int, log: LogModel) -> list[tuple[int, Vector]]:
        """What adds up: the bias before the first tare, and the zeros after each."""
        found = []
        for i, parameter in enumerate(self.continuous):
            if parameter.path == BIAS:
                assert parameter.index is not None
                found.append((i, log.constant(parameter.index, 0)))
        first = len(self.continuous)
        for i, zero in enumerate(self.zeros):
            if zero.log == number:
                found.append((first + i, log.constant(zero.component, zero.epoch)))
        return found

    def _fixed_bias(self, log: LogModel) -> Vector:
        """(ticks, 6) of a bias that is not to be identified."""
        total = np.zeros((log.ticks, 6))
        if any(p.path == BIAS for p in self.continuous):
            wanted = {p.index for p in self.continuous if p.path == BIAS}
        else:
            wanted = set()
        for component, value in enumerate(self.program.context.loaded.task.robot.sensor.bias):
            if component not in wanted and value:
                total += value * log.constant(component, 0)
        return total


@dataclass(frozen=True)
class Fit:
    """What logs decide.

    Attributes:
        problem: what was to be decided.
        values: (p,) of parameters and zeros.
        delay: ticks of the sensor's delay; None where it was not to be decided.
        information: (p, p) in units of the scales.
        blocks: at the values.
        noises: of each block, by channel.
        freedom: ticks and channels, less parameters.
        delays: ticks that are not much less likely than `delay`.
    """

    problem: LogProblem
    values: Vector
    delay: int | None
    information: Vector
    blocks: tuple[Channels, ...]
    noises: tuple[tuple[ChannelNoise | None, ...], ...]
    freedom: int
    delays: tuple[int, ...] = ()

    def posterior(self, weak: float = WEAK) -> tuple[Vector, Vector]:
        """(p, p) covariance in units of the scales, and (p,) deviations, with the file's values.

        Args:
            weak: deviation of these, in scales.
        """
        whole = self.information + np.eye(len(self.information)) / weak**2
        size = np.sqrt(np.diag(whole))
        inverse = np.linalg.inv(whole / np.outer(size, size)) / np.outer(size, size)
        return inverse, np.sqrt(np.diag(inverse))

    @cached_property
    def known(self) -> Mask:
        """(p,) what is known closely, and by the logs: not because the file limits the rest."""
        deviations, alone = self.posterior()[1], self.posterior(_WEAKER * WEAK)[1]
        return np.asarray((deviations < KNOWN) & (alone < _BY_LOGS * deviations))

    @property
    def task(self) -> Task:
        """The world that is found."""
        delay = None if self.delay is None else self.delay * self.problem.period
        return self.problem.task(self.values, delay)


def noises_of(
    blocks: Sequence[Channels], order: int | None = None
) -> tuple[tuple[ChannelNoise | None, ...], ...]:
    """Of each block and channel; None of a channel without values."""
    found = []
    for block in blocks:
        each: list[ChannelNoise | None] = []
        for i in range(block.measured.shape[1]):
            there = block.present[:, i]
            if not there.any():
                each.append(None)
                continue
            size = float(np.abs(block.measured[there]).max()) if block.present.any() else 0.0
            each.append(ChannelNoise.of(block.left[:, i], there, max(size, 1e-9), order))
        found.append(tuple(each))
    return tuple(found)


def normal_equations(
    blocks: Sequence[Channels], noises: Sequence[Sequence[ChannelNoise | None]], scales: Vector
) -> tuple[Vector, Vector, float, int]:
    """(p, p) M and (p,) J'e in units of the scales, the sum of squares, and how many there are."""
    p = len(scales)
    M, g, total, count = np.zeros((p, p)), np.zeros(p), 0.0, 0
    for block, each in zip(blocks, noises, strict=True):
        for i, noise in enumerate(each):
            if noise is None:
                continue
            rows = noise.usable(block.present[:, i])
            e = noise.whitened(block.left[:, i])[rows]
            total, count = total + float(e @ e), count + len(e)
            if len(block.slopes) == len(scales):
                J = noise.whitened(block.slopes[:, :, i].T)[rows] * scales
                M += J.T @ J
                g += J.T @ e
    return M, g, total, count


#: Parameters of the contact in the order in which they are taken up, by words of their paths.
_STAGES = (("stiffness", "damping", "xyz", "bias"), ("rpy", "friction", "filter"))


def fit(problem: LogProblem, progress: Callable[[str], None] = lambda _: None) -> Fit:
    """Finds the parameters.

    Args:
        problem: logs and what is wanted.
        progress: is called with what is being done.
    """
    period = problem.program.context.period
    sensor = problem.program.context.loaded.task.robot.sensor
    ticks = SensorModel.of(sensor, period).delay_ticks
    search = _Search(problem, started(problem, problem.declared.copy()), ticks)
    search.joints(progress)
    search.contacts(progress)
    return search.found()


class _Search:
    """The iterations."""

    def __init__(self, problem: LogProblem, values: Vector, ticks: int) -> None:
        self.problem, self.values, self.ticks = problem, values, ticks

    @property
    def delay(self) -> float:
        """Of the sensor [s]."""
        own = self.problem.program.context.loaded.task.robot.sensor.delay
        return own if self.problem.delay is None else self.ticks * self.problem.period

    def joints(self, progress: Callable[[str], None]) -> None:
        """What torques of the joints say, where nothing touches."""
        problem, taken = self.problem, self.problem.taken(OF_JOINTS, zeros=False)
        if problem.joints_wanted:
            task = problem.task(self.values)
            problem.joints = [log.joints(task) for log in problem.logs]
        if any(joints is not None for joints in problem.joints):
            progress("joints")
            self._descended(taken, (JOINT,), last=False, most=_MOST_STEPS)
            self._descended(taken, (JOINT,), last=True)

    def contacts(self, progress: Callable[[str], None]) -> None:
        """What the sensor says."""
        words: tuple[str, ...] = ()
        both = self.problem.weighed
        for number, stage in enumerate((*_STAGES, ("payload",) if both else ())):
            words = (*words, *stage)
            taken = self.problem.taken(words, zeros=True)
            if not both:
                taken &= ~self.problem.taken(OF_JOINTS, zeros=False)
            last = number == len(_STAGES)
            of = (WRENCH, JOINT) if both and last else (WRENCH,)
            if last:
                self._turns()
            for _ in range(6):
                progress("contact")
                self._descended(taken, of, last=last)
                best = self._best_delay(taken)
                if best == self.ticks:
                    break
                self.ticks = best

    def _turns(self) -> None:
        """Finds out whether sensors turn with the tool, of which files do not say so."""
        for number, log in enumerate(self.problem.logs):
            if not log.open:
                continue
            left = {}
            for turns in (False, True):
                log.turns = turns
                block = self.problem.blocks(self.values, self.delay, of=(WRENCH,))[number]
                left[turns] = float(np.square(block.left).sum())
            log.turns = left[True] < left[False]

    def found(self) -> Fit:
        """The parameters, and what is known of them."""
        problem = self.problem
        every = np.ones(len(problem.scales), dtype=bool)
        blocks = problem.blocks(self.values, self.delay, by=every)
        noises = noises_of(blocks)
        M, _, _, count = normal_equations(blocks, noises, problem.scales)
        delays: tuple[int, ...] = ()
        if problem.delay is not None:
            taken = ~problem.taken(OF_JOINTS, zeros=False)
            left = self._profile(taken)
            delays = tuple(d for d, x in left.items() if x < left[self.ticks] + 2.71)
        return Fit(
            problem, self.values, self.ticks if delays else None, M, tuple(blocks), noises,
            count - len(problem.scales), delays,
        )  # fmt: skip

    def _descended(
        self, taken: Mask, of: Sequence[str], *, last: bool, most: int = _FEW_STEPS
    ) -> None:
        """Least squares under their own noise.

        Args:
            taken: (p,) which parameters are changed.
            of: which channels count.
            last: whether to the end, with noise that hangs together from tick to tick.
            most: steps, if it is not the last time.
        """
        problem, order = self.problem, None if last else 0
        problem.metric = None
        scales = problem.scales[taken]
        blocks = problem.blocks(self.values, self.delay, by=taken, of=of)
        noises = noises_of(blocks, order)
        damping = 1e-6
        for _ in range(_MOST_STEPS if last else most):
            problem.metric = problem.task(self.values, self.delay)
            M, g, total, _ = normal_equations(blocks, noises, scales)
            home = ((problem.declared - self.values) / problem.scales)[taken]
            cost = total + float(home @ home) / WEAK**2
            improved = False
            while damping < 1e6:
                move, deviations = self._move(M, g, home, damping, taken)
                tried = self.values.copy()
                tried[taken] = np.maximum(tried[taken] + scales * move, problem.least[taken])
                other = problem.blocks(tried, self.delay, of=of)
                _, _, after, _ = normal_equations(other, noises, scales)
                away = ((problem.declared - tried) / problem.scales)[taken]
                if after + float(away @ away) / WEAK**2 <= cost * (1 + 1e-12):
                    improved = True
                    break
                damping = max(damping * 10, 1e-4)
            if not improved:
                problem.metric = None
                return
            move = (tried - self.values)[taken] / scales
            self.values, problem.metric = tried, None
            blocks = problem.blocks(self.values, self.delay, by=taken, of=of)
            renewed = noises_of(blocks, order)
            change = np.max(np.abs(move) / deviations, initial=0.0)
            same = _alike(noises, renewed)
            noises = renewed
            damping = max(damping / 10, 1e-9)
            if change < (_SMALL if last else 0.1) and same:
                return

    def _move(
        self, M: Vector, g: Vector, home: Vector, damping: float, taken: Mask
    ) -> tuple[Vector, Vector]:
        """A step; what is at its bound, and would go beyond it, stays there."""
        move, deviations = step(M, g, home, damping)
        held = (self.values <= self.problem.least)[taken] & (move < 0)
        if held.any():
            free = np.flatnonzero(~held)
            move = np.zeros_like(move)
            move[free], deviations[free] = step(M[np.ix_(free, free)], g[free], home[free], damping)
        return move, deviations

    def _best_delay(self, taken: Mask) -> int:
        if self.problem.delay is None:
            return self.ticks
        left = self._profile(taken)
        return min(left, key=lambda ticks: left[ticks])

    def _profile(self, taken: Mask) -> dict[int, float]:
        """Sums of squares that are left with other delays, the parameters following linearly."""
        problem, scales = self.problem, self.problem.scales[taken]
        blocks = problem.blocks(self.values, self.delay, by=taken, of=(WRENCH,))
        home = ((problem.declared - self.values) / problem.scales)[taken]
        most = max(self.ticks, 1) + round(_LONGEST_DELAY / problem.period)
        channels = []
        for block, noises in zip(blocks, noises_of(blocks), strict=True):
            # Ticks that some delay does not reach count for none.
            inner = block.present.copy()
            inner[: most + 2], inner[len(inner) - most - 2 :] = False, False
            for i, noise in enumerate(noises):
                if noise is not None:
                    columns = np.column_stack([block.predicted[:, i], block.slopes[:, :, i].T])
                    rows = np.flatnonzero(noise.usable(inner[:, i]))
                    measured = noise.whitened(np.nan_to_num(block.measured[:, i]))
                    channels.append((rows, measured, noise.whitened(columns)))
        found: dict[int, float] = {}
        for other in self._tried(most):
            late = other - self.ticks
            M, g, total = np.zeros((len(scales),) * 2), np.zeros(len(scales)), 0.0
            for rows, measured, columns in channels:
                part = columns[rows - late]
                e, J = measured[rows] - part[:, 0], part[:, 1:] * scales
                M, g, total = M + J.T @ J, g + J.T @ e, total + float(e @ e)
            move, _ = step(M, g, home)
            found[other] = total - 2 * float(g @ move) + float(move @ M @ move)
        return found

    def _tried(self, most: int) -> list[int]:
        """Delays that are tried: all near the present one, ever fewer farther away."""
        near = range(max(self.ticks - 8, 0), self.ticks + 9)
        away = {round(8 * 1.3**i) for i in range(30)}
        far = {t for d in away for t in (self.ticks - d, self.ticks + d) if 0 <= t <= most}
        return sorted({*near, *far})


def step(M: Vector, g: Vector, home: Vector, damping: float = 0.0) -> tuple[Vector, Vector]:
    """A step in units of the scales, and the deviations of the parameters there.

    Args:
        M: (p, p) information.
        g: (p,) J'e.
        home: (p,) from the values to those of the file, which count as one weak measurement.
        damping: of Levenberg and Marquardt.
    """
    whole = M + np.eye(len(M)) / WEAK**2
    size = np.sqrt(np.diag(whole))
    inverse = np.linalg.inv(whole / np.outer(size, size) + damping * np.eye(len(M)))
    found = inverse @ ((g + home / WEAK**2) / size) / size
    return found, np.sqrt(np.diag(inverse)) / size


def _alike(
    before: Sequence[Sequence[ChannelNoise | None]], after: Sequence[Sequence[ChannelNoise | None]]
) -> bool:
    for one, two in zip(before, after, strict=True):
        for a, b in zip(one, two, strict=True):
            if a is not None and b is not None and abs(a.deviation / b.deviation - 1) > 1e-3:
                return False
    return True


def started(problem: LogProblem, values: Vector) -> Vector:
    """Values to start from: surfaces are where, and as stiff as, forces say.

    Of each shape the height x of the ball above it and the force f along its normal are laid
    through f = k max(0, o - x) + c, with the o that leaves least.
    """
    made = values.copy()
    task = problem.program.context.loaded.task
    at = {p.name: i for i, p in enumerate(problem.continuous)}
    names = {p.path.split(".")[1] for p in problem.continuous if p.path.startswith("world.")}
    for name in names:
        found = [log.touch(name, task) for log in problem.logs]
        x, f, normal = (np.concatenate(part) for part in zip(*found, strict=True))
        laid = _hinge(x, f)
        if laid is None:
            continue
        offset, stiffness, touching = laid
        if f"world.{name}.stiffness" in at:
            made[at[f"world.{name}.stiffness"]] = stiffness
        R = from_rpy(task.shapes[name].rpy)
        away = offset * R.T @ normal[touching].mean(axis=0)
        for i in range(3):
            if f"world.{name}.xyz.{i}" in at:
                made[at[f"world.{name}.xyz.{i}"]] += away[i]
    return made


def _hinge(x: Vector, f: Vector) -> tuple[float, float, Mask] | None:
    """o, k and where x < o, of f = k max(0, o - x) + c; None where nothing presses."""
    best, found = float(np.square(f - f.mean()).sum()), None
    for o in np.unique(np.quantile(x, np.linspace(0.0, 1.0, 200)[1:])):
        depth = np.maximum(o - x, 0.0)
        moved, force = depth - depth.mean(), f - f.mean()
        square = float(moved @ moved)
        k = float(moved @ force) / square if square > 0 else 0.0
        left = float(np.square(force - k * moved).sum())
        if k > 0 and left < best:
            best, found = left, (float(o), k, x < o)
    return found
