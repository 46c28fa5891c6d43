"""The base of all control laws, and the table of those that a file can name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, Literal, TypeVar

from taskspec.laws import conditions, design
from taskspec.laws.gains import Gain, Gains, LawGain

if TYPE_CHECKING:
    from taskspec.control.command import Command
    from taskspec.laws.case import Case
    from taskspec.laws.conditions import AxisContact, StabilityCondition
    from taskspec.laws.energy import Energy
    from taskspec.laws.gains import AxisDesign


Solve = Literal["closed-form", "qp"]
"""How the command of a law becomes that of the joints."""


class ControlLaw(ABC):
    """A control law: its equation, and everything that is known of it.

    Subclasses state what differs from this base. What they do not state follows from their facts.

    Attributes:
        kind: its name in a file.
        title: what it is called in words.
        equations: the chapter's numbers; of a law that it does not have, the equation itself.
        gains: that a task file may give it.
        derived: gains that its design makes of them.
        force_loop: it reaches a force set point whatever the stiffness; without one the set point
            displaces the motion reference.
        shares: a motion and a force may stand on one axis.
        selects: an axis either moves by acceleration or follows a force; stiff motion axes have a
            bandwidth instead of a spring.
        axis_springs: a motion axis may have a stiffness and damping of its own.
        natural: it leaves the arm its own inertia, and the springs of the axes hold each other.
        feeds_forward: without a force loop, it feeds the acceleration of its references through the
            arm's inertia, so that what moves along one axis does not disturb the others.
        damps_joints: its damping is one of the joints.
        bare: it compensates nothing, not even gravity, and follows no goal in the null space.
        multipliers: its forces are multipliers of constraints: force axes and equations alike.
        mechanism_form: it has a form for a held mechanism, which takes no measured force off.
        slides: its motion axes may have a sliding term, see `laws.sliding`.
        undamped: where damping comes from, of a law that damps no axis; else empty.
        rest: equation of the force that its springs come to rest with.
        storage: its storage function in words, of which `energy` has the terms; empty without one.
        commands: what it commands the joints: `torque`, or `velocity`, which an arm that takes
            positions is commanded by as well.
        solve: how its command becomes that of the joints, where a file does not say it.
        following: designed gains that change with another gain of their axis, by the other and by
            themselves, with their power of it.
        follows: designed gains of a force axis that may follow the contact's stiffness as it is
            estimated; see `laws.contact_stiffness`.
        dual: the law that does the same on arms that take what this one does not command.
    """

    kind: ClassVar[str]
    title: ClassVar[str]
    equations: ClassVar[str]
    gains: ClassVar[tuple[LawGain, ...]]
    derived: ClassVar[tuple[LawGain, ...]] = ()
    force_loop: ClassVar[bool] = False
    shares: ClassVar[bool] = False
    selects: ClassVar[bool] = False
    axis_springs: ClassVar[bool] = True
    natural: ClassVar[bool] = False
    feeds_forward: ClassVar[bool] = False
    damps_joints: ClassVar[bool] = False
    bare: ClassVar[bool] = False
    multipliers: ClassVar[bool] = False
    mechanism_form: ClassVar[bool] = False
    slides: ClassVar[bool] = False
    undamped: ClassVar[str] = ""
    rest: ClassVar[str] = "K e"
    storage: ClassVar[str] = ""
    commands: ClassVar[str] = "torque"
    solve: ClassVar[Solve] = "closed-form"
    following: ClassVar[Mapping[str, Mapping[str, float]]] = {}
    follows: ClassVar[tuple[str, ...]] = ()
    dual: ClassVar[str] = "admittance"

    @abstractmethod
    def command(self, case: Case) -> Command:
        """The law's equation, filled in with a stage."""

    def energy(self, case: Case) -> Energy | None:  # noqa: ARG002
        """What it stores in a stage, and what changes that; None where it states no storage."""
        return None

    # What files may say

    @property
    def gain_names(self) -> tuple[str, ...]:
        """Names of the gains that a file may give."""
        return tuple(gain.name for gain in self.gains)

    @property
    def holds_null_space(self) -> bool:
        """Whether it follows a goal in the null space of a redundant arm."""
        return not (self.bare or self.damps_joints)

    @property
    def observes_disturbances(self) -> bool:
        """Whether a disturbance observer may stand beside it.

        It commands torques that carry the arm, and leaves all other forces to be measured at the
        tool: those of multipliers follow from the same torques.
        """
        return self.commands == "torque" and not (self.bare or self.multipliers)

    @property
    def compensates(self) -> bool:
        """Whether weight and inertia of the arm's model are in its torques."""
        return self.commands == "torque" and not self.bare

    @property
    def soft_axes(self) -> bool:
        """Whether a stiffness or damping of its own makes a motion axis a soft one."""
        return self.selects and self.axis_springs

    # Gains

    def design(self, axis: AxisDesign) -> dict[str, Gain]:
        """All gains on one axis by name: those of the file, and designed ones."""
        build = design.accelerations if self.selects else design.springs
        return build(self, axis)

    def design_equation(self, axis: AxisDesign) -> dict[str, Gain]:
        """Gains of the force loop of one equation, along its unit gradient."""
        return design.force_loop(self, axis)

    def spring(self, gains: Mapping[str, float], mass: float) -> float:
        """Stiffness with which a motion axis holds on to its reference [N/m].

        Args:
            gains: on the axis, by name [SI].
            mass: effective along it [kg].
        """
        return gains["stiffness"] if "stiffness" in gains else mass * gains.get("K_P", 0.0)

    def loop_damping(self, gains: Mapping[str, float]) -> float:
        """Damping of the force loop on an axis [N s/m].

        Args:
            gains: on the axis, by name [SI].
        """
        return gains.get("force.damping", gains.get("damping", 0.0))

    def unreturned(self, gains: Mapping[str, float]) -> float:
        """What a force loop pushes with against its damping where nothing returns its force.

        A multiple of the set point: its own, and as much again once its integral is full. One of
        velocities has p in place of the first, and perhaps no integral.

        Args:
            gains: on the axis, by name [SI].
        """
        if self.commands == "torque":
            return 2.0
        return gains.get("force.proportional", 0.0) + (gains.get("force.integral", 0.0) > 0)

    # What it comes to

    def settles_at(self, *, moves: bool, reached: bool) -> str:  # noqa: ARG002
        """Where the force stands that a force loop settles at.

        Args:
            moves: whether the axis has a velocity too.
            reached: whether it is the set point.
        """
        return "set point"

    def gives_way(self, gains: Gains, axes: Sequence[str]) -> list[float] | None:
        """How fast loops yield to forces that are not returned, per newton, by axis.

        None where the law leaves open what it settles at.
        """
        if self.multipliers:
            return [1.0] * len(axes)
        return give_way(gains, axes, "force.damping")

    def pulls(self, gains: Mapping[str, float], rate: float) -> float:  # noqa: ARG002
        """The force that a motion on a force axis adds to its set point [N].

        Args:
            gains: on the axis, by name [SI].
            rate: of the motion [m/s].
        """
        return 0.0

    def strikes_with(self, gains: Mapping[str, Gain], arm_mass: float) -> float:  # noqa: ARG002
        """Mass that meets a surface along an axis [kg].

        Args:
            gains: on the axis, by name.
            arm_mass: the arm's own mass along it [kg].
        """
        return arm_mass

    def drag(self, gains: Mapping[str, float]) -> float | None:  # noqa: ARG002
        """Damping of an axis against its velocity itself, not its error [N s/m]; None if on joints.

        Args:
            gains: on the axis, by name [SI].
        """
        return None if self.damps_joints or self.bare else 0.0

    def conditions(self, at: AxisContact) -> Iterator[StabilityCondition]:
        """The chapter's conditions of stability of an axis on a contact."""
        if at.rigid and at.force:
            yield from conditions.rigid_loop(at, self.last_equation)

    @property
    def last_equation(self) -> str:
        """The last of its equations, which is that of the force."""
        return self.equations.split(",")[-1].strip()

    def enforces(
        self, *, force: bool, motion: bool, open_loop: bool, soft: bool, lets_go: bool = False
    ) -> str:
        """What controls an axis, in words.

        Args:
            force: whether a force loop is on it.
            motion: whether its motion error is controlled.
            open_loop: whether a force displaces its motion reference.
            soft: whether it is soft.
            lets_go: whether nothing is to hold it.
        """
        if lets_go and not force:
            return "nobody" if self.undamped else "the law's damping"
        if force:
            return "force over motion" if motion else "force control"
        if open_loop:
            return "impedance, open loop"
        springs = not self.selects and not self.shares
        return "impedance" if soft or springs else "motion control"


