"""A compiled controller on an arm under ideal rigid constraints: a reference integration of (4.78).

The constraints are the world's equations, held exactly: H q'' = P (u - C q' - g) - J_phi^T
(J_phi H^-1 J_phi^T)^-1 gamma is integrated by Runge-Kutta within each control period, and the state
is put back onto the constraints after it. The multipliers are those of (4.77) at the start of the
period, with the torque held then; the controller sees them one tick late.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction
from taskspec.program.ports import fields, slices
from taskspec.program.program import Program
from taskspec.program.world.equations import EquationModel

Vector = NDArray[np.float64]
Disturbance = Callable[[float], Vector]

#: Distance at which a constraint is kept as well as numbers can [m, rad].
ROUNDING = 1e-15


class Arm:
    """The arm of a program with its equations as numbers.

    Pinocchio's own algorithms give the arm's terms, not those that the controller is compiled from.
    One CasADi function makes the rest of them in place: a run evaluates it some ten times in each
    control period.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        robot = program.context.robot
        self._model, self._data = robot.pin, robot.pin.createData()
        self._frame = robot.pin.getFrameId("tip")
        n, m = robot.pin.nv, len(program.context.equations)
        self._q, self._v, self._u, self._rest = (np.zeros(n) for _ in range(4))
        self._crba, self._bias, self._jacobian = np.zeros((n, n)), np.zeros(n), np.zeros((n, 3))
        self._p, self._drift, self._t = np.zeros(3), np.zeros(3), np.zeros(1)
        arguments = [
            self._crba.reshape(-1), self._bias, self._jacobian.reshape(-1), self._p, self._drift,
            self._q, self._v, self._u, self._t,
        ]  # fmt: skip
        self._H, self._acceleration = np.zeros(n * n), np.zeros(n)
        self._distance, self._gamma, self._by_time, self._lambda = np.zeros((4, m))
        self._J, self._normals = np.zeros(m * n), np.zeros(3 * m)
        self._nearer, self._kept = np.zeros(n), np.zeros(n)
        results = [
            self._H, self._distance, self._J, self._gamma, self._by_time, self._normals,
            self._lambda, self._acceleration, self._nearer, self._kept,
        ]  # fmt: skip
        function = _function(n, [*program.context.equations.values()])
        self._function = BoundFunction(function, arguments, results)

    def at(self, q: Vector, v: Vector, u: Vector | float, t: float) -> None:
        """Evaluates everything at q, v, u (n,) and t [s]."""
        self._q[:], self._v[:], self._u[:], self._t[0] = q, v, u, t
        model, data = self._model, self._data
        self._crba[:] = pin.crba(model, data, q)
        self._bias[:] = pin.nonLinearEffects(model, data, q, v)
        pin.forwardKinematics(model, data, q, v, self._rest)
        world = pin.LOCAL_WORLD_ALIGNED
        self._jacobian[:] = pin.computeFrameJacobian(model, data, q, self._frame, world)[:3].T
        pin.updateFramePlacement(model, data, self._frame)
        self._p[:] = data.oMf[self._frame].translation
        drift = pin.getFrameClassicalAcceleration(model, data, self._frame, world)
        self._drift[:] = drift.linear
        self._function.evaluate()

    def dynamics(self, q: Vector, v: Vector) -> tuple[Vector, Vector]:
        """H (n, n) and C q' + g (n,)."""
        self.at(q, v, 0.0, 0.0)
        return self._H.reshape(len(q), -1).copy(), self._bias.copy()

    def constraint(self, q: Vector, v: Vector, t: float) -> tuple[Vector, Vector, Vector, Vector]:
        """Distance (m,), J_phi with unit normals (m, n), gamma (m,), r_t / |r_x| (m,)."""
        self.at(q, v, 0.0, t)
        J = self._J.reshape(-1, len(self._distance)).T
        return self._distance.copy(), J.copy(), self._gamma.copy(), self._by_time.copy()

    def wrench(self, force: Vector) -> Vector:
        """(3,) what the tool feels of (m,) forces along the normals, where it last was [N]."""
        return -force @ self._normals.reshape(-1, len(force)).T

    def multipliers(self, q: Vector, v: Vector, u: Vector, t: float) -> Vector:
        """Lambda (m,) by (4.77)."""
        self.at(q, v, u, t)
        return self._lambda.copy()

    def acceleration(self, q: Vector, v: Vector, u: Vector, t: float) -> Vector:
        """q'' (n,) by (4.78)."""
        self.at(q, v, u, t)
        return self._acceleration.copy()

    def onto(self, q: Vector, v: Vector, t: float) -> tuple[Vector, Vector]:
        """The state nearest to (q, v) that keeps the constraints, to `ROUNDING`."""
        self.at(q, v, 0.0, t)
        for _ in range(4):
            if np.abs(self._distance).max() < ROUNDING:
                break
            q = self._nearer.copy()
            self.at(q, v, 0.0, t)
        return q, self._kept.copy()


