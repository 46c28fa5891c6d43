"""The command of a law at one instant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING

from taskspec.deferred_methods import dataclass

if TYPE_CHECKING:
    import casadi as ca


@dataclass(frozen=True, slots=True)
class Command:
    """The command of a law; `resolution` makes of it what the joints are commanded.

    Attributes:
        wrench: (m,) w*, sent through J^T.
        acceleration: (m,) a* for the inverse-dynamics core (4.14), or None for the laws that
            only send a wrench through J^T and compensate gravity.
        joint: (n,) torque added in the joints, such as their damping, or None.
        joint_acceleration: (n,) q'' of the whole arm, in place of `acceleration` and posture, from
            laws that decide all its coordinates.
        bare: nothing is compensated, not even gravity.
        velocity: (m,) of the task axes, of laws that command velocities; else None.
        joint_velocity: (n,) of the whole arm, in place of `velocity` and posture.
        motion: (n,) the same before constraints, of laws with multipliers.
        memory: what the law remembers, by the name of its slot.
    """

    wrench: ca.SX
    acceleration: ca.SX | None = None
    joint: ca.SX | None = None
    joint_acceleration: ca.SX | None = None
    bare: bool = False
    velocity: ca.SX | None = None
    joint_velocity: ca.SX | None = None
    motion: ca.SX | None = None
    memory: Mapping[str, ca.SX] = field(default_factory=dict)
