"""A stage's closed form about an equilibrium: the compiled function, differentiated by CasADi.

The derivative is taken along directions of the joints, the measured wrench, the measured reactions
and the memory. A direction of the joints moves the tip's pose as it moves in truth to first order;
H, C q' + g, g and the tip's Jacobian stay as they are, and J' q' is 0 at rest.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec.laws.gains import Gains
from taskspec.modes import DEFAULT_RAMP
from taskspec.program.bound import BoundFunction, evaluated
from taskspec.program.context import Context
from taskspec.program.execution.choice import Chooser
from taskspec.program.execution.tracks import Tracks
from taskspec.program.ports import LAW, handed_of, now_at_start, slices
from taskspec.program.reference.force_references import kept_slot
from taskspec.program.reference.slowed_path import AT, TIME
from taskspec.program.stages.stage import FROZEN, CompiledStage
from taskspec.program.velocity_estimate import VelocityEstimate
from taskspec.program.world import estimated_frames
from taskspec.robot.model_terms import PinocchioTerms

Matrix = NDArray[np.float64]

#: A blending that is to keep what it adds lasts this long [s].
_FOR_EVER = 1e9
#: Ramps and blendings are over this long after they should be [s].
_AFTER = 1.0


@dataclass(frozen=True, slots=True)
class LinearEstimate:
    """The estimate of q' about the equilibrium: 2n states, what is predicted of a tick.

    Attributes:
        correct: (2n, 3n) positions and velocities of now, of what was predicted and of q.
        predict: (2n, 3n + 6) what is predicted of the next tick, of these, u and the wrench.
    """

    correct: Matrix
    predict: Matrix

    @staticmethod
    def of(context: Context) -> LinearEstimate | None:
        """That of a task's controller; None where q' is measured."""
        estimate = VelocityEstimate.of(context.loaded.task.control.velocity, context.period)
        if estimate is None:
            return None
        n = context.robot.n
        x, q, u, w = (
            ca.SX.sym(name, k) for name, k in (("x", 2 * n), ("q", n), ("u", n), ("w", 6))
        )
        acceleration = None
        if estimate.modelled:
            H, J = ca.SX(ca.DM(context.start_inertia)), ca.SX(ca.DM(context.start_jacobian))
            acceleration = estimate.acceleration(H, ca.SX(n, 1), J, u, w)
        pairs = (estimate.correct(x, q), (x, q)), (estimate.predict(x, acceleration), (x, u, w))
        found = [np.array(ca.evalf(ca.jacobian(of, ca.vertcat(*by)))) for of, by in pairs]
        return LinearEstimate(*found)


@dataclass(frozen=True, slots=True)
class LinearController:
    """u and memory' per q, q', measured wrench, measured reactions and memory.

    Attributes:
        torque: (n, 2n + 6 + e + m).
        memory: (m, 2n + 6 + e + m); m slots of memory on which a later torque depends.
        slots: their numbers.
        finite: whether the torque has a derivative.
        velocity: how q' is estimated; None where it is measured.
    """

    torque: Matrix
    memory: Matrix
    slots: tuple[int, ...]
    velocity: LinearEstimate | None = None

    @property
    def states(self) -> int:
        """Of the estimate of q'."""
        return 0 if self.velocity is None else len(self.velocity.correct)

    @property
    def finite(self) -> bool:
        """Whether the torque has a derivative at all."""
        return bool(np.isfinite(self.torque).all() and np.isfinite(self.memory).all())


