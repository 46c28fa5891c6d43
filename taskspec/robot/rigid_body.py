"""The dynamics of an arm as expressions of q and q': H, C q' + g, g, and its tip's motion.

The recursions are those of the textbooks, in the frames and with the bodies of `base_parameters`:

- C q' by Newton and Euler's equations, out to the tip and back (Luh, Walker and Paul 1980);
- H and g from what each joint carries as one body (Walker and Orin 1982);
- J and J' q' from the axes, and from how the last frame accelerates at q'' = 0.

With w a frame's angular velocity, a the acceleration of its origin, both in its own axes, and

    U = [w']_x + [w]_x [w]_x,

a point r of its body accelerates by a + U r, so that a body of the pseudo-inertia [Sigma h; h^T m]
takes the force and the moment about the origin

    f = U h + m a,    n = vee(U Sigma - Sigma U^T) + h x a.

CasADi folds the zeros and ones of the constants as the expressions are made; what is left for a
7-joint arm is some 1450 instructions.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.robot.base_parameters import ChainJoint, base_parameters
from taskspec.robot.model_terms import TermSymbols, loaded
from taskspec.robot.types import RobotModel
from taskspec.store import Store, sources

Matrix = NDArray[np.float64]

#: Of so many arms the compiled terms are kept: runs of a sweep have the same.
_KEPT = 8


class RigidBody:
    """An arm's model terms as expressions, for a chain of hinges and slides.

    Placements, axes, inertias of links, tool and load, armatures, gravity and the pose of the base
    are those of Pinocchio's model, by which the robot is judged.
    """

    def __init__(self, robot: RobotModel) -> None:
        """Reads the model.

        Raises:
            ValueError: it is no chain of hinges and slides.
        """
        self._chain = base_parameters(robot.pin, robot.tip_joint, robot.tip)
        self._coupling = robot.coupling
        self._content = self._chain.content + robot.coupling.content

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RigidBody) and self._content == other._content

    def __hash__(self) -> int:
        return hash(self._content)

    def terms(self, q: ca.SX, v: ca.SX) -> TermSymbols:
        """The model terms at joint positions q (n,) [rad, m] and velocities v (n,) [rad/s, m/s].

        Returns:
            Expressions, of which `vectors` fill what `model_terms.symbols` leaves open.
        """
        if self._coupling.couples:
            return self._coupled(q, v)
        return self._of_joints(q, v)

    def tip(self, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """(3,), (3, 3) the tip in the world at joint positions q (n,) [rad, m]."""
        if self._coupling.couples:
            q = ca.sparsify(ca.DM(self._coupling.ratios)) @ q + ca.DM(self._coupling.offsets)
        return self._tip(_poses([_Moved(j, q[i]) for i, j in enumerate(self._chain.joints)]))

    def _tip(self, poses: Sequence[tuple[ca.SX, ca.SX]]) -> tuple[ca.SX, ca.SX]:
        """The tip in the world, by the poses of the joints' frames there."""
        R, p = poses[-1]
        tip_rotation = ca.sparsify(ca.DM(self._chain.tip_rotation))
        return p + R @ self._chain.tip_origin, R @ tip_rotation

    def _coupled(self, x: ca.SX, v: ca.SX) -> TermSymbols:
        """The model terms of the coordinates that are left, of those of all joints."""
        A, b = ca.sparsify(ca.DM(self._coupling.ratios)), ca.DM(self._coupling.offsets)
        whole = self._of_joints(A @ x + b, A @ v)
        return replace(
            whole,
            H=A.T @ whole.H @ A,
            bias=A.T @ whole.bias,
            gravity=A.T @ whole.gravity,
            J=whole.J @ A,
        )

    def _of_joints(self, q: ca.SX, v: ca.SX) -> TermSymbols:
        """The model terms of all joints, as if each moved by itself."""
        chain = self._chain
        moved = [_Moved(joint, q[i]) for i, joint in enumerate(chain.joints)]
        poses, motions = _poses(moved), _motions(moved, v)
        R_last, (p, R) = poses[-1][0], self._tip(poses)
        H, gravity = _composite(moved, poses, chain.gravity)
        J = _jacobian(moved, poses, p)
        last = motions[-1]
        return TermSymbols(
            inputs=(),
            H=H,
            bias=_coriolis(moved, motions) + gravity,
            gravity=gravity,
            p=p,
            R=R,
            J=J,
            drift=ca.vertcat(R_last @ (last.a + last.U @ chain.tip_origin), R_last @ last.dw),
            twist=J @ v,
        )

    @property
    def function(self) -> ca.Function:
        """(q, v) -> the vectors of `ModelTerms.arrays`; made once for arms that are alike."""
        return _function(self)

    @property
    def loaded_function(self) -> ca.Function:
        """(q, v, mass) -> the same of an arm that carries a point mass at its tip."""
        return _loaded_function(self)


