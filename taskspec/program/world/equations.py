"""Constraint equations of the world as functions: one source for controller, checks and plant.

Whatever the scale of r, forces and distances are taken along its unit gradient n = r_x / |r_x|, so
that a set point is in newtons and the distance r / |r_x| in metres. On joints n is a direction of
joint space, the force a moment, and the distance an angle.

Where r depends on the tip's rotation, r_x is its derivative along twists (v; w) of the tip in the
world. Its two parts have different units, and no length joins them that the file has not stated: if
r depends on the tip's place too, |r_x| is the length of the first part alone. The distance is then
that along the place with the rotation as it is, the force that along the same line, and the moment
about the tip is this force times the second part over the first. Of an r of rotations alone |r_x|
is the length of the second part; distance and force are an angle and a moment.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.expression.tree import Name, walk
from taskspec.geometry import rotation as so3
from taskspec.geometry.axis import ROTATIONS, TRANSLATIONS
from taskspec.program.algebra import CasadiAlgebra, constants
from taskspec.program.world import tip_pose
from taskspec.program.world.frames import FrameModel, resolve
from taskspec.robot import RobotModel
from taskspec.robot.rigid_body import rigid_body
from taskspec.spec import Constraint, Task

Vector = NDArray[np.float64]

#: Keeps the unit gradient finite where the gradient vanishes.
_SQUARED_GRADIENT_FLOOR = 1e-30
#: A gradient that turns by less than this is one of a flat surface [rad].
_FLAT = 1e-3
#: A gradient that turns by more than this per radian of a turn is singular: at 3 deg from there.
_TURNED_OVER = 20.0
#: Directions across a gradient, and turns into each of them, in which it is sampled.
_TANGENTS, _ANGLES = 12, 9


@dataclass(frozen=True, slots=True)
class EquationModel:
    """r(place, clock) = 0, or one side of it.

    Attributes:
        name: of the object.
        constraint: as the file states it.
        rotation, origin: (3, 3), (3,) of the frame in which x, y, z, rx, ry and rz count.
        params: numbers that it may use.
        axes: (3, 3) of each other fixed frame, whose axes it may name.

    Its place is the (n,) joint positions, the (3,) tip in the world, or if it `turns` the (12,)
    pose of the tip as `tip_pose` has it, whose rate is a twist.
    """

    name: str
    constraint: Constraint
    rotation: NDArray[np.float64]
    origin: NDArray[np.float64]
    params: dict[str, float]
    axes: Mapping[str, NDArray[np.float64]]

    @property
    def joints(self) -> bool:
        """Whether its place is a configuration of the joints."""
        return self.constraint.joints

    @property
    def moves(self) -> bool:
        """Whether it changes with time."""
        nodes = walk(self.constraint.residual.tree)
        return any(isinstance(node, Name) and node.path == ("clock",) for node in nodes)

    @property
    def turns(self) -> bool:
        """Whether its place is a pose of the tip."""
        return self.constraint.turns

    @property
    def angular(self) -> bool:
        """Whether its distance is an angle [rad], and its force a moment [N m]."""
        return self.constraint.angular

    @property
    def on(self) -> slice:
        """Of the rows of the tip's Jacobian those that its unit gradient multiplies."""
        return slice(0, 6 if self.turns else 3)

    def place(self, q: ca.SX, p: ca.SX, R: ca.SX) -> ca.SX:
        """Its place, of joints q (n,) and a tip at p (3,) with axes R (3, 3)."""
        if self.joints:
            return q
        return tip_pose.pose(p, R) if self.turns else p

    def rate(self, v: ca.SX, twist: ca.SX) -> ca.SX:
        """The rate of its place, of joints that move with v (n,) and a tip with a twist (6,)."""
        return v if self.joints else twist[self.on]

    def residual(self, place: ca.SX, clock: ca.SX) -> ca.SX:
        """r, left minus right, at a place (3,), (12,) or (n,) and time [s]."""
        algebra = CasadiAlgebra(None, 0.0)
        known = {**constants(self.params), "clock": clock}
        if self.joints:
            known |= {f"q{i + 1}": place[i] for i in range(place.shape[0])}
        else:
            local = ca.DM(self.rotation.T) @ (place[:3] - ca.DM(self.origin))
            known |= {axis: local[i] for i, axis in enumerate(TRANSLATIONS)}
        axes = {name: ca.SX(ca.DM(R)) for name, R in self.axes.items()}
        if self.turns:
            axes["tool"] = tip_pose.axes(place)
            turned = so3.log(ca.DM(self.rotation.T) @ axes["tool"])
            known |= {axis: turned[i] for i, axis in enumerate(ROTATIONS)}

        def lookup(name: Name) -> ca.SX:
            head, *axis = name.path
            return axes[head][:, "xyz".index(axis[0])] if axis else known[head]

        return algebra.translate(self.constraint.residual, lookup)

    def terms(self, place: ca.SX, clock: ca.SX, rate: ca.SX | None = None) -> EquationTerms:
        """What control and plant need of it, (4.125)-(4.128).

        Args:
            place: as `place` has it.
            clock: time [s].
            rate: of the place, as `rate` has it; None at rest.
        """
        rate = ca.SX.zeros(6 if self.turns else place.shape[0]) if rate is None else rate
        x, t = ca.SX.sym("x", place.shape[0]), ca.SX.sym("t")
        dx = ca.SX.sym("dx", rate.shape[0])
        r = self.residual(x, t)
        r_x = tip_pose.jacobian(r, x) if self.turns else ca.jacobian(r, x)
        r_t = ca.jacobian(r, t)
        along = ca.vertcat(tip_pose.rate(x, dx) if self.turns else dx, 1)
        # The second derivative along (x', 1) holds the mixed term twice.
        drift = ca.jtimes(ca.jtimes(r, ca.vertcat(x, t), along), ca.vertcat(x, t), along)
        found = ca.Function("terms", [x, dx, t], [r, r_x, r_t, drift])
        value, gradient, by_time, bend = found(place, rate, clock)
        measured = gradient if self.joints else gradient[3 if self.angular else 0 :][:3]
        scale = ca.sqrt(ca.sumsqr(measured) + _SQUARED_GRADIENT_FLOOR)
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
        p, R = (q, q) if self.joints else rigid_body(robot).tip(q)
        place = self.place(q, p, R)
        at = self.terms(place, clock)
        J = ca.jacobian(self.residual(place, clock), q) / at.scale
        return ca.Function("on_joints", [q, clock], [at.distance, ca.densify(J)])

    def unit_normal(self, place: ca.SX) -> NDArray[np.float64]:
        """(3,), (6,) or (n,) unit gradient at a place of numbers when the task begins."""
        return np.array(ca.evalf(self.terms(place, ca.SX(0)).normal)).ravel()

    def turning(self, terms: EquationTerms, place: ca.SX) -> ca.SX:
        """(d, d) change of the unit gradient with the place, of terms at these symbols."""
        along = tip_pose.jacobian if self.turns else ca.jacobian
        return along(terms.normal.T, place)