class Operating:
    """A stage entered at the start pose, long after its ramps, with its references where it is."""

    def __init__(
        self, context: Context, stage: CompiledStage, tangent: ca.Function | None = None
    ) -> None:
        self.context, self.stage = context, stage
        self._tangent = _tangent(stage.closed_form) if tangent is None else tangent
        n = context.robot.n
        self._terms = PinocchioTerms(context.robot)
        self._now = now_at_start(context.loaded.task)
        self._now[2 + list(context.loaded.task.stages).index(stage.name)] = 1.0
        self._wrench, self._reactions = np.zeros(6), np.zeros(len(context.loaded.task.reported))
        self._terms.at(context.start, np.zeros(n))
        # The tip may be looked at elsewhere, as `touching` has it.
        self._terms.arrays[4][:] = context.start_p
        self._arguments = [
            self._now,
            context.start,
            np.zeros(n),
            *self._terms.arrays,
            self._wrench,
            self._reactions,
        ]
        self._fields = slices((*LAW, ("reaction_ref", len(context.equations))))
        self._enter()

    def under(self, gains: Gains) -> Operating:
        """The same stage under other gains, pressing alike; none that is zero becomes another.

        Args:
            gains: values of the stage's parameters.
        """
        stage = replace(self.stage, plan=self.stage.plan.but(gains=gains))
        other = Operating(self.context, stage, self._tangent)
        other.press(self._wrench, self._reactions)
        return other

    def there(self, context: Context) -> Operating:
        """The same stage, pressing alike, with the arm where another context begins."""
        other = Operating(context, self.stage, self._tangent)
        other.press(self._wrench, self._reactions)
        return other

    def press(self, wrench: Matrix, reactions: Matrix) -> None:
        """What is measured at the equilibrium; long after the entry it changes nothing else."""
        self._wrench[:], self._reactions[:] = wrench, reactions

    def _enter(self) -> None:
        context, stage = self.context, self.stage
        self._now[0] = 0.0
        poses = {
            estimated_frames.slot(f): np.concatenate([g.rotation.ravel(order="F"), g.origin])
            for f in context.frames.values()
            if f.kind == "estimated"
            for g in (context.frames[f.estimated_in],)
        }
        entry = stage.entry
        size = sum(n for _, n in handed_of(context.loaded.task, context.robot.n))
        handed = np.concatenate(
            [context.start_p, context.start_R.ravel(order="F"), np.zeros(size - 12)]
        )
        given = [np.concatenate([np.zeros(0), *(poses[name] for name in entry.poses)])]
        given.append(stage.gains)
        entered = evaluated(entry.function, *self._arguments, handed, *given)
        self.memory, self.parameters, numbers = entered
        if FROZEN in stage.parameters:
            stage.parameters.write(self.parameters, FROZEN, 1.0)
        if stage.choice is not None:
            given = [*self._arguments, self.memory, self.parameters]
            Chooser(stage.choice, stage.parameters, given).first()
        for axis in stage.plan.plans:
            if kept_slot(axis) in stage.parameters:
                kept = stage.plan.set_points.of(axis) or 0.0
                stage.parameters.write(self.parameters, kept_slot(axis), kept)
        tracks = Tracks(stage, self.parameters, self.memory)
        tracks.numbers[:] = numbers
        forces = [p.axis.set_point for p in stage.plan.plans.values()]
        ramps = [force.ramp for force in forces if force is not None]
        ramps += [point.ramp for point in stage.plan.spec.constraints.values()]
        longest = max([DEFAULT_RAMP, *(r for r in ramps if r is not None)])
        self._now[0] = max(longest, tracks.duration) + _AFTER
        if TIME in stage.memory:
            # A path that signals slow has come to its end, too.
            stage.memory.write(self.memory, TIME, tracks.duration)
            stage.memory.write(self.memory, AT, float(self._now[0]))
        tracks.refresh(float(self._now[0]))
        self._bring_references()

    def _bring_references(self) -> None:
        """Moves each motion reference to where the arm is, for good."""
        stage, write = self.stage, self.stage.parameters.write
        moving = [a for a, p in stage.plan.plans.items() if p.motion and not p.open_loop]
        for name in moving:
            for slot, value in (("offset", 0.0), ("slope", 0.0), ("pressed", 0.0), ("blend", 1.0)):
                write(self.parameters, f"{slot}.{name}", value)
        if "wait" in stage.parameters:
            write(self.parameters, "wait", 0.0)
        own, _ = evaluated(stage.own, *self._arguments, self.memory, self.parameters)
        error = self.outputs()["error"]
        for name in moving:
            i, last = AXES.index(name), f"last.{name}"
            carried = last in stage.memory and not self._by_gap(name)
            if carried:
                offset = float(self.memory[stage.memory.slots[last]][0]) - own[i]
            else:
                offset = -own[i] if name.is_rotation else -error[i]
            write(self.parameters, f"offset.{name}", float(offset))
            write(self.parameters, f"blend.{name}", _FOR_EVER)
        self._carry_sprung()

    def _carry_sprung(self) -> None:
        """Has a carried reference point lie where the set points of springs have moved it.

        Else every tick would move it by their whole way, along axes that turn with the tool.
        """
        stage = self.stage
        sprung = [f"last.{a}" for a, p in stage.plan.plans.items() if p.motion and p.open_loop]
        sprung = [slot for slot in sprung if slot in stage.memory]
        if sprung:
            after = evaluated(stage.closed_form, *self._arguments, self.memory, self.parameters)[1]
            for slot in (*sprung, "reference_point"):
                where = stage.memory.slots[slot]
                self.memory[where] = after[where]

    def _by_gap(self, name: str) -> bool:
        return name == "z" and self.stage.plan.frame.kind == "following"

    def outputs(self) -> dict[str, Matrix]:
        """The numbers of `LAW`, and the reference of each equation, by name."""
        given = (*self._arguments, self.memory, self.parameters)
        numbers = evaluated(self.stage.closed_form, *given)[2]
        return {name: numbers[where] for name, where in self._fields.items()}

    def linear(self) -> LinearController:
        """The derivative of torque and memory, one direction after the other."""
        n, count = self.context.robot.n, self._measured
        directions = self._directions()
        along, found = np.zeros(len(directions)), np.zeros(n + self.stage.memory.size)
        given = [*self._arguments, self.memory, self.parameters, along]
        tangent, columns = BoundFunction(self._tangent, given, [found]), []
        for direction in directions.T:
            along[:] = direction
            tangent.evaluate()
            columns.append(found.copy())
        whole = np.column_stack(columns)
        torque, memory = whole[:n], whole[n:]
        slots = _feedback_slots(torque[:, count:], memory[:, count:])
        kept = [*range(count), *(count + s for s in slots)]
        estimate = LinearEstimate.of(self.context)
        return LinearController(
            torque[:, kept], memory[np.ix_(slots, kept)], tuple(slots), estimate
        )

    @property
    def _measured(self) -> int:
        """How many numbers are measured: of q, q', wrench and reactions."""
        return 2 * len(self.context.start) + 6 + len(self._reactions)

    def _directions(self) -> Matrix:
        """Directions of what moves in `_tangent`: a column for each input and slot of the memory.

        With q moves the pose of the tip.
        """
        n, J, R = self.context.robot.n, self.context.start_jacobian, self.context.start_R
        count = self._measured + self.stage.memory.size
        turned = [(pin.skew(spin) @ R).ravel(order="F") for spin in J[3:].T]
        moved = np.eye(2 * n, count)
        pose = np.zeros((12, count))
        pose[:, :n] = np.vstack([J[:3], np.column_stack(turned)])
        return np.vstack([moved, pose, np.eye(count)[2 * n :]])


