"""Entering a stage: where the carried reference is in its frame, and how to go on from there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.control.gains import FORCE_LOOP_LAWS
from taskspec.control.state import AXES
from taskspec.geometry.surface import box_face
from taskspec.motion import blend, profile
from taskspec.motion.path import PathPlan
from taskspec.motion.polynomial import PiecewiseCubic
from taskspec.program.stage import PROBE, CompiledStage
from taskspec.robot import RobotModel

Vector = NDArray[np.float64]

#: Speed of a move that names none [m/s, rad/s] (language.md section 7).
MOVE_SPEED = {"linear": 0.05, "angular": np.deg2rad(30.0)}


@dataclass(frozen=True, slots=True)
class Carried:
    """The one reference pose that goes from stage to stage.

    Attributes:
        p, R: (3,), (3, 3) reference pose of the tip in the world. Axes that a force set point
            has moved are where they were measured.
        twist: (6,) its velocity, world axes, at the tip.
        held: (6,) wrench that the robot applied on axes with a force set point, world [N, N m].
    """

    p: Vector
    R: Vector
    twist: Vector
    held: Vector = field(default_factory=lambda: np.zeros(6))


@dataclass(slots=True)
class Tracks:
    """The piecewise cubics of a stage and the next time at which one of them changes."""

    cubics: dict[str, PiecewiseCubic] = field(default_factory=dict)
    path: PathPlan | None = None
    knots: list[float] = field(default_factory=list)
    passed: int = 0

    @property
    def next_knot(self) -> float:
        """Stage time [s] of the next change, infinite after the last."""
        return self.knots[self.passed] if self.passed < len(self.knots) else np.inf

    def refresh(self, stage: CompiledStage, parameters: Vector, t: float) -> None:
        """Writes the segments that hold at stage time t [s] into the parameters."""
        while self.next_knot <= t:
            self.passed += 1
        for name, cubic in self.cubics.items():
            stage.parameters.write(parameters, f"segment.{name}", cubic.segment(t))
        if self.path is not None:
            timing = self.path.timing
            stage.parameters.write(parameters, "segment.path", timing.segment(t))
            s = timing(t)
            for axis, spline in self.path.splines.items():
                stage.parameters.write(parameters, f"table.{axis}", spline.segment(s))


@dataclass(frozen=True, slots=True)
class Entered:
    """Numbers of a stage that has just been entered."""

    parameters: Vector
    memory: Vector
    tracks: Tracks


def enter(
    stage: CompiledStage,
    robot: RobotModel,
    carried: Carried,
    tip: tuple[Vector, Vector],
    inputs: Sequence[Vector],
) -> Entered:
    """Starts a stage from the carried reference (language.md section 4: hold, bumpless).

    Args:
        stage: the stage. robot: for its tool.
        carried: the reference that the last stage left.
        tip: (3,), (3, 3) measured pose of the tip.
        inputs: the tick's inputs before memory and parameters, at t = 0.
    """
    parameters, memory = np.zeros(stage.parameters.size), np.zeros(stage.memory.size)
    for slot, value in stage.initial.items():
        stage.memory.write(memory, slot, value)
    write = _writer(stage, parameters)
    p, R = tip
    write("entry", p)
    if "frame.face" in stage.parameters:
        assert stage.frame.surface is not None
        center = p if robot.tool.flat else p + R @ robot.tool.centers[0]
        write("frame.face", box_face(stage.frame.surface, stage.frame.surface.face(center)))
    if "lever" in stage.parameters:
        write("lever", R.T @ (stage.frame.origin - p))
    seen = _look(stage, inputs, memory, parameters, carried, R)
    if "place" in stage.memory:
        stage.memory.write(memory, "place", seen["here"])
        seen = _look(stage, inputs, memory, parameters, carried, R)
    frame = seen["frame"].reshape(3, 3, order="F")
    if "orientation" in stage.parameters:
        write("orientation", (frame.T @ carried.R).ravel(order="F"))
    if "base" in stage.parameters:
        write("base", frame.ravel(order="F"))

    error, start, rate = _continue(stage, seen, frame, carried, tip)
    pressed = _pressed(stage, frame, carried)
    for name, plan in stage.plans.items():
        i = AXES.index(name)
        if plan.force or plan.open_loop:
            write(f"force_at_entry.{name}", seen["measured"][i])
        elif plan.yields:
            write(f"force_at_entry.{name}", (frame.T @ carried.held[:3])[i])
        if plan.open_loop and name.startswith("r"):
            write(f"start.{name}", start[name])
    tracks = _plan(stage, start, rate)
    tracks.refresh(stage, parameters, 0.0)
    for slot, value in start.items():
        write(f"path_start.{slot}", value)
    if tracks.path is not None:
        write("path_end", tracks.path.duration)
    durations = [c.knots[-2] for c in tracks.cubics.values()]
    ends = [stage.spec.time or 0.0, tracks.path.duration if tracks.path else 0.0, *durations]
    write("end", max(ends))
    _blend(stage, inputs, memory, parameters, start, rate, pressed)
    first = {a: value + pressed.get(a, 0.0) for a, value in start.items()}
    away = np.array([error.get(a, 0.0) + pressed.get(a, 0.0) for a in AXES[:3]])
    _start_memory(stage, memory, seen, frame, away, first)
    return Entered(parameters, memory, tracks)


def _writer(stage: CompiledStage, parameters: Vector):  # type: ignore[no-untyped-def]
    def write(name: str, value: float | Vector) -> None:
        if name in stage.parameters:
            stage.parameters.write(parameters, name, value)

    return write


def _look(
    stage: CompiledStage,
    inputs: Sequence[Vector],
    memory: Vector,
    parameters: Vector,
    carried: Carried,
    R: Vector,
) -> dict[str, Vector]:
    """The stage's probe, with the frame turning as the reference moves on."""
    lever = np.zeros(3)
    seen: dict[str, Vector] = {}
    for _ in range(2):
        way = carried.twist[:3] + np.cross(carried.twist[3:], lever)
        numbers = np.array(stage.probe(*inputs, memory, parameters, way)).ravel()
        at = 0
        for name, length in PROBE:
            seen[name] = numbers[at : at + length]
            at += length
        lever = seen["lever"]
    return seen


