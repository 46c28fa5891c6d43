"""The control laws that a task file can name: what each is, in one table."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class LawFacts:
    """What the rest of the language needs to know of a law.

    Attributes:
        equations: the chapter's numbers.
        gains: that a task file may give it.
        force_loop: it reaches a force set point whatever the stiffness; without one the set point
            displaces the motion reference.
        shares: a motion and a force may stand on one axis.
        damps_joints: its damping is one of the joints.
        natural: it leaves the arm its own inertia, and the springs of the axes hold each other.
        bare: it compensates nothing, not even gravity, and follows no goal in the null space.
        multipliers: its forces are multipliers of constraints: force axes and equations alike.
    """

    equations: str
    gains: tuple[str, ...]
    force_loop: bool = False
    shares: bool = False
    natural: bool = False
    damps_joints: bool = False
    bare: bool = False
    multipliers: bool = False

    @property
    def holds_null_space(self) -> bool:
        """It follows a goal in the null space of a redundant arm."""
        return not (self.bare or self.damps_joints)


LAWS: dict[str, LawFacts] = {
    "impedance": LawFacts("(4.16), (4.17)", ("mass", "stiffness", "damping")),
    "impedance-natural": LawFacts("(4.18)-(4.20)", ("stiffness", "damping"), natural=True),
    "pd": LawFacts("(4.21)", ("stiffness", "damping"), natural=True),
    "pd-joint": LawFacts("(4.31)", ("stiffness", "damping"), natural=True, damps_joints=True),
    "stiffness": LawFacts("(4.32), (4.33)", ("stiffness",), natural=True, bare=True),
    "parallel": LawFacts(
        "(4.36)-(4.39)",
        ("mass", "stiffness", "damping", "force.proportional", "force.integral"),
        force_loop=True,
        shares=True,
    ),
    "parallel-pid": LawFacts(
        "(4.50)",
        ("stiffness", "damping", "force.proportional", "force.integral"),
        force_loop=True,
        shares=True,
        natural=True,
    ),
    "hybrid": LawFacts(
        "section 4.3.3, (4.123)",
        ("bandwidth", "damping_ratio", "force.proportional", "force.integral", "force.damping"),
        force_loop=True,
    ),
    "hybrid-multipliers": LawFacts(
        "(4.104)-(4.106), (4.117)",
        ("bandwidth", "damping_ratio", "force.proportional", "force.integral", "force.damping"),
        force_loop=True,
        multipliers=True,
    ),
    "hybrid-reaction": LawFacts(
        "(4.118)-(4.122)",
        ("bandwidth", "damping_ratio", "force.proportional", "force.damping"),
        force_loop=True,
        multipliers=True,
    ),
}
