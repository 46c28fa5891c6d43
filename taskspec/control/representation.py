"""Minimal representations of orientation: Euler angles phi_e and their rates.

Of R (3, 3), the orientation of the tool in its task frame:

    rpy:  R = Rz(yaw) Ry(pitch) Rx(roll),   phi_e = (roll, pitch, yaw)
    zyz:  R = Rz(phi) Ry(theta) Rz(psi),    phi_e = (phi, theta, psi)

    w = T_e(phi_e) phi_e',  J_a = T_e^-1(phi_e) J,  f_a = T_e^T(phi_e) f

on the rotational rows, with w and f in the axes of the task frame. |det T_e| is |cos(pitch)| for
rpy and |sin(theta)| for zyz. Where it is zero two of the three axes coincide, and no rates
represent a turn about the axis that is missing: the representation is singular there, not the arm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca

from taskspec.control.reference import Reference
from taskspec.control.state import TaskState
from taskspec.deferred_methods import dataclass
from taskspec.geometry import rotation
from taskspec.geometry.axis import AXES


@dataclass(frozen=True, slots=True)
class Representation:
    """One set of Euler angles; angles (3,) [rad], angular velocities (3,) in frame axes [rad/s].

    Attributes:
        name: as in a task file.
        names: of the three angles.
        angles: phi_e of R (3, 3).
        matrix: R (3, 3) of phi_e.
        rates: T_e (3, 3) of phi_e.
        inverse: T_e^-1 (3, 3) of phi_e, in closed form.
        regularity: |det T_e| of phi_e, 0 at the singularity and at most 1.
    """

    name: str
    names: tuple[str, str, str]
    angles: Callable[[ca.SX], ca.SX]
    matrix: Callable[[ca.SX], ca.SX]
    rates: Callable[[ca.SX], ca.SX]
    inverse: Callable[[ca.SX], ca.SX]
    regularity: Callable[[ca.SX], ca.SX]

    def inverse_rate(self, phi: ca.SX, phi_rate: ca.SX) -> ca.SX:
        """d/dt T_e^-1 (3, 3) while phi_e (3,) changes at phi_e' (3,)."""
        at, along = ca.SX.sym("phi", 3), ca.SX.sym("rate", 3)
        slope = ca.jtimes(ca.vec(self.inverse(at)), at, along)
        return ca.Function("slope", [at, along], [ca.reshape(slope, 3, 3)])(phi, phi_rate)


