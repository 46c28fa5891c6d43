"""Hybrid force/velocity control in a task frame (section 4.3.3): one loop for each axis."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.control.command import Command
from taskspec.laws.gains import (
    BANDWIDTH,
    DAMPING,
    DAMPING_RATIO,
    FORCE_DAMPING,
    FORCE_INTEGRAL,
    FORCE_MASS,
    FORCE_PROPORTIONAL,
    K_D,
    K_P,
    SLIDING_GAIN,
    SLIDING_LAYER,
    STIFFNESS,
)
from taskspec.laws.law import ControlLaw, register

if TYPE_CHECKING:
    import casadi as ca

    from taskspec.geometry.axis import Axis
    from taskspec.laws.case import Case


@register
class Hybrid(ControlLaw):
    """Motion axes by acceleration, force axes and soft ones by force, (4.123).

    Motion axis:         x'' = x''_d + K_D e' + K_P e, and what `sliding` adds to it.
    Along a normal:      x'' = x''_d + K_D e' + K_P e + h^-1 (f - f_r): a motion axis along a
        contact's normal yields to the surface that it meets. f_r is what the last stage held there,
        as it is released, and h^-1 the block of J H^-1 J^T that belongs to those axes.
    Force and soft axes: h z'' = u + f holds whatever f is measured, with h^-1 the block of
        J H^-1 J^T that belongs to them and u the force that the robot applies on them. Sent through
        the same core, so that the force does not shake the motion axes. An axis that
        walls could hold has an apparent mass of its own in h^-1.
    """

    kind = "hybrid"
    title = "hybrid force/velocity control in a task frame"
    equations = "section 4.3.3, (4.123)"
    gains = (BANDWIDTH, DAMPING_RATIO, FORCE_PROPORTIONAL, FORCE_INTEGRAL, FORCE_DAMPING)
    slides = True
    derived = (K_P, K_D, STIFFNESS, DAMPING, FORCE_MASS, SLIDING_LAYER, SLIDING_GAIN)
    mechanism_form = True
    force_loop = True
    follows = ("force.damping", "force.integral")
    selects = True
    rest = "K e of the soft axis"

    def command(self, case: Case) -> Command:
        """The three equations, each on its axes; on a mechanism perhaps the form for that."""
        if case.free is not None:
            return on_mechanism(case)
        state, reference = case.state, case.reference
        K_P, K_D = case.diagonals("K_P", "K_D")
        velocity_error = reference.velocity - state.velocity
        acceleration = reference.acceleration + K_D * velocity_error + K_P * reference.error
        met = state.rows([a for a in case.normal if a not in case.soft])
        if met:
            h_inverse = state.mobility[met, met]
            acceleration[met] += h_inverse @ (state.f[met] - reference.released[met])
        drives = {a: _drive(case, a) for a in state.axes if a in (*case.force, *case.soft)}
        rows = state.rows([*drives])
        if rows:
            h_inverse, u = _apparent(case, rows), case.column(drives.values())
            acceleration[rows] = reference.acceleration[rows] + h_inverse @ (u + state.f[rows])
        if case.gains.get(SLIDING_LAYER.name):
            # Loaded here: it needs CasADi, which a file that is only read does not.
            from taskspec.laws import sliding

            acceleration += sliding.term(case, acceleration)
        return Command(acceleration=acceleration, wrench=-state.f)


def _apparent(case: Case, rows: list[int]) -> ca.SX:
    """S h^-1 S of force and soft axes; S_i = 1 / sqrt(m_i h^-1_ii) where axis i has a mass m_i."""
    h_inverse, masses = case.state.mobility[rows, rows], case.gains.get("force.mass", {})
    for i, row in enumerate(rows):
        mass = masses.get(case.state.axes[row])
        if mass is not None:
            share = 1 / (mass.value * h_inverse[i, i]) ** 0.5
            h_inverse[i, :] *= share
            h_inverse[:, i] *= share
    return h_inverse


def _drive(case: Case, axis: Axis, *, own: bool = True) -> ca.SX:
    """u, the force [N, N m] that the robot applies on a force axis or a soft one.

    Args:
        case: the stage.
        axis: the axis.
        own: whether a designed damping is the axis' own; else something else sees to that.
    """
    state, reference, i = case.state, case.reference, case.state.axes.index(axis)
    rate = reference.velocity[i] - state.velocity[i]
    if axis in case.soft:
        pull = soft_drive(reference.error[i], rate, case.gain("stiffness", axis),
                          case.gain("damping", axis))  # fmt: skip
        return pull + case.applied(reference.released[i])
    damping = case.gains["force.damping"][axis]
    integral = case.gain("force.integral", axis) if "force.integral" in case.gains else 0.0
    return force_drive(
        case.applied(reference.force[i]),
        case.applied(state.f[i]),
        case.applied(reference.force_integral[i]),
        state.velocity[i] - reference.velocity[i],
        (
            case.gain("force.proportional", axis),
            integral,
            damping.value if own or damping.origin == "file" else 0.0,
        ),
    )


def on_mechanism(case: Case) -> Command:
    """The form for a held mechanism, which damps what is not free by itself.

    A damping of the file is added to that along its axis.
    """
    assert case.free is not None
    drives = {a: _drive(case, a, own=False) for a in (*case.force, *case.soft)}
    # Loaded here: it needs CasADi, which a file that is only read does not.
    from taskspec.laws import mechanism_form

    return mechanism_form.command(case, case.free, drives, *case.diagonals("K_P", "K_D"))


def force_drive(
    desired: ca.SX,
    measured: ca.SX,
    integral: ca.SX,
    velocity: ca.SX,
    gains: tuple[float, float, float],
) -> ca.SX:
    """u = f_d + p (f_d - f) + i int (f_d - f) dt - d v of one force axis (docs/language/law.md).

    Forces are those that the robot applies [N, N m]; velocity is relative to the frame; gains are
    p [1], i [1/s], d [N s/m, N m s/rad].
    """
    p, i, d = gains
    return desired + p * (desired - measured) + i * integral - d * velocity


def soft_drive(error: ca.SX, error_rate: ca.SX, stiffness: float, damping: float) -> ca.SX:
    """u = D e' + K e of one soft axis, so that h e'' + D e' + K e = 0 in free space."""
    return damping * error_rate + stiffness * error
