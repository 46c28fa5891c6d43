"""Equations that hold exactly: rigid bilateral constraints of the arm (4.72)-(4.79).

The plant's step is v' = v + h M^-1 (u - bias + f + J_phi^T lambda), q' = q + h v', with
M = H + h D for the damping D of the joints, which MuJoCo takes at the step's end, and f what its
contacts exert. With (4.125)-(4.128) the constraint at the end of the step is

    phi' = phi + h (J_phi v' + phi_t) + h^2 / 2 gamma = 0   to third order in h,

so that lambda follows from (4.77) with gamma_h = gamma / 2 + (J_phi v + phi_t) / h + phi / h^2 in
the place of gamma: along a motion that keeps the constraint they differ by the order of h. That is
(4.78) with its drift taken back in every step: there is no gain to choose, and no projection after
the step that would move the arm without a force.
"""

from __future__ import annotations

import casadi as ca
import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.control import constrained, linear
from taskspec.program.bound import Wiring
from taskspec.program.world.equations import EquationModel, equation_models
from taskspec.spec import Task
from taskspec_runner.plant.arm import SceneArm

Vector = NDArray[np.float64]

#: Evaluations of MuJoCo's contacts in a step, at most. Without friction two are enough.
MOST_ROUNDS = 20
#: Multipliers have settled when another round would change them by this part, or so many newtons.
_SETTLED = 1e-9