@dataclass(frozen=True, slots=True)
class EquationTerms:
    """An equation at an instant, divided by the length of its gradient.

    Attributes:
        distance: r / |r_x| [m, rad], to first order the distance from the constraint.
        normal: (1, d) r_x / |r_x|; of a tip that turns also along its rotation [m/rad].
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
    axes = {name: frame.rotation for name, frame in frames.items()}
    found = {}
    for name, declared in task.equations.items():
        frame = frames[declared.frame or "world"]
        found[name] = EquationModel(
            name, declared.equation, frame.rotation, frame.origin, params, axes
        )
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
        rate: of the place.
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
        gradient: (3,) unit gradient at the tip, world axes; None of an equation that is not on the
            tip's place alone.
        bend: (3, 3) its change with the tip's place [1/m].
        singular: the gradient of one on the tip's rotation turns over with the slightest turn.
    """

    distance: float
    normal: NDArray[np.float64]
    rate: float
    scale: float
    gradient: NDArray[np.float64] | None
    bend: NDArray[np.float64] | None = None
    singular: bool = False

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


def at_start(model: EquationModel, start: Vector, p: Vector, R: Vector, J: Vector) -> StartEquation:
    """An equation at the start pose.

    Args:
        model: the equation.
        start: (n,) joints.
        p, R: (3,), (3, 3) pose of the tip.
        J: (6, n) its Jacobian.
    """
    at = ca.evalf(model.place(ca.SX(start), ca.SX(p), ca.SX(R)))
    place = ca.SX.sym("place", at.shape[0])
    terms = model.terms(place, ca.SX(0))
    found = ca.Function(
        "at_start",
        [place],
        [
            *(terms.distance, terms.normal, -terms.by_time, terms.scale),
            model.turning(terms, place),
        ],
    )
    distance, unit, rate, scale, bend = found(at)
    normal = np.array(unit).ravel()
    on_place = not (model.joints or model.turns)
    turnover = np.array(bend)[3:, 3:] if model.turns else np.zeros(1)
    return StartEquation(
        distance=float(distance),
        normal=normal if model.joints else normal @ J[model.on],
        rate=float(rate),
        scale=float(scale),
        gradient=normal if on_place else None,
        bend=np.array(bend) if on_place else None,
        singular=float(np.abs(turnover).max()) > _TURNED_OVER * float(np.abs(normal).max()),
    )
