"""What is decided about a stage before any expression: axes, plans, gains, what it touches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import Axis
from taskspec.laws.gains import AxisPlant, Gains, value_of
from taskspec.motion.path import PathShape
from taskspec.program.axes import existing_axes
from taskspec.program.context import Context
from taskspec.program.reference import orientation
from taskspec.program.reference.constraints import active_equations, equation_gains
from taskspec.program.reference.coupling import Coupling, coupling
from taskspec.program.reference.modes import AxisPlan, plan_axes
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.moving_base import MovingBase
from taskspec.spec import Law, Limits, Stage


@dataclass(frozen=True, slots=True)
class PlannedStage:
    """A stage of a task, with what holds for it.

    Attributes:
        name: as in the file. spec: its entry there. law, limits: as they hold for it.
        frame: its task frame. axes_rotation: (3, 3) that frame at the start pose.
        axes: that exist in it. plans: who controls each of them. gains: with their origins.
        path: its path, if any. couplings: of the axes that follow a mechanism.
        contact: the object that forces are believed to act on.
        stiffness: believed of that contact [N/m], 0 without one.
        moving_base: how the object that carries the frame moves; None where nothing does.
        active: equations that constrain the stage.
    """

    name: str
    spec: Stage
    law: Law
    limits: Limits
    frame: FrameModel
    axes_rotation: NDArray[np.float64]
    axes: tuple[Axis, ...]
    plans: Mapping[Axis, AxisPlan]
    gains: Gains
    path: PathShape | None
    couplings: Mapping[Axis, Coupling]
    contact: str | None
    stiffness: float
    moving_base: MovingBase | None
    active: tuple[str, ...]


def plan_stage(
    context: Context,
    name: str,
    path: PathShape | None,
    axes_rotation: NDArray[np.float64],
    gains: Gains | None,
) -> PlannedStage:
    """Decides what a stage is made of.

    Args:
        context: what the stages share. name: the stage's.
        path: in SI units, already restricted to the axes that it drives.
        axes_rotation: (3, 3) the stage's frame at the start pose.
        gains: in place of those of the file and of the design.
    """
    stage = context.loaded.task.stages[name]
    frame, law = context.frame_of(stage), context.law_of(stage)
    axes = existing_axes(context.robot.axes, axes_rotation)
    contact = context.contact_of(frame)
    normal = None if contact is None else axes_rotation.T @ context.start_normals[contact]
    plans = plan_axes(axes, stage.axes, path, law, normal)
    active = active_equations(law, stage, context.equations)
    if gains is None:
        gains = _design(context, frame, law, plans, active, axes_rotation)
    return PlannedStage(
        name=name,
        spec=stage,
        law=law,
        limits=context.limits_of(stage),
        frame=frame,
        axes_rotation=axes_rotation,
        axes=axes,
        plans=plans,
        gains=gains,
        path=path,
        couplings={
            a: coupling(context, frame, axes_rotation, plans, a)
            for a, plan in plans.items()
            if plan.mode == "follows"
        },
        contact=contact,
        stiffness=context.stiffness_of(frame),
        moving_base=context.base_of(frame),
        active=active,
    )


def _design(
    context: Context,
    frame: FrameModel,
    law: Law,
    plans: Mapping[Axis, AxisPlan],
    active: Sequence[str],
    axes_rotation: NDArray[np.float64],
) -> Gains:
    """Gains of the axes, of the equations `active` and of the joints."""
    axes = tuple(plans)
    felt = context.felt_stiffness(frame, axes, axes_rotation)
    rates = orientation.rates_of(law, axes_rotation.T @ context.start_R)
    plants = context.plants(axes, axes_rotation, felt, rates, context.lever_of(frame))
    gains = law.design({a: p.axis for a, p in plans.items()}, plants)
    for gain, by_name in equation_gains(context, law, active, context.equations).items():
        gains.setdefault(gain, {}).update(by_name)
    if law.control_law.damps_joints:
        stiffness = [_stiffness(gains, plans, plants, a) for a in axes]
        joints = context.joint_plants(axes, axes_rotation, stiffness, rates)
        gains["joint_damping"] = law.design_joints(joints)
    return gains


def _stiffness(
    gains: Gains, plans: Mapping[Axis, AxisPlan], plants: Mapping[Axis, AxisPlant], axis: Axis
) -> float:
    """Of spring and contact together, on an axis [N/m, N m/rad]."""
    contact = plants[axis].k if plans[axis].axis.has_force else 0.0
    return value_of(gains, "stiffness", axis) + contact
