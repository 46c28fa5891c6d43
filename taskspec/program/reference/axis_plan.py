"""The control of each axis of a stage: the file's axes, completed with holds, paths and forces."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.modes import AxisMode, OnPath, OpenLoop
from taskspec.motion.path import PathShape
from taskspec.spec import AxisEntry, Law


@dataclass(frozen=True, slots=True)
class AxisPlan:
    """One axis of a stage.

    Attributes:
        axis: its entry in the file, or a hold where it has none.
        mode: what decides its motion reference.
        force: it has a force set point under a law with a force loop.
        motion: its motion error is controlled.
        soft: a motion axis with its own stiffness or damping, under a law that has such.
        open_loop: its force set point displaces the motion reference.
        world: a rotation that holds against the world although the frame turns.
        yields: a motion axis along the nominal contact's normal. The contact force on it is left
            uncancelled: cancelled, the arm would push through a surface as if it were not there.
    """

    axis: AxisEntry
    mode: AxisMode
    force: bool
    motion: bool
    soft: bool
    open_loop: bool
    world: bool
    yields: bool

    @property
    def set_point(self) -> bool:
        """Whether it has a force set point, whatever the law makes of it."""
        return self.force or self.open_loop

    @property
    def leads(self) -> bool:
        """Whether another axis may follow its reference: that of a motion which is commanded."""
        return self.motion and not self.force and self.mode.leads and not self.axis.is_soft


def plan_axes(
    axes: tuple[Axis, ...],
    declared: Mapping[Axis, AxisEntry],
    path: PathShape | None,
    law: Law,
    met: Collection[Axis],
) -> dict[Axis, AxisPlan]:
    """The plan of every axis that exists.

    Args:
        axes: those of the frame that exist.
        declared: the stage's entries.
        path, law: the stage's.
        met: axes that are mostly along the normal of their contact.
    """
    facts = law.control_law
    plans = {}
    for name in axes:
        axis = declared.get(name) or AxisEntry()
        open_loop = axis.has_force and not facts.force_loop and not axis.mode.lets_go
        force = axis.has_force and facts.force_loop
        plans[name] = AxisPlan(
            axis=axis,
            mode=_mode_of(name, axis, path, open_loop=open_loop),
            force=force,
            motion=not force or facts.shares,
            soft=facts.soft_axes and axis.is_soft and not force,
            open_loop=open_loop,
            world=axis.mode.world,
            yields=not force and name in met,
        )
    return plans


def uncontrolled(axes: tuple[Axis, ...]) -> dict[Axis, AxisPlan]:
    """Axes of a stage that controls the joints: nobody controls them."""
    entry = AxisEntry()
    nobody = AxisPlan(
        axis=entry,
        mode=entry.mode,
        force=False,
        motion=False,
        soft=False,
        open_loop=False,
        world=False,
        yields=False,
    )
    return dict.fromkeys(axes, nobody)


def _mode_of(name: Axis, axis: AxisEntry, path: PathShape | None, *, open_loop: bool) -> AxisMode:
    """The mode of an axis."""
    if open_loop:
        return OpenLoop(name.is_rotation)
    if path is not None and name in path.axes:
        return OnPath(name.is_rotation, path)
    return axis.mode


def not_finite(plans: Mapping[Axis, AxisPlan], outputs: Mapping[str, NDArray[np.float64]]) -> str:
    """The name of a reference that is not a number, as `force.z`; empty where all are.

    Args:
        plans: of the axes.
        outputs: of a tick, by name.
    """
    for name, plan in plans.items():
        i = AXES.index(name)
        for kind in ("position", "velocity"):
            if plan.motion and not np.isfinite(outputs[f"{kind}_ref"][i]):
                return f"{kind}.{name}"
        if plan.set_point and not np.isfinite(outputs["force_ref"][i]):
            return f"{'torque' if name.startswith('r') else 'force'}.{name}"
    return ""