@lru_cache(maxsize=_KEPT)
def rigid_body(robot: RobotModel) -> RigidBody:
    """A robot's rigid bodies; read once of each.

    Raises:
        ValueError: it is no chain of hinges and slides.
    """
    return RigidBody(robot)


@lru_cache(maxsize=_KEPT)
def _function(body: RigidBody) -> ca.Function:
    """The function, by what it follows from kept from run to run."""
    made = f"casadi {ca.CasadiMeta.version()} {sources(Path(__file__).parent)}"
    key, store = f"{made}\n{body._content.hex()}", Store.named("terms")
    kept = store.get(key)
    if kept is not None:
        # What CasADi does not read all the same is made anew.
        with suppress(Exception):
            return ca.Function.deserialize(kept.decode("ascii"))
    function = _written(body)
    store.put(key, function.serialize().encode("ascii"))
    return function


def _written(body: RigidBody) -> ca.Function:
    n = body._coupling.n
    q, v = ca.SX.sym("q", n), ca.SX.sym("v", n)
    return ca.Function("terms", [q, v], list(body.terms(q, v).vectors()), {"cse": True})


@lru_cache(maxsize=_KEPT)
def _loaded_function(body: RigidBody) -> ca.Function:
    n = body._coupling.n
    q, v, mass = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("load")
    terms = loaded(body.terms(q, v), mass)
    return ca.Function("loaded_terms", [q, v, mass], list(terms.vectors()), {"cse": True})


