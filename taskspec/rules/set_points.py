"""Set points of force against limits, the surface that returns them, and the time that is left."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from taskspec.geometry.axis import Axis
from taskspec.laws.gains import on_axis
from taskspec.program.axes import MOSTLY
from taskspec.program.limits.consistency import SET_POINT_SHARE
from taskspec.program.plan import StagePlan
from taskspec.rules import Finding, Phase, rule, warning
from taskspec.spec import FILE, KeyPath, SetPoint
from taskspec.statics.rows import shares_of
from taskspec.text.units import FORCE, in_si, show


@rule("TS308", "a pull on a surface that can only push", phase=Phase.AXES)
def pulls(stage: StagePlan) -> Iterator[Finding]:
    """Constant set points that a surface, or an equation, can never return."""
    for axis, value in stage.set_points.constant.items():
        along = stage.contacts.facing(axis)
        if abs(along) > MOSTLY and value * along > 0:
            yield warning(
                "TS308",
                f"{value:g} N along {axis!r} pulls on {stage.contacts.of(axis)!r}, which can only "
                "push back",
                FILE.stages[stage.name].axes[axis].force,
                "forces are what the robot applies: pressing goes against the outward normal",
            )
    for equation, value, place in _on_equations(stage):
        model = stage.context.equations[equation]
        relation = model.constraint.relation
        presses = {"<=": 1, ">=": -1}.get(relation, 0)
        if presses * value < 0:
            pull = in_si(value, FORCE.on(rotation=model.angular))
            yield warning(
                "TS308",
                f"{pull} pulls on {equation!r}, which can only push back",
                place,
                f"under {relation} pressing is {'positive' if presses > 0 else 'negative'}: it "
                "goes along the gradient of left minus right",
            )


@rule("TS610", "a limit below a set point", phase=Phase.AXES)
def limited_set_points(stage: StagePlan) -> Iterator[Finding]:
    """Constant set points that the stage's own limit on force stops."""
    most = stage.limits.force
    if most is None:
        return
    own = FILE.stages[stage.name]
    values = [
        (v, own.axes[a].force) for a, v in stage.set_points.constant.items() if not a.is_rotation
    ]
    values += [
        (value, place)
        for equation, value, place in _on_equations(stage)
        if not stage.context.equations[equation].angular
    ]
    for value, place in values:
        if abs(value) <= shares_of(stage).force * most:
            continue
        effect = (
            f"keeps this stage at {SET_POINT_SHARE * most:g} N instead of {abs(value):g} N"
            if stage.law.solve == "qp"
            else f"stops this stage before its {abs(value):g} N"
        )
        yield warning(
            "TS610",
            f"the limit on force, {most:g} N, {effect}",
            place,
            "raise the limit, for this stage by its own `limits`, or lower the force",
        )


@rule("TS619", "a ramp that is longer than its stage", phase=Phase.AXES)
def long_ramps(stage: StagePlan) -> Iterator[Finding]:
    """Set points that are not reached before the time of their stage is over."""
    time = stage.spec.time
    if time is None or stage.spec.until is not None:
        return
    for axis in stage.set_points.constant:
        force = stage.spec.axes[axis].set_point
        if force is not None and force.rise > time:
            key = axis.effort if force.ramp is None else "ramp"
            yield warning(
                "TS619",
                f"the set point is reached in {show(force.rise, 's', 3)}, and the stage ends after "
                f"{show(time, 's', 3)}",
                FILE.stages[stage.name].axes[axis][key],
                "let the stage last longer, or shorten the ramp",
            )


@rule("TS615", "force control that begins off the surface")
def presses_in_the_air(stage: StagePlan) -> Iterator[Finding]:
    """Stages that press on a surface which they do not touch as they start.

    A force loop in the air goes at f_d/d towards the surface, d its damping, and at a multiple of
    that once its integral is full. What it covers while the set point is ramped is no matter, nor
    is a tool that a limit on the power of its law's tank slows down.
    """
    if _bounded(stage):
        return
    for axis, gap, speed in in_the_air(stage):
        at = "" if not math.isfinite(speed) else f" at up to {show(speed, 'mm/s', 2)}"
        yield warning(
            "TS615",
            f"stage {stage.name!r} presses {show(gap, 'mm', 3)} off {stage.contacts.main!r}: "
            f"nothing returns the force, and the tool goes there{at}",
            FILE.stages[stage.name].axes[axis].force,
            "let a stage before it touch: a velocity until a force is measured",
        )


def in_the_air(stage: StagePlan) -> Iterator[tuple[Axis, float, float]]:
    """Axes that press from off the surface, how far [m], and how fast they may go there [m/s]."""
    law, gap = stage.law.control_law, stage.nominal.gap
    if gap is None or not law.force_loop:
        return
    for axis, value in stage.set_points.constant.items():
        entry = stage.spec.axes[axis]
        force = entry.set_point
        if force is None or entry.mode.travels:
            continue
        along = stage.contacts.facing(axis)
        if (
            stage.contacts.of(axis) != stage.contacts.main
            or abs(along) < MOSTLY
            or value * along > 0
        ):
            continue
        gains = on_axis(stage.gains, axis)
        damping = law.loop_damping(gains)
        if gap * damping > abs(value) * force.rise / 2:
            yield axis, gap, law.unreturned(gains) * abs(value) / damping if damping else math.inf


def _bounded(stage: StagePlan) -> bool:
    """Whether a tank bounds the power with which the tool goes to a surface."""
    return stage.law.tank is not None and stage.law.tank.power is not None


def _on_equations(stage: StagePlan) -> Iterator[tuple[str, float, KeyPath]]:
    """Equations with a constant set point, its value [N, N m], and where it stands."""
    for equation, entry in stage.spec.constraints.items():
        value = _multiplier(stage, equation, entry)
        if value is not None:
            key = "torque" if stage.context.equations[equation].angular else "force"
            key = key if entry.generalised is None else "generalised"
            yield equation, value, FILE.stages[stage.name].constraints[equation][key]


def _multiplier(stage: StagePlan, equation: str, point: SetPoint) -> float | None:
    """A constant set point along a unit gradient [N, N m]; of joint torques that at the start."""
    if point.wanted is not None:
        return stage.known(point.wanted)
    values = [stage.known(each) for each in point.expressions]
    torques = np.array([value for value in values if value is not None])
    normal = stage.context.start_equations[equation].normal
    if len(torques) != len(normal):
        return None
    return float(normal @ torques / (normal @ normal))
