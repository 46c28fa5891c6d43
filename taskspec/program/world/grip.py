"""How the tool holds what it grasps: a compliant coupling in all six directions."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Grip:
    """A spring and damper between the tool tip and what it holds.

    Attributes:
        stiffness: [N/m]. damping: [N s/m].
        angular_stiffness: [N m/rad]. angular_damping: [N m s/rad].
    """

    stiffness: float
    damping: float
    angular_stiffness: float
    angular_damping: float


#: Every grasp's.
GRIP = Grip(stiffness=50e3, damping=300.0, angular_stiffness=500.0, angular_damping=1.5)
