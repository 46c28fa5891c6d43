"""Whether a task keeps to where the robot's own controller stops."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from taskspec.analysis.rehearsal import Rehearsal
from taskspec.foresight.approach import approach, striking_mass
from taskspec.foresight.commanded import commanded, commanded_joints
from taskspec.foresight.force_profile import force_profiles
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.rules.places import motion_of
from taskspec.spec import FILE, KeyPath
from taskspec.spec.protection import Protected, ProtectedTip, Protection, Wrenches
from taskspec.text.units import Dimension, show

_MOTIONS = ("speed", "acceleration", "jerk")
_SLOWER = {
    "speed": "move slower",
    "acceleration": "move slower, so that it is reached and left more gently",
    "jerk": "move slower, or begin and end where the reference rests",
}


def _protection(task: TaskPlan | StagePlan) -> Protection | None:
    return task.context.loaded.task.robot.protection


@rule({}, also=("TS414",), phase=Phase.TASK, bars=True)
def protected_joints(task: TaskPlan) -> Iterator[Finding]:
    """Protections that have another number of values than the robot has joints."""
    protection, robot = _protection(task), task.context.robot
    if protection is None or protection.joints is None:
        return
    n = robot.pin.nv
    for key, values in protection.joints.given:
        assert isinstance(values, tuple)
        if len(values) not in (1, n):
            yield error(
                "TS414",
                f"{len(values)} values for the {n} joints of {robot.name!r}",
                FILE.robot.protection.joints[key],
                "one value for all joints, or one for each",
            )


@rule("TS443", "a motion beyond the robot's protection")
def protected_motion(stage: StagePlan) -> Iterator[Finding]:
    """References that change faster than the robot's own controller lets them."""
    protection = _protection(stage)
    if protection is None:
        return
    course = commanded(stage)
    if course is None:
        return
    courses = dict(zip(_MOTIONS, (course.rates, course.accelerations, course.jerks), strict=True))
    for group, rows, what in (
        (protection.tip, slice(0, 3), "the tip's {}"),
        (protection.turn, slice(3, 6), "the {} of the tool's turn"),
    ):
        for key in _MOTIONS:
            most = None if group is None else getattr(group, key)
            sizes = np.linalg.norm(courses[key][:, rows], axis=1)
            i = int(np.argmax(sizes))
            if group is not None and most is not None and sizes[i] > most:
                yield _beyond(
                    stage, protection, group, key, what.format(key),
                    float(course.times[i]), float(sizes[i]), most, type(group).dimension_of(key),
                )  # fmt: skip
                return
    yield from _joints(stage, protection)


def _joints(stage: StagePlan, protection: Protection) -> Iterator[Finding]:
    joints, course, robot = protection.joints, commanded(stage), stage.context.robot
    if joints is None or course is None:
        return
    pieces = list(commanded_joints(stage, course))
    for row, key in enumerate(_MOTIONS):
        values = getattr(joints, key)
        if values is None or not pieces or len(values) not in (1, robot.pin.nv):
            continue
        bounds = np.broadcast_to(np.asarray(values), (robot.pin.nv,))
        piece = max(pieces, key=lambda p: float((p.most[row] / bounds).max()))
        i = int(np.argmax(piece.most[row] / bounds))
        if piece.most[row, i] > bounds[i]:
            dimension = type(joints).dimension_of(key)
            if not turns_at(robot, i):
                dimension = ProtectedTip.dimension_of(key)
            yield _beyond(
                stage, protection, joints, key, f"the {key} of joint {i + 1}",
                float(piece.time[row, i]), float(piece.most[row, i]), float(bounds[i]), dimension,
            )  # fmt: skip
            return


def _beyond(
    stage: StagePlan,
    protection: Protection,
    group: Protected,
    key: str,
    what: str,
    when: float,
    value: float,
    most: float,
    dimension: Dimension,
) -> Finding:
    return warning(
        "TS443",
        f"in stage {stage.name!r}, at t = {show(when, 's', 3)}, {what} is to be "
        f"{show(value, dimension, 3)}, and the robot's protection has {show(most, dimension, 5)} "
        f"({protection.source_of(group)}): its own controller stops there",
        motion_of(stage),
        _SLOWER[key],
    )


