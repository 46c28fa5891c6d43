"""The storage functions of laws, and the power that each of their terms puts in."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis

if TYPE_CHECKING:
    from taskspec.laws.case import Case


@dataclass(frozen=True, slots=True)
class Energy:
    """What a law stores at one instant, and what changes it.

    With gains that do not vary, and the torque that the law's equation commands at every instant,

        d/dt (kinetic + spring) = contact + reference + force + integral - dissipated.

    Attributes:
        kinetic: of the mass that the law moves [J].
        spring: of its springs [J].
        contact: power of the environment on the tool [W].
        reference: what a reference that moves puts in [W].
        force: what set points of forces, and errors of forces, put in [W].
        integral: what the integrals of force loops put in [W]. None of these three where an energy
            tank pays for them.
        dissipated: what its dampers take [W].
        commanded: q'^T (u - g) of all this [W]; None where the mass is not the arm's own, so that
            joint torques do not show it.
    """

    kinetic: ca.SX
    spring: ca.SX
    contact: ca.SX
    reference: ca.SX | None
    force: ca.SX | None
    integral: ca.SX | None
    dissipated: ca.SX
    commanded: ca.SX | None = None

    @property
    def stored(self) -> ca.SX:
        """The storage function [J]."""
        return self.kinetic + self.spring

    def signals(self) -> dict[str, ca.SX]:
        """By the names of the language; see `signals.entries`."""
        powers = ("contact", "reference", "force", "integral", "dissipated")
        return {
            "energy.kinetic": self.kinetic,
            "energy.spring": self.spring,
            "energy.stored": self.stored,
        } | {f"power.{n}": power for n in powers if (power := getattr(self, n)) is not None}


def of_the_arm(
    case: Case,
    damped: ca.SX | None = None,
    in_joints: ca.SX | None = None,
    force: ca.SX | None = None,
    integral: ca.SX | None = None,
) -> Energy:
    """1/2 q'^T H q' + 1/2 e^T K_m e, of a law that leaves the arm its inertia, (4.22).

    Args:
        case: the stage.
        damped: (m,) velocity that the dampers of its axes push along; None without any.
        in_joints: (n,) torque of dampers in the joints [N m]; None without any.
        force: (m,) of set points and errors of forces, as the theory has it, which the law takes
            off [N, N m]; None without any.
        integral: (m,) the same of integrals.
    """
    state, reference = case.state, case.reference
    v, pull = state.velocity, case.times("stiffness", reference.error)
    moved, dissipated = ca.dot(pull, reference.velocity), ca.SX(0)
    if damped is not None:
        damper = case.times("damping", damped)
        dissipated = ca.dot(damper, damped)
        # A damper against a reference that moves takes the tool along.
        moved += ca.dot(damper, v) + dissipated
    if in_joints is not None:
        dissipated -= ca.dot(in_joints, case.joint_velocity)
    added = ca.SX(0) if force is None else -ca.dot(v, force)
    wound = ca.SX(0) if integral is None else -ca.dot(v, integral)
    return Energy(
        kinetic=ca.sumsqr(state.H_factor.T @ case.joint_velocity) / 2,
        spring=ca.dot(pull, reference.error) / 2,
        contact=ca.dot(state.f, v),
        reference=moved,
        force=added,
        integral=wound,
        dissipated=dissipated,
        commanded=ca.dot(pull, v - reference.velocity) + moved + added + wound - dissipated,
    )


def of_a_mass(
    case: Case,
    axes: Iterable[Axis],
    force: ca.SX | None = None,
    integral: ca.SX | None = None,
) -> Energy:
    """1/2 e'^T M e' + 1/2 e^T K e, of a law that gives the tool a mass M of its own, (4.15).

    Args:
        case: the stage.
        axes: that have such a mass.
        force: (m,) what the law adds to the measured force f, along e' [N, N m]; None for nothing.
        integral: (m,) what integrals add to it.
    """
    state, reference = case.state, case.reference
    on = ca.DM([float(axis in {*axes}) for axis in state.axes])
    e, f = on * reference.error, on * state.f
    rate = on * (reference.velocity - state.velocity)
    nothing = 0 * rate
    return Energy(
        kinetic=ca.dot(case.times("mass", rate), rate) / 2,
        spring=ca.dot(case.times("stiffness", e), e) / 2,
        contact=ca.dot(f, state.velocity),
        reference=-ca.dot(f, reference.velocity),
        force=ca.dot(nothing if force is None else force, rate),
        integral=ca.dot(nothing if integral is None else integral, rate),
        dissipated=ca.dot(case.times("damping", rate), rate),
    )


def beside_a_tank(case: Case, granted: ca.SX, filled: ca.SX) -> Energy:
    """1/2 q'^T H q' + r 1/2 e^T K_m e: what stays of any law with an energy tank (`laws.tank`).

    Args:
        case: the stage.
        granted: r, the share of its springs.
        filled: power of its dampers over the last period [W].
    """
    state = case.state
    pull = case.times("stiffness", case.reference.error)
    return Energy(
        kinetic=ca.sumsqr(state.H_factor.T @ case.joint_velocity) / 2,
        spring=granted * ca.dot(pull, case.reference.error) / 2,
        contact=ca.dot(state.f, state.velocity),
        reference=None,
        force=None,
        integral=None,
        dissipated=filled,
    )
