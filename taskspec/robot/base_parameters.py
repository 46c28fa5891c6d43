"""A chain of hinges and slides, its frames and inertias such that its equations are short.

Frames are Khalil and Kleinfinger's (1986): z along the joint's axis, x along the common normal with
the next one, so that a joint's placement in the one before is a turn about x and a shift along it.
Inertias are base parameters (Gautier and Khalil 1990): what of a body the joint under it does not
feel, since it stays the same in the body before however the joint moves, is counted with that body.
Neither changes what the equations are worth.

A body is its pseudo-inertia (Wensing, Kim and Slotine 2018), the 4 x 4 matrix

    P = [Sigma  h; h^T  m],    Sigma = int r r^T dm,    h = int r dm,    m = int dm,

which a homogeneous transform X takes to another frame as X P X^T. A hinge about z does not depend
on the entries of P among z and 1, and a slide does not depend on Sigma.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass

if TYPE_CHECKING:
    import pinocchio as pin

Matrix = NDArray[np.float64]

#: Products of a few rotations are as exact as this; what is nearer to 0 or 1 is meant to be that.
_ROUNDING = 16 * float(np.finfo(float).eps)
#: Axes whose directions differ by less count as parallel: their common normal has no place.
_PARALLEL = 1e-9
#: From this sine of their angle on, the feet of the common normal are used.
_SKEW = 0.1


@dataclass(frozen=True, slots=True)
class ChainJoint:
    """A joint and the body that it moves, in frames whose z is the joint's axis.

    Attributes:
        turns: whether it is a hinge.
        rotation, origin: (3, 3), (3,) its frame in the one before, at q = -offset [m].
        offset: what is added to q [rad].
        body: (4, 4) pseudo-inertia of what it carries, without what it does not depend on.
        armature: inertia of its motor [kg m^2, kg].
    """

    turns: bool
    rotation: Matrix
    origin: Matrix
    offset: float
    body: Matrix
    armature: float


@dataclass(frozen=True, slots=True)
class BaseParameters:
    """An arm from its base to its tip.

    Attributes:
        joints: from the base on.
        tip_rotation, tip_origin: (3, 3), (3,) the tip in the last joint's frame.
        gravity: (3,) of the world [m/s^2].
    """

    joints: tuple[ChainJoint, ...]
    tip_rotation: Matrix
    tip_origin: Matrix
    gravity: Matrix

    @property
    def content(self) -> bytes:
        """All its numbers: two arms that agree in them have the same equations."""
        numbers = [self.tip_rotation, self.tip_origin, self.gravity]
        for joint in self.joints:
            numbers += [joint.rotation, joint.origin, joint.body]
            numbers.append(np.array([joint.turns, joint.offset, joint.armature]))
        return b"".join(np.ascontiguousarray(x, dtype=float).tobytes() for x in numbers)


def base_parameters(model: pin.Model, tip_joint: int, tip: pin.SE3) -> BaseParameters:
    """Reads a chain off Pinocchio's model.

    Args:
        model: hinges and slides, each on the one before; bodies, armatures and gravity.
        tip_joint: the last joint.
        tip: pose of the tip in its frame.

    Raises:
        ValueError: the model branches, goes on behind the tip, or has another kind of joint.
    """
    n = model.njoints - 1
    if list(model.parents)[1:] != list(range(n)) or tip_joint != n:
        raise ValueError("the arm is no chain: each joint has to sit on the one before it")
    kinds = [_axis(model, i + 1) for i in range(n)]
    aligned = [np.eye(4), *(_pose(_to_axis(axis)) for _, axis in kinds), np.eye(4)]
    placements = [np.array(P.homogeneous) for P in [*list(model.jointPlacements)[1:], tip]]
    links = [
        _Link.of(_inverse(aligned[i]) @ placements[i] @ aligned[i + 1], first=i == 0, last=i == n)
        for i in range(n + 1)
    ]
    bodies = [
        _seen(_inverse(aligned[i] @ links[i].before), _pseudo_inertia(model.inertias[i]))
        for i in range(1, n + 1)
    ]
    joints: list[ChainJoint] = []
    for i in reversed(range(n)):
        turns = kinds[i][0]
        screw = links[i].after @ links[i + 1].before
        angle = float(np.arctan2(screw[1, 0], screw[0, 0]))
        X = links[i].normal @ _pose(np.eye(3), screw[:3, 3])
        if not turns:
            X, angle = X @ _pose(_about_z(angle)), 0.0
        unfelt = np.zeros((4, 4))
        part = slice(2, 4) if turns else slice(0, 3)
        unfelt[part, part] = bodies[i][part, part]
        if i:
            bodies[i - 1] += _seen(X, unfelt)
        joints.append(
            ChainJoint(
                turns=turns,
                rotation=_tidy(X[:3, :3]),
                origin=_tidy(X[:3, 3]),
                offset=0.0 if abs(angle) < _ROUNDING else angle,
                body=_tidy_body(bodies[i] - unfelt),
                armature=float(model.armature[i]),
            )
        )
    end = links[n].normal
    return BaseParameters(
        joints=tuple(reversed(joints)),
        tip_rotation=_tidy(end[:3, :3]),
        tip_origin=_tidy(end[:3, 3]),
        gravity=np.array(model.gravity.linear),
    )


@dataclass(frozen=True, slots=True)
class _Link:
    """A placement as the product of three poses (4, 4).

    Attributes:
        before: a screw along the z before, which the joint there takes.
        normal: what is left, which has many zeros.
        after: a screw along the z after, which the joint there takes.
    """

    before: Matrix
    normal: Matrix
    after: Matrix

    @staticmethod
    def of(X: Matrix, *, first: bool, last: bool) -> _Link:
        """Splits a placement; before the first and after the last there is no joint."""
        R, p = X[:3, :3], X[:3, 3]
        before = after = np.eye(4)
        if first:
            after = _pose(_about_z(_sparsest(R)))
        elif last:
            before = _pose(_about_z(-_sparsest(R.T)))
        else:
            before, after = _screws(R, p)
        return _Link(before, _inverse(before) @ X @ _inverse(after), after)


def _screws(R: Matrix, p: Matrix) -> tuple[Matrix, Matrix]:
    """The screws (4, 4) that lead to the common normal of two axes, and from it on.

    With R = Rz(a) Rx(b) Rz(c), the second axis is (sin a sin b, -cos a sin b, cos b).
    """
    sine = float(np.hypot(R[0, 2], R[1, 2]))
    if sine < _PARALLEL:
        a = np.arctan2(p[1], p[0]) if np.hypot(p[0], p[1]) > _ROUNDING else 0.0
        rest = _about_z(-a) @ R
        c, along = np.arctan2(-rest[0, 1], rest[0, 0]), 0.0
    else:
        a, c = np.arctan2(R[0, 2], -R[1, 2]), np.arctan2(R[2, 0], R[2, 1])
        along = -float((_about_z(-a) @ p)[1]) / sine if sine > _SKEW else 0.0
    up_to_normal = np.array([0.0, 0.0, p[2] - along * R[2, 2]])
    return _pose(_about_z(a), up_to_normal), _pose(_about_z(c), np.array([0.0, 0.0, along]))


def _sparsest(R: Matrix) -> float:
    """The angle about its z by which R (3, 3) is to be turned back so that most entries are 0."""
    angles = [0.0]
    for x, y, _ in R:
        if max(abs(x), abs(y)) > _ROUNDING:
            angles += [float(np.arctan2(x, y)), float(np.arctan2(-y, x))]
    return max(angles, key=lambda angle: int(np.sum(_tidy(R @ _about_z(-angle)) == 0.0)))


def _axis(model: pin.Model, i: int) -> tuple[bool, Matrix]:
    """Whether joint `i` is a hinge, and its unit axis (3,) in its own frame."""
    joint = model.joints[i].extract()
    kind = type(joint).__name__
    if kind not in ("JointModelRevoluteUnaligned", "JointModelPrismaticUnaligned"):
        raise ValueError(f"joint {model.names[i]!r} is neither a hinge nor a slide but a {kind}")
    axis = np.array(joint.axis)
    return kind == "JointModelRevoluteUnaligned", axis / np.linalg.norm(axis)


def _to_axis(axis: Matrix) -> Matrix:
    """(3, 3) a rotation that takes z to `axis`."""
    least = np.eye(3)[int(np.argmin(np.abs(axis)))]
    y = np.cross(axis, least)
    y /= np.linalg.norm(y)
    return np.column_stack([np.cross(y, axis), y, axis])


def _about_z(angle: float) -> Matrix:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _pose(R: Matrix, p: Matrix | None = None) -> Matrix:
    X = np.eye(4)
    X[:3, :3] = R
    if p is not None:
        X[:3, 3] = p
    return X


def _inverse(X: Matrix) -> Matrix:
    R = X[:3, :3]
    return _pose(R.T, -R.T @ X[:3, 3])


def _pseudo_inertia(Y: pin.Inertia) -> Matrix:
    """(4, 4) of a body about its frame's origin."""
    m, c, about = float(Y.mass), np.array(Y.lever), np.array(Y.inertia)
    P = np.empty((4, 4))
    P[:3, :3] = np.trace(about) / 2 * np.eye(3) - about + m * np.outer(c, c)
    P[:3, 3] = P[3, :3] = m * c
    P[3, 3] = m
    return P


def _seen(X: Matrix, P: Matrix) -> Matrix:
    """A pseudo-inertia in another frame, in which its own has the pose X."""
    return np.asarray(X @ P @ X.T)


def _tidy(x: Matrix) -> Matrix:
    """Entries that rounding alone keeps from 0, 1 or -1, made that."""
    tidy = np.array(x)
    for value in (0.0, 1.0, -1.0):
        tidy[np.abs(tidy - value) < _ROUNDING] = value
    return tidy


def _tidy_body(P: Matrix) -> Matrix:
    """A pseudo-inertia without those entries of its moments that are rounding."""
    tidy = np.array(P)
    second, first = tidy[:3, :3], tidy[:3, 3]
    second[np.abs(second) < _ROUNDING * np.abs(second).max()] = 0.0
    first[np.abs(first) < _ROUNDING * np.abs(first).max()] = 0.0
    tidy[3, :3] = first
    return tidy
