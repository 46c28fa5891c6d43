"""How far gains and stiffness may go before a stage becomes unstable, on the same sampled model."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.context import Context
from taskspec.program.sensor import SensorModel
from taskspec.spec import Task
from taskspec.stability.budget import Budget
from taskspec.stability.controller import LinearController
from taskspec.stability.family import Family
from taskspec.stability.gain_paths import together
from taskspec.stability.loop import FARTHEST, Mode, Poles, modes, poles, states
from taskspec.stability.plant import LinearPlant
from taskspec.stability.sampled_stage import SampledStage
from taskspec.text.units import FREQUENCY, TIME

#: A swing that grows more slowly than this [1/s] is on the boundary: in a hundred seconds it gets
#: a tenth larger. One that grows by no more than rounding may have moved its pole is there too.
LEAST_GROWTH = 1e-3
#: A mode that turns by less than this [rad/s] does not swing, it drifts: as pose and contact of the
#: start have it. Both have changed before a drift slower than the other [1/s] is felt.
_SWINGS, LEAST_DRIFT = 1.0, 0.1
#: A stage is on its boundary if one of its gains is within this part of it: stiffness and mass of a
#: contact are not known better. A fifth of a percent more, to which a boundary can be measured.
MARGIN = 0.022
#: A mode whose damping ratio is above this is far from a boundary: where a gain alone decides how a
#: mode is damped, and as steeply as its square, a part m of it takes 2 m off the damping ratio.
_NEAR = 2 * MARGIN
#: A mode rings if its damping ratio is below the first and it dies away slower than the second
#: [1/s]: it takes more than seven swings to a hundredth of what began it, and longer than 0.2 s.
LEAST_DAMPING_RATIO, QUICK = 0.1, 20.0
#: How far from its value a gain is looked for, either way, and in which steps.
REACH, _STEP = 1e3, 10 ** (1 / 3)
#: Systems with more states than this are not searched for boundaries: it would take a second.
_MOST_SEARCHED = 130
#: A boundary is found to this part of its value.
_FOUND = 5e-4
#: Gains that move the boundary, in the order in which they are proposed.
PROPOSED = (
    "force.integral",
    "force.proportional",
    "force.damping",
    "damping",
    "mass",
    "stiffness",
    "bandwidth",
    "damping_ratio",
    "joint_damping",
)
#: Those of them that make a force loop quick.
QUICK_LOOP = ("force.integral", "force.proportional")
#: Those of them that a motion loop has.
MOTION = ("bandwidth", "damping_ratio")


@dataclass(frozen=True, slots=True)
class Limit:
    """The largest or smallest value of something for which a stage is stable.

    Attributes:
        what: the gain, the object whose stiffness it is, or the path of a number of the robot.
        on: axes, equations or joints whose gain moves; empty for an object and for the robot.
        value: at the boundary, on the first of them [SI].
        now: as it is there.
        upper: stable below it.
        given: the value of now stands in the file.
    """

    what: str
    on: tuple[str, ...]
    value: float
    now: float
    upper: bool
    given: bool


def grows(mode: Mode) -> bool:
    """Whether a mode is clearly unstable."""
    least = LEAST_GROWTH if abs(mode.s.imag) > _SWINGS else LEAST_DRIFT
    return mode.s.real > max(least, mode.doubt)


def near_boundary(mode: Mode) -> bool:
    """Whether a mode is damped so little that a small change of a gain may make it grow."""
    return mode.s.imag != 0 and mode.damping_ratio < _NEAR


@dataclass(frozen=True, slots=True)
class Quality:
    """What poles are to be.

    Attributes:
        bad: of some poles [1/s] those that are not so.
    """

    bad: Callable[[Poles], NDArray[np.bool_]]

    def holds(
        self, controller: LinearController, plant: LinearPlant, sensor: SensorModel, period: float
    ) -> bool:
        """Whether all modes of a loop are so; eigenvalues alone mostly tell."""
        s = poles(controller, plant, sensor, period)
        bad = s[self.bad(s)]
        if not len(bad):
            return True
        if np.any(np.abs(np.exp(bad * sensor.hold_ticks * period) - 1) > FARTHEST):
            return False
        found = np.array([m.s for m in modes(controller, plant, sensor, period)], dtype=complex)
        return not self.bad(found).any()


def rings(mode: Mode, quick: float = QUICK) -> bool:
    """Whether a mode that dies away takes many swings, and long, to do so.

    Args:
        mode: the mode.
        quick: rate from which on it is gone before it matters [1/s].
    """
    swings = abs(mode.s.imag) > _SWINGS and -mode.s.real < quick
    return swings and bool(_ring(np.array([mode.s]))[0])


def _ring(s: Poles) -> NDArray[np.bool_]:
    return np.asarray((-s.real < LEAST_DAMPING_RATIO * np.abs(s)) & (-s.real < QUICK))


#: No mode grows at all; no mode grows or rings.
STABLE, QUIET = Quality(lambda s: np.asarray(s.real > 0)), Quality(_ring)


@dataclass(frozen=True, slots=True)
class Search:
    """What boundaries are looked for.

    Attributes:
        context: the task.
        sampled: the stage as it is.
        task: whose world and robot are true; None for the nominal ones.
        good: what the modes are to be on the one side, and not on the other.
        beside: the same stage as it is else, such as where friction holds its tool; to be as good.
        reach: how far from its value anything is looked for, either way.
        budget: of gains; None for all.
    """

    context: Context
    sampled: SampledStage
    task: Task | None = None
    good: Quality = STABLE
    reach: float = REACH
    budget: Budget | None = None
    beside: tuple[SampledStage, ...] = ()

    def gains(
        self, axes: Sequence[str], *, given: bool | None = None, of: Sequence[str] = PROPOSED
    ) -> Iterator[Limit]:
        """Boundaries of the gains on some axes, each number by itself with all others as they are.

        Args:
            axes: whose gains are moved, with those of others that are the same number.
            given: only gains that stand in the file, or only designed ones; None for both.
            of: the gains.
        """
        for what in of:
            by = self.sampled.stage.plan.gains.get(what, {})
            moved: set[str] = set()
            for axis in [next(iter(by))] if by and what == "joint_damping" else axes:
                if axis not in by or axis in moved:
                    continue
                if given is not None and (by[axis].origin == "file") != given:
                    continue
                on = together(self.context, self.sampled, what, axis)
                moved.update(on)
                limit = self.gain(what, on)
                if limit is not None:
                    yield limit

    def everywhere(self, but: str, *, given: bool) -> Iterator[Limit]:
        """Boundaries of gains that are moved by one factor on all axes.

        Args:
            but: gains that `gains` moves as a whole for this axis are left out.
            given: only gains that stand in the file, or only designed ones.
        """
        for what in PROPOSED:
            by = self.sampled.stage.plan.gains.get(what, {})
            on = [a for a, gain in by.items() if (gain.origin == "file") == given]
            whole = but in on and set(together(self.context, self.sampled, what, but)) == set(on)
            if on and not whole:
                limit = self.gain(what, on)
                if limit is not None:
                    yield limit

    def gain(self, what: str, on: Sequence[str]) -> Limit | None:
        """The boundary of one gain nearest to its value; None without one within `reach`.

        Args:
            what: the gain.
            on: axes or joints it is of.
        """
        now = self.sampled.stage.plan.gains[what][on[0]]
        if now.value <= 0:
            return None
        task = self._true
        plant, period = self.sampled.plant(task), self.context.period
        sensor = SensorModel.of(task.robot.sensor, period)
        if not self._small(task):
            return None
        if self.budget is not None and not self.budget.take():
            return None
        plants = [plant, *(other.plant(task) for other in self.beside)]
        families = [Family.of(sampled, what, on) for sampled in (self.sampled, *self.beside)]

        def holds(factor: float) -> bool:
            return all(
                family is not None and self.good.holds(family.at(factor), plant, sensor, period)
                for family, plant in zip(families, plants, strict=True)
            )

        if None in families:
            return None
        found = _boundary(holds, self.reach)
        if found is None:
            return None
        factor, upper = found
        return Limit(what, tuple(on), now.value * factor, now.value, upper, now.origin == "file")

    def near(self, axis: str, part: float = MARGIN) -> str:
        """The gain of an axis, or of the joints, that is within a part of a boundary; "" for none.

        Of a force loop it is one that makes it quick. Late by some ticks, a stiff contact takes off
        so much of a damper that two percent of this may be ten of an integral.

        Args:
            axis: whose gains are moved, each with those of others that are the same number.
            part: of the boundary.
        """
        task = self._true
        plant, period = self.sampled.plant(task), self.context.period
        sensor = SensorModel.of(task.robot.sensor, period)
        if not self._small(task):
            return ""
        gains = self.sampled.stage.plan.gains
        for what in QUICK_LOOP if axis in gains.get("force.proportional", {}) else PROPOSED:
            by = gains.get(what, {})
            of = next(iter(by), "") if what == "joint_damping" else axis
            if of not in by or by[of].value <= 0:
                continue
            family = Family.of(self.sampled, what, together(self.context, self.sampled, what, of))
            if family is None:
                continue
            for factor in (1 / (1 - part), 1 - part):
                if any(map(grows, modes(family.at(factor), plant, sensor, period))):
                    return what
        return ""

    def stiffness(self, name: str) -> Limit | None:
        """The boundary of a contact's stiffness nearest to its value; None where it has none."""
        now = self.sampled.context.compliances[name].stiffness
        found = self._world(lambda task, factor: _stiffer(task, name, factor, self.sampled))
        if found is None:
            return None
        factor, upper = found
        return Limit(name, (), now * factor, now, upper, given=True)

    def robot(self) -> Iterator[Limit]:
        """Boundaries of what delays a loop over a servo: its bandwidth, its delay and a filter.

        The gains stay as they are. A delay is one of whole ticks of the servo, a sensor without a
        filter one that passes what there is between two samples.
        """
        task = self._true
        if task.robot.takes_torques:
            return
        servo, corner = task.robot.servo, task.robot.sensor.filter
        for path, now in {
            BANDWIDTH: servo.bandwidth,
            FILTER: corner or 0.5 / self.context.period,
        }.items():
            found = self._world(lambda task, factor: _with(task, path, factor * now))  # noqa: B023
            if found is not None:
                factor, upper = found
                yield Limit(path, (), now * factor, now, upper, given=True)
        most = self._longest_delay()
        if most is not None:
            yield Limit(DELAY, (), most / servo.rate, servo.delay, True, given=True)

    def _longest_delay(self) -> int | None:
        """The most ticks of the servo with which a stage is as it should be; None where none is."""
        task, rate = self._true, self._true.robot.servo.rate
        now = task.robot.servo.delay_ticks

        def late(ticks: int) -> Task:
            return _with(task, DELAY, ticks / rate)

        def holds(ticks: int) -> bool:
            return self._holds(late(ticks))

        if not self._small(task):
            return None
        if holds(now):
            low, high = now, 2 * now + 1
            while high > low + 1 and not self._small(late(high)):
                high -= 1
            if holds(high):
                return None  # It is too far off to matter.
        elif holds(0):
            low, high = 0, now
        else:
            return None
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if holds(middle) else (low, middle)
        return low

    @property
    def _true(self) -> Task:
        """The task whose world and robot are true."""
        return self.sampled.context.loaded.task if self.task is None else self.task

    def _world(self, changed: Callable[[Task, float], Task]) -> tuple[float, bool] | None:
        """The factor nearest to 1 from which on worlds are otherwise; whether good ones are below.

        Args:
            changed: the task with the factor in it.
        """
        task = self._true
        if not self._small(task):
            return None
        return _boundary(lambda factor: self._holds(changed(task, factor)), self.reach)

    def _small(self, task: Task) -> bool:
        """Whether the loop in a world is small enough to be searched."""
        sensor = SensorModel.of(task.robot.sensor, self.context.period)
        plant = self.sampled.plant(task)
        return states(self.sampled.controller, plant, sensor) <= _MOST_SEARCHED

    def _holds(self, task: Task) -> bool:
        """Whether the stage as it is is good in a world."""
        period = self.context.period
        sensor = SensorModel.of(task.robot.sensor, period)
        return all(
            self.good.holds(each.controller, each.plant(task), sensor, period)
            for each in (self.sampled, *self.beside)
        )


