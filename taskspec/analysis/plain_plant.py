"""A plain plant of a task: the arm, what its tool touches or holds, and nothing else, as one step.

Every contact is the spring and damper that the file declares, with Coulomb's friction, under each
sphere of the tool; a grip is a spring and damper in six directions, a mechanism one coordinate. The
step is semi-implicit Euler, as the simulator's is. It has no bodies but the arm's, and knows
nothing of the simulator's solver: it is what `LinearPlant` is about an equilibrium, anywhere.

    (H + h D + G^T M G) a = tau - C q' - g - D q' - G^T f,    f = K e + B e',
    q'+ = q' + h a,    q+ = q + h q'+

with the mass M that the simulator's constraints add, and H, C q' + g and the tip's Jacobian of
where the period of control begins.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.program.bound import Wiring
from taskspec.program.context import Context
from taskspec.program.operators import quick_operators
from taskspec.program.world import frames
from taskspec.program.world.equations import equation_models, reaction
from taskspec.program.world.mechanisms import MechanismModel
from taskspec.program.world.stiffness import (
    GRIP,
    added_mass,
    compliance,
    contact_mobility,
    creep,
    equation_compliance,
)
from taskspec.robot.model_terms import ModelTerms
from taskspec.spec import Mechanism, Shape

Vector = NDArray[np.float64]

#: Dry friction of a mechanism takes away this share of a slip in one step, a stop turns a motion
#: back within so many steps, overdamped: as the simulator has them.
_SETTLING, _STOP_STEPS, _STOP_DAMPING = 0.5, 3.0, 2.0
_IMPEDANCE = 0.99
#: A slip that is no slip [m/s].
_NO_SLIP = 1e-12


class PlainPlant:
    """The plant of a task's own world, stepped from the arrays of a machine.

    Attributes:
        q, v: (n,) of the joints after the last step.
        held: (2,) coordinate of the held mechanism, and its rate; zeros where there is none.
        wrench: (6,) by the environment on the tip in the last step, world axes [N, N m].
        wrist: (6,) the same as a sensor between flange and tool feels it; `wrench` elsewhere.
        effort: (1,) what the robot applies to the coordinate [N m, N].
        reactions: (equations,) what it applies along each equation [N, N m].
        step: one period of control with the torque held.
    """

    @quick_operators()
    def __init__(self, context: Context, terms: ModelTerms, torque: Vector) -> None:
        """A plant at rest at the start.

        Args:
            context: of the task.
            terms: evaluated at the state with which each period begins.
            torque: (n,) of the machine.
        """
        n = len(torque)
        self.q, self.v = context.start.copy(), np.zeros(n)
        self.held, self.effort = np.zeros(2), np.zeros(1)
        self._held = np.zeros(2)
        self.wrench, self.clock = np.zeros(6), np.zeros(1)
        self.reactions = np.zeros(len(context.equations))
        at_wrist = context.loaded.task.robot.sensor.at == "wrist"
        self.wrist = np.zeros(6) if at_wrist else self.wrench
        wiring = Wiring()
        names = ("H", "bias", "gravity", "J", "p", "R", "drift")
        given = {name: wiring.reads(name, a) for name, a in zip(names, terms.arrays, strict=True)}
        step = _Step(context, given)
        state = _State(
            wiring.reads("q", terms.q), wiring.reads("v", terms.v), wiring.reads("held", self._held)
        )
        clock, tau = wiring.reads("clock", self.clock), wiring.reads("torque", torque)
        for i in range(step.substeps):
            state = step.once(state, tau, clock + i * step.period)
        wiring.writes(state.q, self.q)
        wiring.writes(state.v, self.v)
        wiring.writes(state.held, self.held)
        wiring.writes(step.wrench, self.wrench)
        wiring.writes(step.effort, self.effort)
        wiring.writes(step.reactions, self.reactions)
        if at_wrist:
            wiring.writes(step.at_wrist(), self.wrist)
        # What comes more than once is not looked for: that takes as long as all its steps.
        self._function = wiring.bound("plant", cse=False)

    def step(self, clock: float) -> None:
        """One period of control that begins at run time `clock` [s]."""
        self.clock[0], self._held[:] = clock, self.held
        self._function.evaluate()


@dataclass(frozen=True, slots=True)
class _State:
    q: ca.SX
    v: ca.SX
    held: ca.SX


@dataclass(slots=True)
class _Forces:
    """What acts in one step: added mass (c, c), generalised force (c,), wrench on the tip (6,)."""

    mass: ca.SX
    on: ca.SX
    wrench: ca.SX


class _Step:
    """Steps of the plant within one period of control."""

    def __init__(self, context: Context, given: dict[str, ca.SX]) -> None:
        task, robot = context.loaded.task, context.robot
        self._context, self._task = context, task
        n = self._n = robot.pin.nv
        self.period = 1.0 / task.control.plant_rate
        self.substeps = round(task.control.plant_rate / task.control.rate)
        self._H = ca.triu2symm(ca.SX(ca.Sparsity.upper(n), given["H"]))
        self._bias, self._drift = given["bias"], given["drift"]
        self._J = ca.reshape(given["J"], 6, n)
        self._p, self._R = given["p"], ca.reshape(given["R"], 3, 3)
        self._D = np.broadcast_to(np.array(task.robot.joint_damping, dtype=float), n)
        self._mechanism = context.mechanisms.get(context.held)
        self._declared: Mechanism | None = task.mechanisms.get(context.held)
        self._c = n + (self._declared is not None)
        self._begun: ca.SX | None = None
        self.wrench, self.effort = ca.SX.zeros(6), ca.SX.zeros(1)
        self.reactions = ca.SX.zeros(len(context.equations))
        self._acceleration = ca.SX.zeros(6)

    def once(self, state: _State, tau: ca.SX, clock: ca.SX) -> _State:
        """One step."""
        n, c, h = self._n, self._c, self.period
        begun = state.q if self._begun is None else self._begun
        self._begun = begun
        d = self._J @ (state.q - begun)
        p, R = self._p + d[:3], self._R + ca.skew(d[3:]) @ self._R
        twist = self._J @ state.v
        forces = _Forces(ca.SX.zeros(c, c), ca.SX.zeros(c), ca.SX.zeros(6))
        for name in self._task.shapes:
            self._touch(forces, name, p, R, twist, clock)
        self._constrain(forces, p, twist, state, clock)
        H = ca.SX.zeros(c, c)
        H[:n, :n] = self._H + h * ca.diag(ca.DM(self._D))
        on = ca.SX.zeros(c)
        on[:n] = tau - self._bias - self._D * state.v
        grip = None
        if self._declared is not None and self._mechanism is not None:
            H[n, n] = self._declared.coordinate_inertia + h * self._declared.damping
            on[n] = -self._declared.damping * state.held[1] + self._detent(state.held[0])
            grip = self._grip(p, R, twist, state.held)
        mass = H + forces.mass
        on += forces.on
        if grip is not None:
            G, f, M = grip
            mass += G.T @ M @ G
            on -= G.T @ f
        factor = ca.ldl(mass, False)
        a = ca.ldl_solve(on, *factor)
        if self._declared is not None:
            unit = ca.SX.zeros(c)
            unit[n] = 1.0
            column = ca.ldl_solve(unit, *factor)
            a += column * self._rubs(state.held, a[n], column[n])
            a += column * self._stops(state.held, a[n], column[n])
        self.wrench = forces.wrench
        if grip is not None:
            G, f, M = grip
            # The rows of a free knob act across its axis alone.
            pull = self._ways.T @ -(f + M @ (G @ a))
            self.wrench = self.wrench + pull
            self.effort = -ca.dot(self._moves, pull)
        v = state.v + h * a[:n]
        held = state.held
        if self._declared is not None:
            rate = held[1] + h * a[n]
            held = ca.vertcat(held[0] + h * rate, rate)
        self._acceleration = self._J @ a[:n] + self._drift
        return _State(state.q + h * v, v, held)

    # --- what the tool touches -----------------------------------------------------------------

    def _touch(
        self, forces: _Forces, name: str, p: ca.SX, R: ca.SX, twist: ca.SX, clock: ca.SX
    ) -> None:
        """Adds a shape under every sphere of the tool; each bears its share."""
        context, task, n = self._context, self._task, self._n
        shape: Shape = task.shapes[name]
        robot = context.robot
        declared = compliance(shape, robot, context.start, self.period)
        mobility = contact_mobility(robot, shape)
        surface, count = frames.surface(shape), len(robot.tool.centers)
        k, b, m = declared.stiffness / count, declared.damping / count, added_mass(mobility)
        slip_force, slip_mass = creep(b, mobility, self.period)
        base = context.moving_bases[name].at(clock) if name in context.moving_bases else None
        point = ca.SX.sym("point", 3)
        gradient = surface.gradient(point)
        at = ca.Function("at", [point], [surface.distance(point), gradient])
        for center, radius in zip(robot.tool.centers, robot.tool.radii, strict=True):
            lever = R @ ca.DM(center)
            distance, normal = at(p + lever if base is None else base.place(p + lever))
            normal = normal if base is None else base.A @ normal
            gap = distance - float(radius)
            touched = lever - float(radius) * normal
            rate = twist[:3] + ca.cross(twist[3:], touched)
            if base is not None:
                rate -= base.twist(p + touched)[:3]
            own = self._J[:3, :] - ca.skew(touched) @ self._J[3:, :]
            closing = ca.dot(normal, rate)
            inside = gap < 0
            row = normal.T @ own
            push = ca.if_else(inside, ca.fmax(-(k * gap + b * closing), 0), 0)
            forces.mass[:n, :n] += ca.if_else(push > 0, m, 0) * row.T @ row
            force = push * normal
            if shape.friction > 0:
                slip = rate - closing * normal
                size = ca.norm_2(slip) + _NO_SLIP
                most = shape.friction * push
                sticks = ca.logic_and(slip_force * size < most, inside)
                force -= ca.if_else(sticks, slip_force, most / size) * slip
                across = own - normal @ row
                # What slides has its friction turn with it, at the step's end.
                mass = ca.if_else(sticks, slip_mass, 0)
                forces.mass[:n, :n] += mass * across.T @ across
            forces.on[:n] += own.T @ force
            forces.wrench += ca.vertcat(force, ca.cross(touched, force))

    def _constrain(
        self, forces: _Forces, p: ca.SX, twist: ca.SX, state: _State, clock: ca.SX
    ) -> None:
        """Adds the constraint equations."""
        n, applied = self._n, []
        for name, model in equation_models(self._task).items():
            declared = equation_compliance(
                model,
                self._context.robot,
                self._context.start,
                self._task.equations[name],
                self.period,
            )
            place, rate = (state.q, state.v) if model.joints else (p, twist[:3])
            terms = model.terms(place, rate, clock)
            force = reaction(model, terms, rate, declared.stiffness, declared.damping)
            applied.append(force)
            if model.joints:
                forces.on[:n] -= force * terms.normal.T
            else:
                forces.on[:n] -= self._J[:3, :].T @ (force * terms.normal.T)
                forces.wrench[:3] -= force * terms.normal.T
        self.reactions = ca.vertcat(ca.SX(0, 1), *applied)

    # --- what it holds ---------------------------------------------------------------------------

    def _grip(self, p: ca.SX, R: ca.SX, twist: ca.SX, held: ca.SX) -> tuple[ca.SX, ca.SX, ca.DM]:
        """Rows (r, c) of the coupling, its force (r,) before what it adds, and the mass it adds."""
        n, model = self._n, self._mechanism
        assert model is not None
        assert self._declared is not None
        axis = model.rotation[:, 2]
        handle, turn = _handle(model, held[0])
        moves = ca.DM(axis)
        if model.angular:
            moves = ca.cross(ca.DM(axis), handle - ca.DM(model.origin)) + model.lead * ca.DM(axis)
        turns = ca.DM(axis) if model.angular else ca.DM.zeros(3)
        self._moves = ca.vertcat(moves, turns)
        ways = np.eye(6)
        if self._declared.knob == "free":
            across = np.linalg.svd(axis[None, :])[2][1:]
            ways = np.vstack([ways[:3], np.hstack([np.zeros((2, 3)), across])])
            self._moves = ca.vertcat(moves, ca.DM.zeros(3))
        self._ways = ca.DM(ways)
        G = ca.SX.zeros(6, n + 1)
        G[:, :n] = self._J
        G[:, n] = -ca.vertcat(moves, turns)
        G = self._ways @ G
        apart = R @ (turn @ ca.DM(self._context.start_R)).T
        if self._declared.knob == "free":
            # Only how the axis leans counts.
            lean = ca.cross(ca.DM(axis), R @ ca.DM(self._context.start_R.T @ axis))
            askew = lean
        else:
            askew = 0.5 * ca.vertcat(
                apart[2, 1] - apart[1, 2], apart[0, 2] - apart[2, 0], apart[1, 0] - apart[0, 1]
            )
        e = self._ways @ ca.vertcat(p - handle, askew)
        rate = self._ways @ (twist - ca.vertcat(moves, turns) * held[1])
        turning = len(ways) - 3
        K = ca.DM([GRIP.stiffness] * 3 + [GRIP.angular_stiffness] * turning)
        B = ca.DM([GRIP.damping] * 3 + [GRIP.angular_damping] * turning)
        return G, K * e + B * rate, ca.diag(B * self.period)

    def _detent(self, place: ca.SX) -> ca.SX:
        detent = None if self._declared is None else self._declared.detent
        if detent is None:
            return ca.SX(0)
        away = (place - detent.at) / detent.width
        return ca.if_else(ca.fabs(away) < 1, detent.force * ca.sin(np.pi * away), 0)

    def _rubs(self, held: ca.SX, a: ca.SX, mobility: ca.SX) -> ca.SX:
        """Dry friction of the mechanism [N m, N]."""
        assert self._declared is not None
        c = self._declared.friction
        if c == 0:
            return ca.SX(0)
        wanted = (-_SETTLING / self.period * held[1] - a) / mobility
        return ca.fmin(ca.fmax(wanted, -c), c)

    def _stops(self, held: ca.SX, a: ca.SX, mobility: ca.SX) -> ca.SX:
        """What its stops exert [N m, N]."""
        assert self._declared is not None
        if self._declared.stop is None:
            return ca.SX(0)
        low, high = self._declared.stop
        time, d = _STOP_STEPS * self.period, _IMPEDANCE
        b, k = 2 / (d * time), 1 / (d * time * _STOP_DAMPING) ** 2
        total = ca.SX(0)
        for sign, end in ((1.0, low), (-1.0, high)):
            if not np.isfinite(end):
                continue
            room = sign * (held[0] - end)
            wanted = -b * sign * held[1] - k * room
            push = ca.fmax(d * (wanted - sign * a) / mobility, 0)
            total += ca.if_else(room < 0, sign * push, 0)
        return total

    def at_wrist(self) -> ca.SX:
        """(6,) what a sensor between flange and tool feels, about the tip, world axes."""
        body = self._context.robot.model.body(self._context.robot.tip_body)
        mass, R = float(body.mass[0]), self._R
        lever = R @ ca.DM(np.array(body.ipos))
        turned = pin.Quaternion(*(float(x) for x in body.iquat)).matrix()
        own = R @ ca.DM(turned @ np.diag(np.array(body.inertia)) @ turned.T) @ R.T
        linear, angular = self._acceleration[:3], self._acceleration[3:]
        at = linear + ca.cross(angular, lever) - ca.DM([0, 0, -9.81])
        force = -mass * at
        return self.wrench + ca.vertcat(force, ca.cross(lever, force) - own @ angular)


def _handle(model: MechanismModel, s: ca.SX) -> tuple[ca.SX, ca.SX]:
    """(3,) where the handle is at a coordinate, and (3, 3) how far it has turned, world axes."""
    axis = model.rotation[:, 2]
    if not model.angular:
        return ca.DM(model.grip) + s * ca.DM(axis), ca.SX.eye(3)
    cosine, sine = ca.cos(s), ca.sin(s)
    turn = ca.vertcat(
        ca.horzcat(cosine, -sine, 0), ca.horzcat(sine, cosine, 0), ca.horzcat(0, 0, 1)
    )
    A = ca.DM(model.rotation)
    turned = A @ turn @ A.T
    lever = ca.DM(model.grip - model.origin)
    return ca.DM(model.origin) + turned @ lever + model.lead * s * ca.DM(axis), turned
