"""Artificial constraints of a stage's axes in words: what its law is to bring about.

v and w are velocity and angular velocity, f and m force and moment that the robot applies.
"""

from __future__ import annotations

from taskspec.geometry.axis import Axis
from taskspec.program.plan import StagePlan


def rate_symbol(axis: Axis) -> str:
    """The symbol of the velocity along or about an axis."""
    return f"w_{axis[1:]}" if axis.is_rotation else f"v_{axis}"


def force_symbol(axis: Axis) -> str:
    """The symbol of the force along or the moment about an axis."""
    return f"m_{axis[1:]}" if axis.is_rotation else f"f_{axis}"


def turns(stage: StagePlan) -> bool:
    """Whether the stage's frame turns as the tool moves."""
    frame = stage.frame
    curved = frame.surface is not None and not frame.surface.flat
    return frame.mechanism is not None or curved


def artificial(stage: StagePlan, axis: Axis) -> str:
    """The artificial constraint of an axis of a stage; empty where there is none."""
    plan, parts = stage.plans[axis], []
    if plan.motion:
        parts.append(plan.mode.constraint(axis, rate_symbol(axis), turns=turns(stage)))
    if plan.axis.set_point is not None:
        parts.append(plan.axis.set_point.constraint(force_symbol(axis)))
    return "; ".join(part for part in parts if part)