#: Numbers of the robot that delay a loop, by their paths.
BANDWIDTH, DELAY, FILTER = "robot.servo.bandwidth", "robot.servo.delay", "robot.sensor.filter"
#: What they are measured in.
OF_THE_ROBOT = {BANDWIDTH: FREQUENCY, DELAY: TIME, FILTER: FREQUENCY}


def _with(task: Task, path: str, value: float) -> Task:
    """The task with one number of the robot's servo or sensor changed."""
    _, part, key = path.split(".")
    changed = getattr(task.robot, part).model_copy(update={key: value})
    return task.model_copy(update={"robot": task.robot.model_copy(update={part: changed})})


def _stiffer(task: Task, name: str, factor: float, sampled: SampledStage) -> Task:
    """The task with the stiffness of one object changed, and its damping left.

    Under a servo designed damping follows it, as it will once the file has that stiffness.
    """
    compliance = sampled.context.compliances[name]
    changes: dict[str, object] = {"stiffness": compliance.stiffness * factor}
    if task.robot.takes_torques:
        changes["damping"] = compliance.damping
    changed = task.world[name].model_copy(update=changes)
    return task.model_copy(update={"world": {**task.world, name: changed}})


def _boundary(holds: Callable[[float], bool], reach: float) -> tuple[float, bool] | None:
    """The factor nearest to 1 at which `holds` changes; and whether it holds below, not above."""
    at_one = holds(1.0)
    for k in range(1, math.ceil(math.log(reach) / math.log(_STEP)) + 1):
        for way in (1 / _STEP, _STEP):
            if holds(way**k) != at_one:
                return _bisect(holds, way ** (k - 1), way**k, at_one), at_one == (way > 1)
    return None


def _bisect(holds: Callable[[float], bool], a: float, b: float, at_a: bool) -> float:
    """Where `holds` changes between a and b, on the side on which it holds."""
    while abs(math.log(b / a)) > _FOUND:
        middle = math.sqrt(a * b)
        if holds(middle) == at_a:
            a = middle
        else:
            b = middle
    return a if at_a else b
