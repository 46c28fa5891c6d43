"""A stage's constraints with their set points, integrals and the choice of coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from taskspec.control.gains import Gains
from taskspec.control.laws.multipliers import Multipliers
from taskspec.control.reference import opposite
from taskspec.motion import blend
from taskspec.program.axis_reference import Translate
from taskspec.program.clock import Clock
from taskspec.program.constraints import ConstraintSet
from taskspec.program.layout import Layout
from taskspec.program.references import ReferenceSet, risen, wound
from taskspec.program.signals import SignalTable
from taskspec.program.unreached import Unreached
from taskspec.spec import SetPoint


@dataclass(frozen=True, slots=True)
class ConstraintControl:
    """What a multiplier law needs of a stage's constraints.

    Attributes:
        names: force axes, then equations. multipliers: in the theory's sign.
        held: (n,) what keeps q'' continuous after another choice of coordinates, as it fades.
    """

    names: tuple[str, ...]
    multipliers: Multipliers
    held: ca.SX

    def diagonal(self, gains: Gains, name: str) -> ca.DM:
        """(m,) one gain on all constraints."""
        return ca.DM([gains[name][constraint].value for constraint in self.names])


@dataclass(frozen=True, slots=True)
class EquationForces:
    """Set points and integrals of the equations that constrain a stage, as the robot applies them.

    Attributes:
        desired: by equation [N, N m]. integrals: of desired - measured. updates: of the memory.
    """

    desired: dict[str, ca.SX]
    integrals: dict[str, ca.SX]
    updates: dict[str, ca.SX]


def equation_forces(
    *,
    names: Sequence[str],
    set_points: Mapping[str, SetPoint],
    measured: Mapping[str, ca.SX],
    gains: Gains,
    clock: Clock,
    memory: Layout,
    parameters: Layout,
    table: SignalTable,
    translate: Translate,
    period: float,
    unreached: Unreached,
) -> EquationForces:
    """References of the equations `names`; one without a set point is to bear no force."""
    found = EquationForces({}, {}, {})
    for name in names:
        slot = f"equation.{name}"
        point = set_points.get(name)
        wanted = ca.SX(0) if point is None else translate(point.wanted)
        ramp = None if point is None else point.ramp
        force = unreached.reachable(name, risen(slot, wanted, ramp, clock, parameters))
        found.desired[name] = force
        if "force.integral" not in gains:
            continue
        memorised = f"integral.{slot}"
        found.integrals[name] = found.updates[memorised] = wound(
            memory.add(memorised),
            force,
            unreached.step(name, period * (force - measured[name])),
            gains["force.integral"][name].value,
            table.scalars["touching"],
            ca.SX(0),
        )
    return found


def constrain(
    chosen: ConstraintSet,
    forces: EquationForces,
    references: ReferenceSet,
    clock: Clock,
    parameters: Layout,
) -> ConstraintControl:
    """The constraints of a stage as its law sees them."""
    desired = {**references.force_ref, **forces.desired}
    integrals = {**references.integrals, **forces.integrals}
    zero = ca.SX(0)
    n = chosen.J.shape[1]
    held, since = parameters.add("held", n), parameters.add("chosen_at")
    return ConstraintControl(
        chosen.names,
        Multipliers(
            J=chosen.J,
            gamma=chosen.gamma,
            directions=chosen.directions,
            closing=chosen.closing,
            desired=opposite(ca.vertcat(*(desired[name] for name in chosen.names))),
            measured=opposite(chosen.measured),
            integral=opposite(ca.vertcat(*(integrals.get(name, zero) for name in chosen.names))),
        ),
        held * blend.offset_shape((clock.t - since) / blend.BLEND_TIME),
    )
