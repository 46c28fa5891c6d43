"""Entering a stage, as one function (docs/conventions.md).

enter(time, state, model terms, measured wrench, what is handed over) -> memory, parameters, cubics.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws import tank
from taskspec.laws.coupled import stretched
from taskspec.laws.disturbance import ESTIMATE
from taskspec.laws.gains import Gains, pairs_of, value_of
from taskspec.modes import StageStart
from taskspec.motion.path import PathPlan
from taskspec.motion.polynomial import PiecewiseCubic
from taskspec.program.plan import StagePlan
from taskspec.program.ports import PROBE, handed_of, slices
from taskspec.program.reference.force_references import kept_slot
from taskspec.program.reference.joint_reference import TIMING, joint_start
from taskspec.program.reference.measurement import Measurement
from taskspec.program.slots import Slots, gain_slot
from taskspec.program.stages.estimated_stiffness import EstimatedStiffness, estimate_slot
from taskspec.program.world import estimated_frames, tracked_frames
from taskspec.program.world.moving_base import BaseMotion

_FIELDS = slices(PROBE)


@dataclass(frozen=True, slots=True)
class StageEntry:
    """The entry of a stage.

    Attributes:
        function: the tick's inputs before memory and parameters, the numbers of `handed_of`, the
            poses of estimated frames (12 each), gains -> memory, parameters, cubics (knots, then
            coefficients row after row, one after the other). It is at stage time 0.
        poses: parameters with the poses of estimated frames, in the order of that argument.
        gains: names and axes of the gains that are parameters, in the order of theirs.
        cubics: parameters that are pieces of its moves and of its path's timing, by the number of
            pieces that each has, in the order of the last result.
        path: of a table, timed as the file says; None for any other.
    """

    function: ca.Function
    poses: tuple[str, ...]
    gains: tuple[tuple[str, str], ...]
    cubics: Mapping[str, int]
    path: PathPlan | None


@dataclass(frozen=True, slots=True)
class _Continuation:
    """The handed-over reference in a stage's coordinates, by axis.

    Attributes:
        error: reference minus measurement [m, rad].
        start: the reference's coordinate.
        rate: its rate.
        pressed: how far a spring law's reference is displaced beyond it so that the force that the
            last stage held is held on.
    """

    error: Mapping[Axis, ca.SX]
    start: Mapping[Axis, ca.SX]
    rate: Mapping[Axis, ca.SX]
    pressed: Mapping[Axis, ca.SX]


class Entering:
    """The entry of a stage from the reference that is handed over.

    Holds the expressions of the entry while they are found, one after the other.

    Args:
        plan: of the stage.
        gains: of its law, parameters where they are to be changed.
        measurement: whose layouts are complete.
        estimated: what it estimates.
        initial: slots of the memory that do not start at 0.
        probe, own: of the stage; see `outputs.probe` and `CompiledStage`.
    """

    def __init__(
        self,
        plan: StagePlan,
        gains: Gains,
        measurement: Measurement,
        estimated: EstimatedStiffness,
        initial: Mapping[str, float],
        probe: ca.Function,
        own: ca.Function,
    ) -> None:
        self.plan = plan
        self.probe, self.own = probe, own
        self.layouts = {"memory": measurement.memory, "parameters": measurement.parameters}
        self.inputs, self.clock = measurement.inputs, measurement.clock
        self.translate = measurement.translate
        self.equations = tuple(measurement.rows)
        at_start = ca.vertcat(0, self.inputs.now[1:])
        self.given = [at_start, *self.inputs.symbols()[1:]]
        given = handed_of(plan.context.loaded.task, plan.context.robot.n)
        self.handed = ca.SX.sym("handed", sum(length for _, length in given))
        handed = {name: self.handed[where] for name, where in slices(given).items()}
        self.p_ref, self.R_ref = handed["p"], ca.reshape(handed["R"], 3, 3)
        self.held, self.commanded = handed["held"], handed["commanded"]
        self.angle, self.same = handed["angle"], handed["same"]
        self.followed, self.follows = handed["track"], handed["tracks"]
        self.disturbance = handed.get("disturbance")
        self.tank = handed.get("tank")
        begun, carried = estimated.begun(handed)
        self.gains = _at_entry(gains, estimated, begun)
        # From here on the reference's velocity is that against what carries the frame.
        self.twist, self.base = handed["twist"], self._base()
        if self.base is not None:
            self.twist = self.twist - self.base.twist(self.inputs.terms.p)
        self.tunable = tuple(
            (name, axis)
            for name, by_axis in gains.items()
            for axis in by_axis
            if gain_slot(name, axis) in self.parameters
        )
        self.values: dict[str, dict[str, ca.SX]] = {
            "memory": {name: ca.SX(value) for name, value in initial.items()} | begun,
            "parameters": {
                gain_slot(name, axis): self.parameters.symbol(gain_slot(name, axis))
                for name, axis in self.tunable
            },
        }
        for name, value in carried.items():
            self._write(name, value)

    @property
    def parameters(self) -> Slots:
        """Layout of the parameters."""
        return self.layouts["parameters"]

    @property
    def memory(self) -> Slots:
        """Layout of the memory."""
        return self.layouts["memory"]

    def entry(self) -> StageEntry:
        """Fills parameters and memory in the order in which they depend on each other."""
        poses = self._poses()
        self._place(poses)
        probed = self._look()
        if "angle_at_entry" in self.parameters:
            self._write("angle_at_entry", probed["angle"])
            probed = self._look()
        if "place" in self.memory:
            self._remember("place", probed["here"])
            probed = self._look()
        self.probed, self.frame = probed, ca.reshape(probed["frame"], 3, 3)
        self._write("orientation", ca.vec(self.frame.T @ self.R_ref))
        self._write("base", ca.vec(self.frame))
        going = self._continue()
        self._forces(going)
        for name, force in zip(self.equations, ca.vertsplit(probed["reaction"]), strict=True):
            # Set points of equations rise from what is measured.
            self._write(f"force_at_entry.equation.{name}", force)
        cubics, path = self._tracks(going)
        self._blend(going)
        self._start_memory(going)
        numbers = [
            part for c in cubics.values() for part in (c.knots, ca.vec(ca.SX(c.coefficients).T))
        ]
        gains = [self.parameters.symbol(gain_slot(name, axis)) for name, axis in self.tunable]
        arguments = [
            *self.inputs.symbols(),
            self.handed,
            ca.vertcat(ca.SX(0, 1), *poses.values()),
            ca.vertcat(ca.SX(0, 1), *gains),
        ]
        results = [self._vector("memory"), self._vector("parameters")]
        results.append(ca.densify(ca.vertcat(ca.SX(0, 1), *numbers)))
        return StageEntry(
            function=ca.Function("enter", arguments, results),
            poses=tuple(poses),
            gains=self.tunable,
            cubics={name: c.coefficients.shape[0] for name, c in cubics.items()},
            path=path,
        )

    def _base(self) -> BaseMotion | None:
        base = self.plan.moving_base
        return None if base is None else base.at(self.inputs.now[1])

    def _write(self, name: str, value: ca.SX | float) -> None:
        """Sets a parameter that this stage may not have."""
        if name in self.parameters:
            self.values["parameters"][name] = value

    def _remember(self, name: str, value: ca.SX | float) -> None:
        self.values["memory"][name] = value

    def _vector(self, which: str) -> ca.SX:
        """The memory or the parameters as they are now; what has not been set is 0."""
        layout = self.layouts[which]
        found = ca.SX.zeros(layout.size)
        for name, value in self.values[which].items():
            found[layout.slots[name]] = value
        return ca.densify(found)

    def _poses(self) -> dict[str, ca.SX]:
        """(12,) of the estimated frames that the stage needs, by parameter."""
        names = [n for n in self.parameters.slots if n.startswith(estimated_frames.PREFIX)]
        poses = {name: ca.SX.sym(name, estimated_frames.SIZE) for name in names}
        self.values["parameters"] |= poses
        return poses

    def _place(self, poses: Mapping[str, ca.SX]) -> None:
        """The place where the stage begins, and the choices of its frame there."""
        frame, p, R = self.plan.frame, self.inputs.terms.p, self.inputs.terms.R
        self._write("entry", p)
        if "angle" in self.memory:
            self._remember("angle", ca.if_else(self.same, self.angle, 0.0))
        if "lever" in self.parameters:
            self._write("lever", R.T @ (self._world(estimated_frames.origin(frame, poses)) - p))
        if frame.tracking is not None:
            same = self.follows == tracked_frames.NUMBERS[frame.tracking.of]
            begun = ca.if_else(same, self.followed, tracked_frames.begun(frame, R))
            for i, slot in enumerate(
                (tracked_frames.FILTERED, tracked_frames.DIRECTION, tracked_frames.RATE)
            ):
                self._remember(slot, begun[3 * i : 3 * i + 3])
        if frame.surface is not None:
            tool = self.plan.context.robot.tool
            center = p if tool.flat else p + R @ ca.DM(tool.centers[0])
            if self.base is not None:
                center = self.base.place(center)
            face = frame.surface.face_at(center)
            if face is not None:
                self._write("frame.face", face)

    def _world(self, point: ca.SX) -> ca.SX:
        """A point (3,) of what carries the frame, in the world."""
        return point if self.base is None else self.base.world(point)

    def _look(self) -> dict[str, ca.SX]:
        """The stage's probe, with the frame turning as the reference moves on."""
        state = [*self.given, self._vector("memory"), self._vector("parameters")]
        numbers = self.probe(*state, self.twist[:3])
        if self.plan.frame.by_tool_point:
            # It turns as the tool point moves, not the tip.
            lever = numbers[_FIELDS["lever"]]
            numbers = self.probe(*state, self.twist[:3] + ca.cross(self.twist[3:], lever))
        probed = {name: numbers[where] for name, where in _FIELDS.items()}
        probed["reaction"] = numbers[_FIELDS["measured"].stop :]
        return probed

    def _continue(self) -> _Continuation:
        """The handed-over reference in the stage's coordinates."""
        frame, probed, p, R = self.frame, self.probed, self.inputs.terms.p, self.inputs.terms.R
        offset = self.R_ref @ (R.T @ probed["offset"])
        away = frame.T @ (self.p_ref + offset - p - probed["offset"])
        spin = self.twist[3:]
        arm = probed["lever"] if self.plan.frame.by_tool_point else offset
        moving = frame.T @ (self.twist[:3] + ca.cross(spin, arm))
        turning = frame.T @ spin
        rates = ca.vertcat(
            ca.reshape(probed["rate_map"], 3, 3) @ moving, turning - probed["turning"]
        )
        error, start, rate = {}, {}, {}
        for name, axis in self.plan.plans.items():
            i = AXES.index(name)
            error[name] = away[i] if i < 3 else ca.SX(0)
            start[name] = probed["coordinate"][i] + error[name] if i < 3 else ca.SX(0)
            rate[name] = turning[i - 3] if axis.world else rates[i]
            if axis.force and not axis.mode.moves:
                # Braking a reference that nothing commands would push with the loop's damper.
                rate[name] = ca.SX(0)
        return _Continuation(error, start, rate, self._pressed())

    def _pressed(self) -> dict[Axis, ca.SX]:
        if self.plan.law.control_law.force_loop:
            return {}
        local, found = self._local(self.held), {}
        coupled = bool(pairs_of(self.gains, "stiffness"))
        forces = {name: local[name.row] for name in self.plan.plans}
        for name in self.plan.plans:
            stiffness = value_of(self.gains, "stiffness", name)
            # A gain that is an expression is positive; see `tunable`.
            if isinstance(stiffness, ca.SX) or stiffness > 0:
                found[name] = (
                    stretched(self.gains, name, forces)
                    if coupled
                    else local[AXES.index(name)] / stiffness
                )
        return found

    def _local(self, wrench: ca.SX) -> ca.SX:
        """A wrench (6,) of the world's axes in the frame's."""
        return ca.vertcat(self.frame.T @ wrench[:3], self.frame.T @ wrench[3:])

    def _forces(self, going: _Continuation) -> None:
        """Set points rise from the measured force; held forces fade where motion takes over."""
        held, commanded = self._local(self.held), self._local(self.commanded)
        for name, axis in self.plan.plans.items():
            i = AXES.index(name)
            self._write(kept_slot(name), commanded[i])
            if axis.set_point:
                self._write(f"force_at_entry.{name}", self.probed["measured"][i])
            elif axis.yields or axis.soft:
                self._write(f"force_at_entry.{name}", held[i])
            if axis.open_loop and name.is_rotation:
                self._write(f"start.{name}", going.start[name])

    def _tracks(self, going: _Continuation) -> tuple[dict[str, PiecewiseCubic], PathPlan | None]:
        """Moves and the path's timing by parameter, and a path that is known from its file."""
        cubics: dict[str, PiecewiseCubic] = {}
        ends: list[ca.SX | float] = [self.plan.spec.time or 0.0]
        for name, axis in self.plan.plans.items():
            cubic = axis.mode.track(going.start[name], going.rate[name]) if axis.motion else None
            if cubic is not None:
                cubics[f"segment.{name}"] = cubic
                ends.append(cubic.rests)
        table = None
        if self.plan.ready_path is not None:
            path = self.plan.ready_path.plan(going.start)
            if not self.plan.ready_path.form.in_splines:
                cubics["segment.path"] = path.timing
            else:
                table = path
                self._write("segment.path", ca.DM(path.timing.segment(0.0)))
                for driven, spline in path.splines.items():
                    self._write(f"table.{driven}", ca.DM(spline.segment(path.timing(0.0))))
            if self.plan.ready_path.slowed is None:
                ends.append(path.duration)
            self._write("path_end", path.duration)
        if self.plan.joint_path is not None:
            begun = joint_start(self.plan.joint_path, self.inputs, self.clock, self.translate)
            if begun.timing is not None:
                cubics[TIMING] = begun.timing
            for slot, value in begun.parameters.items():
                self._write(slot, value)
            ends.append(begun.lasts)
            self._write("path_end", begun.lasts)
        for slot, cubic in cubics.items():
            self._write(slot, cubic.segment_at_start())
        for name, start in going.start.items():
            self._write(f"path_start.{name}", start)
        self._write("end", ca.mmax(ca.vertcat(*ends)))
        return cubics, table

    def _blend(self, going: _Continuation) -> None:
        """Chooses each axis's blending so that its reference continues the one handed over."""
        own, own_rate = self._own()
        wait = ca.SX(0)
        for name in self.plan.leaders_first:
            axis, i = self.plan.plans[name], AXES.index(name)
            if axis.mode.leaders:
                # What it starts from follows from what has been chosen for its leaders.
                own, own_rate = self._own()
            handed = axis.mode.hand_over(
                StageStart(
                    axis=name,
                    plan=self.plan,
                    starts=going.start,
                    rates=going.rate,
                    pressed=going.pressed.get(name, ca.SX(0)),
                    own=own[i],
                    own_rate=own_rate[i],
                )
            )
            wait = ca.fmax(wait, handed.wait)
            for slot, value in handed.parameters.items():
                self._write(slot, value)
            self._write(f"pressed.{name}", handed.pressed)
            self._write(f"offset.{name}", handed.offset)
            self._write(f"slope.{name}", handed.slope)
            self._write(f"blend.{name}", handed.time)
        self._write("wait", wait)

    def _own(self) -> tuple[ca.SX, ca.SX]:
        """(6,), (6,) own(0) and own'(0) of every axis, by what has been chosen so far."""
        found = self.own(*self.given, self._vector("memory"), self._vector("parameters"))
        return found[0], found[1]

    def _start_memory(self, going: _Continuation) -> None:
        """The point that references move along, integrals that hold the measured force, a tank."""
        if self.plan.law.tank is not None:
            own, (left, stretched, had) = self.plan.law.tank, ca.vertsplit(self.tank)
            handed = ca.fmin(left, own.energy) + stretched
            self._remember(tank.ENERGY, ca.if_else(had, handed, own.first))
            if tank.SHARE in self.memory:  # Of the last tick's share integrals go by alone.
                self._remember(tank.SHARE, 1.0)
            self._remember(tank.STATE, ca.if_else(had, tank.HANDED_ON, tank.FRESH))
        zero = ca.SX(0)
        pressed = {a: going.pressed.get(a, zero) for a in AXES}
        away = ca.vertcat(*(going.error.get(a, zero) + pressed[a] for a in AXES[:3]))
        if "reference_point" in self.memory:
            along = away
            if self.plan.frame.kind == "following":
                along = ca.vertcat(away[:2], 0)
            along = self.frame @ along
            if self.base is not None:
                along = self.base.A.T @ along
            self._remember("reference_point", self.probed["here"] + along)
            for a in AXES[:3]:
                first = going.start[a] + pressed[a] if a in going.start else zero
                self._remember(f"last.{a}", first)
        if ESTIMATE in self.memory:
            self._remember(ESTIMATE, self.disturbance)
        for name, axis in self.plan.plans.items():
            slot = f"integral.{name}"
            if not axis.force or not axis.motion or name.is_rotation or slot not in self.memory:
                continue
            integral = value_of(self.gains, "force.integral", name)
            # A gain that is an expression is positive; see `tunable`.
            if isinstance(integral, ca.SX) or integral > 0:
                held = value_of(self.gains, "stiffness", name) * away[AXES.index(name)]
                self._remember(slot, -held / integral)
            else:
                self._remember(slot, 0.0)


def _at_entry(gains: Gains, estimated: EstimatedStiffness, begun: Mapping[str, ca.SX]) -> Gains:
    """The gains with those that follow an estimate as they are when it begins."""
    found = {name: {**by_axis} for name, by_axis in gains.items()}
    for axis in estimated.axes:
        at, first = estimated.followed(axis), begun[estimate_slot("followed", axis)]
        for by_axis in found.values():
            gain = by_axis.get(axis)
            if gain is not None and isinstance(gain.value, ca.SX):
                by_axis[axis] = replace(gain, value=ca.substitute(gain.value, at, first))
    return found
