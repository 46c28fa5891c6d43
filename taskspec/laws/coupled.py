"""Axes that a matrix of gains couples: the damping that is designed for all of them together.

Of M e'' + D e' + K e = 0 with M = L L^T and L^-1 K L^-T = V diag(w^2) V^T the modes are the columns
of L^-T V. They keep apart, each with the damping ratio z, under the generalised critical damping

    D = P diag(d) P^T,    P = L V,    d_i = 2 z w_i.

Sampling bounds each d_i by what bounds the damping of an axis: 1 / (3 T p^T M_f^-1 p), with p the
column of P and M_f^-1 what the arm is moved by, J H^-1 J^T; 1 / (3 T) where that is M^-1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from taskspec.deferred import ca, np
from taskspec.geometry.axis import Axis, axes_of, coupled
from taskspec.laws.design import SMALLEST_MASS, SPRING_DAMPING_RATIO, DesignedLaw
from taskspec.laws.gains import AxisDesign, Gain, Gains, is_number, pairs_of, rows, value_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

_DESIGNED = "designed: 2 {} w of the modes of mass and stiffness"


def groups(gains: Gains) -> list[tuple[Axis, ...]]:
    """The axes that mass and stiffness couple, group by group."""
    return coupled([*pairs_of(gains, "mass"), *pairs_of(gains, "stiffness")])


def with_damping(
    law: DesignedLaw,
    gains: Gains,
    axes: Mapping[Axis, AxisDesign],
    mobility: NDArray[np.float64] | None,
) -> None:
    """Designs the damping of coupled axes together, where the file gives none of theirs.

    Args:
        law: of the stage.
        gains: of its axes, with entries off the diagonal; the damping is changed in place.
        axes: what the design of each starts from.
        mobility: (m, m) J H^-1 J^T on the same axes; None where they do not move each other.
    """
    if "damping" not in law.gain_names or law.damps_joints:
        return
    order = tuple(axes)
    if mobility is None:
        mobility = np.diag([1 / axis.plant.h for axis in axes.values()])
    for group in groups(gains):
        at, period = [order.index(axis) for axis in group], axes[group[0]].plant.period
        own = [on for on, gain in gains["damping"].items() if gain.origin == "file"]
        if any({*axes_of(on)} & {*group} for on in own):
            continue
        looped = law.force_loop and any(axes[a].force for a in group)
        ratio = 1.0 if looped else SPRING_DAMPING_RATIO
        K = rows(gains, "stiffness", group)
        for i, axis in enumerate(group):
            if axes[axis].force and not axes[axis].lets_go:
                K[i][i] = K[i][i] + axes[axis].plant.k
        if law.natural:
            held = np.linalg.inv(mobility)[np.ix_(at, at)]
            for i, axis in enumerate(group):
                smallest = SMALLEST_MASS["angular" if axis.is_rotation else "linear"]
                held[i, i] = max(held[i, i], smallest)
            D = modal_damping(held.tolist(), K, ratio, period, mobility[np.ix_(at, at)])
        else:
            D = modal_damping(rows(gains, "mass", group), K, ratio, period)
        for i, row in enumerate(group):
            for j, column in list(enumerate(group))[i:]:
                on = str(row) if i == j else row + column
                gains["damping"][on] = Gain(D[i][j], _DESIGNED.format(f"{ratio:g}"))


def modal_damping(
    M: Sequence[Sequence[Any]],
    K: Sequence[Sequence[Any]],
    ratio: float,
    period: float,
    mobility: NDArray[np.float64] | None = None,
) -> list[list[Any]]:
    """D (m, m) that gives every mode of M, K (m, m) a damping ratio, as far as sampling allows.

    Numbers where M and K are numbers, else expressions.

    Args:
        M: apparent mass, positive definite.
        K: stiffness; what is negative in it is not damped.
        ratio: of every mode.
        period: of control [s].
        mobility: (m, m) that the arm is moved by; None for that of M.
    """
    m = len(M)
    if all(is_number(x) for matrix in (M, K) for row in matrix for x in row):
        L = np.linalg.cholesky(_positive_definite(np.array(M, dtype=float)))
        C = np.linalg.solve(L, np.linalg.solve(L, np.array(K, dtype=float)).T)
        values, V = np.linalg.eigh((C + C.T) / 2)
        P = L @ V
        d = 2 * ratio * np.sqrt(np.maximum(values, 0.0))
        moved = np.ones(m) if mobility is None else np.einsum("ij,ik,kj->j", P, mobility, P)
        D = P @ np.diag(np.minimum(d, 1 / (3 * period * moved))) @ P.T
        found: list[list[float]] = D.tolist()
        return found
    # Loaded here: it needs CasADi, which a file that is only read does not.
    from taskspec.control import linear

    L, stiff = linear.cholesky(_matrix(M)), _matrix(K)
    C = linear.forward(L, linear.forward(L, stiff).T)
    values, V = linear.eigen(C)
    P = L @ V
    d = 2 * ratio * ca.sqrt(ca.fmax(values, 0))
    through = P if mobility is None else ca.DM(mobility) @ P
    moved = ca.SX.ones(m) if mobility is None else ca.sum1(P * through).T
    D = P @ ca.diag(ca.fmin(d, 1 / (3 * period * moved))) @ P.T
    return [[D[min(i, j), max(i, j)] for j in range(m)] for i in range(m)]


def _positive_definite(M: NDArray[np.float64]) -> NDArray[np.float64]:
    """M itself; where it is indefinite, which is reported (TS216), its diagonal."""
    if np.linalg.eigvalsh(M)[0] > 0:
        return M
    diagonal: NDArray[np.float64] = np.diag(np.abs(np.diag(M)))
    return diagonal


def matrix(gains: Gains, name: str, axes: Sequence[str]) -> ca.SX:
    """(m, m) one gain on some axes, zero where it has no entry."""
    return _matrix(rows(gains, name, axes))


def _matrix(entries: Sequence[Sequence[Any]]) -> ca.SX:
    return ca.vertcat(*(ca.horzcat(*(ca.SX(x) for x in row)) for row in entries))


def least_eigenvalue(
    entries: Sequence[Sequence[float]], group: Sequence[Axis]
) -> tuple[float, dict[Axis, float]]:
    """The least eigenvalue of a matrix (m, m) [SI], and its direction by axis.

    Where translations and rotations are coupled, a radian counts as the arm's length.

    Args:
        entries: of the matrix, symmetric, on the axes of `group`.
        group: its axes.
    """
    from taskspec.control.state import ARM_LENGTH

    both = len({axis.is_rotation for axis in group}) > 1
    scale = np.array([1 / ARM_LENGTH if both and a.is_rotation else 1.0 for a in group])
    values, vectors = np.linalg.eigh(np.array(entries, dtype=float) * np.outer(scale, scale))
    direction = vectors[:, 0] * np.sign(vectors[np.argmax(np.abs(vectors[:, 0])), 0])
    return float(values[0]), dict(zip(group, (direction * scale).tolist(), strict=True))


def stretched(gains: Gains, axis: Axis, forces: Mapping[Axis, Any]) -> Any:
    """How far the springs are stretched along an axis that bear given forces, (K^-1 f)_i [m, rad].

    Args:
        gains: of the stage.
        axis: whose springs others are coupled with.
        forces: on the axes that bear one; the others bear none.
    """
    group = next((g for g in coupled([*pairs_of(gains, "stiffness")]) if axis in g), (axis,))
    loads = [forces.get(a, 0.0) for a in group]
    K = rows(gains, "stiffness", group)
    if all(is_number(x) for x in (*loads, *(x for row in K for x in row))):
        return float(np.linalg.solve(np.array(K), np.array(loads))[group.index(axis)])
    from taskspec.control import linear

    solved = linear.solve(linear.cholesky(_matrix(K)), ca.vertcat(*(ca.SX(f) for f in loads)))
    return solved[group.index(axis)]


def yielding_stiffness(gains: Gains, axis: Axis) -> float:
    """The stiffness along an axis while those that are coupled with it give way, 1 / (K^-1)_ii.

    That of the axis itself where it is coupled with none; 0 without a spring.
    """
    own = value_of(gains, "stiffness", axis)
    if own <= 0 or not any(axis in axes_of(on) for on in pairs_of(gains, "stiffness")):
        return own
    return 1.0 / float(stretched(gains, axis, {axis: 1.0}))
