"""What a task is predicted to come to where its closed loop is run ahead."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.analysis.oscillation import (
    LEAST_FORCE,
    LEAST_MOMENT,
    LEAST_SPEED,
    OF_SET_POINT,
    OF_TORQUE,
    References,
    amid_noise,
    judged,
    oscillation,
)
from taskspec.analysis.rehearsal import Rehearsal, rehearsal_of
from taskspec.analysis.rehearsed_signals import RehearsedSignals
from taskspec.analysis.saturation import LASTS, torque_share, velocity_share
from taskspec.foresight.conditions import names, parts
from taskspec.foresight.doubts import doubted
from taskspec.geometry.axis import ROTATIONS, TRANSLATIONS
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.stages.protected import PROTECTION, about_force
from taskspec.rules import Finding, Phase, rule, warning
from taskspec.rules.places import motion_of
from taskspec.rules.predicted_forces import close_calls
from taskspec.rules.protection import fast_torques
from taskspec.spec import FILE, KeyPath
from taskspec.spec.stage import OSCILLATION, SATURATION
from taskspec.text.expression import Expression, evaluate
from taskspec.text.expression.series import SeriesAlgebra
from taskspec.text.expression.tree import Node
from taskspec.text.units import FORCE, MOMENT, VELOCITY, Dimension, show

Vector = NDArray[np.float64]

_SERIES = SeriesAlgebra()
#: The part of a stage that one has which is left out.
_VISITS = "visits"
#: The plain plant's forces are those of the simulator to within this share, 0.4 % at their blows:
#: what comes so close to a bound may come beyond it.
_CLOSE = 0.01
#: Noise of a sensor passes so many of its deviations now and then in a stage.
_NOISE = 3.5
_SLOWER = "move or approach more slowly, or raise the limit"
_FURTHER = "give it more time or way, or let the guard wait for less"
#: Codes that stand for what stops a run or fails, and what helps.
_ENDS = {
    "force": ("TS616", _SLOWER),
    "torque": ("TS616", _SLOWER),
    "speed": ("TS420", _SLOWER),
    "deviation": ("TS420", "move more slowly, hold its axes more stiffly, or raise the limit"),
    "joint_velocity": ("TS424", "move more slowly, or start in another posture"),
    "joint_position": ("TS424", "shorten the way, or start in another posture"),
    "singularity": ("TS422", "keep the arm bent: shorten the way, or start elsewhere"),
    "frame_left": ("TS425", "shorten the way, or end the stage before"),
    "time": ("TS611", _FURTHER),
    "travel": ("TS617", _FURTHER),
    "fail_if": ("TS618", "let it begin beyond what the stage comes to, or press less"),
}
#: What helps where a path of joints presses on something: it does so at any speed.
_ROUND = "lead the joints clear of what the tool presses on, or raise the limit"
#: Codes about what a grip bears.
_OF_GRIPS = {"TS322", "TS328", "TS329", "TS420", "TS610", "TS616"}
#: Codes that leave open how a run ends. Some say what it will be like, or that it misses what is
#: expected; in it only the tool's end touches (TS428); a blow may be less than predicted (TS616).
_OPEN = {
    *("TS426", "TS428", "TS430", "TS431", "TS613", "TS614", "TS616", "TS619"),
    *("TS720", "TS722", "TS723", "TS724", "TS725", "TS726", "TS727"),
}
#: Nothing is added where one of these is reported at the same place.
_UNLESS = (
    *("TS420", "TS422", "TS424", "TS425", "TS443", "TS444", "TS501"),
    *("TS610", "TS611", "TS613", "TS614", "TS616", "TS617", "TS618", "TS619"),
    *("TS720", "TS722", "TS723", "TS724", "TS725", "TS726", "TS727"),
)


@rule(
    {"TS445": "a torque that changes faster than the robot's protection lets it"},
    also=(
        *("TS420", "TS422", "TS424", "TS425", "TS426", "TS443", "TS444", "TS502"),
        *("TS611", "TS616", "TS617", "TS618", "TS726"),
    ),
    phase=Phase.REHEARSAL,
)
def rehearsed_ends(task: TaskPlan) -> Iterator[Finding]:
    """Tasks that are stopped, fail or miss what they expect when their loop is run ahead."""
    # What is reported already is not looked for again; of a mechanism reports may be amiss.
    if task.reported - _OPEN and (not task.context.held or task.reported & _OF_GRIPS):
        return
    doubt = any(doubted(task)) or bool(close_calls(task))
    run = rehearsal_of(task) if doubt else None
    if run is None:
        return
    if run.status in ("stopped", "failed"):
        yield from (each for each in _ended(task, run) if each.code not in task.reported)
        return
    yield from fast_torques(task, run)
    close = list(_close_limits(task, run))
    yield from close[:1]
    # The stage in which a run is broken off is not over.
    over = [name for name in run.names if run.status == "done" or name != run.stage]
    for name in over:
        yield from _unrest(task, run, name)
    for expectation in task.context.loaded.task.expect:
        expression = expectation.expression
        for condition in parts(expression.tree):
            if _misses(task, run, condition):
                yield _missed(run, expression, condition)


def _ended(task: TaskPlan, run: Rehearsal) -> Iterator[Finding]:
    """How a run does not come to its end."""
    stage, time, cause = task.stages[run.stage], show(float(run.times[-1]), "s", 3), run.cause
    if cause == PROTECTION:
        code = "TS444" if about_force(run.text) else "TS443"
        hint = "move or approach more slowly"
    elif cause in _ENDS:
        code, hint = _ENDS[cause]
    else:
        return
    if cause == "force" and stage.joint_path is not None:
        hint = _ROUND
    own, place = FILE.stages[run.stage], _place(stage)
    if cause in ("time", "travel"):
        place = own.within[cause]
    elif cause == "fail_if":
        place = own.fail_if
    yield warning(
        code,
        f"run ahead, stage {run.stage!r} {'stops the run' if run.status == 'stopped' else 'fails'} "
        f"at t = {time}: {run.text}{_peak(run)}",
        place,
        hint,
        unless=_UNLESS,
    )


def _place(stage: StagePlan) -> KeyPath:
    return motion_of(stage) if stage.spec.axes or stage.spec.path else FILE.stages[stage.name]


def _peak(run: Rehearsal) -> str:
    """The largest speed or force of the last stage, as the end of a sentence."""
    mine = run.ticks(run.stage)
    if not mine.any():
        return ""
    if run.cause == "speed":
        return f" (it comes to {show(float(run.field('speed')[mine].max()), 'mm/s', 4)})"
    most = float(np.linalg.norm(run.wrench[mine, :3], axis=1).max())
    return f" (its force comes to {show(most, 'N', 3)})" if 0 < most < math.inf else ""


def _close_limits(task: TaskPlan, run: Rehearsal) -> Iterator[Finding]:
    """Limits that a run comes so near to that noise, or what is not modelled, may stop it."""
    noise = task.context.loaded.true_task.robot.sensor.noise
    least = 0.0 if noise is None else _NOISE * noise.force
    for name in run.names:
        stage, mine = task.stages[name], run.ticks(name)
        if not mine.any():
            continue
        force = float(np.linalg.norm(run.wrench[mine, :3], axis=1).max())
        speed = float(run.field("speed")[mine].max())
        most = _stops_at(stage, "force")
        if most is not None and (1 + _CLOSE) * force + least > most:
            yield warning(
                "TS616",
                f"run ahead, stage {name!r} comes to {show(force, 'N', 3)}, and the limit on force "
                f"is {show(most, 'N', 3)}: too little is left between them",
                _place(stage),
                _SLOWER,
                unless=_UNLESS,
            )
        most = _stops_at(stage, "speed")
        if most is not None and (1 + _CLOSE) * speed > most:
            yield warning(
                "TS426",
                f"run ahead, stage {name!r} comes to {show(speed, 'mm/s', 3)}, and the limit on "
                f"speed is {show(most, 'mm/s', 3)}: too little is left between them",
                _place(stage),
                "move more slowly, or raise the limit",
                unless=_UNLESS,
            )


def _stops_at(stage: StagePlan, limit: str) -> float | None:
    """A limit that stops the run, as one does in the stage to which it leads."""
    leads = stage.limits.then(limit) not in ("", stage.name)
    return None if leads else getattr(stage.limits, limit)


def _unrest(task: TaskPlan, run: Rehearsal, name: str) -> Iterator[Finding]:
    """An oscillation that does not decay, or a joint at its torque limit, as a verdict sees it."""
    stage, mine = task.stages[name], run.ticks(name)
    half = judged(int(mine.sum()))
    if not half:
        return
    share, limit = max(_at_limits(task, run, name))
    if SATURATION not in stage.spec.allow and share > LASTS:
        yield warning(
            "TS420",
            f"run ahead, stage {name!r} has {limit} for {100 * share:.0f} % of its last half",
            _place(stage),
            "ask for less, or start where the arm bears it better",
            unless=("TS420",),
        )
    if OSCILLATION in stage.spec.allow:
        return
    moved = [run.field(f"{kind}_ref")[mine] for kind in ("position", "velocity", "force")]
    columns = [column for each in moved for column in each.T if np.isfinite(column).all()]
    references = References(columns)
    noisy = task.context.loaded.true_task.robot.sensor.noise is not None
    for signal, dimension, least, values in _watched(task, run, stage, half):
        if np.ptp(values[-half:]) < least:
            continue
        found = oscillation(values, task.context.period, least, references, noisy=noisy)
        if found is not None:
            yield warning(
                "TS502",
                f"run ahead, {signal} of stage {name!r} oscillates at "
                f"{found.frequency:.3g} Hz with an amplitude of "
                f"{show(found.amplitude, dimension, 3)}, which does not decay",
                _place(stage),
                "lower the gains of its loop, or approach more slowly",
                unless=("TS501", "TS502"),
            )
            return


def _at_limits(task: TaskPlan, run: Rehearsal, name: str) -> Iterator[tuple[float, str]]:
    """The share of a stage's last half in which each joint is at a limit, and at which."""
    robot, mine = task.context.robot, run.ticks(name)
    resolution, codes = run.resolutions[run.names.index(name)], run.field("limits")[mine][:, 0]
    for i, most in enumerate(robot.torque_limit):
        share = torque_share(run.torque[mine][:, i], float(most))
        yield share, f"joint {i + 1} at its torque limit"
    if resolution is None:
        return
    for i, most in enumerate(robot.velocity_limit):
        share = velocity_share(resolution, i, codes, run.v[mine][:, i], float(most))
        yield share, f"joint {i + 1} at its velocity limit"


