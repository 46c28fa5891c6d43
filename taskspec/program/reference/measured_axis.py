"""The coordinate of an axis as it is measured, with its rate, for axes that follow it."""

from __future__ import annotations

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import ROTATIONS, Axis
from taskspec.program.reference.coordinates import Coordinates

#: Of |theta|^2 [rad^2]: below, the series of c is exact to a double's rounding at its first term.
_SMALL = 1e-8


@dataclass(frozen=True, slots=True)
class MeasuredAxis:
    """A measured coordinate in the place of a reference.

    It is not filtered: joint positions are measured without noise, and a filter would make what
    follows it late by its time constant.

    Attributes:
        value: the coordinate [m, rad].
        rate: of it [m/s, rad/s].
        acceleration: 0; it is not measured.
        released: 0; no force stands in it.
    """

    value: ca.SX
    rate: ca.SX
    acceleration: ca.SX
    released: ca.SX


def measured_axis(on: Coordinates, axis: Axis) -> MeasuredAxis:
    """The measured coordinate of an axis that exists in the stage's frame."""
    rates = _turning(on) if axis.is_rotation else _moving(on)
    return MeasuredAxis(on.position[axis], rates[axis.column], ca.SX(0), ca.SX(0))


def _moving(on: Coordinates) -> ca.SX:
    """(3,) rates of the coordinates along the axes [m/s]."""
    velocity = on.point.twist[:3] if on.at.foot is None else on.tool.velocity
    return on.at.rate_map @ (on.at.R.T @ velocity)


def _turning(on: Coordinates) -> ca.SX:
    """(3,) rates of the rotation vector theta since the stage began [rad/s].

    theta' = w - theta x w / 2 + c theta x (theta x w), with c = 1/|theta|^2 - (1 + cos |theta|) /
    (2 |theta| sin |theta|), w the tool's angular velocity against the axes that theta is in.
    """
    spin = ca.SX.zeros(3) if on.frame.kind == "tool" else on.at.R @ on.at.turning(on.tool.velocity)
    w = on.base.T @ (on.terms.twist[3:] - spin)
    theta = ca.vertcat(*(on.position.get(a, ca.SX(0)) for a in ROTATIONS))
    across = ca.cross(theta, w)
    square = ca.sumsqr(theta)
    small = square < _SMALL
    safe = ca.if_else(small, 1, square)
    size = ca.sqrt(safe)
    c = ca.if_else(small, 1 / 12, 1 / safe - (1 + ca.cos(size)) / (2 * size * ca.sin(size)))
    return w - across / 2 + c * ca.cross(theta, across)
