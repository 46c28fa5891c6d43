"""Entering a stage: where the handed-over reference is in its frame, and how it goes on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.gains import value_of
from taskspec.modes import StageStart
from taskspec.program.bound import evaluated
from taskspec.program.execution.choice import choose_first
from taskspec.program.execution.hand_over import HandedOver
from taskspec.program.execution.tracks import Tracks, plan_tracks
from taskspec.program.ports import PROBE, slices
from taskspec.program.slots import gain_slot
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.world import estimated_frames
from taskspec.robot import RobotModel

Vector = NDArray[np.float64]
_FIELDS = slices(PROBE)


@dataclass(frozen=True, slots=True)
class Entered:
    """Numbers of a stage that has just been entered."""

    parameters: Vector
    memory: Vector
    tracks: Tracks


@dataclass(frozen=True, slots=True)
class Continuation:
    """The handed-over reference in a stage's coordinates, by axis.

    Attributes:
        error: reference minus measurement [m, rad].
        start: the reference's coordinate.
        rate: its rate.
        pressed: how far a spring law's reference is displaced beyond it so that the force that the
            last stage held is held on.
    """

    error: Mapping[Axis, float]
    start: Mapping[Axis, float]
    rate: Mapping[Axis, float]
    pressed: Mapping[Axis, float]


def enter(
    stage: CompiledStage,
    robot: RobotModel,
    handed_over: HandedOver,
    tip: tuple[Vector, Vector],
    inputs: Sequence[Vector],
    estimated_poses: Mapping[str, Vector],
) -> Entered:
    """Starts a stage from the handed-over reference (docs/conventions.md).

    Args:
        stage: the stage.
        robot: for its tool.
        handed_over: the reference that the last stage left.
        tip: (3,), (3, 3) measured pose of the tip.
        inputs: the tick's inputs before memory and parameters, at t = 0.
        estimated_poses: (12,) of measured frames, by parameter.
    """
    return _Entry(stage, handed_over, tip, inputs, estimated_poses).run(robot)


class _Entry:
    """The numbers of one entry while they are found, one after the other."""

    def __init__(
        self,
        stage: CompiledStage,
        handed_over: HandedOver,
        tip: tuple[Vector, Vector],
        inputs: Sequence[Vector],
        estimated_poses: Mapping[str, Vector],
    ) -> None:
        self.stage, self.handed_over, self.inputs = stage, handed_over, inputs
        self.estimated_poses = estimated_poses
        self.p, self.R = tip
        self.A, self.a, self.twist = np.eye(3), np.zeros(3), handed_over.twist
        if stage.plan.moving_base is not None:
            # From here on the reference's velocity is that against what carries the frame.
            clock = float(inputs[0][1])
            self.A, self.a = stage.plan.moving_base.pose(clock)
            self.twist = handed_over.twist - stage.plan.moving_base.twist(clock, self.p)
        self.parameters = np.zeros(stage.parameters.size)
        for name, by_axis in stage.plan.gains.items():
            for axis, gain in by_axis.items():
                self._write(gain_slot(name, axis), gain.value)
        self.memory = np.zeros(stage.memory.size)
        for slot, value in stage.initial.items():
            stage.memory.write(self.memory, slot, value)

    def run(self, robot: RobotModel) -> Entered:
        """Fills parameters and memory in the order in which they depend on each other."""
        self._place(robot)
        self.probed = self._look()
        if "angle_at_entry" in self.stage.parameters:
            self._write("angle_at_entry", self.probed["angle"])
            self.probed = self._look()
        if "place" in self.stage.memory:
            self._remember("place", self.probed["here"])
            self.probed = self._look()
        self.frame = self.probed["frame"].reshape(3, 3, order="F")
        self._write("orientation", (self.frame.T @ self.handed_over.R).ravel(order="F"))
        self._write("base", self.frame.ravel(order="F"))
        going = self._continue()
        self._forces(going)
        self._equations()
        tracks = plan_tracks(self.stage, going.start, going.rate)
        tracks.refresh(self.stage, self.parameters, 0.0)
        for axis, value in going.start.items():
            self._write(f"path_start.{axis}", value)
        self._write("path_end", tracks.path.duration if tracks.path else 0.0)
        self._write("end", max(self.stage.plan.spec.time or 0.0, tracks.duration))
        self._blend(going)
        self._start_memory(going)
        choose_first(self.stage, self.inputs, self.memory, self.parameters)
        return Entered(self.parameters, self.memory, tracks)

    def _write(self, name: str, value: float | Vector) -> None:
        """Sets a parameter that this stage may not have."""
        if name in self.stage.parameters:
            self.stage.parameters.write(self.parameters, name, value)

    def _remember(self, name: str, value: float | Vector) -> None:
        self.stage.memory.write(self.memory, name, value)

    def _place(self, robot: RobotModel) -> None:
        """Where the stage begins, and what of its frame is chosen there."""
        frame = self.stage.plan.frame
        self._write("entry", self.p)
        for name, pose in self.estimated_poses.items():
            self._write(name, pose)
        if self.handed_over.tracked == self.stage.tracked and "angle" in self.stage.memory:
            self._remember("angle", self.handed_over.angle)
        origin = self.A @ estimated_frames.origin(frame, self.estimated_poses) + self.a
        self._write("lever", self.R.T @ (origin - self.p))
        if frame.surface is not None:
            center = self.p if robot.tool.flat else self.p + self.R @ robot.tool.centers[0]
            face = frame.surface.face_at(self.A.T @ (center - self.a))
            if face is not None:
                self._write("frame.face", face)

    def _look(self) -> dict[str, Vector]:
        """The stage's probe, with the frame turning as the reference moves on."""
        lever = np.zeros(3)
        probed: dict[str, Vector] = {}
        for _ in range(2):
            twist = self.twist
            way = twist[:3] + np.cross(twist[3:], lever)
            given = (*self.inputs, self.memory, self.parameters, way)
            (numbers,) = evaluated(self.stage.probe, *given)
            probed = {name: numbers[where] for name, where in _FIELDS.items()}
            probed["reaction"] = numbers[_FIELDS["measured"].stop :]
            lever = probed["lever"]
        return probed

    def _continue(self) -> Continuation:
        """The handed-over reference in the stage's coordinates."""
        handed_over, frame, probed = self.handed_over, self.frame, self.probed
        offset = handed_over.R @ (self.R.T @ probed["offset"])
        away = frame.T @ (handed_over.p + offset - self.p - probed["offset"])
        spin = self.twist[3:]
        following = self.stage.plan.frame.kind == "following"
        arm = probed["lever"] if following else offset
        moving = frame.T @ (self.twist[:3] + np.cross(spin, arm))
        moving = probed["rate_map"].reshape(3, 3, order="F") @ moving
        rates = np.concatenate([moving, frame.T @ spin - probed["turning"]])
        error, start, rate = {}, {}, {}
        for name, plan in self.stage.plan.plans.items():
            i = AXES.index(name)
            error[name] = float(away[i]) if i < 3 else 0.0
            start[name] = float(probed["coordinate"][i]) + error[name] if i < 3 else 0.0
            rate[name] = float((frame.T @ spin)[i - 3] if plan.world else rates[i])
            if plan.force and not plan.mode.moves:
                # Braking a reference that nothing asks for would push with the loop's damper.
                rate[name] = 0.0
        return Continuation(error, start, rate, self._pressed())

    def _pressed(self) -> dict[Axis, float]:
        if self.stage.plan.law.control_law.force_loop:
            return {}
        local = np.concatenate([self.frame.T @ part for part in np.split(self.handed_over.held, 2)])
        springs = {
            name: value_of(self.stage.plan.gains, "stiffness", name)
            for name in self.stage.plan.plans
        }
        return {
            name: float(local[AXES.index(name)] / stiffness)
            for name, stiffness in springs.items()
            if stiffness > 0
        }

    def _forces(self, going: Continuation) -> None:
        """Set points rise from the measured force; held forces fade where motion takes over."""
        held = np.concatenate([self.frame.T @ part for part in np.split(self.handed_over.held, 2)])
        for name, plan in self.stage.plan.plans.items():
            i = AXES.index(name)
            if plan.set_point:
                self._write(f"force_at_entry.{name}", self.probed["measured"][i])
            elif plan.yields or plan.soft:
                self._write(f"force_at_entry.{name}", held[i])
            if plan.open_loop and name.is_rotation:
                self._write(f"start.{name}", going.start[name])

    def _equations(self) -> None:
        """Set points of equations rise from what is measured."""
        for name, force in zip(self.stage.equations, self.probed["reaction"], strict=True):
            self._write(f"force_at_entry.equation.{name}", float(force))

    def _blend(self, going: Continuation) -> None:
        """Chooses each axis's blending so that its reference continues the one handed over."""
        own, own_rate = evaluated(self.stage.own, *self.inputs, self.memory, self.parameters)
        wait = 0.0
        for name, plan in self.stage.plan.plans.items():
            i = AXES.index(name)
            handed = plan.mode.hand_over(
                StageStart(
                    axis=name,
                    plan=self.stage.plan,
                    starts=going.start,
                    rates=going.rate,
                    pressed=going.pressed.get(name, 0.0),
                    own=own[i],
                    own_rate=own_rate[i],
                )
            )
            wait = max(wait, handed.wait)
            for slot, value in handed.parameters.items():
                self._write(slot, value)
            self._write(f"pressed.{name}", handed.pressed)
            self._write(f"offset.{name}", handed.offset)
            self._write(f"slope.{name}", handed.slope)
            self._write(f"blend.{name}", handed.time)
        self._write("wait", wait)

    def _start_memory(self, going: Continuation) -> None:
        """The point that references move along, and integrals that hold the measured force."""
        first = {a: value + going.pressed.get(a, 0.0) for a, value in going.start.items()}
        away = np.array([going.error.get(a, 0.0) + going.pressed.get(a, 0.0) for a in AXES[:3]])
        if "reference_point" in self.stage.memory:
            along = away * (1.0, 1.0, 0.0) if self.stage.plan.frame.kind == "following" else away
            along = self.A.T @ self.frame @ along
            self._remember("reference_point", self.probed["here"] + along)
            for axis in AXES[:3]:
                self._remember(f"last.{axis}", first.get(axis, 0.0))
        for name, plan in self.stage.plan.plans.items():
            if plan.force and plan.motion and not name.is_rotation:
                integral = value_of(self.stage.plan.gains, "force.integral", name)
                stiffness = value_of(self.stage.plan.gains, "stiffness", name)
                held = stiffness * float(away[AXES.index(name)])
                if f"integral.{name}" in self.stage.memory:
                    self._remember(f"integral.{name}", -held / integral if integral > 0 else 0.0)
