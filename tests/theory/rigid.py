"""A compiled controller on an arm under ideal rigid constraints: a reference integration of (4.78).

The constraints are the world's equations, held exactly: H q'' = P (u - C q' - g) - J_phi^T
(J_phi H^-1 J_phi^T)^-1 gamma is integrated by Runge-Kutta within each control period, and the state
is put back onto the constraints after it. The multipliers are those of (4.77) at the start of the
period, with the torque held then; the controller sees them one tick late.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.program.program import Program

Vector = NDArray[np.float64]
Disturbance = Callable[[float], Vector]

#: Distance at which a constraint is kept as well as numbers can [m, rad].
ROUNDING = 1e-15


@dataclass
class Arm:
    """The arm of a program with its equations as numbers."""

    program: Program
    data: pin.Data = field(init=False)

    def __post_init__(self) -> None:
        self.robot = self.program.context.robot
        self.model = self.robot.pin
        self.data = self.model.createData()
        self.frame = self.model.getFrameId("tip")
        self.equations = [
            _numeric(m, self.model.nv) for m in self.program.context.equations.values()
        ]

    def dynamics(self, q: Vector, v: Vector) -> tuple[Vector, Vector]:
        """H (n, n) and C q' + g (n,)."""
        H = np.triu(pin.crba(self.model, self.data, q))
        return H + np.triu(H, 1).T, pin.nonLinearEffects(self.model, self.data, q, v)

    def constraint(self, q: Vector, v: Vector, t: float) -> tuple[Vector, Vector, Vector, Vector]:
        """Distance (m,), J_phi with unit normals (m, n), gamma (m,), r_t / |r_x| (m,)."""
        pin.forwardKinematics(self.model, self.data, q, v, np.zeros_like(v))
        pin.updateFramePlacements(self.model, self.data)
        world = pin.LOCAL_WORLD_ALIGNED
        J = pin.computeFrameJacobian(self.model, self.data, q, self.frame, world)[:3]
        drift = pin.getFrameClassicalAcceleration(self.model, self.data, self.frame, world).linear
        p = self.data.oMf[self.frame].translation
        found = []
        for on_joints, terms in self.equations:
            if on_joints:
                d, n, r_t, bend = (np.array(x).ravel() for x in terms(q, v, t))
                found.append((d, n, bend, r_t))
            else:
                d, n, r_t, bend = (np.array(x).ravel() for x in terms(p, J @ v, t))
                found.append((d, n @ J, bend + n @ drift, r_t))
        d, rows, gamma, r_t = zip(*found, strict=True)
        return np.concatenate(d), np.array(rows), np.concatenate(gamma), np.concatenate(r_t)

    def multipliers(self, q: Vector, v: Vector, u: Vector, t: float) -> Vector:
        """Lambda (m,) by (4.77)."""
        H, bias = self.dynamics(q, v)
        _, J, gamma, _ = self.constraint(q, v, t)
        Y = np.linalg.solve(H, np.column_stack([J.T, bias - u]))
        return np.linalg.solve(J @ Y[:, :-1], J @ Y[:, -1] - gamma)

    def acceleration(self, q: Vector, v: Vector, u: Vector, t: float) -> Vector:
        """q'' (n,) by (4.78)."""
        H, bias = self.dynamics(q, v)
        _, J, gamma, _ = self.constraint(q, v, t)
        Y = np.linalg.solve(H, np.column_stack([J.T, u - bias]))
        W, free = Y[:, :-1], Y[:, -1]
        return free - W @ np.linalg.solve(J @ W, J @ free + gamma)

    def onto(self, q: Vector, v: Vector, t: float) -> tuple[Vector, Vector]:
        """The state nearest to (q, v) that keeps the constraints, to `ROUNDING`."""
        for _ in range(4):
            d, J, _, _ = self.constraint(q, v, t)
            if np.max(np.abs(d)) < ROUNDING:
                break
            q = q - np.linalg.pinv(J) @ d
        _, J, _, r_t = self.constraint(q, v, t)
        H, _ = self.dynamics(q, v)
        W = np.linalg.solve(H, J.T)
        return q, v - W @ np.linalg.solve(J @ W, J @ v + r_t)


def _numeric(model, n):
    size = n if model.joints else 3
    x, dx, t = ca.SX.sym("x", size), ca.SX.sym("dx", size), ca.SX.sym("t")
    terms = model.terms(x, dx, t)
    out = [terms.distance, terms.normal, terms.by_time, terms.drift]
    return model.joints, ca.Function("terms", [x, dx, t], out)


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
    n = arm.model.nv
    v = np.zeros(n) if velocity is None else velocity
    q, v = arm.onto(program.context.start.copy(), v, 0.0)
    _, J, _, _ = arm.constraint(q, v, 0.0)
    # Before the first tick the arm rests on its constraints without pressing.
    force = low = np.zeros(len(J))
    late = [force] * delay
    rows = []
    for k in range(round(time / T)):
        t = k * T
        _sense(arm, machine, q, v, late[0], t)
        if k == 0:
            machine.start()
        machine.tick(t)
        u = machine.torque.copy()
        total = u if disturbance is None else u + disturbance(t)
        force = -arm.multipliers(q, v, total, t)
        low = pole * low + (1 - pole) * force
        late = [*late[1:], low]
        outputs = {name: value.copy() for name, value in machine.named_outputs().items()}
        rows.append((t, q, v, u, force, outputs))
        q, v = _advance(arm, q, v, total, t, T, substeps)
    columns = [np.array([row[i] for row in rows]) for i in range(5)]
    names = rows[0][5]
    return RigidRun(*columns, {name: np.array([row[5][name] for row in rows]) for name in names})


def _sense(arm, machine, q, v, force, t):
    machine.q[:], machine.v[:] = q, v
    equations = arm.program.context.equations
    machine.reactions[:] = force
    machine.wrench[:] = 0.0
    pin.forwardKinematics(arm.model, arm.data, q)
    pin.updateFramePlacements(arm.model, arm.data)
    p = arm.data.oMf[arm.frame].translation
    for i, (model, (_, terms)) in enumerate(zip(equations.values(), arm.equations, strict=True)):
        if not model.joints:
            normal = np.array(terms(p, np.zeros(3), t)[1]).ravel()
            machine.wrench[:3] -= force[i] * normal


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
