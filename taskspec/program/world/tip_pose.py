"""The tip's pose as one vector of twelve numbers, and derivatives along twists of it.

A pose is (p; R column by column), in the world. It changes along a twist (v; w), world axes, by
p' = v and R' = w^ R. So the derivative of a function of R, be it a rotation vector or an angle
between axes, is taken through the nine numbers of R: a Jacobian of the rotation vector, of Euler
angles or of anything else needs no formula of its own.
"""

from __future__ import annotations

import casadi as ca


def pose(p: ca.SX, R: ca.SX) -> ca.SX:
    """(12,) the pose of a place (3,) and axes (3, 3)."""
    return ca.vertcat(p, ca.vec(R))


def place(x: ca.SX) -> ca.SX:
    """(3,) the place of a pose."""
    return x[:3]


def axes(x: ca.SX) -> ca.SX:
    """(3, 3) the axes of a pose."""
    return ca.reshape(x[3:12], 3, 3)


def rate(x: ca.SX, twist: ca.SX) -> ca.SX:
    """(12,) the rate of a pose that moves with a twist (6,)."""
    return ca.vertcat(twist[:3], ca.vec(ca.skew(twist[3:]) @ axes(x)))


def jacobian(expression: ca.SX, x: ca.SX) -> ca.SX:
    """(k, 6) derivative of an expression (k,) of the symbols x (12,) along twists."""
    twist = ca.SX.sym("twist", 6)
    return ca.jacobian(expression, x) @ ca.jacobian(rate(x, twist), twist)
