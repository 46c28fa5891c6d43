"""The tool in its frame's coordinates.

Kinds of frames count translations differently (docs/language/frames.md):

* fixed: the coordinate of the control point;
* turning with a handle: off its circle, along it from the stage's start, and along the axis;
* following a surface: x and y in lengths on the surface from the stage's start, z the gap;
* tracking the force: the distance of the tool point along the frame's axes from the stage's start;
* carried by the tool: the distance along the tool's own axes from the stage's start.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.geometry import rotation
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.clock import Clock
from taskspec.program.plan import StagePlan
from taskspec.program.reference.axis_plan import AxisPlan
from taskspec.program.reference.measurement import Measurement
from taskspec.program.world import kinematics
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.mechanisms import MechanismModel
from taskspec.robot.model_terms import TermSymbols


@dataclass(frozen=True, slots=True)
class Coordinates:
    """The measured coordinates of a stage's frame.

    Attributes:
        position: of every existing axis [m, rad].
        base: (3, 3) axes to which rotations are relative: the frame, or the tool's at entry.
        turned: (3, 3) rotation in those axes since the stage's start.
    """

    position: dict[Axis, ca.SX]
    base: ca.SX
    turned: ca.SX
    frame: FrameModel
    at: kinematics.FrameState
    tool: kinematics.ToolPoint
    point: kinematics.ControlPoint
    terms: TermSymbols
    clock: Clock
    plans: Mapping[Axis, AxisPlan]
    marks: Mapping[str, ca.SX]


def frame_coordinates(plan: StagePlan, measurement: Measurement) -> Coordinates:
    """Measured coordinates; takes the memory and parameters that the frame's kind needs."""
    frame, plans, at, terms = plan.frame, plan.plans, measurement.at, measurement.terms
    memory, parameters = measurement.memory, measurement.parameters
    marks: dict[str, ca.SX] = {}
    position: dict[Axis, ca.SX] = {}
    if frame.still:
        local = at.R.T @ (measurement.point.p - at.origin)
        position = {a: local[i] for i, a in enumerate(AXES[:3]) if a in plans}
    elif frame.kind == "turning":
        assert frame.mechanism is not None
        assert measurement.tracked is not None
        angle, since = measurement.tracked.angle, measurement.tracked.since
        local = on_handle(frame, frame.mechanism, terms.p, angle, since)
        position = {a: local[i] for i, a in enumerate(AXES[:3]) if a in plans}
    else:
        for name, length in (("reference_point", 3), ("place", 3)):
            marks[name] = memory.add(name, length)
        for a in AXES[:3]:
            marks[f"last.{a}"] = memory.add(f"last.{a}")
            marks[f"distance.{a}"] = memory.add(f"distance.{a}")
        here = measurement.point.p if at.foot is None else at.foot
        moved = at.R.T @ (here - marks["place"])
        position = {
            a: marks[f"distance.{a}"] + moved[i] for i, a in enumerate(AXES[:3]) if a in plans
        }
        if frame.kind == "following" and Axis.Z in plans:
            position[Axis.Z] = measurement.table[f"{frame.surface_name}.gap"]
    base, turned = at.R, ca.SX.eye(3)
    if any(a.is_rotation for a in plans):
        marks["orientation"] = parameters.add("orientation", 9)
        if not frame.still:
            marks["base"] = parameters.add("base", 9)
        if frame.kind == "tool":
            base = ca.reshape(marks["base"], 3, 3)
        start = ca.reshape(marks["orientation"], 3, 3)
        turned = base.T @ terms.R @ start.T
        angles = rotation.log(turned)
        position |= {a: angles[i] for i, a in enumerate(AXES[3:]) if a in plans}
    return Coordinates(
        position=position,
        base=base,
        turned=turned,
        frame=frame,
        at=at,
        tool=measurement.tool,
        point=measurement.point,
        terms=terms,
        clock=measurement.clock,
        plans=plans,
        marks=marks,
    )


def on_handle(
    frame: FrameModel, mechanism: MechanismModel, p: ca.SX, angle: ca.SX, since: ca.SX
) -> ca.SX:
    """Coordinates (3,) of a world point p (3,) in a frame that turns with a handle [m].

    Args:
        frame: placed on the handle of `mechanism`.
        angle: of the handle [rad].
        since: the angle from which the distance along the circle counts [rad].
    """
    away = mechanism.deviation(p, angle, since)
    return ca.DM(frame.rotation.T) @ (away - ca.DM(frame.origin))