@rule("TS444", "a force beyond the robot's protection")
def protected_forces(stage: StagePlan) -> Iterator[Finding]:
    """Set points and blows at which the robot's own controller stops, or that no sensor shows."""
    protection = _protection(stage)
    groups = [] if protection is None else [g for g in (protection.reflex, protection.sensor) if g]
    least = {
        key: min(((v, g) for g in groups if (v := getattr(g, key)) is not None), default=None,
                 key=lambda each: each[0])
        for key in ("force", "torque")
    }  # fmt: skip
    if protection is None or not any(least.values()):
        return
    axes = FILE.stages[stage.name].axes
    wanted = dict(stage.set_points)
    for profile in force_profiles(stage):
        wanted[profile.axis] = float(np.abs(profile.values).max())
    for key, rotation in (("force", False), ("torque", True)):
        mine = {a: v for a, v in wanted.items() if a.is_rotation == rotation}
        bound = least[key]
        size = float(np.linalg.norm([*mine.values()]))
        if bound is not None and size > bound[0]:
            axis = max(mine, key=lambda a: abs(mine[a]))
            yield _too_hard(stage, protection, bound, key, f"asks for {_shown(key, size)}",
                            axes[axis][key], "ask for less")  # fmt: skip
            return
    way, bound = approach(stage, stage.nominal.gap), least["force"]
    if way is None or bound is None:
        return
    compliance = stage.context.compliances[way.contact]
    mass = striking_mass(stage, way.axis)
    peak = way.closing * max(float(np.sqrt(mass * compliance.stiffness)), compliance.damping)
    if peak > bound[0]:
        meets = f"meets {way.contact!r} with {show(way.closing, 'mm/s', 3)}, which makes about"
        yield _too_hard(stage, protection, bound, "force", f"{meets} {show(peak, 'N', 3)}",
                        axes[way.axis].velocity, "approach more slowly")  # fmt: skip


def _shown(key: str, value: float) -> str:
    return show(value, "N" if key == "force" else "N*m", 3)


def _too_hard(
    stage: StagePlan,
    protection: Protection,
    bound: tuple[float, Wrenches],
    key: str,
    does: str,
    place: KeyPath,
    hint: str,
) -> Finding:
    most, group = bound
    what = (
        "the robot's reflex stops it" if group is protection.reflex else "the sensor's range ends"
    )
    return warning(
        "TS444",
        f"stage {stage.name!r} {does}, and {what} at {_shown(key, most)} "
        f"({protection.source_of(group)}): the run stops there",
        place,
        hint,
    )


def fast_torques(task: TaskPlan, run: Rehearsal) -> Iterator[Finding]:
    """Torques of a rehearsal that change faster than the robot's own controller lets them."""
    protection, robot = _protection(task), task.context.robot
    rates = None if protection is None or protection.joints is None else protection.joints
    if protection is None or rates is None or rates.torque_rate is None or len(run.torque) < 2:
        return
    bounds = np.broadcast_to(np.asarray(rates.torque_rate), (robot.pin.nv,))
    sizes = np.abs(np.diff(run.torque, axis=0)) / task.context.period
    tick, joint = np.unravel_index(int(np.argmax(sizes / bounds)), sizes.shape)
    if sizes[tick, joint] <= bounds[joint]:
        return
    name = run.names[int(run.index[tick + 1])]
    unit = "N*m/s" if turns_at(robot, int(joint)) else "N/s"
    changes = int(run.index[tick]) != int(run.index[tick + 1])
    stage = task.stages[name]
    when = f", at t = {show(float(run.times[tick + 1]), 's', 3)}"
    yield warning(
        "TS445",
        f"run ahead, the torque of joint {joint + 1} changes by "
        f"{float(sizes[tick, joint]):.3g} {unit} {'as' if changes else 'in'} stage {name!r}"
        f"{' begins' if changes else when}, "
        f"and the robot's protection has {float(bounds[joint]):g} {unit} "
        f"({protection.source_of(rates)})",
        motion_of(stage) if stage.spec.axes or stage.spec.path else FILE.stages[name],
        "approach more slowly, press more softly, or keep the rate: solve: qp",
    )