def _function(n: int, equations: list[EquationModel]) -> ca.Function:
    """What `Arm` keeps of a state, from the arm's terms there, q, v, u (n,) and t."""
    # NumPy's rows are CasADi's columns: the upper triangle, which alone is known, comes below.
    lower, bias, columns = ca.SX.sym("H", n, n), ca.SX.sym("bias", n), ca.SX.sym("J", 3, n)
    p, drift = ca.SX.sym("p", 3), ca.SX.sym("drift", 3)
    q, v, u, t = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("u", n), ca.SX.sym("t")
    d, rows, gamma, r_t, normals = [], [], [], [], []
    for model in equations:
        place, rate = (q, v) if model.joints else (p, columns @ v)
        terms = model.terms(place, t, rate)
        normal, bend = terms.normal, terms.drift
        d.append(terms.distance)
        r_t.append(terms.by_time)
        rows.append(normal if model.joints else normal @ columns)
        gamma.append(bend if model.joints else bend + normal @ drift)
        normals.append(ca.SX(1, 3) if model.joints else normal)
    distance, J, bend, by_time = (ca.vertcat(*x) for x in (d, rows, gamma, r_t))
    H = ca.tril(lower) + ca.tril(lower, False).T
    W, free = ca.solve(H, J.T), ca.solve(H, u - bias)
    felt = J @ W
    reaction = ca.solve(felt, J @ free + bend)
    out = [
        H, distance, J, bend, by_time, ca.vertcat(*normals), -reaction, free - W @ reaction,
        q - J.T @ ca.solve(J @ J.T, distance), v - W @ ca.solve(felt, J @ v + by_time),
    ]  # fmt: skip
    arguments = [ca.vec(lower), bias, ca.vec(columns), p, drift, q, v, u, t]
    return ca.Function("arm", arguments, [ca.densify(x) for x in out])


@dataclass
class RigidRun:
    """What a run under rigid constraints left behind; one row a tick.

    Attributes:
        t: [s]. q, v, u: (ticks, n). force: (ticks, m) what the robot applies along the unit
            normals [N, N m], of the tick's own torque. outputs: by name.
    """

    t: Vector
    q: Vector
    v: Vector
    u: Vector
    force: Vector
    outputs: dict[str, Vector]


def run_rigid(
    program: Program,
    time: float,
    *,
    disturbance: Disturbance | None = None,
    velocity: Vector | None = None,
    delay: int = 1,
    pole: float = 0.0,
    substeps: int = 2,
) -> RigidRun:
    """Runs a compiled task whose first stage lasts for `time` [s] on the ideal constraints.

    Args:
        program: the task; its start is put onto the constraints first.
        time: [s]. disturbance: joint torque (n,) that the controller does not know, of time.
        velocity: (n,) of the joints at the start, put onto the constraints; at rest by default.
        delay: ticks after which the controller sees a multiplier. pole: of a low-pass before that.
        substeps: of the integration in a control period.
    """
    arm, T = Arm(program), program.context.period
    machine = program.machine()
    n = program.context.robot.pin.nv
    v = np.zeros(n) if velocity is None else velocity
    q, v = arm.onto(program.context.start.copy(), v, 0.0)
    _, J, _, _ = arm.constraint(q, v, 0.0)
    # Before the first tick the arm rests on its constraints without pressing.
    force = low = np.zeros(len(J))
    late = [force] * delay
    rows = []
    for k in range(round(time / T)):
        t = k * T
        _sense(arm, machine, q, v, late[0])
        if k == 0:
            machine.start()
        machine.tick(t)
        u = machine.torque.copy()
        total = u if disturbance is None else u + disturbance(t)
        force = -arm.multipliers(q, v, total, t)
        low = pole * low + (1 - pole) * force
        late = [*late[1:], low]
        rows.append((t, q, v, u, force, machine.outputs.copy()))
        q, v = _advance(arm, q, v, total, t, T, substeps)
    *columns, outputs = [np.array(column) for column in zip(*rows, strict=True)]
    named = slices(fields(len(force), program.context.followed))
    return RigidRun(*columns, {name: outputs[:, where] for name, where in named.items()})


def _sense(arm, machine, q, v, force):
    machine.q[:], machine.v[:] = q, v
    machine.reactions[:] = force
    # The arm was last evaluated where it is now: as it was put onto its constraints.
    machine.wrench[:3] = arm.wrench(force)


def _advance(arm, q, v, u, t, T, substeps):
    h = T / substeps
    for i in range(substeps):
        at = t + i * h
        k1v = arm.acceleration(q, v, u, at)
        k2v = arm.acceleration(q + h / 2 * v, v + h / 2 * k1v, u, at + h / 2)
        k2q = v + h / 2 * k1v
        k3v = arm.acceleration(q + h / 2 * k2q, v + h / 2 * k2v, u, at + h / 2)
        k3q = v + h / 2 * k2v
        k4v = arm.acceleration(q + h * k3q, v + h * k3v, u, at + h)
        k4q = v + h * k3v
        q = q + h / 6 * (v + 2 * k2q + 2 * k3q + k4q)
        v = v + h / 6 * (k1v + 2 * k2v + 2 * k3v + k4v)
    return arm.onto(q, v, t + T)
