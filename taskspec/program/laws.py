"""From a stage's law and gains to joint torques: which equation is called with which numbers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import casadi as ca

from taskspec.control.gains import Gains, diagonal
from taskspec.control.laws import hybrid as hybrid_law
from taskspec.control.laws import impedance as impedance_laws
from taskspec.control.laws.parallel import parallel
from taskspec.control.model_terms import TermSymbols
from taskspec.control.resolution import Command, posture_acceleration, torque
from taskspec.control.state import TaskState
from taskspec.program.modes import AxisPlan
from taskspec.program.references import ReferenceSet
from taskspec.program.signals import SignalTable

#: A redundant arm holds its posture in the null space at this frequency [Hz], critically damped.
POSTURE_FREQUENCY = 2.0

#: The chapter's numbers of each law, for `explain`.
EQUATIONS = {
    "impedance": "(4.16), (4.17)",
    "impedance-natural": "(4.18)-(4.20)",
    "pd": "(4.21)",
    "parallel": "(4.36)-(4.39)",
    "hybrid": "section 4.3.3, (4.123)",
}


class Law(Protocol):
    """A law with its gains filled in."""

    def __call__(
        self,
        state: TaskState,
        references: ReferenceSet,
        plans: Mapping[str, AxisPlan],
        gains: Gains,
        table: SignalTable,
    ) -> Command: ...


def _impedance(
    state: TaskState,
    references: ReferenceSet,
    plans: Mapping[str, AxisPlan],
    gains: Gains,
    table: SignalTable,
) -> Command:
    mass, stiffness, damping = (
        ca.DM(diagonal(gains, name, state.axes)) for name in ("mass", "stiffness", "damping")
    )
    return impedance_laws.impedance(state, references.law, mass, stiffness, damping)


def _impedance_natural(
    state: TaskState,
    references: ReferenceSet,
    plans: Mapping[str, AxisPlan],
    gains: Gains,
    table: SignalTable,
) -> Command:
    stiffness, damping = (
        ca.DM(diagonal(gains, name, state.axes)) for name in ("stiffness", "damping")
    )
    return impedance_laws.impedance_natural(state, references.law, stiffness, damping)


def _pd(
    state: TaskState,
    references: ReferenceSet,
    plans: Mapping[str, AxisPlan],
    gains: Gains,
    table: SignalTable,
) -> Command:
    stiffness, damping = (
        ca.DM(diagonal(gains, name, state.axes)) for name in ("stiffness", "damping")
    )
    return impedance_laws.pd(state, references.law, stiffness, damping)


def _parallel(
    state: TaskState,
    references: ReferenceSet,
    plans: Mapping[str, AxisPlan],
    gains: Gains,
    table: SignalTable,
) -> Command:
    mass, stiffness, damping, proportional, integral = (
        ca.DM(diagonal(gains, name, state.axes))
        for name in ("mass", "stiffness", "damping", "force.proportional", "force.integral")
    )
    # (4.16) is this law with K_F = I, f_d = 0: an axis that meets the surface yields to it.
    met = [i for i, a in enumerate(state.axes) if plans[a].yields]
    proportional[met] = 1.0
    return parallel(state, references.law, mass, stiffness, damping, proportional, integral)


def _hybrid(
    state: TaskState,
    references: ReferenceSet,
    plans: Mapping[str, AxisPlan],
    gains: Gains,
    table: SignalTable,
) -> Command:
    yielding, drives = [], []
    for i, name in enumerate(state.axes):
        plan = plans[name]
        if plan.force:
            p, integral, d = (
                gains[f"force.{gain}"][name].value
                for gain in ("proportional", "integral", "damping")
            )
            measured = table.scalars[f"{'torque' if name.startswith('r') else 'force'}.{name}"]
            relative = state.velocity[i] - references.law.velocity[i]
            drive = hybrid_law.force_drive(
                references.force_ref[name],
                measured,
                references.integrals[name],
                relative,
                (p, integral, d),
            )
        elif plan.soft:
            drive = hybrid_law.soft_drive(
                references.law.error[i],
                references.law.velocity[i] - state.velocity[i],
                gains["stiffness"][name].value,
                gains["damping"][name].value,
            )
        else:
            continue
        yielding.append(name)
        drives.append(drive)
    return hybrid_law.hybrid(
        state,
        references.law,
        ca.DM(diagonal(gains, "K_P", state.axes)),
        ca.DM(diagonal(gains, "K_D", state.axes)),
        yielding,
        ca.vertcat(ca.SX(0, 1), *drives),
        [a for a in state.axes if plans[a].yields and not plans[a].soft],
    )


_LAWS: dict[str, Law] = {
    "impedance": _impedance,
    "impedance-natural": _impedance_natural,
    "pd": _pd,
    "parallel": _parallel,
    "hybrid": _hybrid,
}


def joint_torque(
    kind: str,
    *,
    state: TaskState,
    references: ReferenceSet,
    plans: Mapping[str, AxisPlan],
    gains: Gains,
    table: SignalTable,
    terms: TermSymbols,
    q: ca.SX,
    v: ca.SX,
    posture: ca.SX,
) -> ca.SX:
    """Joint torques (n,) [N m] of law `kind`, with the posture (n,) where the arm is redundant."""
    command = _LAWS[kind](state, references, plans, gains, table)
    redundant = q.shape[0] > len(state.axes)
    pull = posture_acceleration(q, v, posture, POSTURE_FREQUENCY) if redundant else None
    return torque(command, state, terms.H, terms.bias, terms.gravity, pull)