class _Moved:
    """A joint at its q: how vectors and bodies of its frame look in the frame before.

    A turn is the product of a constant one, of entries that are mostly 0 or 1, and of one about z.

    Attributes:
        joint: the joint.
        origin: (3,) its frame's origin in the frame before.
    """

    def __init__(self, joint: ChainJoint, q: ca.SX) -> None:
        """Takes a joint and its q, to which the offset is added here."""
        self.joint = joint
        self._K = K = ca.sparsify(ca.DM(joint.rotation))
        self._turn = ca.SX(ca.DM.eye(3))
        self.origin = ca.SX(ca.DM(joint.origin))
        q = q + joint.offset
        if joint.turns:
            c, s = ca.cos(q), ca.sin(q)
            self._turn = ca.sparsify(ca.blockcat([[c, -s, 0], [s, c, 0], [0, 0, 1]]))
        else:
            self.origin = self.origin + K[:, 2] * q

    def out(self, x: ca.SX) -> ca.SX:
        """(3,) in this frame's axes, of a vector in those before."""
        return self._turn.T @ (self._K.T @ x)

    def back(self, x: ca.SX) -> ca.SX:
        """(3,) in the axes before, of a vector in this frame's."""
        return self._K @ (self._turn @ x)

    def rotation_after(self, R: ca.SX) -> ca.SX:
        """(3, 3) this frame in the world, of the one before."""
        return R @ self._K @ self._turn

    def wrench_back(self, f: ca.SX, n: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Force, and moment about the origin of the frame before, of those of this frame."""
        f = self.back(f)
        return f, self.back(n) + ca.cross(self.origin, f)

    def body_back(self, P: ca.SX) -> ca.SX:
        """(4, 4) pseudo-inertia in the frame before, of one in this frame."""
        if self.joint.turns:
            turned = _congruent(ca.diagcat(self._turn, 1), P)
            # The trace of Sigma stays, and so does its z z.
            turned[1, 1] = P[0, 0] + P[1, 1] - turned[0, 0]
            P = turned
        X = ca.SX.eye(4)
        X[:3, :3], X[:3, 3] = self._K, self.origin
        return _congruent(X, P)


def _congruent(X: ca.SX, P: ca.SX) -> ca.SX:
    """X P X^T of a symmetric P."""
    return ca.triu2symm(ca.triu(X @ P @ X.T))


def _poses(moved: list[_Moved]) -> list[tuple[ca.SX, ca.SX]]:
    """(3, 3), (3,) of each joint's frame in the world."""
    R, p, poses = ca.SX(ca.DM.eye(3)), ca.SX.zeros(3), []
    for joint in moved:
        p = p + R @ joint.origin
        R = joint.rotation_after(R)
        poses.append((R, p))
    return poses


class _Motion:
    """Motion of a frame at q'' = 0, in its own axes.

    Attributes:
        w, dw: (3,) angular velocity and acceleration.
        a: (3,) acceleration of its origin.
        U: (3, 3) [w']_x + [w]_x [w]_x.
        spread: (3,) U_zz - U_yy, U_xx - U_zz, U_yy - U_xx.
    """

    def __init__(self, w: ca.SX, dw: ca.SX, a: ca.SX) -> None:
        """From velocity and accelerations."""
        self.w, self.dw, self.a = w, dw, a
        (x, y, z), (dx, dy, dz) = ca.vertsplit(w), ca.vertsplit(dw)
        xx, yy, zz, xy, xz, yz = x * x, y * y, z * z, x * y, x * z, y * z
        columns = (
            *(-(yy + zz), xy + dz, xz - dy),
            *(xy - dz, -(xx + zz), yz + dx),
            *(xz + dy, yz - dx, -(xx + yy)),
        )
        self.U = ca.reshape(ca.vertcat(*columns), 3, 3)
        self.spread = ca.vertcat(zz - yy, xx - zz, yy - xx)


def _motions(moved: list[_Moved], v: ca.SX) -> list[_Motion]:
    """Of each joint's frame, from the base outwards.

    A hinge adds z q' to w and w x z q' to w'; a slide adds 2 w x z q' to the acceleration.
    """
    rest = ca.SX.zeros(3)
    motion, motions = _Motion(rest, rest, rest), []
    for i, joint in enumerate(moved):
        w, dw = joint.out(motion.w), joint.out(motion.dw)
        a = joint.out(motion.a + motion.U @ joint.origin)
        sideways = ca.vertcat(w[1], -w[0], 0) * v[i]
        if joint.joint.turns:
            w, dw = w + ca.vertcat(0, 0, v[i]), dw + sideways
        else:
            a = a + 2 * sideways
        motion = _Motion(w, dw, a)
        motions.append(motion)
    return motions


def _coriolis(moved: list[_Moved], motions: list[_Motion]) -> ca.SX:
    """C q' (n,): what the joints have to bear of the bodies' forces, from the tip back."""
    f, n, borne = ca.SX.zeros(3), ca.SX.zeros(3), []
    for joint, motion in zip(reversed(moved), reversed(motions), strict=True):
        own_f, own_n = _of_motion(joint.joint.body, motion)
        f, n = f + own_f, n + own_n
        borne.append(n[2] if joint.joint.turns else f[2])
        f, n = joint.wrench_back(f, n)
    return ca.vertcat(*reversed(borne))


def _of_motion(P: Matrix, motion: _Motion) -> tuple[ca.SX, ca.SX]:
    """Force and moment about the frame's origin that move a body (4, 4) as its frame."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = P[:3, :3]
    x, y, z = P[:3, 3]
    # The moment by U, column after column, by its spread and by a.
    by_U = [
        [0, -xz, xy, 0, 0, yy, 0, -zz, 0],
        [0, 0, -xx, yz, 0, -xy, zz, 0, 0],
        [0, xx, 0, -yy, 0, 0, -yz, xz, 0],
    ]
    by_spread = [[yz, 0, 0], [0, xz, 0], [0, 0, xy]]
    by_a = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    moment = ca.sparsify(ca.DM(np.hstack([by_U, by_spread, by_a])))
    n = moment @ ca.vertcat(ca.vec(motion.U), motion.spread, motion.a)
    return motion.U @ ca.DM([x, y, z]) + float(P[3, 3]) * motion.a, n


def _composite(
    moved: list[_Moved], poses: list[tuple[ca.SX, ca.SX]], gravity: Matrix
) -> tuple[ca.SX, ca.SX]:
    """H (n, n) and g (n,), from all that each joint carries as one body.

    Column k of H is what the joints up to k bear when k alone accelerates by 1; g is what they bear
    when the base accelerates against gravity.
    """
    n, size = len(moved), float(np.linalg.norm(gravity))
    H, g = ca.SX.zeros(n, n), ca.SX.zeros(n)
    up = -gravity / size if size else gravity
    P = ca.SX.zeros(4, 4)
    for k in reversed(range(n)):
        joint = moved[k].joint
        P = P + ca.DM(joint.body)
        h, m = P[:3, 3], P[3, 3]
        upward = poses[k][0].T @ up
        if joint.turns:
            f = ca.vertcat(-h[1], h[0], 0)
            moment = ca.vertcat(-P[0, 2], -P[1, 2], P[0, 0] + P[1, 1])
            g[k] = size * (h[0] * upward[1] - h[1] * upward[0])
        else:
            f, moment = ca.vertcat(0, 0, m), ca.vertcat(h[1], -h[0], 0)
            g[k] = size * (m * upward[2])
        H[k, k] = (moment if joint.turns else f)[2] + joint.armature
        for j in reversed(range(k)):
            f, moment = moved[j + 1].wrench_back(f, moment)
            H[j, k] = H[k, j] = (moment if moved[j].joint.turns else f)[2]
        P = moved[k].body_back(P)
    return H, g


def _jacobian(moved: list[_Moved], poses: list[tuple[ca.SX, ca.SX]], p: ca.SX) -> ca.SX:
    """(6, n) of a point p (3,), world axes: z x (p - p_i) above z of a hinge, z above 0 else."""
    columns = []
    for joint, (R, origin) in zip(moved, poses, strict=True):
        z = R[:, 2]
        turns = joint.joint.turns
        columns.append(ca.vertcat(ca.cross(z, p - origin), z) if turns else ca.vertcat(z, 0, 0, 0))
    return ca.densify(ca.horzcat(*columns))
