"""A plain plant of a task: the arm, what its tool touches or holds, and nothing else, as one step.

Every contact is the spring and damper that the file declares, with Coulomb's friction, under each
sphere of the tool and of loose bodies, or under the whole surface of a flat tool; a grip is a
spring and damper in six directions, a mechanism one coordinate, a loose body six. The step is
semi-implicit Euler, as the simulator's is. It knows nothing of the simulator's solver: it is what
`LinearPlant` is about an equilibrium, anywhere. Its world is the true one, where the file has
another than it tells the controller of.

    (H + h D + G^T M G) a = tau - C q' - g - D q' - G^T f,    f = K e + B e',
    q'+ = q' + h a,    q+ = q + h q'+

with the mass M that the simulator's constraints add, and H, C q' + g and the tip's Jacobian of
where the period of control begins.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.analysis.coordinates import Coordinate, about_itself, coordinates
from taskspec.analysis.loose_bodies import LooseBody, loose_bodies
from taskspec.analysis.point_contacts import (
    Ground,
    Mover,
    Patch,
    PointContact,
    Resistance,
    Spheres,
    WholeToolContact,
    plane_patch,
)
from taskspec.analysis.whole_contacts import whole_contacts
from taskspec.deferred_methods import dataclass
from taskspec.program.bound import Wiring
from taskspec.program.context import Context
from taskspec.program.operators import quick_operators
from taskspec.program.world import frames
from taskspec.program.world.equations import equation_models, reaction
from taskspec.program.world.holding import truly_holding
from taskspec.program.world.moving_base import moving_bases
from taskspec.program.world.payload import modelled_inertia, true_inertia
from taskspec.program.world.stiffness import (
    GRIP,
    Compliance,
    compliance,
    contact_mobility,
    equation_compliance,
    friction_ratio,
    mobility_of,
    pair_compliance,
)
from taskspec.robot import RobotModel
from taskspec.robot.model_terms import ModelTerms, PinocchioTerms
from taskspec.robot.rebuild import GRAVITY
from taskspec.shapes import Plane
from taskspec.spec import Task

Vector = NDArray[np.float64]

#: Dry friction of a joint as the simulator has it where nothing else is asked of it: it takes a
#: slip away at this rate [1/s], and yields by this share of what a force moves the joint alone.
_JOINT_SETTLING, _YIELDING = 2 / (0.95 * 0.02), (1 - 0.9) / 0.9
#: Sweeps over the joints, whose frictions act on each other through the inertia.
_SWEEPS = 4


class PlainPlant:
    """The plant of a task's true world, stepped from the arrays of a machine.

    Attributes:
        q, v: (n,) of the joints after the last step.
        mechanisms: (2 mechanisms,) of each its coordinate and its rate: of the held one first.
        bodies: (13 bodies,) of each loose body position [m], quaternion (w x y z) and twist, world.
        wrench: (6,) by the environment on the tip in the last step, world axes [N, N m].
        wrist: (6,) the same as a sensor between flange and tool feels it; None elsewhere.
        tip_rotation: (9,) the tip's axes in the last step, row by row.
        effort: (1,) what the robot applies to the coordinate [N m, N].
        reactions: (equations,) what it applies along each equation [N, N m].
        numbers: wrench, mechanisms, effort, reactions and bodies, one after the other; parts:
            these.
    """

    @quick_operators()
    def __init__(self, context: Context, terms: ModelTerms, torque: Vector) -> None:
        """A plant at rest at the start.

        Args:
            context: of the task.
            terms: evaluated at the state with which each period begins.
            torque: (n,) of the machine.

        Raises:
            RobotError: what the robot holds is where it cannot hold it.
        """
        task = context.loaded.true_task
        n, self._terms = len(torque), terms
        self.q, self.v = truly_holding(context, task).copy(), np.zeros(n)
        terms.at(self.q, self.v)
        p, R = terms.tip()
        self.tip_rotation, self.clock = R.ravel(), np.zeros(1)
        step = _Step(context, task, terms, _Start(self.q.copy(), p, R))
        bodies, sizes = step.at_start(), [6, 2 * len(step.mechanisms), 1, len(task.equations)]
        self.numbers = np.concatenate([np.zeros(sum(sizes)), bodies])
        self.parts = np.split(self.numbers, np.cumsum(sizes))
        self.wrench, self.mechanisms, self.effort, self.reactions, self.bodies = self.parts
        self.wrist = np.zeros(6) if task.robot.sensor.at == "wrist" else None
        self._before = (np.zeros(n), np.zeros(n), 0 * self.mechanisms, 0 * self.bodies)
        # A step reads where these were while it writes where they are.
        now = (self.q, self.v, self.mechanisms, self.bodies)
        self._moving = [each for each in zip(self._before, now, strict=True) if each[0].size]
        self._periods = [i * step.period for i in range(step.substeps)]
        wiring = Wiring()
        state, clock = self._reads(wiring, step)
        state = step.once(state, wiring.reads("torque", torque), clock)
        wiring.writes(state.q, self.q)
        wiring.writes(state.v, self.v)
        wiring.writes(state.mechanisms, self.mechanisms)
        wiring.writes(state.bodies, self.bodies)
        wiring.writes(step.wrench, self.wrench)
        wiring.writes(step.effort, self.effort)
        wiring.writes(step.reactions, self.reactions)
        wiring.writes(step.tip_rows(), self.tip_rotation)
        if self.wrist is not None:
            wiring.writes(step.at_wrist(), self.wrist)
            # As the run begins the arm rests, and feels the weight of its tool.
            self.wrist[:] = step.weight()
        # What comes more than once is not looked for: that takes as long as all its steps.
        self._function = wiring.bound("plant", cse=False)
        self._step = self._function.evaluate
        # What is touched whole is looked for before a step: where the tool is in its coordinates.
        self._whole = [*step.whole.values()]
        self._places = None
        if self._whole:
            wiring = Wiring()
            step.place(wiring, *self._reads(wiring, step))
            self._places = wiring.bound("places")

    def _reads(self, wiring: Wiring, step: _Step) -> tuple[_State, ca.SX]:
        """Where the plant is as a step begins, and when that is [s]."""
        step.read(wiring)
        state = _State(*(wiring.reads("before", array) for array in self._before))
        return state, wiring.reads("clock", self.clock)

    def step(self, clock: float) -> None:
        """One period of control that begins at run time `clock` [s]."""
        self.tip_rotation[:] = self._terms.rotation.reshape(3, 3, order="F").ravel()
        for since in self._periods:
            self.clock[0] = clock + since
            for before, now in self._moving:
                before[:] = now
            if self._places is not None:
                self._places.evaluate()
                for each in self._whole:
                    each.look()
            self._step()


@dataclass(frozen=True, slots=True)
class _State:
    q: ca.SX
    v: ca.SX
    mechanisms: ca.SX
    bodies: ca.SX


@dataclass(frozen=True, slots=True)
class _Start:
    """Joint positions (n,) and the pose of the tip as the run begins."""

    q: Vector
    p: Vector
    R: Vector


class _Step:
    """Steps of the plant within one period of control."""

    def __init__(self, context: Context, task: Task, terms: ModelTerms, start: _Start) -> None:
        robot = context.robot
        self._context, self._task, self._terms, self._start = context, task, terms, start
        n = self._n = robot.pin.nv
        self.period = 1.0 / task.control.plant_rate
        self.substeps = round(task.control.plant_rate / task.control.rate)
        self._D = np.broadcast_to(np.array(task.robot.joint_damping, dtype=float), n)
        self._dry = np.broadcast_to(np.array(task.robot.joint_friction, dtype=float), n)
        self._yields = _yields(robot) if self._dry.any() else np.zeros(n)
        name = (task.robot.grasp or "").removesuffix(".handle")
        self.mechanisms = coordinates(task, name if name in task.mechanisms else "", n)
        self._held_one = self.mechanisms.get(name)
        self._bases = moving_bases(task)
        at = n + len(self.mechanisms)
        self._loose = loose_bodies(task, at)
        self._held = self._loose.get(name)
        self._c = at + 6 * len(self._loose)
        self._tool = Spheres(robot.tool.centers, robot.tool.radii, len(robot.tool.centers))
        self._inertia = true_inertia(robot, task.robot)
        mobility = terms.jacobian @ np.linalg.solve(terms.inertia, terms.jacobian.T)
        self._mobility = float(np.linalg.eigvalsh(mobility[:3, :3])[-1])
        self._turning = float(np.linalg.eigvalsh(mobility[3:, 3:])[-1])
        self.whole = whole_contacts(task, robot, self._loose)
        self._ratio = friction_ratio(task)
        self.wrench, self.effort = ca.SX.zeros(6), ca.SX.zeros(1)
        self.reactions = ca.SX.zeros(len(task.equations))
        self._acceleration, self._twist = ca.SX.zeros(6), ca.SX.zeros(6)

    def read(self, wiring: Wiring) -> None:
        """Takes the arm's terms, and where shapes are touched whole."""
        n = self._n
        for each in self.whole.values():
            each.read(wiring)
        names = ("H", "bias", "gravity", "J", "p", "R", "drift")
        arrays = self._terms.arrays
        given = {name: wiring.reads(name, a) for name, a in zip(names, arrays, strict=True)}
        self._H = ca.triu2symm(ca.SX(ca.Sparsity.upper(n), given["H"]))
        self._bias, self._drift = given["bias"], given["drift"]
        self._J = ca.reshape(given["J"], 6, n)
        self._p, self._R = given["p"], ca.reshape(given["R"], 3, 3)
        # Of the first step in a period, the arm is where its terms are.
        self._begun = wiring.reads("begun", self._terms.q) if self.substeps > 1 else None

    def tip_rows(self) -> ca.SX:
        """(9,) the tip's axes as the period began, row by row."""
        return ca.vec(self._R.T)

    def at_start(self) -> Vector:
        """(13 bodies,) of the loose bodies as they lie."""
        return np.concatenate([np.zeros(0), *(body.at_start() for body in self._loose.values())])

    def once(self, state: _State, tau: ca.SX, clock: ca.SX) -> _State:
        """One step."""
        n, c, h = self._n, self._c, self.period
        tip = self._tip(state)
        states = self._states(state)
        bodies, riding = self._carriers(state)
        H = ca.SX(c, c)
        H[:n, :n] = self._H + h * ca.diag(ca.DM(self._D))
        on = ca.SX.zeros(c)
        on[:n] = tau - self._bias - self._D * state.v
        self._carry(H, on, tip)
        for name, body in self._loose.items():
            body.weigh(H, on, bodies[name])
        on_tip = self._constrain(on, tip, state, clock)
        on_tool, others = self._contacts(tip, bodies | riding, clock)
        grip = None
        for name, mechanism in self.mechanisms.items():
            mechanism.weigh(H, on, states[name], h)
        if self._held_one is not None:
            grip = self._grip(tip, self._held_one, states[self._held_one.model.name])
        elif self._held is not None:
            grip = self._hold(tip, self._held, bodies[self._held.name])
        grips = [] if grip is None else [grip]
        for each in (*on_tool, *others, *grips):
            on -= each.rows.T @ each.force
        if any(each.slips for each in (*on_tool, *others)):
            sliding = _with(H, (*on_tool, *others, *grips))
            free = ca.ldl_solve(on, *ca.ldl(sliding, False))
            on_tool = [each.held_back(free, h) for each in on_tool]
            others = [each.held_back(free, h) for each in others]
        factor = ca.ldl(_with(H, (*on_tool, *others, *grips)), False)
        a = self._rub_joints(ca.ldl_solve(on, *factor), state.v, factor)
        for name, mechanism in self.mechanisms.items():
            column = ca.ldl_solve(_unit(c, mechanism.row), *factor)
            a = mechanism.held_back(a, states[name], column, h)
        self.wrench = on_tip
        for each in on_tool:
            self.wrench = self.wrench + each.answer(a)
        if grip is not None:
            # The rows of a free knob act across its axis alone.
            pull = self._ways.T @ grip.answer(a)
            self.wrench = self.wrench + pull
            self.effort = -ca.dot(self._moves, pull)
        v = state.v + h * a[:n]
        turned = [one.moved(states[name], a, h) for name, one in self.mechanisms.items()]
        moved = [
            body.moved(state.bodies[body.entries], a[body.rows], h) for body in self._loose.values()
        ]
        self._acceleration, self._twist = self._J @ a[:n] + self._drift, tip.twist
        empty = ca.SX(0, 1)
        mechanisms, loose = ca.vertcat(empty, *turned), ca.vertcat(empty, *moved)
        return _State(state.q + h * v, v, mechanisms, loose)

    def _tip(self, state: _State) -> Mover:
        """The tool, of a period that it moves on in by a little."""
        d = self._J @ (state.q - (state.q if self._begun is None else self._begun))
        J = ca.SX(6, self._c)
        J[:, : self._n] = self._J
        R = self._R + ca.skew(d[3:]) @ self._R
        return Mover(self._p + d[:3], R, self._J @ state.v, J, self._mobility, self._turning)

    def place(self, wiring: Wiring, state: _State, clock: ca.SX) -> None:
        """Has a function write where the tool is in the coordinates of what it touches whole."""
        tip = self._tip(state)
        bodies, riding = self._carriers(state)
        for name, whole in self.whole.items():
            ground = self._ground(name, bodies | riding, clock)
            p = ground.place(tip.p)
            axes = [ground.place(tip.p + tip.R[:, i]) - p for i in range(3)]
            wiring.writes(p, whole.p)
            wiring.writes(ca.vertcat(*axes), whole.axes)

    def _carriers(self, state: _State) -> tuple[dict[str, Mover], dict[str, Mover]]:
        """Loose bodies, and shapes that ride on mechanisms, by name."""
        states, c = self._states(state), self._c
        bodies = {
            name: body.mover(state.bodies[body.entries], c) for name, body in self._loose.items()
        }
        riding = {
            name: self.mechanisms[shape.on].mover(states[shape.on], shape, c)
            for name, shape in self._task.shapes.items()
            if shape.on is not None
        }
        return bodies, riding

    def _ground(self, name: str, bodies: dict[str, Mover], clock: ca.SX) -> Ground:
        """The surface of a shape, and what carries it."""
        shape = self._task.shapes[name]
        base = self._bases[name].at(clock) if name in self._bases else None
        surface = about_itself(shape) if name in bodies else frames.surface(shape)
        return Ground(surface, base, bodies.get(name))

    def _states(self, state: _State) -> dict[str, ca.SX]:
        """(2,) of each mechanism, by name."""
        found = state.mechanisms
        return {name: found[2 * i : 2 * i + 2] for i, name in enumerate(self.mechanisms)}

    def _rub_joints(self, a: ca.SX, v: ca.SX, factor: tuple[ca.SX, ...]) -> ca.SX:
        """Accelerations (c,) under the dry friction of joints, of those without it.

        Each joint's force f_i is what has a_i + r_i f_i = -b v_i, within its bounds, one after the
        other: a projected Gauss-Seidel iteration on the simulator's problem.
        """
        rubbing = [i for i, most in enumerate(self._dry) if most > 0]
        columns = {i: ca.ldl_solve(_unit(self._c, i), *factor) for i in rubbing}
        forces = dict.fromkeys(rubbing, ca.SX(0))
        for i in _SWEEPS * rubbing:
            most, yields = float(self._dry[i]), float(self._yields[i])
            left = -_JOINT_SETTLING * v[i] - a[i] - yields * forces[i]
            wanted = forces[i] + left / (columns[i][i] + yields)
            force = ca.fmin(ca.fmax(wanted, -most), most)
            a = a + columns[i] * (force - forces[i])
            forces[i] = force
        return a

    # --- what touches ----------------------------------------------------------------------------

    def _contacts(
        self, tip: Mover, bodies: dict[str, Mover], clock: ca.SX
    ) -> tuple[list[Resistance], list[Resistance]]:
        """Of the tool with every shape, and of loose bodies with the others."""
        task, robot, period = self._task, self._context.robot, self.period
        grounds: dict[str, Ground] = {}
        fixed: list[Resistance] = []
        on_tool: list[Resistance] = []
        others: list[Resistance] = []
        for name, shape in task.shapes.items():
            body = self._loose.get(name)
            ground = grounds[name] = self._ground(name, bodies, clock)
            if body is not None and body is self._held:
                continue
            declared = compliance(shape, robot, self._start.q, period)
            mobility = contact_mobility(robot, shape)
            pair = tip, ground, declared, shape.friction, mobility, period, self._ratio
            patches = self._patches(name, tip, ground)
            made = [WholeToolContact(*pair, patch).resistance() for patch in patches]
            if not patches:
                made = [PointContact(*pair, self._tool).resistance()]
            (on_tool if name in bodies else fixed).extend(made)
        if fixed:
            # Of all that does not yield the tool's ways are the same ones.
            force = sum((each.force for each in fixed), ca.SX.zeros(6))
            mass = sum((each.mass for each in fixed), ca.SX.zeros(6, 6))
            slips = tuple(slip for each in fixed for slip in each.slips)
            on_tool.append(Resistance(tip.J, force, mass, slips))
        for name, other in combinations(task.shapes, 2):
            # Of two bodies the later one touches with its points.
            first, second = (other, name) if other in self._loose else (name, other)
            if first in self._loose:
                numbers = *self._between(first, second), period, self._ratio
                pair = bodies[first], grounds[second], *numbers
                others.append(PointContact(*pair, self._loose[first].spheres).resistance())
        return on_tool, others

    def _patches(self, name: str, tip: Mover, ground: Ground) -> tuple[Patch, ...]:
        """Where the tool touches a shape with its whole surface; none where spheres of it do."""
        tool = self._context.robot.tool
        if name in self.whole:
            return self.whole[name].patches()
        if tool.flat and isinstance(ground.surface, Plane):
            return (plane_patch(tool, tip, ground),)
        return ()

    def _between(self, body: str, other: str) -> tuple[Compliance, float, float]:
        """What is declared of a loose body's contact with another shape, friction and mobility."""
        own, shape = self._task.shapes[body], self._task.shapes[other]
        mobility = mobility_of(own) + mobility_of(shape)
        declared = pair_compliance(shape, 1.0 / mobility, self.period)
        softer = pair_compliance(own, 1.0 / mobility, self.period)
        if shape.free and softer.stiffness < declared.stiffness:
            return softer, own.friction, mobility
        return declared, shape.friction, mobility

    def _constrain(self, on: ca.SX, tip: Mover, state: _State, clock: ca.SX) -> ca.SX:
        """Adds the constraint equations, and returns their wrench (6,) on the tip."""
        n, applied, wrench = self._n, [], ca.SX.zeros(6)
        for name, model in equation_models(self._task).items():
            declared = equation_compliance(
                model,
                self._context.robot,
                self._start.q,
                self._task.equations[name],
                self.period,
            )
            place, rate = (state.q, state.v) if model.joints else (tip.p, tip.twist[:3])
            terms = model.terms(place, rate, clock)
            force = reaction(model, terms, rate, declared.stiffness, declared.damping)
            applied.append(force)
            if model.joints:
                on[:n] -= force * terms.normal.T
            else:
                on[:n] -= self._J[:3, :].T @ (force * terms.normal.T)
                wrench[:3] -= force * terms.normal.T
        self.reactions = ca.vertcat(ca.SX(0, 1), *applied)
        return wrench

    # --- what it holds ---------------------------------------------------------------------------

    def _carry(self, H: ca.SX, on: ca.SX, tip: Mover) -> None:
        """Adds what the tool weighs beyond what the arm's model has."""
        more, known = self._inertia, modelled_inertia(self._context.robot)
        if more == known:
            return
        n = self._n
        for sign, inertia in ((1.0, more), (-1.0, known)):
            M = tip.R @ ca.DM(inertia.matrix()[:3, :3]) @ tip.R.T
            lever = inertia.mass * (tip.R @ ca.DM(inertia.lever))
            about = tip.R @ ca.DM(inertia.matrix()[3:, 3:]) @ tip.R.T
            whole = ca.blockcat([[M, -ca.skew(lever)], [ca.skew(lever), about]])
            H[:n, :n] += sign * self._J.T @ whole @ self._J
            wrench = _inertial(inertia, tip.R, tip.twist, self._drift)
            on[:n] -= sign * self._J.T @ wrench

    def _grip(self, tip: Mover, held_one: Coordinate, held: ca.SX) -> Resistance:
        """Of tool and handle."""
        model, knob = held_one.model, held_one.declared.knob
        p, R, twist = tip.p, tip.R, tip.twist
        axis = model.rotation[:, 2]
        handle, turn = held_one.at(held[0], model.grip)
        moves, turns = held_one.ways(handle)
        self._moves = ca.vertcat(moves, turns)
        ways = np.eye(6)
        if knob == "free":
            across = np.linalg.svd(axis[None, :])[2][1:]
            ways = np.vstack([ways[:3], np.hstack([np.zeros((2, 3)), across])])
            self._moves = ca.vertcat(moves, ca.DM.zeros(3))
        self._ways = ca.DM(ways)
        G = ca.SX(tip.J)
        G[:, held_one.row] = -ca.vertcat(moves, turns)
        G = self._ways @ G
        if knob == "free":
            # Only how the axis leans counts.
            askew = ca.cross(ca.DM(axis), R @ ca.DM(self._start.R.T @ axis))
        else:
            askew = _askew(R @ (turn @ ca.DM(self._start.R)).T)
        e = self._ways @ ca.vertcat(p - handle, askew)
        rate = self._ways @ (twist - ca.vertcat(moves, turns) * held[1])
        turning = len(ways) - 3
        K = ca.DM([GRIP.stiffness] * 3 + [GRIP.angular_stiffness] * turning)
        B = ca.DM([GRIP.damping] * 3 + [GRIP.angular_damping] * turning)
        return Resistance(G, K * e + B * rate, ca.SX(ca.diag(B * self.period)))

    def _hold(self, tip: Mover, held: LooseBody, body: Mover) -> Resistance:
        """The same of a loose body, which is held as it lies."""
        R, origin = frames.pose(held.shape)
        handle = body.R @ ca.DM(R.T @ (self._start.p - origin))
        G = ca.SX(tip.J)
        G -= body.rows(body.p + handle)
        self._ways, self._moves = ca.DM.eye(6), ca.DM.zeros(6)
        e = ca.vertcat(
            tip.p - body.p - handle, _askew(tip.R @ (body.R @ ca.DM(R.T @ self._start.R)).T)
        )
        rate = tip.twist - ca.vertcat(body.velocity(body.p + handle), body.twist[3:])
        K = ca.DM([GRIP.stiffness] * 3 + [GRIP.angular_stiffness] * 3)
        B = ca.DM([GRIP.damping] * 3 + [GRIP.angular_damping] * 3)
        return Resistance(G, K * e + B * rate, ca.SX(ca.diag(B * self.period)))

    def at_wrist(self) -> ca.SX:
        """(6,) what a sensor between flange and tool feels, about the tip, world axes."""
        return self.wrench - _inertial(self._inertia, self._R, self._twist, self._acceleration)

    def weight(self) -> Vector:
        """(6,) the same of an arm at rest as the run begins, which touches nothing."""
        rest = ca.SX.zeros(6)
        return np.array(
            ca.evalf(-_inertial(self._inertia, ca.SX(self._start.R), rest, rest))
        ).ravel()