def _continue(
    stage: CompiledStage,
    seen: Mapping[str, Vector],
    frame: Vector,
    carried: Carried,
    tip: tuple[Vector, Vector],
) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """The carried reference in the stage's coordinates: error, coordinate and rate by axis."""
    p, R = tip
    offset = carried.R @ (R.T @ seen["offset"])
    away = frame.T @ (carried.p + offset - p - seen["offset"])
    velocity, spin = carried.twist[:3], carried.twist[3:]
    following = stage.frame.kind == "following"
    arm = seen["lever"] if following else offset
    moving = frame.T @ (velocity + np.cross(spin, arm))
    if following:
        moving[:2] = seen["foot_map"].reshape(2, 2, order="F") @ moving[:2]
    turning = frame.T @ spin - seen["turning"]
    error, start, rate = {}, {}, {}
    for name, plan in stage.plans.items():
        i = AXES.index(name)
        if i < 3:
            error[name], rate[name] = float(away[i]), float(moving[i])
            start[name] = float(seen["coordinate"][i]) + error[name]
        else:
            error[name], start[name] = 0.0, 0.0
            world = plan.world
            rate[name] = float((frame.T @ spin)[i - 3] if world else turning[i - 3])
        if plan.force and plan.mode == "hold":
            # Braking a reference that is not asked for would push with the force loop's damper.
            rate[name] = 0.0
    return error, start, rate


def _pressed(stage: CompiledStage, frame: Vector, carried: Carried) -> dict[str, float]:
    """How far a spring law's reference is displaced so that it goes on holding what was held."""
    if stage.law.kind in FORCE_LOOP_LAWS:
        return {}
    held = np.concatenate([frame.T @ carried.held[:3], frame.T @ carried.held[3:]])
    return {
        name: float(held[AXES.index(name)] / stage.gains["stiffness"][name].value)
        for name in stage.plans
        if stage.gains["stiffness"][name].value > 0
    }


