"""Constraint equations of the world as functions: one source for controller, checks and plant.

Whatever the scale of r, forces and distances are taken along its unit gradient n = r_x / |r_x|, so
that a set point is in newtons and the distance r / |r_x| in metres. On joints n is a direction of
joint space, the force a moment, and the distance an angle.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.expression.tree import Name, walk
from taskspec.program.algebra import CasadiAlgebra, constants
from taskspec.program.world.frames import FrameModel, resolve
from taskspec.robot import RobotModel
from taskspec.robot.rigid_body import rigid_body
from taskspec.spec import Constraint, Task

Vector = NDArray[np.float64]

#: Keeps the unit gradient finite where the gradient vanishes.
_SQUARED_GRADIENT_FLOOR = 1e-30
#: A gradient that turns by less than this is one of a flat surface [rad].
_FLAT = 1e-3
#: Directions across a gradient, and turns into each of them, in which it is sampled.
_TANGENTS, _ANGLES = 12, 9


@dataclass(frozen=True, slots=True)
class EquationModel:
    """r(place, clock) = 0, or one side of it.

    Attributes:
        name: of the object.
        constraint: as the file states it.
        joints: (n,) joint positions are its place, else the (3,) tool tip in the world.
        rotation, origin: (3, 3), (3,) of the frame in which x, y and z count.
        params: numbers that it may use.
    """

    name: str
    constraint: Constraint
    rotation: NDArray[np.float64]
    origin: NDArray[np.float64]
    params: dict[str, float]

    @property
    def joints(self) -> bool:
        """Whether its place is a configuration of the joints."""
        return self.constraint.joints

    @property
    def moves(self) -> bool:
        """Whether it changes with time."""
        nodes = walk(self.constraint.residual.tree)
        return any(isinstance(node, Name) and node.path == ("clock",) for node in nodes)

    def residual(self, place: ca.SX, clock: ca.SX) -> ca.SX:
        """r, left minus right, at a place (3,) or (n,) and time [s]."""
        algebra = CasadiAlgebra(None, 0.0)
        known = {**constants(self.params), "clock": clock}
        if self.joints:
            known |= {f"q{i + 1}": place[i] for i in range(place.shape[0])}
        else:
            local = ca.DM(self.rotation.T) @ (place - ca.DM(self.origin))
            known |= {axis: local[i] for i, axis in enumerate("xyz")}

        def lookup(name: Name) -> ca.SX:
            return known[name.path[0]]

        return algebra.translate(self.constraint.residual, lookup)

    def terms(self, place: ca.SX, rate: ca.SX, clock: ca.SX) -> EquationTerms:
        """What control and plant need of it at a place that changes at `rate`, (4.125)-(4.128)."""
        x, t = ca.SX.sym("x", place.shape[0]), ca.SX.sym("t")
        dx = ca.SX.sym("dx", place.shape[0])
        r = self.residual(x, t)
        r_x, r_t = ca.jacobian(r, x), ca.jacobian(r, t)
        along = ca.vertcat(dx, 1)
        # The second derivative along (x', 1) holds the mixed term twice.
        drift = ca.jtimes(ca.jtimes(r, ca.vertcat(x, t), along), ca.vertcat(x, t), along)
        found = ca.Function("terms", [x, dx, t], [r, r_x, r_t, drift])
        value, gradient, by_time, bend = found(place, rate, clock)
        scale = ca.sqrt(ca.sumsqr(gradient) + _SQUARED_GRADIENT_FLOOR)
        return EquationTerms(
            distance=value / scale,
            normal=gradient / scale,
            by_time=by_time / scale,
            drift=bend / scale,
            scale=scale,
        )

    def on_joints(self, robot: RobotModel) -> ca.Function:
        """(q, clock) -> the distance at joint positions q (n,), and the row J_phi (1, n) there.

        Of an equation on the tip, J_phi is its unit gradient times the Jacobian of the tip.
        """
        q, clock = ca.SX.sym("q", robot.n), ca.SX.sym("clock")
        place = q if self.joints else rigid_body(robot).tip(q)[0]
        at = self.terms(place, ca.SX.zeros(place.shape[0]), clock)
        J = at.normal if self.joints else at.normal @ ca.jacobian(place, q)
        return ca.Function("on_joints", [q, clock], [at.distance, ca.densify(J)])

    def unit_normal(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """(3,) or (n,) gradient at a place when the task begins, divided by its length."""
        terms = self.terms(ca.SX(ca.DM(place)), ca.SX.zeros(len(place)), ca.SX(0))
        return np.array(ca.evalf(terms.normal)).ravel()


@dataclass(frozen=True, slots=True)
class EquationTerms:
    """An equation at an instant, divided by the length of its gradient.

    Attributes:
        distance: r / |r_x| [m, rad], to first order the distance from the constraint.
        normal: (1, d) r_x / |r_x|.
        by_time: r_t / |r_x| [m/s, rad/s].
        drift: (x'^T r_xx x' + 2 r_xt x' + r_tt) / |r_x|, without the curvature of the path from
            the joints to the place [m/s^2, rad/s^2].
        scale: |r_x|: the multiplier of r itself is the force divided by it.
    """

    distance: ca.SX
    normal: ca.SX
    by_time: ca.SX
    drift: ca.SX
    scale: ca.SX


def equation_models(
    task: Task, frames: dict[str, FrameModel] | None = None
) -> dict[str, EquationModel]:
    """All equations of a task, by name; their frames are known to be fixed."""
    frames = resolve(task) if frames is None else frames
    params = {name: quantity.value for name, quantity in task.params.items()}
    found = {}
    for name, declared in task.equations.items():
        frame = frames[declared.frame or "world"]
        found[name] = EquationModel(name, declared.equation, frame.rotation, frame.origin, params)
    return found


def reaction(
    model: EquationModel,
    terms: EquationTerms,
    rate: ca.SX,
    stiffness: float | ca.SX,
    damping: float | ca.SX,
) -> ca.SX:
    """The force of the robot on a compliant constraint along the unit gradient [N, N m].

    k distance + b d(distance)/dt; under `<=` and `>=` it never pulls, and is zero where the
    relation holds.

    Args:
        model: the equation.
        terms: at the place.
        rate: of the place (3,) or (n,).
        stiffness, damping: of the constraint.
    """
    closing = terms.normal @ rate + terms.by_time
    force = stiffness * terms.distance + damping * closing
    relation = model.constraint.relation
    if relation == "<=":
        return ca.if_else(terms.distance > 0, ca.fmax(force, 0), 0)
    if relation == ">=":
        return ca.if_else(terms.distance < 0, ca.fmin(force, 0), 0)
    return force


@dataclass(frozen=True, slots=True)
class StartEquation:
    """An equation at the start pose.

    Attributes:
        distance: r / |r_x| [m, rad].
        normal: (n,) unit normal on the joints' rates.
        rate: at which it moves away by itself, -r_t / |r_x| [m/s, rad/s].
        scale: |r_x|.
        gradient: (3,) unit gradient at the tip, world axes; None of an equation on joints.
        bend: (3, 3) its change with the tip's place [1/m].
    """

    distance: float
    normal: NDArray[np.float64]
    rate: float
    scale: float
    gradient: NDArray[np.float64] | None
    bend: NDArray[np.float64] | None = None

    def gradients_within(self, distance: float) -> NDArray[np.float64]:
        """(3, k) unit gradients at the tip of a curved equation within a distance [m].

        Those of a surface of the same curvature: along each tangent t the gradient turns by
        |bend t| per metre, to a right angle at most, beyond which its lines come again.
        """
        assert self.gradient is not None
        assert self.bend is not None
        found = [self.gradient]
        tangents = np.linalg.svd(self.gradient[None, :])[2][1:]
        for phi in np.linspace(0.0, np.pi, _TANGENTS, endpoint=False):
            turns = self.bend @ (np.cos(phi) * tangents[0] + np.sin(phi) * tangents[1])
            rate = float(np.linalg.norm(turns))
            if rate * distance < _FLAT:
                continue
            most = min(np.pi / 2, rate * distance)
            angles = np.linspace(-most, most, _ANGLES)[:, None]
            found.extend(np.cos(angles) * self.gradient + np.sin(angles) * turns / rate)
        return np.array(found).T


def at_start(model: EquationModel, start: Vector, p: Vector, J: Vector) -> StartEquation:
    """An equation at the start pose: joints `start` (n,), tip at p (3,) with Jacobian J (6, n)."""
    at = start if model.joints else p
    place = ca.SX.sym("place", len(at))
    terms = model.terms(place, ca.SX.zeros(len(at)), ca.SX(0))
    found = ca.Function(
        "at_start",
        [place],
        [
            *(terms.distance, terms.normal, -terms.by_time, terms.scale),
            ca.jacobian(terms.normal, place),
        ],
    )
    distance, unit, rate, scale, bend = found(at)
    normal = np.array(unit).ravel()
    return StartEquation(
        distance=float(distance),
        normal=normal if model.joints else normal @ J[:3],
        rate=float(rate),
        scale=float(scale),
        gradient=None if model.joints else normal,
        bend=None if model.joints else np.array(bend),
    )