class RigidConstraints:
    """The exact equations of a task, as torques on an arm.

    What contacts, limits and couplings exert depends on the multipliers, and these on them. Both
    are solved for together: lambda = (4.77) of MuJoCo's constraint forces under lambda is a fixed
    point, which Broyden's method finds. Where nothing of this acts on the arm the first is right.

    Attributes:
        function: all of the step's beginning, and of a round, to the multipliers of the next one.
        clock: (1,) of the simulator [s].
        J, J_rate: (3 nv,) of the tip's place, and its rate, row by row; `turning_J`,
            `turning_J_rate` of its rotation. `body` is the tip's, `tip` its place, `axes` (9,) its
            axes row by row.
        H: (nv nv,) of all degrees of freedom, row by row.
        constraint_forces: (k,) view of what MuJoCo's constraints exert on the joints [N m, N].
        exerted: (k,) of these those for which the function was evaluated.
        round: (1,) of this step, from 0.
        multipliers: (m,) of this round, by the environment along the unit gradients [N, N m];
            `before` those of the round before, and `step` what would have taken them to (4.77).
        broyden: (m m,) the step of the multipliers for what is left to (4.77), negative.
        next_multipliers, next_step, next_broyden: of these, what the function writes.
        on_tip: (6,) what those on the tip exert there, world axes [N, N m].
        on_joints: (k,) what all of them exert on the joints [N m, N].
        others: (k,) what else is applied to the joints in this step; `joints` is where all that is.
        settled: (1,) whether `multipliers` are those of (4.77).
        cartesian: whether any is on the tip.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        arm: SceneArm,
        task: Task,
        applied: Vector,
    ) -> None:
        """Of an arm; `applied` (equations,) takes what the robot applies along each gradient."""
        self._model, self._data = model, data
        places, free = arm.places(model), list(arm.robot.coupling.free)
        own, nv = places.velocities, model.nv
        self.body = places.tip
        self.tip, self.axes = data.xpos[places.tip], data.xmat[places.tip]
        self.joints, self.constraint_forces = data.qfrc_applied[own], data.qfrc_constraint[own]
        k = len(self.joints)
        models = equation_models(task)
        exact = {name: each for name, each in models.items() if task.equations[name].exact}
        m = len(exact)
        self.cartesian = any(not each.joints for each in exact.values())
        self.clock, self.round, self.settled = np.zeros(1), np.zeros(1), np.zeros(1)
        self.J, self.J_rate, self.H = np.zeros(3 * nv), np.zeros(3 * nv), np.zeros(nv * nv)
        self.turning_J, self.turning_J_rate = np.zeros(3 * nv), np.zeros(3 * nv)
        self.exerted, self.others, self.on_joints = (np.zeros(k) for _ in range(3))
        self.on_tip = np.zeros(6)
        self.multipliers, self.before, self.step = (np.zeros(m) for _ in range(3))
        self.next_multipliers, self.next_step = np.zeros(m), np.zeros(m)
        self.broyden, self.next_broyden = np.zeros(m * m), np.zeros(m * m)

        wiring = Wiring()
        q, v = wiring.reads("q", data.qpos[places.positions]), wiring.reads("v", data.qvel[own])
        tip, clock = wiring.reads("tip", self.tip), wiring.reads("clock", self.clock)
        R = ca.reshape(wiring.reads("axes", self.axes), 3, 3).T
        J, J_rate = (
            ca.vertcat(
                *(ca.reshape(wiring.reads(name, getattr(self, name)), nv, 3).T for name in names)
            )[:, own]
            for names in (("J", "turning_J"), ("J_rate", "turning_J_rate"))
        )
        H = ca.reshape(wiring.reads("H", self.H), nv, nv)[own, own]
        h = wiring.numbers("h", model.opt.timestep)
        damping = wiring.numbers("damping", *model.dof_damping[own])
        moves = (
            wiring.reads("passive", data.qfrc_passive[own])
            + wiring.reads("motors", data.qfrc_actuator[own])
            + wiring.reads("others", self.others)
        )
        bias = wiring.reads("bias", data.qfrc_bias[own])
        exerted = wiring.reads("exerted", self.exerted)
        at = {name: each.place(q[free], tip, R) for name, each in exact.items()}
        rows = [
            _row(each, at[name], J, J_rate, v, free, clock, h[0]) for name, each in exact.items()
        ]
        J_phi, gamma = ca.vertcat(*(row[0] for row in rows)), ca.vertcat(*(row[1] for row in rows))
        factor = linear.cholesky(H + ca.diag(h * damping))
        wanted = constrained.multipliers(factor, bias, moves + exerted, J_phi, gamma)
        found = self._next(wiring, wanted)
        wiring.writes(found, self.next_multipliers)
        wiring.writes(J_phi.T @ found, self.on_joints)
        on_tip, names = ca.SX.zeros(6), list(models)
        for i, (name, each) in enumerate(exact.items()):
            number = names.index(name)
            wiring.writes(-found[i], applied[number : number + 1])
            if not each.joints:
                on_tip[each.on] += found[i] * each.terms(at[name], clock).normal.T
        wiring.writes(on_tip, self.on_tip)
        self.function = wiring.bound("rigid_constraints")

    def _next(self, wiring: Wiring, wanted: ca.SX) -> ca.SX:
        """Multipliers (m,) of the next round, by Broyden's method, from those of (4.77)."""
        m = wanted.shape[0]
        number = wiring.reads("round", self.round)
        now, before = wiring.reads("now", self.multipliers), wiring.reads("before", self.before)
        step_before = wiring.reads("step", self.step)
        B = ca.reshape(wiring.reads("broyden", self.broyden), m, m)
        step = wanted - now
        moved, change = now - before, step - step_before
        along = ca.dot(moved, B @ change)
        update = (moved + B @ change) @ (moved.T @ B) / along
        # In the first two rounds there is nothing to compare with.
        begins = ca.logic_or(number < 2, ca.logic_not(ca.fabs(along) > 0))
        B = ca.if_else(begins, ca.if_else(number < 2, ca.SX.eye(m), B), B - update)
        settled = ca.mmax(ca.fabs(step)) < _SETTLED * (1 + ca.mmax(ca.fabs(wanted)))
        first = number < 1
        wiring.writes(ca.logic_and(ca.logic_not(first), settled), self.settled)
        wiring.writes(step, self.next_step)
        wiring.writes(ca.vec(B), self.next_broyden)
        return ca.if_else(first, wanted, ca.if_else(settled, now, now + B @ step))

    def apply(self) -> None:
        """Adds the torques at the pose and velocity that `mj_step1` has left.

        All other applied forces have to be there.
        """
        model, data = self._model, self._data
        self.clock[0], self.round[0] = data.time, 0.0
        if self.cartesian:
            J, turning_J, J_rate, turning_J_rate = (
                each.reshape(3, model.nv)
                for each in (self.J, self.turning_J, self.J_rate, self.turning_J_rate)
            )
            mujoco.mj_jacBody(model, data, J, turning_J, self.body)
            mujoco.mj_jacDot(model, data, J_rate, turning_J_rate, self.tip, self.body)
        mujoco.mj_fullM(model, data, self.H.reshape(model.nv, model.nv))
        mujoco.mj_fwdActuation(model, data)
        self.others[:] = self.joints
        # Contacts mostly exert what they did in the step before.
        self.exerted[:] = self.constraint_forces
        self.function.evaluate()
        for number in range(1, MOST_ROUNDS + 1):
            self.joints[:] = self.others + self.on_joints
            self.before[:], self.step[:] = self.multipliers, self.next_step
            self.multipliers[:], self.broyden[:] = self.next_multipliers, self.next_broyden
            mujoco.mj_fwdAcceleration(model, data)
            mujoco.mj_fwdConstraint(model, data)
            if np.array_equal(self.constraint_forces, self.exerted):
                break
            self.exerted[:], self.round[0] = self.constraint_forces, number
            self.function.evaluate()
            if self.settled[0]:
                break


def _row(
    model: EquationModel,
    place: ca.SX,
    J: ca.SX,
    J_rate: ca.SX,
    v: ca.SX,
    free: list[int],
    clock: ca.SX,
    h: ca.SX,
) -> tuple[ca.SX, ca.SX]:
    """J_phi (1, k) of unit gradient and gamma_h of an equation.

    Args:
        model: the equation.
        place: as it has it.
        J, J_rate: (6, k) Jacobian of the tip, and its rate.
        v: (k,) of all joints; `free` of them move by themselves.
        clock: of the simulator [s].
        h: step of the plant [s].
    """
    if model.joints:
        terms = model.terms(place, clock, v[free])
        J_phi, gamma = ca.SX.zeros(1, v.shape[0]), terms.drift
        J_phi[0, free] = terms.normal
    else:
        on = J[model.on, :]
        terms = model.terms(place, clock, on @ v)
        J_phi = terms.normal @ on
        gamma = terms.drift + terms.normal @ (J_rate[model.on, :] @ v)
    closing = J_phi @ v + terms.by_time
    return J_phi, gamma / 2 + closing / h + terms.distance / h**2
