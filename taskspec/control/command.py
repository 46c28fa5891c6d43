"""The command of a law at one instant."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.deferred_methods import dataclass

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True, slots=True)
class Command:
    """The command of a law; `resolution.torque` makes joint torques of it.

    Attributes:
        wrench: (m,) w*, sent through J^T.
        acceleration: (m,) a* for the inverse-dynamics core (4.14), or None for the laws that
            only send a wrench through J^T and compensate gravity.
        joint: (n,) torque added in the joints, such as their damping, or None.
        joint_acceleration: (n,) q'' of the whole arm, in place of `acceleration` and posture, from
            laws that decide all its coordinates.
        bare: nothing is compensated, not even gravity.
    """

    wrench: ca.SX
    acceleration: ca.SX | None = None
    joint: ca.SX | None = None
    joint_acceleration: ca.SX | None = None
    bare: bool = False
