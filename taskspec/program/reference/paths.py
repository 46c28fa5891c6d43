"""From a stage's `path` to the curve that drives its axes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from taskspec.expression import Expression
from taskspec.geometry.axis import ROTATIONS, Axis
from taskspec.motion.joint_path import JointPath
from taskspec.motion.path import PathShape
from taskspec.motion.paths import PathForm, TableFile
from taskspec.motion.table import OutsideError, Table, TableError, read_table
from taskspec.program.context import Context
from taskspec.program.errors import spec_error
from taskspec.program.known_value import known_value
from taskspec.program.reference.joint_motion import JointMotion
from taskspec.program.reference.path_share import values_within
from taskspec.robot import RobotError
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.robot.start import check_joints, inside_limits
from taskspec.spec import FILE, KeyPath, Path, Stage
from taskspec.spec.quantities import DimensionedNumber
from taskspec.text.codes import register
from taskspec.text.confines import REMEDY, confines, here
from taskspec.text.units import ANGLE, LENGTH, TIME, alternatives, fitting, parse_unit

register(
    {
        "TS220": "an axis that the arm does not have in this frame",
        "TS222": "a path that drives no axis",
        "TS223": "a table of points that cannot be used",
        "TS235": "a path that cannot be laid",
        "TS236": "a speed of a path without a greatest value",
        "TS227": "a path that only turns, at a speed of translation",
    }
)


def path_shape(
    context: Context, name: str, stage: Stage, axes: tuple[Axis, ...]
) -> PathShape | None:
    """The path of stage `name`, on the axes that it has coordinates for and `axes` does not name.

    Args:
        context: the task.
        name: of the stage.
        stage: its entry.
        axes: that exist in its frame.

    Raises:
        SpecError: the table cannot be read, or the path drives an axis that does not exist.
    """
    path = stage.path
    if path is None or path.joints is not None:
        return None
    place = FILE.stages[name].path
    form = path.form
    if isinstance(form, TableFile):
        form = replace(form, table=_table(context, name, path))
    _laid(context, form, axes, place)
    missing = [a for a in form.own if a not in axes and form.moves(a)]
    if missing:
        raise spec_error(
            context.loaded,
            place,
            "TS220",
            f"the path moves along {missing[0]!r}, which this arm cannot in this frame",
            f"axes that exist here: {', '.join(axes)}",
        )
    driven = tuple(a for a in form.own if a in axes and a not in stage.axes)
    if not driven:
        raise spec_error(
            context.loaded,
            place,
            "TS222",
            "the path drives no axis: `axes` names every axis that it has coordinates for",
            "leave the axes that the path drives out of `axes`",
        )
    still = not any(form.moves(a) for a in driven if not a.is_rotation)
    if path.speed is not None and still and not form.unknown_length:
        raise spec_error(
            context.loaded,
            place.speed,
            "TS227",
            "this path only turns, and `speed` is one along a way",
            "give the path a `time`",
        )
    if not isinstance(path.speed, Expression):
        return PathShape(form, driven, speed=path.speed, time=path.time)
    most = values_within(context, stage, path.speed).high
    if not 0 < most < math.inf:
        message = "the greatest speed of this path is not known, and it is planned for that"
        hint = "bound what slows it: 40 mm/s * clamp(1 - abs(force.x)/(20 N), 0, 1)"
        if most <= 0:
            message = "this path never moves: its speed is never more than 0"
            hint = "mind its sign: a path is gone along forwards"
        raise spec_error(context.loaded, place.speed, "TS236", message, hint)
    return PathShape(form, driven, speed=most, slowed=path.speed)


def joint_path(context: Context, name: str, stage: Stage) -> JointPath | JointMotion | None:
    """The path of joints of stage `name`; None where it has none.

    Raises:
        SpecError: TS411 where its positions are not such of the robot's joints, and where a speed
            of turning is given to joints that slide.
    """
    path = stage.path
    if path is None or path.joints is None:
        return None
    robot, place = context.robot, FILE.stages[name].path.joints
    if path.joint_motion:
        return _joint_motion(context, name, stage, path.joint_motion)
    several = len(path.joint_targets) > 1
    for i, target in enumerate(path.joint_targets):
        of = f"target {i + 1} of the path" if several else "the path"
        try:
            check_joints(robot, target, of, ())
            inside_limits(robot, target, "go to", ())
        except RobotError as error:
            raise spec_error(
                context.loaded, place, error.code, error.message, error.hint
            ) from error
    slides = [i for i in range(robot.n) if not turns_at(robot, i)]
    if slides and path.joint_speed is not None:
        i = slides[0]
        raise spec_error(
            context.loaded,
            place,
            "TS411",
            f"joint {i + 1} ({robot.joint_names[i]!r}) slides, and `speed` is one of turning",
            "give the path a `time`",
        )
    return JointPath(
        tuple(tuple(map(float, target)) for target in path.joint_targets),
        path.joint_speed,
        path.time,
    )


def _joint_motion(
    context: Context, name: str, stage: Stage, positions: tuple[Expression, ...]
) -> JointMotion:
    """A path of joints that are expressions of time."""
    path, place = stage.path, FILE.stages[name].path.joints
    assert path is not None
    assert path.time is not None
    params = {param: quantity.value for param, quantity in context.loaded.task.params.items()}
    measured = [
        DimensionedNumber(0.0, None if known_value(context, each) == 0 else each.dimension)
        for each in positions
    ]
    try:
        check_joints(context.robot, measured, "the path", ())
    except RobotError as error:
        raise spec_error(context.loaded, place, error.code, error.message, error.hint) from error
    by_t = any(each.uses("t") for each in positions)
    return JointMotion(
        positions=positions,
        time=path.time,
        turns=tuple(turns_at(context.robot, i) for i in range(context.robot.n)),
        from_rest=by_t
        and not any(each.uses("clock") for each in positions)
        and not by_phase(stage),
        params=params,
    )


def joint_end(
    context: Context, positions: tuple[Expression, ...], time: float
) -> NDArray[np.float64] | None:
    """(n,) where joints are that go by expressions of time when that is over; None if unknown."""
    found = [known_value(context, each, {"t": time}) for each in positions]
    known = [each for each in found if each is not None]
    return np.array(known, dtype=float) if len(known) == len(found) else None


def by_phase(stage: Stage) -> bool:
    """Whether a force or a velocity of a stage goes by its t, so that others keep their phase."""
    others = [entry.set_point.wanted for entry in stage.axes.values() if entry.set_point]
    others += [each for point in stage.constraints.values() for each in point.expressions]
    for entry in stage.axes.values():
        others += [e for e, place in entry.mode.expressions() if not place]
    return any(expression.uses("t") for expression in others)


def _laid(context: Context, form: PathForm, axes: tuple[Axis, ...], place: KeyPath) -> None:
    """Refuses a curve that cannot be laid."""
    wrong = form.unfit(axes)
    if wrong is None:
        return
    here = (place if form.bare else place[form.name])[wrong.key]
    raise spec_error(context.loaded, here, wrong.code, wrong.message, wrong.hint)


def _table(context: Context, name: str, path: Path) -> Table:
    assert path.file is not None
    loaded = context.loaded
    folder = loaded.base or FilePath()
    place = FILE.stages[name].path.file
    try:
        table = read_table(here(folder / path.file), _factor, confines(loaded.base))
    except OutsideError as error:
        message = f"{path.file!r} lies outside of the task's project"
        raise spec_error(loaded, place, "TS409", message, REMEDY) from error
    except OSError as error:
        message = f"cannot read {path.file!r}: {error.strerror}"
        hint = "paths are relative to the task file"
        raise spec_error(loaded, place, "TS223", message, hint) from error
    except TableError as error:
        at = f"{path.file}:{error.line}" if error.line else str(path.file)
        raise spec_error(loaded, place, "TS223", f"{at}: {error}") from error
    timed = table.time is not None
    if timed and (path.speed is not None or path.time is not None):
        key = "speed" if path.speed is not None else "time"
        message = f"{path.file} has a t column, which times the path already"
        raise spec_error(
            loaded, FILE.stages[name].path[key], "TS223", message, f"leave '{key}' out"
        )
    if not timed and path.speed is None and path.time is None:
        raise spec_error(
            context.loaded,
            place,
            "TS223",
            f"{path.file} has no t column, so the path needs `speed` or `time`",
        )
    return table


def _factor(unit: str, column: str) -> float:
    """Factor to SI of a column's unit.

    Raises:
        ValueError: the unit does not exist or does not fit the column.
    """
    wanted = TIME if column == "t" else ANGLE if column in ROTATIONS else LENGTH
    fits = alternatives(fitting(wanted))
    try:
        found = parse_unit(unit)
    except ValueError as error:
        raise ValueError(f"column {column!r}: no unit {unit!r}; {fits} fit") from error
    if found.dimension != wanted:
        raise ValueError(f"column {column!r}: {unit!r} does not fit; {fits} do")
    return float(found.scale)
