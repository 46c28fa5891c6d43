"""What the controller makes of its encoders, and of the friction of joints that it compensates."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.laws.friction import Compensation
from taskspec.program.components import ends
from taskspec.program.context import Context
from taskspec.program.plan import TaskPlan
from taskspec.program.velocity_estimate import VelocityEstimate
from taskspec.robot.model_terms import PinocchioTerms
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.spec import FILE, KeyPath
from taskspec.spec.joint_velocity import DIFFERENCES
from taskspec.stability.hunting import gained
from taskspec.stability.loop import UnfitError
from taskspec.stability.sampled_stage import SampledStage, loop_of
from taskspec.text.units import TIME, number, scaled, show

Vector = NDArray[np.float64]

#: From this part of what a motor can exert on, torques that encoders make are reported.
_SHARE = 0.2
#: From this factor on it is reported how much further off an arm rests with an observer.
_FARTHER = 1.5
_FRICTION = "robot.joint_friction"
#: From this gain on most random files hunt, below it fewer than half (`campaigns/hunting.py`).
_LIKELY = 4.0
#: Of differences of g [rad, m].
_STEP = 1e-5


@rule(
    {
        "TS141": "a velocity of joints that cannot be estimated so",
        "TS142": "a compensation of friction that has nothing to compensate",
    },
    phase=Phase.TASK,
)
def possible_feedback(task: TaskPlan) -> Iterator[Finding]:
    """Estimates and compensations that the arm, or the controller's rate, does not allow."""
    spec = task.context.loaded.task
    velocity, friction, rate = spec.control.velocity, spec.control.friction, spec.control.rate
    place = FILE.control.velocity
    if velocity.observer is not None and not spec.robot.takes_torques:
        yield error(
            "TS141",
            f"an observer goes by the torques that are commanded, and {spec.robot.model!r} takes "
            f"{spec.robot.commands}",
            place.observer,
            "take filtered differences: velocity: {filter: 50 Hz}",
        )
    corner = velocity.corner
    if corner is not None and corner >= rate / 2:
        yield error(
            "TS141",
            f"a corner at {show(corner, 'Hz', 3)} is beyond half the controller's rate of "
            f"{show(rate, 'Hz', 4)}",
            place.filter if velocity.observer is None else place.observer,
            f"lower it, or take plain differences: velocity: {DIFFERENCES}",
        )
    if friction is None:
        return
    if not spec.robot.takes_torques:
        yield error(
            "TS142",
            f"joints that take {spec.robot.commands} have a servo for their friction",
            FILE.control.friction,
            "leave it out",
        )
    elif not any((*spec.robot.joint_friction, *spec.robot.joint_damping)):
        yield error(
            "TS142",
            "the robot declares no friction that could be compensated",
            FILE.control.friction,
            "say what is known of it, such as robot: {joint_friction: 0.5 N*m}",
        )


@dataclass(frozen=True, slots=True)
class TorqueNoise:
    """What lines of the encoders may make of a torque at most.

    Attributes:
        share: of what the motor exerts.
        stage: in which. joint: its number, from 0 on.
        torque: by so much the torque is off [N m, N].
    """

    share: float
    stage: str
    joint: int
    torque: float


def torque_noise(task: TaskPlan) -> TorqueNoise | None:
    """The worst of all stages and joints; None where encoders have no lines, or torques no law.

    By |K| r/2 of the positions, and |D| r/2 times what the estimate of velocities makes of it at
    most. K and D are du/dq and du/dq' about the equilibrium, K with what carries the arm.
    """
    context = task.context
    loaded, robot = context.loaded, context.robot
    encoder = loaded.true_task.robot.encoder
    if encoder is None or not loaded.task.robot.takes_torques:
        return None
    off = np.broadcast_to(encoder.resolution, robot.n) / 2
    if len(encoder.resolution) not in (1, robot.n) or not off.any():
        return None
    estimate = VelocityEstimate.of(loaded.task.control.velocity, context.period)
    carries, found = _of_gravity(context), None
    for name in task.stages:
        sampled = _loop(task, name)
        if sampled is None:
            continue
        noise = _noise(sampled, off, estimate, carries)
        shares = noise / robot.torque_limit
        i = int(np.argmax(shares))
        if found is None or shares[i] > found.share:
            found = TorqueNoise(float(shares[i]), name, i, float(noise[i]))
    return found


@rule("TS349", "encoders so coarse that torques jump", phase=Phase.STABILITY)
def coarse_encoders(task: TaskPlan) -> Iterator[Finding]:
    """Stages in which lines of the encoders move the torque by more than a part of its limit."""
    worst, loaded = torque_noise(task), task.context.loaded
    if worst is None or not worst.share > _SHARE:
        return
    unit = "N*m" if task.context.robot.hinges[worst.joint] else "N"
    declared = loaded.task.robot.encoder is not None
    estimate = VelocityEstimate.of(loaded.task.control.velocity, task.context.period)
    yield warning(
        "TS349",
        f"the lines of the encoders may move the torque of joint {worst.joint + 1} by "
        f"{show(worst.torque, unit, 3)} in stage {worst.stage!r}, {100 * worst.share:.0f} % of "
        "what it can exert",
        FILE.robot.encoder if declared else FILE.truth,
        _REMEDY_OF_NOISE[_kind(estimate)],
    )


_REMEDY_OF_NOISE = {
    "measured": "lower the stiffness, or take finer encoders",
    "differences": "take filtered differences, control: {velocity: {filter: 50 Hz}}, or an "
    "observer, control: {velocity: {observer: 80 Hz}}",
    "filter": "lower the corner of the filter, take an observer, or lower the damping",
    "observer": "lower the corner of the observer, or the damping of the law",
}