def _about(axis: int, angle: ca.SX) -> ca.SX:
    """Rotation (3, 3) by an angle about coordinate axis 0, 1 or 2."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = ca.SX.eye(3)
    R[i, i] = R[j, j] = ca.cos(angle)
    R[i, j], R[j, i] = -ca.sin(angle), ca.sin(angle)
    return R


def _length(a: ca.SX, b: ca.SX) -> ca.SX:
    return ca.sqrt(a**2 + b**2)


def _rpy_rates(phi: ca.SX) -> ca.SX:
    c_p, s_p, c_y, s_y = ca.cos(phi[1]), ca.sin(phi[1]), ca.cos(phi[2]), ca.sin(phi[2])
    return ca.horzcat(ca.vertcat(c_y * c_p, s_y * c_p, -s_p), ca.vertcat(-s_y, c_y, 0), [0, 0, 1])


def _rpy_inverse(phi: ca.SX) -> ca.SX:
    c_p, s_p, c_y, s_y = ca.cos(phi[1]), ca.sin(phi[1]), ca.cos(phi[2]), ca.sin(phi[2])
    roll = ca.horzcat(c_y / c_p, s_y / c_p, 0)
    return ca.vertcat(roll, ca.horzcat(-s_y, c_y, 0), ca.horzcat(s_p * roll[:2], 1))


def _zyz_rates(phi: ca.SX) -> ca.SX:
    c_a, s_a, c_b, s_b = ca.cos(phi[0]), ca.sin(phi[0]), ca.cos(phi[1]), ca.sin(phi[1])
    return ca.horzcat([0, 0, 1], ca.vertcat(-s_a, c_a, 0), ca.vertcat(c_a * s_b, s_a * s_b, c_b))


def _zyz_inverse(phi: ca.SX) -> ca.SX:
    c_a, s_a, c_b, s_b = ca.cos(phi[0]), ca.sin(phi[0]), ca.cos(phi[1]), ca.sin(phi[1])
    psi = ca.horzcat(c_a / s_b, s_a / s_b, 0)
    return ca.vertcat(ca.horzcat(-c_b * psi[:2], 1), ca.horzcat(-s_a, c_a, 0), psi)


REPRESENTATIONS: dict[str, Representation] = {
    "rpy": Representation(
        name="rpy",
        names=("roll", "pitch", "yaw"),
        angles=lambda R: ca.vertcat(
            ca.atan2(R[2, 1], R[2, 2]),
            ca.atan2(-R[2, 0], _length(R[0, 0], R[1, 0])),
            ca.atan2(R[1, 0], R[0, 0]),
        ),
        matrix=lambda phi: _about(2, phi[2]) @ _about(1, phi[1]) @ _about(0, phi[0]),
        rates=_rpy_rates,
        inverse=_rpy_inverse,
        regularity=lambda phi: ca.fabs(ca.cos(phi[1])),
    ),
    "zyz": Representation(
        name="zyz",
        names=("phi", "theta", "psi"),
        angles=lambda R: ca.vertcat(
            ca.atan2(R[1, 2], R[0, 2]),
            ca.atan2(_length(R[0, 2], R[1, 2]), R[2, 2]),
            ca.atan2(R[2, 1], -R[2, 0]),
        ),
        matrix=lambda phi: _about(2, phi[0]) @ _about(1, phi[1]) @ _about(2, phi[2]),
        rates=_zyz_rates,
        inverse=_zyz_inverse,
        regularity=lambda phi: ca.fabs(ca.sin(phi[1])),
    ),
}


@dataclass(frozen=True, slots=True)
class Analytical:
    """A task in Euler angles.

    Attributes:
        state: x' = J_a q', J_a' q', J_a H^-1 J_a^T and f_a on the m axes.
        reference: phi_d - phi within (-pi, pi], phi_d', phi_d'' on the rotational rows.
        regularity: the lesser |det T_e| of tool and reference.
    """

    state: TaskState
    reference: Reference
    regularity: ca.SX


def analytical(
    representation: Representation, state: TaskState, reference: Reference, R: ca.SX
) -> Analytical:
    """Restates the rotational rows of a task in Euler angles; the translations stay.

    Args:
        representation: which angles.
        state: the arm, in frame axes; all three rotations exist.
        reference: its error is the rotation vector from the tool to the reference, its velocity
            and acceleration are those of the reference's angular velocity.
        R: (3, 3) orientation of the tool in the task frame, which is at rest.
    """
    rows = state.rows(AXES[3:])
    w, w_d = state.velocity[rows], reference.velocity[rows]
    phi = representation.angles(R)
    phi_d = representation.angles(rotation.exp(reference.error[rows]) @ R)
    to, to_d = representation.inverse(phi), representation.inverse(phi_d)
    rate, rate_d = to @ w, to_d @ w_d
    turned, turned_d = (
        representation.inverse_rate(phi, rate),
        representation.inverse_rate(phi_d, rate_d),
    )
    back = representation.rates(phi).T
    apart = phi_d - phi

    m = len(state.axes)
    W = ca.SX.eye(m)
    W[rows, rows] = to
    return Analytical(
        state=replace(
            state,
            J=W @ state.J,
            drift=_put(state.drift, rows, to @ state.drift[rows] + turned @ w),
            velocity=_put(state.velocity, rows, rate),
            mobility=W @ state.mobility @ W.T,
            f=_put(state.f, rows, back @ state.f[rows]),
        ),
        reference=replace(
            reference,
            error=_put(reference.error, rows, ca.atan2(ca.sin(apart), ca.cos(apart))),
            velocity=_put(reference.velocity, rows, rate_d),
            acceleration=_put(
                reference.acceleration, rows, to_d @ reference.acceleration[rows] + turned_d @ w_d
            ),
            force=_put(reference.force, rows, back @ reference.force[rows]),
            force_integral=_put(
                reference.force_integral, rows, back @ reference.force_integral[rows]
            ),
            released=_put(reference.released, rows, back @ reference.released[rows]),
        ),
        regularity=ca.fmin(representation.regularity(phi), representation.regularity(phi_d)),
    )


def _put(vector: ca.SX, rows: list[int], values: ca.SX) -> ca.SX:
    changed = ca.SX(vector)
    changed[rows] = values
    return changed