def give_way(gains: Gains, axes: Sequence[str], against: str) -> list[float]:
    """k_I over what a force loop works against, by axis; alike where one of them is zero.

    Args:
        gains: of the stage.
        axes: its force axes.
        against: name of the gain.
    """
    integral, held = gains.get("force.integral", {}), gains.get(against, {})
    pairs = [(integral[a].value, held[a].value) for a in axes if a in integral and a in held]
    if len(pairs) < len(axes) or any(i <= 0 or h <= 0 for i, h in pairs):
        return [1.0] * len(axes)
    return [i / h for i, h in pairs]


#: What every law states.
_STATED = ("kind", "title", "equations", "gains")
#: By name, in the order in which they are listed.
LAWS: dict[str, ControlLaw] = {}

_L = TypeVar("_L", bound=type[ControlLaw])


def register(law: _L) -> _L:
    """Makes a law one that files can name.

    Raises:
        TypeError: it lacks its equation, or what the base has no default for.
        ValueError: its name is taken.
    """
    missing = [name for name in _STATED if not hasattr(law, name)]
    if missing:
        raise TypeError(f"the law {law.__name__} does not state its {', '.join(missing)}")
    if law.kind in LAWS:
        raise ValueError(f"there is a law {law.kind!r} already")
    LAWS[law.kind] = law()
    return law


def commanding(commands: str, having: Callable[[ControlLaw], bool]) -> list[str]:
    """The names of laws that command something and have a fact, for a message.

    Args:
        commands: `torque` or `velocity`.
        having: the fact.
    """
    return [kind for kind, law in LAWS.items() if law.commands == commands and having(law)]


def gain_named(name: str) -> LawGain:
    """A gain of any law by its name; a plain number where no law declares it."""
    declared = (gain for law in LAWS.values() for gain in (*law.gains, *law.derived))
    return next((gain for gain in declared if gain.name == name), LawGain(name))