def _kind(estimate: VelocityEstimate | None) -> str:
    if estimate is None:
        return "measured"
    if estimate.modelled:
        return "observer"
    return "filter" if estimate.pole else "differences"


def _noise(
    sampled: SampledStage, off: Vector, estimate: VelocityEstimate | None, carries: Vector
) -> Vector:
    """(n,) by how much torques are off where positions are off by up to `off` (n,) [N m, N]."""
    n, of_u = len(off), sampled.controller.torque
    found = np.abs(of_u[:, :n] + carries) @ off
    if estimate is not None:
        found += estimate.of_position * (np.abs(of_u[:, n : 2 * n]) @ off)
    return np.asarray(found)


def _of_gravity(context: Context) -> Vector:
    """(n, n) dg/dq at the start, by differences."""
    terms, columns, still = PinocchioTerms(context.robot), [], np.zeros(context.robot.n)
    for step in _STEP * np.eye(len(still)):
        terms.at(context.start + step, still)
        above = np.array(terms.gravity)
        terms.at(context.start - step, still)
        columns.append((above - terms.gravity) / (2 * _STEP))
    return np.column_stack(columns)


@rule("TS517", "an observer that takes friction for motion", phase=Phase.STABILITY)
def observed_friction(task: TaskPlan) -> Iterator[Finding]:
    """Stages that friction keeps further from their reference than without an observer.

    Of a joint that friction holds against a torque u - g, the observer believes that it moves with
    c (u - g) / h, c = `of_acceleration`. A damper d takes that off, so that of a pull p only
    p / (1 + d c / h) is left, and the joint sticks that many times further from its reference.
    """
    context = task.context
    loaded = context.loaded
    estimate = VelocityEstimate.of(loaded.task.control.velocity, context.period)
    if estimate is None or not estimate.modelled or not any(loaded.true_task.robot.joint_friction):
        return
    n, H = context.robot.n, context.start_inertia
    worst, of = 0.0, ""
    for name in task.stages:
        sampled = _loop(task, name)
        if sampled is not None:
            D = -sampled.controller.torque[:, n : 2 * n]
            share = estimate.of_acceleration * np.linalg.eigvals(np.linalg.solve(H, D)).real.max()
            worst, of = max((worst, of), (float(share), name))
    if 1 + worst > _FARTHER:
        lag = scaled(estimate.of_acceleration, TIME, 2)
        yield warning(
            "TS517",
            f"friction holds joints up to {number(1 + worst, 2)} times as far from the reference "
            f"in stage {of!r} as with measured velocities: the observer, {lag} behind what it does "
            "not know, takes the torque against friction for motion, and the damper takes it off",
            FILE.control.velocity.observer,
            "raise its corner, or take filtered differences: control: {velocity: {filter: 50 Hz}}",
        )


@rule("TS518", "more friction compensated than there is", phase=Phase.STABILITY)
def over_compensated(task: TaskPlan) -> Iterator[Finding]:
    """Stages that may hunt, as they push harder against friction than friction does.

    Where it takes at least what is compensated, both together take energy. Else what is added is a
    spring about the reference, of which a swing may gain more than the friction takes.
    """
    friction, declared = task.context.friction, task.context.loaded.task.control.friction
    if friction is None or declared is None or not task.context.loaded.task.robot.takes_torques:
        return
    least, place = _least_friction(task)
    beyond = np.array(friction.coulomb) - least
    i = int(np.argmax(beyond))
    if not beyond[i] > 0:
        return
    for name in task.stages:
        sampled = _loop(task, name)
        gain = 0.0 if sampled is None else _gain(sampled, friction, least)
        if not gain > 1:
            continue
        unit = "N*m" if task.context.robot.hinges[i] else "N"
        gains = f"up to {number(gain, 2)} times what friction takes of it"
        yield warning(
            "TS518",
            f"joint {i + 1} gets {show(friction.coulomb[i], unit, 3)} against a friction of which "
            f"there may be {show(float(least[i]), unit, 3)}: in stage {name!r} a swing gains "
            f"{gains if math.isfinite(gain) else 'energy, and no friction takes any of it'} "
            f"in each period, and {'may' if gain < _LIKELY else 'is likely to'} go on (hunt)",
            place,
            "compensate a smaller share, or widen its sign: control: {friction: {share: "
            f"{100 * declared.share:.0f} %, "
            f"width: {show(10 * friction.width, 'mrad/s', 3)}}}}}",
        )
        return


def _gain(sampled: SampledStage, friction: Compensation, least: Vector) -> float:
    """As `gained`, 0 of a loop that cannot be analysed."""
    try:
        return gained(sampled, friction, least)
    except UnfitError:
        return 0.0


def _least_friction(task: TaskPlan) -> tuple[Vector, KeyPath]:
    """(n,) least friction that joints may have [N m, N], and where the file says so."""
    context = task.context
    loaded, n = context.loaded, context.robot.n
    least = np.broadcast_to(np.array(loaded.true_task.robot.joint_friction), n).astype(float)
    place = FILE.truth[_FRICTION] if _FRICTION in loaded.task.truth.paths else FILE.control.friction
    for variation in loaded.task.vary.get(_FRICTION, ()):
        if variation is not None:
            low = ends(context, _FRICTION, None, variation)[0]
            if low < least.min():
                least, place = np.full(n, low), FILE.vary[_FRICTION]
    return least, place


def _loop(task: TaskPlan, name: str) -> SampledStage | None:
    """The loop of a stage; None where its torque has no derivative, or it is no path of tools."""
    try:
        return loop_of(task, name)
    except UnfitError:
        return None
