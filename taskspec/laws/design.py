"""Designed gains: rules for what a file leaves out, shared by the laws (docs/language/gains.md).

A designed gain follows from the effective mass h of the axis, the nominal contact stiffness k and
the control period T, so that a task file need not know any of them.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from taskspec.deferred import ca
from taskspec.laws.gains import (
    FORCE_MASS,
    SLIDING_GAIN,
    SLIDING_LAYER,
    AxisDesign,
    AxisPlant,
    Gain,
    LawGain,
    is_number,
)

SMALLEST_MASS = {"linear": 1.0, "angular": 0.05}
_MOTION_BANDWIDTH = 5.0
#: Of the springs and the inertia that they move [Hz].
SPRING_FREQUENCY = 2.0
#: Of springs; a force loop takes 1.
SPRING_DAMPING_RATIO = 0.7
#: A designed force loop answers at this frequency [Hz].
INTEGRAL_FREQUENCY = 2.0
#: Of a motion that is commanded by velocity [Hz].
VELOCITY_BANDWIDTH = 2.0
#: M / D of an admittance without a mass of the file [s].
_LAG = 0.005
#: How many times its least stable damping a force loop over a servo has.
GAIN_MARGIN = 3.0
#: Damping of such a loop where no stiffness is known [N s/m].
_UNKNOWN_CONTACT = 500.0
#: K_F of (4.121), which has no integral to rely on.
_REACTION_GAIN = 0.5
_JAMMED = "designed: Lambda_ii, by which the axis does not flip where walls hold the tool"


class DesignedLaw(Protocol):
    """The facts of a law that the rules go by; see `laws.law.ControlLaw`."""

    @property
    def gain_names(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def derived(self) -> tuple[LawGain, ...]: ...  # noqa: D102
    @property
    def force_loop(self) -> bool: ...  # noqa: D102
    @property
    def natural(self) -> bool: ...  # noqa: D102
    @property
    def damps_joints(self) -> bool: ...  # noqa: D102


def accelerations(law: DesignedLaw, axis: AxisDesign) -> dict[str, Gain]:
    """Gains of an axis that either moves by acceleration, is soft, or follows a force."""
    if axis.force:
        return force_loop(law, axis)
    if axis.soft:
        return _soft(axis)
    bandwidth = axis.of_the_law("bandwidth") or Gain(_MOTION_BANDWIDTH, "designed: 5 Hz")
    ratio = axis.of_the_law("damping_ratio") or Gain(1.0, "designed: 1")
    w = 2 * math.pi * bandwidth.value
    sliding = {gain.name: axis.of_the_law(gain.name) for gain in (SLIDING_LAYER, SLIDING_GAIN)}
    return {
        "bandwidth": bandwidth,
        "damping_ratio": ratio,
        "K_P": Gain(w**2, "(2 pi bandwidth)^2"),
        "K_D": Gain(2 * ratio.value * w, "2 damping_ratio 2 pi bandwidth"),
    } | {name: gain for name, gain in sliding.items() if gain is not None}


def springs(law: DesignedLaw, axis: AxisDesign) -> dict[str, Gain]:
    """Gains of an axis that a spring and a damper hold, beside a force loop if the law has one."""
    plant = axis.plant
    # Where the arm keeps its own inertia, an axis moves its effective mass while the springs
    # of the other axes hold them: at the wrist ten times the free one.
    smallest = SMALLEST_MASS["angular" if axis.rotation else "linear"]
    h = max(plant.held if law.natural else plant.h, smallest)
    mass = axis.of_the_law("mass") or Gain(h, "designed: effective mass of the axis")
    # The inverse-dynamics core leaves nothing to move but `mass`, so that is what dampers stop.
    moved = plant if law.natural else replace(plant, h=mass.value)
    if not law.natural and mass.origin != "file" and mass.value < plant.jammed:
        mass = Gain(plant.jammed, _JAMMED)
    stiffness = (
        axis.own_stiffness
        or axis.of_the_law("stiffness")
        or Gain(h * (2 * math.pi * SPRING_FREQUENCY) ** 2, "designed: h (2 pi 2 Hz)^2")
    )
    damping = axis.own_damping or axis.of_the_law("damping")
    loop = axis.force and law.force_loop
    held = Gain(0.0, "free") if axis.lets_go and not loop else stiffness
    gains = {"mass": mass, "stiffness": held}
    if loop:
        if damping is None and plant.k == 0 and plant.damper is None:
            # Nothing but the spring brings the axis back.
            damping = _spring_damping(mass, stiffness, 0.0, moved)
        own = force_loop(law, replace(axis, plant=moved), damping)
        return gains | {
            "damping": own["force.damping"],
            "force.proportional": axis.of_the_law("force.proportional")
            or _beside_motion(natural=law.natural),
            "force.integral": own["force.integral"],
        }
    if "damping" not in law.gain_names or law.damps_joints:
        return gains
    k = plant.k if axis.force and not axis.lets_go else 0.0
    return gains | {"damping": damping or _spring_damping(mass, stiffness, k, moved)}


def force_loop(law: DesignedLaw, axis: AxisDesign, damping: Gain | None = None) -> dict[str, Gain]:
    """Gains of a force loop on an axis or an equation.

    Args:
        law: of the stage.
        axis: the axis, or the direction of an equation's gradient.
        damping: that is given otherwise; None for that of the loop, which may be designed.
    """
    plant, mass = axis.plant, None
    if FORCE_MASS in law.derived and plant.jams:
        mass = Gain(plant.jammed, _JAMMED)
    damping = damping or axis.of_the_law("force.damping")
    if damping is None and plant.damper is not None:
        damping = Gain(plant.damper, "designed: a Lambda_ii, a = 100/s or 1/(3 T)")
    elif damping is None and math.isinf(plant.k):
        damping = Gain(0.0, "designed: 0 along an exact equation, where nothing moves")
    elif damping is None:
        stiffest = max(plant.k, plant.face)
        damping = limited(2 * _root(plant.h * stiffest), plant, "designed: 2 sqrt(h k)")
    integral = axis.of_the_law("force.integral")
    if integral is None and plant.face > plant.k and "stiffness" not in law.gain_names:
        # What it had gathered while the tool lay down on its edge it would take seconds to lose;
        # nothing pulls against the set point, and what is not fed forward the face holds.
        integral = Gain(0.0, "designed: 0 about a face")
    elif integral is None:
        integral = _integral(plant, damping.value)
    integrates = "force.integral" in law.gain_names
    usual = 0.0 if integrates else _REACTION_GAIN
    proportional = axis.of_the_law("force.proportional") or Gain(usual, f"designed: {usual:g}")
    loop = {"force.proportional": proportional, "force.damping": damping}
    loop |= {"force.integral": integral} if integrates else {}
    return loop | ({"force.mass": mass} if mass is not None else {})


def velocities(law: DesignedLaw, axis: AxisDesign) -> dict[str, Gain]:
    """Gains of an axis that is commanded by velocity: of its motion, or p, i and d of its force."""
    if not axis.force:
        return _followed(axis)
    proportional = axis.of_the_law("force.proportional") or Gain(1.0, "designed: 1")
    integral, damping = axis.of_the_law("force.integral"), axis.of_the_law("force.damping")
    loop, k = axis.plant.servo, axis.plant.k
    if loop is not None and math.isinf(k):
        k = loop.stiffness
    if damping is None:
        damping = _over_servo(axis.plant)
        if "force.integral" in law.gain_names:
            # Beside the integral that goes with this, which is later than that of the larger one.
            damping = _over_servo(axis.plant, integral=k / (8 * damping.value))
    gains = {"force.proportional": proportional, "force.damping": damping}
    if "force.integral" in law.gain_names:
        gains["force.integral"] = integral or Gain(k / (8 * damping.value), "designed: k / (8 d)")
    return gains


def admittance(law: DesignedLaw, axis: AxisDesign) -> dict[str, Gain]:  # noqa: ARG001
    """M, D and K of an axis that a force moves; the bandwidth of one that no force moves."""
    if not (axis.force or axis.soft):
        return _followed(axis)
    damping = axis.own_damping or axis.of_the_law("damping")
    stiffness = Gain(0.0, "free") if axis.force else axis.own_stiffness or Gain(0.0, "none given")
    mass = axis.of_the_law("mass")
    if damping is None:
        moved = {"lag": _LAG} if mass is None else {"mass": mass.value}
        damping = _over_servo(axis.plant, spring=stiffness.value, **moved)
        if mass is not None:
            # A mass may be stable without any, and swing for long.
            loop = axis.plant.servo
            returns = stiffness.value + (loop.stiffness if loop is not None and loop.known else 0.0)
            own = 2 * SPRING_DAMPING_RATIO * math.sqrt(mass.value * returns)
            if own > damping.value:
                damping = Gain(own, "designed: 2 0.7 sqrt(mass stiffness), drives and contact")
    if mass is None:
        mass = Gain(_LAG * damping.value, f"designed: {_LAG * 1e3:g} ms damping")
    band = axis.of_the_law("dead_band")
    gains = {"mass": mass, "damping": damping, "stiffness": stiffness}
    return gains | ({} if band is None else {"dead_band": band})


def _followed(axis: AxisDesign) -> dict[str, Gain]:
    """Of a motion that velocities follow."""
    bandwidth = axis.of_the_law("bandwidth") or Gain(VELOCITY_BANDWIDTH, "designed: 2 Hz")
    return {
        "bandwidth": bandwidth,
        "K_V": Gain(2 * math.pi * bandwidth.value, "2 pi bandwidth"),
    }


def _over_servo(plant: AxisPlant, **law: float) -> Gain:
    """The damping of a force loop that a servo follows: three times the least that is stable.

    The least one has the loop's gain 1 where its phase is -180 degrees, so that three times as much
    is a gain margin of three.

    Args:
        plant: with the servo.
        law: what else acts on the axis, see `ServoLoop.least_damping`.
    """
    if plant.servo is None or not plant.servo.known:
        return Gain(_UNKNOWN_CONTACT, "designed: no stiffness is known")
    least, rings = plant.servo.least_damping(**law)
    rule = (
        f"designed: {GAIN_MARGIN:g} times the least that is stable, which rings at {rings:.3g} Hz"
    )
    return Gain(GAIN_MARGIN * least, rule)


def _integral(plant: AxisPlant, damping: float) -> Gain:
    """The slowest of what rules allow the integral of a force loop.

    A force axis between walls has the loop m s^3 + d s^2 + k s + i k, stable below i = d / m. One
    of a held mechanism moves the arm with all others held by the grip: with k and d_e of the
    grip and this Lambda_ii its loop is Lambda_ii s^3 + (d + d_e) s^2 + k s + i k, stable below
    i = (d + d_e) / Lambda_ii. A quarter of either is taken.
    """
    rules = [Gain(2 * math.pi * INTEGRAL_FREQUENCY, "designed: 2 pi 2 Hz")]
    if not is_number(damping) or damping > 0:
        rules.append(Gain(plant.k / (8 * damping), "designed: k / (8 d)"))
    if plant.jams:
        rules.append(Gain(damping / (4 * plant.jammed), "designed: d / (4 m)"))
    if plant.grip is not None and plant.k > 0:
        by_mass = (damping + plant.grip) / (4 * plant.held)
        rules.append(Gain(by_mass, "designed: (d + d_e) / (4 Lambda_ii)"))
    if all(is_number(rule.value) for rule in rules):
        return min(rules, key=lambda rule: rule.value)
    least = functools.reduce(ca.fmin, [rule.value for rule in rules])
    return Gain(least, "designed: the least of its rules")


def joint_damping(given: Sequence[float] | None, joints: Sequence[AxisPlant]) -> dict[str, Gain]:
    """Damping of each joint [N m s/rad], by `joint.N`.

    Args:
        given: by the file, one for all joints or one for each; None for designed ones.
        joints: for each joint, its inertia with the others free (h) and held, and the stiffness
            that springs and contact have about it (k).
    """
    if given is not None:
        values = [*given] * len(joints) if len(given) == 1 else given
        return {f"joint.{i + 1}": Gain(value, "file") for i, value in enumerate(values)}
    return {
        f"joint.{i + 1}": limited(
            2 * SPRING_DAMPING_RATIO * math.sqrt(plant.held * plant.k),
            plant,
            "designed: 2 0.7 sqrt(H_ii (J^T K J)_ii)",
        )
        for i, plant in enumerate(joints)
    }


def limited(wanted: float, plant: AxisPlant, rule: str) -> Gain:
    """A damping that a rule gives, or the most that sampling allows if that is less."""
    if not (is_number(wanted) and is_number(plant.most_damping)):
        return Gain(ca.fmin(wanted, plant.most_damping), rule)
    if wanted <= plant.most_damping:
        return Gain(wanted, rule)
    return Gain(plant.most_damping, "designed: h / (3 T), the most that sampling allows")


def _root(value: float) -> float:
    """The square root of a number, or of what varies."""
    root: float = math.sqrt(value) if is_number(value) else ca.sqrt(ca.fmax(value, 0))
    return root


def _beside_motion(*, natural: bool) -> Gain:
    """K_F of a force loop that shares its axis with a motion."""
    if natural:
        return Gain(0.0, "designed: 0")
    return Gain(1.0, "designed: K_F = 1 leaves the contact force uncancelled")


def _spring_damping(mass: Gain, stiffness: Gain, k: float, plant: AxisPlant) -> Gain:
    wanted = 2 * SPRING_DAMPING_RATIO * _root(mass.value * (stiffness.value + k))
    return limited(wanted, plant, "designed: 2 0.7 sqrt(h (stiffness + k))")


def _soft(axis: AxisDesign) -> dict[str, Gain]:
    plant = axis.plant
    stiffness = axis.own_stiffness or Gain(0.0, "none given")
    damping = axis.own_damping
    if damping is None:
        wanted = 2 * SPRING_DAMPING_RATIO * math.sqrt(plant.h * stiffness.value)
        damping = Gain(min(wanted, plant.most_damping), "designed: 2 0.7 sqrt(h stiffness)")
    return {"stiffness": stiffness, "damping": damping}
