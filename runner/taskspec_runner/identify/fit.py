"""Maximum likelihood of a world's parameters, given what logs have: Gauss and Newton's iterations.

What is left of each channel beside the model is an autoregression (`noise`), estimated with the
parameters in turn. With e the residuals of a channel made white, of unit size, and J their
derivatives by the parameters, the information that the logs have is M = sum J'J over all ticks and
channels. Parameters go by their scale: what a direction of them is known to, less exactly than a
share of the scales, stays as the file has it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec.geometry.rotation import from_rpy
from taskspec.program.program import Program
from taskspec.program.sensor import SensorModel
from taskspec.program.world.stiffness import settled_damping
from taskspec.shapes.overlap import LEAST_FRICTION
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
_MOST_STEPS, _FEW_STEPS, _FEWER_STEPS = 60, 12, 4
#: Delays for which least squares are made; of a bend, where a damping above it starts.
_MOST_DELAYS, _ABOVE = 6, 1.3
#: Steps that are this share of the deviations end the iterations.
_SMALL = 1e-2
#: Noise that differs by a smaller share is the same; steps of so many deviations are near the end.
_SAME, _NEAR_END = 1e-2, 0.5
#: So do steps by which the sum of squares, of unit size each, becomes smaller by less.
_LITTLE = 1e-3
#: Touches of a log that are tried to begin at other ticks, by how much of a tick's way they then
#: are beyond, and by how much less has to be left there.
_MOST_TOUCHES, _OVER, _WORTHWHILE = 4, 0.05, 4.0
#: Ticks by which all delays that are as near are tried, where far ones are not, and where they are.
_NEAR_DELAYS = 2, 8
#: Of the information on a parameter, what arithmetic leaves in doubt.
_LAST_DIGITS = 1e-12
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

    def name(self, number: int) -> str:
        """The name of a channel, such as `force.z` or `joint.3.torque`."""
        if self.of == JOINT:
            return f"joint.{number + 1}.torque"
        return f"{AXES[number].effort}.{AXES[number]}"

    def unit(self, number: int) -> str:
        """The SI unit of a channel's values."""
        return "N" if self.of == WRENCH and number < 3 else "N*m"


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
            elif parameter.path.endswith(".friction"):
                # Less is as good as none, and changes nothing.
                found[i] = LEAST_FRICTION
            elif parameter.path in (FILTER, f"{PAYLOAD}.mass"):
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

    def but(self, task: Task, values: Vector, number: int, value: float) -> Task:
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
                changed = self.but(task, values, i, values[i] + step)
                change = self._change(log, changed, task, contacts, own, parameter)
                if change is not None:
                    slopes[rows[i]] = self._heeded(change / step, i, alone)
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
                other = log.world(self.but(task, values, int(i), values[i] + step))
                # H da = dk - dH a, in the rows of joints that slide; others are not there.
                change = ((other[0] - world[0]) / step @ accelerated[..., None])[..., 0]
                slope = (other[1] - world[1]) / step - change
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

    def _change(
        self,
        log: LogModel,
        changed: Task,
        task: Task,
        contacts: dict[str, Vector],
        own: Vector,
        parameter: Parameter,
    ) -> Vector | None:
        """(ticks, 6) by how much readings change with one parameter; None where they do not.

        They are linear in what the sensor measures.
        """
        tool = self.mobility(changed)
        if parameter.path.startswith("world."):
            owner = owner_of(parameter)
            after, before = log.contact(owner, changed, tool), contacts[owner]
            # A touch that begins or ends within the difference is a jump, and no slope.
            alike = after.any(axis=1) == before.any(axis=1)
            difference = np.where(alike[:, None], after - before, 0.0)
            if not difference.any():
                return None
            return log.passed(log.turned(difference), task)
        if parameter.path.startswith(PAYLOAD):
            moved = sum(log.contacts(task, tool).values(), np.zeros((log.ticks, 6)))
            return log.passed(log.own(moved, changed) - own, task)
        if parameter.path == FILTER:
            return log.passed(own, changed) - log.passed(own, task)
        return None

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
        beyond: (p,) how much beyond its bound a value that is at it would fit best; else 0.
        delays: ticks that are not much less likely than `delay`.
    """

    problem: LogProblem
    values: Vector
    delay: int | None
    information: Vector
    blocks: tuple[Channels, ...]
    noises: tuple[tuple[ChannelNoise | None, ...], ...]
    freedom: int
    beyond: Vector
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
        """What the sensor says.

        As friction creeps by the damping, which seems negative while the delay is wrong, it is
        taken to be firm until all else is there.
        """
        words: tuple[str, ...] = ()
        both = self.problem.weighed
        for number, stage in enumerate((*_STAGES, ("payload",) if both else ())):
            words = (*words, *stage)
            taken = self.problem.taken(words, zeros=True)
            last = number == len(_STAGES)
            if not (both and last):
                taken &= ~self.problem.taken(OF_JOINTS, zeros=False)
            of = (WRENCH, JOINT) if both and last else (WRENCH,)
            if last:
                self._turns()
            for log in self.problem.logs:
                log.firm = not last
            progress("contact")
            self._with_delays(taken, of, last=last)
            if last:
                self._firmer(taken, of)
            elif number:
                self._with_filters(taken, of)

    def _with_delays(self, taken: Mask, of: Sequence[str], *, last: bool) -> None:
        """Least squares with the delay that leaves least, of those that they lead to in turn."""
        tried: dict[int, tuple[float, Vector]] = {}
        while self.ticks not in tried and len(tried) < _MOST_DELAYS:
            self._descended(taken, of, last=last, most=_FEWER_STEPS if tried else _MOST_STEPS)
            tried[self.ticks] = self._cost(of), self.values
            if self.problem.delay is not None:
                self._go(self._profile(taken, far=not last), taken)
        self.ticks = min(tried, key=lambda ticks: tried[ticks][0])
        self.values = tried[self.ticks][1]

    def _with_filters(self, taken: Mask, of: Sequence[str]) -> None:
        """Trades the filter's lag for ticks of delay, as long as that fits better.

        Both come late alike, so it is a valley with a bend, which nothing linear sees across. Steps
        along it are twice as wide each time; near the end `_with_delays` tries all ticks.
        """
        problem, period = self.problem, self.problem.period
        lag = [i for i, p in enumerate(problem.continuous) if p.path == FILTER and taken[i]]
        self._aside(taken, of)
        best = self._cost(of)
        for way in (-1, 1) if lag and problem.delay is not None else ():
            later = way
            while self.ticks + later >= 0:
                before = self.values, self.ticks
                self.values, self.ticks = self.values.copy(), self.ticks + later
                self.values[lag] = np.maximum(self.values[lag] - later * period, 0.0)
                later *= 2
                self._descended(taken, of, last=False, most=_FEWER_STEPS)
                self._aside(taken, of)
                cost = self._cost(of)
                if cost >= best:
                    self.values, self.ticks = before
                    break
                best = cost

    def _aside(self, taken: Mask, of: Sequence[str]) -> None:
        """Lets touches begin a tick earlier or later, all else following, if that leaves less.

        A touch that begins jumps, and no slope says what another tick for it would change.
        """
        problem = self.problem
        blocks = problem.blocks(self.values, self.delay, by=taken, of=of)
        noises, scales = noises_of(blocks), problem.scales[taken]
        M, _, left, _ = normal_equations(blocks, noises, scales)
        whole = M + np.eye(len(M)) / WEAK**2
        size = np.sqrt(np.diag(whole))
        # Two parameters may show as one by more digits than numbers have.
        scaled = whole / np.outer(size, size) + _LAST_DIGITS * np.eye(len(M))
        covariance = np.linalg.inv(scaled) / np.outer(size, size)
        best, start = left - _WORTHWHILE, self.values
        for slope, moves in self._touches(taken):
            along = covariance @ slope
            for move in moves:
                tried = self.values.copy()
                tried[taken] += scales * along * (move / float(slope @ along))
                tried = np.maximum(tried, problem.least)
                other = problem.blocks(tried, self.delay, of=of)
                total = normal_equations(other, noises, scales)[2]
                if total < best:
                    best, start = total, tried
        if start is not self.values:
            self.values = start
            self._descended(taken, of, last=False)

    def _touches(self, taken: Mask) -> Iterator[tuple[Vector, tuple[float, float]]]:
        """Of each touch that begins the (taken,) slopes of the height there, and how it may change.

        By the first of the two changes it begins a tick later, by the second a tick earlier [m].
        """
        problem = self.problem
        task, places = problem.task(self.values), np.flatnonzero(taken)
        for name, moving in problem.moving.items():
            for log in problem.logs:
                for row in log.begun(name, task)[:_MOST_TOUCHES]:
                    before, after = log.heights(name, task, np.array([row - 1, row]))
                    slope = np.zeros(len(places))
                    for i in moving.values():
                        if taken[i]:
                            step = _DIFFERENCE * problem.scales[i]
                            other = problem.but(task, self.values, i, self.values[i] + step)
                            height = log.heights(name, other, np.array([row]))[0]
                            slope[places == i] = (height - after) / _DIFFERENCE
                    if slope.any():
                        over = _OVER * (before - after)
                        yield slope, (over - after, -over - before)

    def _firmer(self, taken: Mask, of: Sequence[str]) -> None:
        """Tries dampings from above the bend where friction comes to creep.

        Below it a small change of the damping changes friction much, above it not at all.
        """
        problem, period = self.problem, 1.0 / self.problem.task(self.values).control.plant_rate
        for i, parameter in enumerate(problem.continuous):
            bend = settled_damping(problem.mobility(problem.task(self.values)), period)
            contact = parameter.path.startswith("world.") and parameter.path.endswith(".damping")
            if contact and taken[i] and self.values[i] < bend:
                before = self._cost(of), self.values, self.ticks
                self.values = self.values.copy()
                self.values[i] = _ABOVE * bend
                self._with_delays(taken, of, last=True)
                if self._cost(of) > before[0]:
                    _, self.values, self.ticks = before

    def _cost(self, of: Sequence[str]) -> float:
        """-log of the likelihood, with the noise that suits best, and of what the file says."""
        problem = self.problem
        blocks = problem.blocks(self.values, self.delay, of=of)
        total = 0.0
        for block, noises in zip(blocks, noises_of(blocks), strict=True):
            # Every delay is judged by as many ticks.
            total += len(block.rows) * sum(np.log(n.deviation) for n in noises if n is not None)
        home = (problem.declared - self.values) / problem.scales
        return total + float(home @ home) / (2 * WEAK**2)

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
        M, g, _, count = normal_equations(blocks, noises, problem.scales)
        home = (problem.declared - self.values) / problem.scales
        move, _ = step(M, g, home)
        held = (self.values <= problem.least) & (move < 0)
        beyond = np.where(held, move * problem.scales, 0.0)
        delays: tuple[int, ...] = ()
        if problem.delay is not None:
            taken = ~problem.taken(OF_JOINTS, zeros=False)
            left = {d: x for d, (x, _) in self._profile(taken, far=True).items()}
            delays = tuple(d for d, x in left.items() if x < left[self.ticks] + 2.71)
        return Fit(
            problem, self.values, self.ticks if delays else None, M, tuple(blocks), noises,
            count - len(problem.scales), beyond, delays,
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
        damping, near = 1e-6, 0
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
                gain = cost - after - float(away @ away) / WEAK**2
                if gain >= -1e-12 * cost:
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
            change = float(np.max(np.abs(move) / deviations, initial=0.0))
            near += change < _NEAR_END
            # Near the end noise is renewed once more, or its order may go to and fro without end.
            same = near > 1 or _alike(noises, renewed)
            if near <= 1:
                noises = renewed
            damping = max(damping / 10, 1e-9)
            small = _SMALL if last else 0.1
            if (change < small and same) or gain < _LITTLE:
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

    def _go(self, profile: dict[int, tuple[float, Vector]], taken: Mask) -> None:
        """To the delay that leaves least, and there to the values that follow."""
        best = min(profile, key=lambda ticks: profile[ticks][0])
        if best != self.ticks:
            problem, move = self.problem, profile[best][1]
            made = self.values.copy()
            made[taken] = np.maximum(
                made[taken] + problem.scales[taken] * move, problem.least[taken]
            )
            self.ticks, self.values = best, made

    def _profile(self, taken: Mask, *, far: bool) -> dict[int, tuple[float, Vector]]:
        """What is left with other delays, to which parameters follow linearly.

        Returns:
            Of each delay the sum of squares, and the step of the parameters, in scales.

        Args:
            taken: (p,) which parameters follow.
            far: whether all delays are tried, or only those near the present one.
        """
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
        found: dict[int, tuple[float, Vector]] = {}
        for other in self._tried(most, far=far):
            late = other - self.ticks
            M, g, total = np.zeros((len(scales),) * 2), np.zeros(len(scales)), 0.0
            for rows, measured, columns in channels:
                part = columns[rows - late]
                e, J = measured[rows] - part[:, 0], part[:, 1:] * scales
                M, g, total = M + J.T @ J, g + J.T @ e, total + float(e @ e)
            move, _ = step(M, g, home)
            found[other] = total - 2 * float(g @ move) + float(move @ M @ move), move
        return found

    def _tried(self, most: int, *, far: bool) -> list[int]:
        """Delays that are tried: all near the present one, ever fewer farther away."""
        width = _NEAR_DELAYS[far]
        near = range(max(self.ticks - width, 0), self.ticks + width + 1)
        away = {round(width * 1.3**i) for i in range(30)} if far else set()
        others = {t for d in away for t in (self.ticks - d, self.ticks + d) if 0 <= t <= most}
        return sorted({*near, *others})


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
            if a is not None and b is not None and abs(a.deviation / b.deviation - 1) > _SAME:
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
