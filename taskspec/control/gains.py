"""Gains: those of the file, and designed ones for what the file leaves out (docs/language.md).

A designed gain follows from the mass h that the axis feels, the believed contact stiffness k and
the control period T, so that a task file need not know any of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from taskspec.geometry.axis import Axis
from taskspec.spec import LAWS, AxisEntry, AxisValues, Law, LawFacts

_SMALLEST_MASS = {"linear": 1.0, "angular": 0.05}
_MOTION_BANDWIDTH = 5.0
_SPRING_FREQUENCY = 2.0
_SPRING_DAMPING_RATIO = 0.7
#: A designed force loop answers at this frequency [Hz].
INTEGRAL_FREQUENCY = 2.0
#: K_F of (4.121), which has no integral to rely on.
_REACTION_GAIN = 0.5


@dataclass(frozen=True, slots=True)
class Gain:
    """One number [SI] and where it came from: "file" or the rule that designed it."""

    value: float
    origin: str


@dataclass(frozen=True, slots=True)
class Plant:
    """What the design of one axis knows about arm and contact.

    Attributes:
        h: mass felt along the axis while the others are free, 1/(J H^-1 J^T)_ii [kg, kg m^2].
        held: the same while the others are held, Lambda_ii.
        k: believed contact stiffness [N/m, N m/rad]. period: control period T [s].
    """

    h: float
    held: float
    k: float
    period: float

    @property
    def most_damping(self) -> float:
        """h / (3 T): what a damper held over one period can remove without overshooting."""
        return self.h / (3 * self.period)


def has_force(axis: AxisEntry) -> bool:
    """Whether the axis has a force or torque set point."""
    return axis.force is not None or axis.torque is not None


def is_soft(axis: AxisEntry) -> bool:
    """Whether the axis is a motion axis with a stiffness or damping of its own."""
    return axis.stiffness is not None or axis.damping is not None


#: name of the gain -> axis -> gain
Gains = dict[str, dict[str, Gain]]


def design(law: Law, axes: Mapping[Axis, AxisEntry], plants: Mapping[Axis, Plant]) -> Gains:
    """All gains of a stage, by name and axis.

    Args:
        law: the stage's law with the gains that the file gives.
        axes: modes of the axes that exist.
        plants: mass and stiffness of the same axes.
    """
    build = _accelerations if "bandwidth" in LAWS[law.kind].gains else _springs
    gains: Gains = {}
    for name, axis in axes.items():
        for gain, value in build(law, name, axis, plants[name]).items():
            gains.setdefault(gain, {})[name] = value
    return gains


def design_constraint(law: Law, joints: bool, plant: Plant) -> dict[str, Gain]:
    """Gains of the force loop of one equation.

    Args:
        law: with what the file gives; an equation takes what is given for translations, one on
            joints what is given for rotations.
        joints: whether it is on joints. plant: mass and stiffness along its unit gradient.
    """
    return _force_loop(law, Axis.RX if joints else Axis.X, plant)


def design_joint_damping(law: Law, joints: Sequence[Plant]) -> dict[str, Gain]:
    """Damping of each joint [N m s/rad], by `joint.N`.

    Args:
        law: with what the file gives. joints: for each joint, its inertia with the others free
            (h) and held, and the stiffness that springs and contact have about it (k).
    """
    given = law.joint_damping
    if given is not None:
        values = given * len(joints) if len(given) == 1 else given
        return {f"joint.{i + 1}": Gain(value, "file") for i, value in enumerate(values)}
    return {
        f"joint.{i + 1}": _limited(
            2 * _SPRING_DAMPING_RATIO * math.sqrt(plant.held * plant.k),
            plant,
            "designed: 2 0.7 sqrt(H_ii (J^T K J)_ii)",
        )
        for i, plant in enumerate(joints)
    }


def _limited(wanted: float, plant: Plant, rule: str) -> Gain:
    if wanted <= plant.most_damping:
        return Gain(wanted, rule)
    return Gain(plant.most_damping, "designed: h / (3 T), the most that sampling allows")


def _accelerations(law: Law, name: Axis, axis: AxisEntry, plant: Plant) -> dict[str, Gain]:
    if has_force(axis):
        return _force_loop(law, name, plant)
    if is_soft(axis):
        return _soft(axis, plant)
    bandwidth = _given(law.bandwidth, name) or Gain(_MOTION_BANDWIDTH, "designed: 5 Hz")
    ratio = _given(law.damping_ratio, name) or Gain(1.0, "designed: 1")
    w = 2 * math.pi * bandwidth.value
    return {
        "bandwidth": bandwidth,
        "damping_ratio": ratio,
        "K_P": Gain(w**2, "(2 pi bandwidth)^2"),
        "K_D": Gain(2 * ratio.value * w, "2 damping_ratio 2 pi bandwidth"),
    }


def _springs(law: Law, name: Axis, axis: AxisEntry, plant: Plant) -> dict[str, Gain]:
    facts = LAWS[law.kind]
    # Where the arm keeps its own inertia, an axis moves the mass that it feels while the springs
    # of the other axes hold them: at the wrist ten times the free one.
    h = max(plant.held if facts.natural else plant.h, _smallest(name))
    mass = _given(law.mass, name) or Gain(h, "designed: mass felt on the axis")
    # The inverse-dynamics core leaves nothing to move but `mass`, so that is what dampers stop.
    moved = plant if facts.natural else replace(plant, h=mass.value)
    stiffness = (
        _own(axis.stiffness)
        or _given(law.stiffness, name)
        or Gain(h * (2 * math.pi * _SPRING_FREQUENCY) ** 2, "designed: h (2 pi 2 Hz)^2")
    )
    given_damping = _own(axis.damping) or _given(law.damping, name)
    gains = {"mass": mass, "stiffness": stiffness}
    if has_force(axis) and facts.force_loop:
        loop = _force_loop(law, name, moved, given_damping)
        gains |= {
            "damping": loop["force.damping"],
            "force.proportional": _force_given(law, "proportional", name)
            or _force_proportional(facts),
            "force.integral": loop["force.integral"],
        }
        return gains
    if "damping" not in facts.gains or facts.damps_joints:
        return gains
    k = plant.k if has_force(axis) else 0.0
    return gains | {"damping": given_damping or _spring_damping(mass, stiffness, k, moved)}


def _force_proportional(facts: LawFacts) -> Gain:
    if facts.natural:
        return Gain(0.0, "designed: 0")
    return Gain(1.0, "designed: K_F = 1 leaves the contact force uncancelled")


def _spring_damping(mass: Gain, stiffness: Gain, k: float, plant: Plant) -> Gain:
    wanted = 2 * _SPRING_DAMPING_RATIO * math.sqrt(mass.value * (stiffness.value + k))
    return _limited(wanted, plant, "designed: 2 0.7 sqrt(h (stiffness + k))")


def _force_loop(law: Law, name: Axis, plant: Plant, damping: Gain | None = None) -> dict[str, Gain]:
    facts = LAWS[law.kind]
    damping = damping or _force_given(law, "damping", name)
    if damping is None:
        damping = _limited(2 * math.sqrt(plant.h * plant.k), plant, "designed: 2 sqrt(h k)")
    integral = _force_given(law, "integral", name)
    if integral is None:
        fastest = 2 * math.pi * INTEGRAL_FREQUENCY
        by_contact = plant.k / (8 * damping.value) if damping.value > 0 else fastest
        integral = (
            Gain(fastest, "designed: 2 pi 2 Hz")
            if fastest <= by_contact
            else Gain(by_contact, "designed: k / (8 d)")
        )
    usual = 0.0 if "force.integral" in facts.gains else _REACTION_GAIN
    proportional = _force_given(law, "proportional", name) or Gain(usual, f"designed: {usual:g}")
    loop = {"force.proportional": proportional, "force.damping": damping}
    return loop | ({"force.integral": integral} if "force.integral" in facts.gains else {})


def _soft(axis: AxisEntry, plant: Plant) -> dict[str, Gain]:
    stiffness = _own(axis.stiffness) or Gain(0.0, "none given")
    damping = _own(axis.damping)
    if damping is None:
        wanted = 2 * _SPRING_DAMPING_RATIO * math.sqrt(plant.h * stiffness.value)
        damping = Gain(min(wanted, plant.most_damping), "designed: 2 0.7 sqrt(h stiffness)")
    return {"stiffness": stiffness, "damping": damping}


def _smallest(name: Axis) -> float:
    return _SMALLEST_MASS["angular" if name.is_rotation else "linear"]


def _own(value: float | None) -> Gain | None:
    return None if value is None else Gain(value, "file")


def _given(values: AxisValues | None, name: Axis) -> Gain | None:
    return _own(None if values is None else values.get(name))


def _force_given(law: Law, gain: str, name: Axis) -> Gain | None:
    return None if law.force is None else _given(getattr(law.force, gain), name)


def diagonal(gains: Gains, name: str, axes: Sequence[str], default: float = 0.0) -> list[float]:
    """One gain on all axes, `default` where an axis has none."""
    given = gains.get(name, {})
    return [given[a].value if a in given else default for a in axes]