def _tangent(closed_form: ca.Function) -> ca.Function:
    """A stage's inputs, a direction of those that move -> how torque and memory change along it.

    What moves is q, q', the tip's p and R, the wrench, the reactions and the memory.
    """
    given = closed_form.sx_in()
    torque, memory, _ = closed_form.call(given)
    _, q, v, *_, p, R, _, wrench, reactions, remembered, _ = given
    moving = ca.vertcat(q, v, p, R, wrench, reactions, remembered)
    along = ca.SX.sym("along", moving.shape[0])
    change = ca.jtimes(ca.vertcat(torque, memory), moving, along)
    return ca.Function("tangent", [*given, along], [ca.densify(change)])


def _feedback_slots(torque: Matrix, memory: Matrix) -> list[int]:
    """Slots of the memory on which this torque depends, or a later one through other slots."""
    found = {int(i) for i in np.flatnonzero(_any(torque))}
    waiting = list(found)
    while waiting:
        row = memory[waiting.pop()]
        for i in np.flatnonzero(_any(row[None, :])):
            if int(i) not in found:
                found.add(int(i))
                waiting.append(int(i))
    return sorted(found)


def _any(part: Matrix) -> Matrix:
    """Columns with anything but zeros."""
    return np.asarray(np.any((part != 0) | ~np.isfinite(part), axis=0))
