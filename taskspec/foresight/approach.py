"""How a stage comes to its surface."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.foresight.ranges import Ranges
from taskspec.geometry.axis import TRANSLATIONS, Axis
from taskspec.laws.gains import on_axis
from taskspec.motion.blend import BLEND_TIME, from_rest, ramp_shape
from taskspec.program.axes import MOSTLY
from taskspec.program.conditions import bounds_of, names, value_of
from taskspec.program.interval import Interval, IntervalAlgebra, point
from taskspec.program.plan import StagePlan
from taskspec.program.walk.nominal import AT_SURFACE
from taskspec.text.expression.tree import Held

Vector = NDArray[np.float64]

#: Steps towards a fixed point, which is come to from below.
_NARROWINGS = 30
#: Half periods of a mass on its contact after which the blow is over.
_BLOWS = 3.0
#: From here on the arm can hardly move along some axis.
_SINGULAR = 1e8


@dataclass(frozen=True, slots=True)
class Approach:
    """A stage on its way to its surface.

    Attributes:
        contact: the object.
        axis: mostly along its normal, that moves.
        rates: (3,) constant velocities along the frame's axes [m/s].
        closing: along the normal [m/s].
        gap: from the object as the stage starts [m]; None where that is unknown.
    """

    contact: str
    axis: Axis
    rates: Vector
    closing: float
    gap: float | None

    @property
    def speed(self) -> float:
        """Of the tool [m/s]."""
        return float(np.linalg.norm(self.rates))


def approach(stage: StagePlan, gap: float | None) -> Approach | None:
    """How a stage comes to its surface; None where it does not, or is there already.

    Args:
        stage: the stage.
        gap: from its contact as it starts [m]; None where that is unknown.
    """
    contact = stage.contacts.approached
    if contact is None or stage.spec.until is None:
        return None
    gap = gap if contact == stage.contacts.main else None
    if gap is not None and gap < AT_SURFACE:
        return None
    normal, rates = stage.contacts.normal(contact), rates_of(stage)
    closing = -float(normal @ stage.rotation @ rates)
    if closing <= 0:
        return None
    fits = {a: abs(stage.kinematics.along(a, normal)) for a in moved(rates)}
    axis = max(fits, key=lambda a: fits[a])
    if fits[axis] < MOSTLY or not waits_for_contact(stage):
        return None
    return Approach(contact, axis, rates, closing, gap)


def meeting(stage: StagePlan, way: Approach) -> float:
    """How fast the tool is at its surface [m/s]: near the start it has not risen to its rate.

    The reference goes on to rise until the blow is at its peak, a quarter of its period later.
    """
    contact, gap = way.contact, way.gap
    if gap is None and stage.name == next(iter(stage.context.loaded.task.stages)):
        gap = stage.context.start_gaps.get(contact)
    timed = any(e.uses("t") for e, _ in stage.spec.axes[way.axis].mode.expressions())
    if gap is None or timed or any(stage.nominal.carried.values()):
        return way.closing
    time = max(gap, 0.0) / way.closing
    if time >= BLEND_TIME / 2:
        return way.closing
    low, high = 0.0, BLEND_TIME
    for _ in range(_NARROWINGS):
        t = (low + high) / 2
        low, high = (t, high) if from_rest(t) < time else (low, t)
    h, k = striking_mass(stage, way.axis), stage.context.compliances[contact].stiffness
    peak = high + math.pi / 2 * math.sqrt(h / k)
    return way.closing * float(ramp_shape(peak / BLEND_TIME))


def rates_of(stage: StagePlan) -> Vector:
    """(3,) velocities of a stage along its frame's axes, constant or risen to [m/s].

    A force that shares an axis with a motion adds nothing where nothing is touched.
    """
    rates = np.zeros(3)
    for axis, entry in stage.spec.axes.items():
        if axis in stage.translations and entry.mode.moves:
            rates[axis.row] = entry.mode.settled_rate(stage.known) or 0.0
    return np.where(np.isfinite(rates), rates, 0.0)


def moved(rates: Vector) -> list[Axis]:
    """The axes whose velocity, of (3,), is not zero."""
    return [a for a, rate in zip(TRANSLATIONS, rates, strict=True) if rate]


def waits_for_contact(stage: StagePlan) -> bool:
    """Whether the guard of a stage cannot hold before something is felt."""
    until = stage.spec.until
    if until is None:
        return False
    contact_signals: dict[str, Interval] = {
        str(n): point(0.0) for n in names(until.tree) if n.path[0] in ("force", "torque")
    }
    contact_signals["touching"] = point(0.0)
    inner = until.tree.x if isinstance(until.tree, Held) else until.tree
    ranges = Ranges(stage, contact_signals)
    return value_of(inner, IntervalAlgebra(), ranges).never


def ends_by_touch(stage: StagePlan) -> bool:
    """Whether a stage comes from free space, by a motion alone, and ends before the blow's peak.

    A mass h on a spring k is at its peak after a quarter of its period, pi/2 sqrt(h/k); a guard
    that waits for twice that has the peak in its own stage.
    """
    gap, task = stage.nominal.gap, stage.context.loaded.task
    begins_free = gap is None or gap >= AT_SURFACE
    pushes = any(plan.set_point for plan in stage.plans.values()) or stage.spec.constraints
    held = task.robot.grasp is not None
    if not begins_free or held or pushes or not waits_for_contact(stage):
        return False
    until = stage.spec.until
    if until is None or not isinstance(until.tree, Held):
        return True
    way = approach(stage, gap)
    if way is None:
        return False
    h, k = striking_mass(stage, way.axis), stage.context.compliances[way.contact].stiffness
    return until.tree.amount.value_si < math.pi * math.sqrt(h / k)


def striking_mass(stage: StagePlan, axis: Axis) -> float:
    """Mass that strikes [kg]: the arm's own along an axis, or the apparent one of its law."""
    own = {name: by_axis[axis] for name, by_axis in stage.gains.items() if axis in by_axis}
    return float(stage.law.control_law.strikes_with(own, stage.design_rules.plants[axis].h))


