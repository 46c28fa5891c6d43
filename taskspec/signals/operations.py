"""Operations of formulas; CasADi is imported when the first formula is evaluated."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import casadi as ca


def acos(x: ca.SX) -> ca.SX:
    """The angle [rad] with the cosine x."""
    import casadi as ca

    return ca.acos(x)


def clip(x: ca.SX, low: float, high: float) -> ca.SX:
    """x, or the end of [low, high] that is nearest to it."""
    import casadi as ca

    return ca.fmin(ca.fmax(x, low), high)


def dot(left: ca.SX, right: ca.SX) -> ca.SX:
    """The scalar product of two vectors."""
    import casadi as ca

    return ca.dot(left, right)


def norm(x: ca.SX) -> ca.SX:
    """The Euclidean norm of a vector."""
    import casadi as ca

    return ca.norm_2(x)


def stack(*parts: ca.SX) -> ca.SX:
    """Numbers and vectors as one column."""
    import casadi as ca

    return ca.vertcat(*parts)
