"""References of a stage by axis, and the same as its law sees them."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from taskspec.control.reference import Reference
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis


@dataclass(frozen=True, slots=True)
class ReferenceSet:
    """References by axis name, and what they need to be carried on.

    Attributes:
        position, error: measured coordinate and e = r - x of every axis [m, rad].
        coordinate: what the reference is held against; the gap along an open-loop force's axis.
        position_ref, velocity_ref: of motion axes.
        force_ref: of force axes, applied by the robot.
        law: the same as vectors over the task state's rows, in the theory's sign.
        integrals: by force axis, integral of f_d - f as the robot applies it [N s].
        updates: memory after this tick.
        own, own_rate: (6,) r(0) of each mode before blending and its rate, for the entry.
    """

    position: Mapping[Axis, ca.SX]
    error: Mapping[Axis, ca.SX]
    coordinate: Mapping[Axis, ca.SX]
    position_ref: Mapping[Axis, ca.SX]
    velocity_ref: Mapping[Axis, ca.SX]
    force_ref: Mapping[Axis, ca.SX]
    law: Reference
    integrals: Mapping[Axis, ca.SX]
    updates: dict[str, ca.SX]
    own: ca.SX
    own_rate: ca.SX

    def six(self, values: Mapping[Axis, ca.SX]) -> ca.SX:
        """(6,) in the order of the axes, NaN where there is no value."""
        found = ca.SX.nan(6)
        for a, value in values.items():
            found[a.row] = value
        return found
