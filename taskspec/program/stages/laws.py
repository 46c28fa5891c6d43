"""From a stage's law and gains to joint torques: which equation is called with which numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca

from taskspec.control.gains import Gains, diagonal
from taskspec.control.laws import hybrid as hybrid_law
from taskspec.control.laws import impedance as impedance_laws
from taskspec.control.laws import multipliers as multiplier_laws
from taskspec.control.laws.parallel import parallel, parallel_pid
from taskspec.control.model_terms import TermSymbols
from taskspec.control.reference import opposite
from taskspec.control.resolution import Command, full_acceleration, torque
from taskspec.control.state import TaskState
from taskspec.geometry.axis import Axis
from taskspec.program.reference.modes import AxisPlan
from taskspec.program.reference.reference_set import ReferenceSet
from taskspec.program.signals import SignalTable, applied
from taskspec.program.stages.multipliers import ConstraintControl


@dataclass(frozen=True, slots=True)
class Case:
    """What a law is filled in with: one stage's state, references and gains.

    Attributes:
        posture: (n,) acceleration that a redundant arm has in its null space, else None.
        constraints: of a stage under a multiplier law, None where it has none.
    """

    state: TaskState
    references: ReferenceSet
    plans: Mapping[Axis, AxisPlan]
    gains: Gains
    table: SignalTable
    joint_velocity: ca.SX
    posture: ca.SX | None = None
    constraints: ConstraintControl | None = None

    def diagonal(self, name: str) -> ca.DM:
        """(m,) one gain on all axes, zero where an axis has none."""
        return ca.DM(diagonal(self.gains, name, self.state.axes))


def _impedance(case: Case) -> Command:
    mass, stiffness, damping = map(case.diagonal, ("mass", "stiffness", "damping"))
    return impedance_laws.impedance(case.state, case.references.law, mass, stiffness, damping)


def _impedance_natural(case: Case) -> Command:
    stiffness, damping = map(case.diagonal, ("stiffness", "damping"))
    return impedance_laws.impedance_natural(case.state, case.references.law, stiffness, damping)


def _pd(case: Case) -> Command:
    stiffness, damping = map(case.diagonal, ("stiffness", "damping"))
    return impedance_laws.pd(case.state, case.references.law, stiffness, damping)


def _pd_joint(case: Case) -> Command:
    joints = case.gains["joint_damping"]
    damping = ca.DM([gain.value for gain in joints.values()])
    stiffness = case.diagonal("stiffness")
    return impedance_laws.pd_joint(case.references.law, case.joint_velocity, stiffness, damping)


def _stiffness(case: Case) -> Command:
    return impedance_laws.stiffness_control(case.references.law, case.diagonal("stiffness"))


def _parallel(case: Case) -> Command:
    mass, stiffness, damping = map(case.diagonal, ("mass", "stiffness", "damping"))
    proportional, integral = map(case.diagonal, ("force.proportional", "force.integral"))
    # (4.16) is this law with K_F = I, f_d = 0: an axis that meets the surface yields to it.
    met = [i for i, a in enumerate(case.state.axes) if case.plans[a].yields]
    proportional[met] = 1.0
    return parallel(
        case.state, case.references.law, mass, stiffness, damping, proportional, integral
    )


def _parallel_pid(case: Case) -> Command:
    stiffness, damping = map(case.diagonal, ("stiffness", "damping"))
    proportional, integral = map(case.diagonal, ("force.proportional", "force.integral"))
    return parallel_pid(case.state, case.references.law, stiffness, damping, proportional, integral)


def _hybrid(case: Case) -> Command:
    axes, plans = case.state.axes, case.plans
    yielding = [a for a in axes if plans[a].force or plans[a].soft]
    drives = [_drive(case, a) for a in yielding]
    return hybrid_law.hybrid(
        case.state,
        case.references.law,
        case.diagonal("K_P"),
        case.diagonal("K_D"),
        yielding,
        ca.vertcat(ca.SX(0, 1), *drives),
        [a for a in axes if plans[a].yields and not plans[a].soft],
    )


def _drive(case: Case, name: Axis) -> ca.SX:
    """The force that the robot applies on a force-controlled or soft axis."""
    i = case.state.axes.index(name)
    reference = case.references.law
    if case.plans[name].soft:
        pull = hybrid_law.soft_drive(
            reference.error[i],
            reference.velocity[i] - case.state.velocity[i],
            case.gains["stiffness"][name].value,
            case.gains["damping"][name].value,
        )
        # What the last stage held on this axis is let go of as on a motion axis.
        return pull + opposite(reference.force[i])
    p, integral, d = (
        case.gains[f"force.{gain}"][name].value for gain in ("proportional", "integral", "damping")
    )
    return hybrid_law.force_drive(
        case.references.force_ref[name],
        case.table.scalars[applied(name)],
        case.references.integrals[name],
        case.state.velocity[i] - reference.velocity[i],
        (p, integral, d),
    )


def free_motion(case: Case) -> ca.SX:
    """q'' (n,) that the motion loops ask for, whatever constrains the arm."""
    reference, state = case.references.law, case.state
    acceleration = (
        reference.acceleration
        + case.diagonal("K_D") * (reference.velocity - state.velocity)
        + case.diagonal("K_P") * reference.error
    )
    return full_acceleration(acceleration, state, case.posture)


def _letting_go(case: Case) -> ca.SX:
    """What the last stage held on axes that are motion now, as it fades (m,)."""
    forced = ca.DM([float(case.plans[a].force) for a in case.state.axes])
    return -(1 - forced) * case.references.law.force


def _hybrid_multipliers(case: Case) -> Command:
    on = case.constraints
    if on is None:
        return Command(wrench=_letting_go(case), joint_acceleration=free_motion(case))
    return multiplier_laws.hybrid_multipliers(
        free_motion(case) + on.held,
        on.multipliers,
        on.diagonal(case.gains, "force.proportional"),
        on.diagonal(case.gains, "force.integral"),
        on.diagonal(case.gains, "force.damping"),
        _letting_go(case),
    )


def _hybrid_reaction(case: Case) -> Command:
    on = case.constraints
    if on is None:
        return Command(wrench=_letting_go(case), joint_acceleration=free_motion(case))
    return multiplier_laws.hybrid_reaction(
        free_motion(case) + on.held,
        on.multipliers,
        on.diagonal(case.gains, "force.proportional"),
        on.diagonal(case.gains, "force.damping"),
        _letting_go(case),
    )


_LAWS: dict[str, Callable[[Case], Command]] = {
    "impedance": _impedance,
    "impedance-natural": _impedance_natural,
    "pd": _pd,
    "pd-joint": _pd_joint,
    "stiffness": _stiffness,
    "parallel": _parallel,
    "parallel-pid": _parallel_pid,
    "hybrid": _hybrid,
    "hybrid-multipliers": _hybrid_multipliers,
    "hybrid-reaction": _hybrid_reaction,
}


def joint_torque(kind: str, case: Case, terms: TermSymbols) -> ca.SX:
    """Joint torques (n,) [N m] of law `kind`."""
    command = _LAWS[kind](case)
    return torque(command, case.state, terms.H, terms.bias, terms.gravity, case.posture)