def dragged(stage: StagePlan, axis: Axis, time: float) -> float:
    """By how much later an axis that goes at a constant rate comes to a place than its reference.

    A damper on the velocity itself pulls at the spring: d x' = k (x_d - x), with the mass left out,
    lets x be where x_d was tau (1 - exp(-t / tau)) ago, tau = d / k.

    Args:
        stage: the stage.
        axis: a translation.
        time: at which the reference comes there, since it set off [s].

    Returns:
        [s]; 0 where the law's damper acts on the error.
    """
    drag = stage.law.control_law.drag(on_axis(stage.gains, axis))
    if drag is None:
        drag = _joint_drag(stage, axis)
    own = stage.spring_of(axis) if drag else 0.0
    if own <= 0:
        return 0.0
    tau, later = drag / own, 0.0
    for _ in range(_NARROWINGS):
        later = tau * -math.expm1(-(time + later) / tau)
    return later


def damping_of(stage: StagePlan, axis: Axis, mass: float) -> float:
    """Damper of a motion axis, on its error or on its velocity [N s/m].

    Args:
        stage: the stage.
        axis: a translation.
        mass: that strikes [kg].
    """
    gains = on_axis(stage.gains, axis)
    if stage.law.control_law.drag(gains) is None:
        return _joint_drag(stage, axis)
    return gains.get("damping", mass * gains.get("K_D", 0.0))


def deepened(stage: StagePlan, way: Approach) -> float | None:
    """The force to which a touch that has to last comes while its reference goes on [N].

    h x'' = k_m (v t - x) + d_m (v - x') - k x - b x' once the blow is over: x' = v k_m / (k + k_m)
    and (k + k_m) x = k_m v t + d_m (v - x').

    Args:
        stage: whose guard has to hold for some time.
        way: how it comes to its surface.

    Returns:
        None where the blow is not over by then, where a force shares the axis, where no
        spring follows the reference, and where the program may give way.
    """
    t, contact = dwell(stage), stage.context.compliances[way.contact]
    h, k, b = striking_mass(stage, way.axis), contact.stiffness, contact.damping
    own = stage.spring_of(way.axis, h)
    if stage.spec.axes[way.axis].has_force or stage.law.solve == "qp" or own <= 0:
        return None
    if t < _BLOWS * math.pi * math.sqrt(h / k) or not math.isfinite(k):
        return None
    damper, v = damping_of(stage, way.axis, h), way.closing
    rate = v * own / (k + own)
    return k * (own * v * t + damper * (v - rate)) / (k + own) + b * rate


def dwell(stage: StagePlan) -> float:
    """How long the guard of a stage has to hold [s]."""
    until = stage.spec.until
    return until.tree.amount.value_si if until and isinstance(until.tree, Held) else 0.0


def _joint_drag(stage: StagePlan, axis: Axis) -> float:
    """Damping along an axis of what brakes the joints, the law's damper and their own [N s/m].

    ((J D^-1 J^T)^-1)_aa at the start pose, the other axes held: of the rates of the joints that
    move the tip so, the ones that lose least.
    """
    n = stage.context.robot.pin.nv
    damping = np.zeros(n) + np.array(stage.context.loaded.task.robot.joint_damping, dtype=float)
    by_joint = [gain.value for gain in stage.gains.get("joint_damping", {}).values()]
    if by_joint and len(by_joint) != n:
        return 0.0  # There is a finding about that.
    damping += by_joint or np.zeros(n)
    if not (damping > 0).all():
        return 0.0
    J = stage.kinematics.jacobian[[a.row for a in stage.axes]]
    mobility = J / damping @ J.T
    if np.linalg.cond(mobility) > _SINGULAR:
        return 0.0
    i = stage.axes.index(axis)
    return float(np.linalg.inv(mobility)[i, i])


def force_at_end(stage: StagePlan) -> float:
    """The force from which on the guard of a stage that comes to a surface holds [N]."""
    assert stage.spec.until is not None
    guard = stage.spec.until.tree
    guard = guard.x if isinstance(guard, Held) else guard
    ranges = Ranges(stage, {})
    bounds = bounds_of([guard], IntervalAlgebra(), ranges)
    forces = [
        min(abs(interval.low), abs(interval.high))
        for quantity, interval in bounds.items()
        if any(name.path[0] == "force" for name in names(quantity))
        and not interval.low <= 0 <= interval.high
    ]
    return max((f for f in forces if math.isfinite(f)), default=0.0)