def _watched(
    task: TaskPlan, run: Rehearsal, stage: StagePlan, half: int
) -> Iterator[tuple[str, Dimension, float, Vector]]:
    """Name, dimension, least amplitude that counts [SI] and values of what a verdict looks at."""
    mine = run.ticks(stage.name)
    forces = RehearsedSignals(task.context, run).forces[mine]
    sensor = task.context.loaded.true_task.robot.sensor
    force, moment = amid_noise(sensor, task.context.period, half)
    for axes, dimension, least in (
        (TRANSLATIONS, FORCE, max(LEAST_FORCE, force)),
        (ROTATIONS, MOMENT, max(LEAST_MOMENT, moment)),
    ):
        rows = [axis.row for axis in axes]
        wanted = run.field("force_ref")[mine][-half:, rows]
        least = max(least, OF_SET_POINT * float(np.nanmax(np.abs(wanted), initial=0.0)))
        for axis in (axis for axis in axes if axis in stage.axes):
            yield f"{axis.effort}.{axis}", dimension, least, forces[:, axis.row]
    wanted = run.field("velocity_ref")[mine][-half:, :3]
    least = max(LEAST_SPEED, OF_SET_POINT * float(np.nanmax(np.abs(wanted), initial=0.0)))
    for axis in stage.translations:
        yield f"velocity.{axis}", VELOCITY, least, run.field("velocity")[mine][:, axis.row]
    for i, most in enumerate(task.context.robot.torque_limit):
        if math.isfinite(most):
            yield f"joint.{i + 1}.torque", MOMENT, OF_TORQUE * float(most), run.torque[mine][:, i]


def _misses(task: TaskPlan, run: Rehearsal, condition: Node) -> bool:
    """Whether a condition is broken, also where forces miss their set points by a little more."""
    about = {n.path[0] for n in names(condition) if n.path[-1] != _VISITS} & {*run.names}
    if run.status == "open" and (run.stage in about or not about):
        return False
    if not all(run.ticks(name).any() for name in about):
        return run.status == "done"  # What is expected of a stage that is left out is missed.
    for share in (0.0, _CLOSE):
        signals = RehearsedSignals(task.context, run, share)
        worth = evaluate(condition, _SERIES, signals.find)
        if worth.known and not bool((worth.inside() == 1).all()):
            return True
    return False


def _missed(run: Rehearsal, expression: Expression, condition: Node) -> Finding:
    ends = "comes to its end and " if run.status == "done" else ""
    return warning(
        "TS726",
        f"run ahead, the task {ends}misses this",
        expression.where(condition),
        "give the stage more time, change what moves it, or expect what it comes to",
        unless=_UNLESS,
    )
