"""Gains: what they are called, their values on the axes, and what their design starts from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import PAIRS, axes_of, is_mixed
from taskspec.text import units
from taskspec.text.units import Dimension, scaled, show

if TYPE_CHECKING:
    from taskspec.expression import Expression
    from taskspec.laws.servo_loop import ServoLoop


@dataclass(frozen=True, slots=True)
class LawGain:
    """A gain that laws have.

    Attributes:
        name: in files, sheets and findings.
        dimension: on a translation; a rotation or a joint that turns has its counterpart.
        unit: that it is shown in, where not in one that suits its dimension.
        powers: gains that follow from it, with which power; itself alone where it is empty.
    """

    name: str
    dimension: Dimension = units.NUMBER
    unit: str = ""
    powers: Mapping[str, int] = field(default_factory=dict)

    def text(self, value: float, *, angular: bool, entry: str = "") -> str:
        """A value [SI] on an axis, or of an entry off the diagonal, in the unit that suits it."""
        if self.unit:
            return show(value, self.unit)
        if is_mixed(entry):
            return scaled(value, self.dimension.mixed)
        return scaled(value, self.dimension.on(rotation=angular))

    def setting(self, value: float, *, angular: bool) -> str:
        """A value [SI] on an axis in the most readable unit, whatever its size."""
        return show(value, self.unit or self.dimension.on(rotation=angular), 3)


MASS = LawGain("mass", units.MASS)
STIFFNESS = LawGain("stiffness", units.STIFFNESS)
DAMPING = LawGain("damping", units.DAMPING)
#: Of a force that moves an axis: what is less does not.
DEAD_BAND = LawGain("dead_band", units.FORCE)
#: What a file calls the damping of a law that damps joints.
JOINT_DAMPING = LawGain("joint_damping", units.DAMPING)
BANDWIDTH = LawGain(
    "bandwidth", units.FREQUENCY, powers={"bandwidth": 1, "K_P": 2, "K_D": 1, "K_V": 1}
)
DAMPING_RATIO = LawGain("damping_ratio", powers={"damping_ratio": 1, "K_D": 1})
#: Of motion loops that command accelerations; both follow from bandwidth and damping ratio.
K_P = LawGain("K_P", units.FREQUENCY**2)
K_D = LawGain("K_D", units.FREQUENCY, "1/s")
#: Of motion loops that command velocities.
K_V = LawGain("K_V", units.FREQUENCY, "1/s")
FORCE_PROPORTIONAL = LawGain("force.proportional")
FORCE_INTEGRAL = LawGain("force.integral", units.FREQUENCY, "1/s")
FORCE_DAMPING = LawGain("force.damping", units.DAMPING)
#: The apparent mass of a force axis that shall not give way with the arm's own.
FORCE_MASS = LawGain("force.mass", units.MASS)

#: Of sliding: s = e' + L e within which the sliding term is linear, and the most of that term.
SLIDING_LAYER = LawGain("sliding.layer", units.VELOCITY)
SLIDING_GAIN = LawGain("sliding.gain", units.LINEAR_ACCELERATION)


def is_number(value: object) -> bool:
    """Whether the value of a gain is a number, not an expression of what it varies by."""
    return isinstance(value, float | int)


@dataclass(frozen=True, slots=True)
class Gain:
    """One number [SI] and where it came from: "file" or the rule that designed it.

    Attributes:
        value: of a gain that varies the nominal one.
        origin: "file", or the rule.
        formula: by which the file has it vary; None for a number.
    """

    value: float
    origin: str
    formula: Expression | None = None


#: name of the gain -> axis, or two of them off the diagonal of its matrix -> gain
Gains = dict[str, dict[str, Gain]]
#: Gains of the laws with springs that are symmetric matrices on the axes.
MATRICES = ("mass", "stiffness", "damping", "force.proportional", "force.integral")


def on_axis(gains: Mapping[str, Mapping[str, Gain]], axis: str) -> dict[str, float]:
    """The gains of one axis, equation or joint, by name [SI]."""
    return {name: by_axis[axis].value for name, by_axis in gains.items() if axis in by_axis}


def value_of(gains: Mapping[str, Mapping[str, Gain]], name: str, axis: str) -> float:
    """One gain on one axis, equation or joint [SI]; 0 where there is none."""
    found = gains.get(name, {}).get(axis)
    return 0.0 if found is None else found.value


def diagonal(gains: Gains, name: str, axes: Sequence[str], default: float = 0.0) -> list[float]:
    """One gain on all axes, `default` where an axis has none."""
    given = gains.get(name, {})
    return [given[a].value if a in given else default for a in axes]


def pairs_of(gains: Mapping[str, Mapping[str, Gain]], name: str) -> dict[str, Gain]:
    """The entries of one gain off the diagonal of its matrix; none where it is diagonal."""
    return {on: gain for on, gain in gains.get(name, {}).items() if on in PAIRS}


def rows(
    gains: Mapping[str, Mapping[str, Gain]], name: str, axes: Sequence[str]
) -> list[list[float]]:
    """One gain as a symmetric matrix (m, m) on some axes, zero where it has no entry [SI]."""
    at = {axis: i for i, axis in enumerate(axes)}
    found = [[0.0] * len(axes) for _ in axes]
    for on, gain in gains.get(name, {}).items():
        where = [at[axis] for axis in axes_of(on) if axis in at]
        if where and len(where) == len(axes_of(on)):
            found[where[0]][where[-1]] = found[where[-1]][where[0]] = gain.value
    return found


@dataclass(frozen=True, slots=True)
class AxisPlant:
    """Arm and contact on one axis, for the design of its gains.

    Attributes:
        h: effective mass along the axis while the others are free, 1/(J H^-1 J^T)_ii [kg, kg m^2].
        held: the same while the others are held, Lambda_ii.
        k: nominal contact stiffness [N/m, N m/rad]; without bounds along an exact equation.
        period: control period T [s].
        grip: damping of the grip on a mechanism along the axis [N s/m, N m s/rad]; None without.
        damper: what a law's form for the mechanism damps the axis with [N s/m, N m s/rad]; None
            where the law damps it by its own rules.
        face: stiffness about the axis of a face that lies flat [N m/rad]; 0 without.
        servo: the loop of a force along the axis, of an arm that takes velocities or positions;
            None for one that takes torques.
        jammed: the apparent mass that a force axis has at least, so that it does not flip where
            walls and their friction hold the tool [kg]; 0 where they cannot.
    """

    h: float
    held: float
    k: float
    period: float
    grip: float | None = None
    damper: float | None = None
    face: float = 0.0
    jammed: float = 0.0
    servo: ServoLoop | None = None

    @property
    def jams(self) -> bool:
        """Whether it may flip between walls; of an axis whose mass varies it is assumed."""
        return self.jammed > 0 and (not is_number(self.h) or self.jammed > self.h)

    @property
    def most_damping(self) -> float:
        """h / (3 T): what a damper held over one period can remove without overshooting."""
        return self.h / (3 * self.period)


@dataclass(frozen=True, slots=True)
class AxisDesign:
    """An axis or equation whose gains are designed where the file gives none.

    Attributes:
        plant: arm and contact.
        given: gains that the file gives the law on this axis, by name, numbers in SI units.
        rotation: whether it is a rotation.
        force: whether it has a force or torque set point.
        stiffness: of the axis itself, as the file gives it [N/m, N m/rad].
        damping: of the axis itself, as the file gives it [N s/m, N m s/rad].
        lets_go: whether nothing is to hold it.
    """

    plant: AxisPlant
    given: Mapping[str, float | Gain] = field(default_factory=dict)
    rotation: bool = False
    force: bool = False
    stiffness: float | None = None
    damping: float | None = None
    lets_go: bool = False

    @property
    def soft(self) -> bool:
        """Whether it has a stiffness or damping of its own."""
        return self.stiffness is not None or self.damping is not None

    def of_the_law(self, name: str) -> Gain | None:
        """A gain that the file gives the law on this axis; None where it is to be designed."""
        given = self.given.get(name)
        return Gain(given, "file") if isinstance(given, float | int) else given

    @property
    def own_stiffness(self) -> Gain | None:
        """Its own stiffness; None where the file gives it none."""
        return None if self.stiffness is None else Gain(self.stiffness, "file")

    @property
    def own_damping(self) -> Gain | None:
        """Its own damping; None where the file gives it none."""
        return None if self.damping is None else Gain(self.damping, "file")