def _with(H: ca.SX, resistances: Iterable[Resistance]) -> ca.SX:
    """(c, c) inertia with the masses of what resists."""
    return sum((each.rows.T @ each.mass @ each.rows for each in resistances), H)


def _inertial(inertia: pin.Inertia, R: ca.SX, twist: ca.SX, acceleration: ca.SX) -> ca.SX:
    """(6,) wrench that moves and carries a rigid body, about the tip, world axes [N, N m].

    Args:
        inertia: of the body, in the tip frame.
        R: (3, 3) of that frame.
        twist, acceleration: (6,) of the tip.
    """
    c, w = inertia.mass * (R @ ca.DM(inertia.lever)), twist[3:]
    about = R @ ca.DM(inertia.matrix()[3:, 3:]) @ R.T
    linear, angular = acceleration[:3] - ca.DM(GRAVITY), acceleration[3:]
    force = inertia.mass * linear + ca.cross(angular, c) + ca.cross(w, ca.cross(w, c))
    return ca.vertcat(force, about @ angular + ca.cross(c, linear) + ca.cross(w, about @ w))


def _yields(robot: RobotModel) -> Vector:
    """(n,) how much joints move under the friction that holds them: counted where q is 0."""
    at_zero = PinocchioTerms(robot)
    at_zero.at(np.zeros(robot.pin.nv), np.zeros(robot.pin.nv))
    return np.asarray(_YIELDING * np.diag(np.linalg.inv(at_zero.inertia)))


def _unit(c: int, i: int) -> ca.SX:
    """(c,) 1 at i, 0 elsewhere."""
    unit = ca.SX.zeros(c)
    unit[i] = 1.0
    return unit


def _askew(apart: ca.SX) -> ca.SX:
    """(3,) small rotation [rad] of a rotation (3, 3)."""
    return 0.5 * ca.vertcat(
        apart[2, 1] - apart[1, 2], apart[0, 2] - apart[2, 0], apart[1, 0] - apart[0, 1]
    )