def _plan(stage: CompiledStage, start: Mapping[str, float], rate: Mapping[str, float]) -> Tracks:
    tracks = Tracks()
    for name, plan in stage.plans.items():
        if plan.motion and plan.mode == "move":
            assert plan.axis.move is not None
            kind = "angular" if name.startswith("r") else "linear"
            speed = plan.axis.speed or MOVE_SPEED[kind]
            tracks.cubics[name] = profile.move(
                start[name], rate[name], start[name] + plan.axis.move, speed
            )
    if stage.path is not None:
        tracks.path = stage.path.plan(start)
    knots = [float(k) for cubic in tracks.cubics.values() for k in cubic.knots[1:]]
    tracks.knots = sorted(set(knots + (tracks.path.knots() if tracks.path else [])))
    return tracks


def _blend(
    stage: CompiledStage,
    inputs: Sequence[Vector],
    memory: Vector,
    parameters: Vector,
    start: Mapping[str, float],
    rate: Mapping[str, float],
    pressed: Mapping[str, float],
) -> None:
    """Chooses each axis's blending so that its reference continues the carried one.

    What it is displaced to hold the last stage's force is let go over the blending time too.
    """
    write = _writer(stage, parameters)
    own, own_rate = (np.array(v).ravel() for v in stage.own(*inputs, memory, parameters))
    for name, plan in stage.plans.items():
        if f"offset.{name}" not in stage.parameters:
            continue
        i = AXES.index(name)
        slope = rate[name] - own_rate[i]
        time = blend.BLEND_TIME
        if plan.mode in ("hold", "velocity"):
            braking = slope * time / 2
            write(f"start.{name}", start[name] + braking)
            offset = -braking
        elif plan.mode == "move":
            slope, offset = 0.0, 0.0
        elif plan.open_loop:
            slope, offset = 0.0, start[name] + pressed.get(name, 0.0) - own[i]
        else:
            offset = start[name] - own[i]
            kind = "angular" if name.startswith("r") else "linear"
            time = blend.blend_time(offset, MOVE_SPEED[kind])
        if not plan.open_loop:
            write(f"pressed.{name}", pressed.get(name, 0.0))
        write(f"offset.{name}", offset)
        write(f"slope.{name}", slope)
        write(f"blend.{name}", time)


def _start_memory(
    stage: CompiledStage,
    memory: Vector,
    seen: Mapping[str, Vector],
    frame: Vector,
    away: Vector,
    start: Mapping[str, float],
) -> None:
    """The point that references move along, and integrals that hold the measured force."""
    if "reference_point" in stage.memory:
        along = away * (1.0, 1.0, 0.0) if stage.frame.kind == "following" else away
        stage.memory.write(memory, "reference_point", seen["here"] + frame @ along)
        for a in AXES[:3]:
            stage.memory.write(memory, f"last.{a}", start.get(a, 0.0))
    for name, plan in stage.plans.items():
        if plan.force and plan.motion:
            integral = stage.gains["force.integral"][name].value
            stiffness = stage.gains["stiffness"][name].value
            if integral > 0:
                held = 0.0 if name.startswith("r") else float(away[AXES.index(name)])
                stage.memory.write(memory, f"integral.{name}", -stiffness * held / integral)


def leave(stage: CompiledStage, outputs: Mapping[str, Vector]) -> Carried:
    """The reference that a stage hands on; force axes hand on where they were measured."""
    R = outputs["tip_rotation"].reshape(3, 3, order="F")
    frame = outputs["frame"].reshape(3, 3, order="F")
    error, twist, held = np.zeros(6), np.zeros(6), np.zeros(6)
    for name, plan in stage.plans.items():
        i = AXES.index(name)
        if plan.force or plan.open_loop:
            held[i] = outputs["measured"][i]
        tracked = plan.motion and not plan.force and not plan.open_loop
        error[i] = outputs["error"][i] if tracked else 0.0
        twist[i] = outputs["velocity_ref" if tracked else "velocity"][i]
    offset = outputs["offset"]
    R_ref = pin.exp3(frame @ error[3:]) @ R
    spin = frame @ twist[3:]
    return Carried(
        p=outputs["tip"] + offset + frame @ error[:3] - R_ref @ (R.T @ offset),
        R=R_ref,
        twist=np.concatenate([frame @ twist[:3] - np.cross(spin, offset), spin]),
        held=np.concatenate([frame @ held[:3], frame @ held[3:]]),
    )
