"""Stages that meet a surface: the peak of force there, and bounds that end them before it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from taskspec.foresight.approach import (
    Approach,
    approach,
    damping_of,
    deepened,
    dragged,
    dwell,
    force_at_end,
    meeting,
    moved,
    rates_of,
    striking_mass,
    waits_for_contact,
)
from taskspec.foresight.conditions import names, parts, value_of
from taskspec.geometry.axis import Axis
from taskspec.motion.blend import BLEND_TIME
from taskspec.program.axes import MOSTLY
from taskspec.program.components import ends, nominal
from taskspec.program.context import Context
from taskspec.program.flow import good_end
from taskspec.program.held_part import HeldPart
from taskspec.program.interval import ANY, Interval, IntervalAlgebra, point
from taskspec.program.plan import StagePlan
from taskspec.program.walk.nominal import AT_SURFACE
from taskspec.rules import Finding, rule, warning
from taskspec.spec import FILE, Within
from taskspec.text.diagnostic import Severity
from taskspec.text.expression.tree import Call, Node, Reduce, walk
from taskspec.text.units import inside, show

#: The peak of a critically damped impact against that of an undamped one: the least that the
#: stage that follows can make of it. Measured with designed gains: 0.42 to 0.62.
_LEAST_SHARE = math.exp(-1.0)
#: By this share less a reference that goes on may press than its spring says.
_DOUBT = 0.1
#: Of the half period of a blow, at how many instants its force is looked at.
_INSTANTS = 2001
#: A press is not followed any longer.
_MOST_STEPS = 5000


@rule("TS617", "a bound that ends a stage before it comes to its surface")
def surfaces_not_reached(stage: StagePlan) -> Iterator[Finding]:
    """Stages that move away from what they wait to feel, or whose bound ends them before it."""
    yield from _away(stage)
    way = approach(stage, stage.nominal.gap)
    if way is not None:
        yield from _short(stage, way)


@rule("TS616", "an impact beyond the limit on force, or beyond what is expected")
def hard_impacts(stage: StagePlan) -> Iterator[Finding]:
    """An impact beyond a bound: a mass h at speed v on a spring k makes v sqrt(h k)."""
    context, stages = stage.context, stage.context.loaded.task.stages
    way = approach(stage, stage.nominal.gap)
    if way is None or any(_short(stage, way)):
        return
    yield from _goes_on(stage, way)
    after = good_end(stages, stage.name)
    limits = [stage.limits.force]
    if after is not None:
        limits.append(StagePlan(context, after).limits.force)
    contact, closing = way.contact, meeting(stage, way)
    h = striking_mass(stage, way.axis)
    k, b = context.compliances[contact].stiffness, context.compliances[contact].damping
    peak = closing * max(math.sqrt(h * k), b)
    known = [limit for limit in limits if limit is not None]
    if len(known) < len(limits) or peak <= max(known):
        yield from _unexpected(stage, way, h, peak, after)
        return
    most = max(known)
    softest = min([k, *_stiffnesses(context, contact)])
    least = _LEAST_SHARE * closing * math.sqrt(h * softest)
    certain = least > most and _lasts(most / least, h, k, b) >= context.period
    stops = certain and stage.law.solve == "closed-form"
    slower = show(inside(closing * most / peak, upper=True, digits=2), "mm/s")
    yield Finding(
        "TS616",
        f"{_meets(stage, way, h)} {'make' if certain else 'may make'} about "
        f"{show(peak, 'N', 3)}, and the limit on force is {show(most, 'N')}",
        FILE.stages[stage.name].axes[way.axis].velocity,
        f"approach with {slower} or less, or raise the limit",
        severity=Severity.ERROR if stops else Severity.WARNING,
    )


def _lasts(share: float, h: float, k: float, b: float) -> float:
    """How long [s] a blow is above a share of the peak v sqrt(h k) of an undamped one.

    Its mass h is on a spring k and a damper b, h x'' = -f with f = k x + b x' from x' = v on. One
    that lasts for less than a tick may pass between two samples of the force: undamped it is half
    a sine, critically damped it falls from twice that peak to two thirds of it in 0.68 sqrt(h/k).
    """
    zeta, times = b / (2 * math.sqrt(h * k)), np.linspace(0.0, math.pi, _INSTANTS)
    # Of a critically damped blow the two roots are one: they are set apart by little.
    apart = np.emath.sqrt(zeta**2 - 1.0 - 1e-12)
    slow, fast = apart - zeta, -apart - zeta
    force = (fast**2 * np.exp(fast * times) - slow**2 * np.exp(slow * times)) / (slow - fast)
    return float(np.mean(force.real >= share)) * math.pi * math.sqrt(h / k)


def _goes_on(stage: StagePlan, way: Approach) -> Iterator[Finding]:
    """A touch that has to last, while the reference goes on to more than the limit on force."""
    most, force = stage.limits.force, deepened(stage, way)
    if most is None or force is None or (1 - _DOUBT) * force <= most:
        return
    yield warning(
        "TS616",
        f"the guard of stage {stage.name!r} has to hold for {show(dwell(stage), 's', 3)}: "
        f"meanwhile {way.axis!r} goes on with {show(way.closing, 'mm/s', 3)} and presses with "
        f"about {show(force, 'N', 3)}, and the limit on force is {show(most, 'N')}",
        FILE.stages[stage.name].until,
        "let it hold for less time, approach more slowly, or raise the limit",
    )


def _meets(stage: StagePlan, way: Approach, h: float) -> str:
    k = stage.context.compliances[way.contact].stiffness
    return (
        f"stage {stage.name!r} meets {way.contact!r} with {show(meeting(stage, way), 'mm/s', 3)}: "
        f"{show(h, 'kg', 2)} on {show(k, 'kN/m', 3)}"
    )


def _unexpected(
    stage: StagePlan, way: Approach, h: float, peak: float, after: str | None
) -> Iterator[Finding]:
    """Expectations of the largest force that the impact may break."""
    for expectation in stage.context.loaded.task.expect:
        for part in parts(expectation.expression.tree):
            reduced = largest_force(part, stage.name, after)
            if reduced is None:
                continue
            met: dict[Node, Interval] = {reduced: point(peak)}
            algebra = IntervalAlgebra()
            broken = value_of(part, algebra, lambda _: ANY, met).never
            if not broken or value_of(part, algebra, lambda _: ANY).never:
                continue  # What no force at all would meet is told by itself.
            yield warning(
                "TS616",
                f"{_meets(stage, way, h)} may make about {show(peak, 'N', 3)}, which is beyond "
                "what is expected here",
                expectation.expression.where(part),
                "approach more slowly, or expect that much",
            )


def largest_force(part: Node, stage: str, after: str | None) -> Reduce | None:
    """The `max(norm(force))` of a condition, of the whole run or of one of two stages."""
    found = [node for node in walk(part) if isinstance(node, Reduce)]
    for node in found if len(found) == 1 else ():
        if not (isinstance(node.arg, Call) and node.arg.function == "norm"):
            continue
        inside_norm = [n.path[:-1] for n in names(node.arg)]
        whole = (("force",), (stage, "force"), (after, "force"))
        if node.reducer == "max" and inside_norm and all(n in whole for n in inside_norm):
            return node
    return None


def _away(stage: StagePlan) -> Iterator[Finding]:
    """A stage that waits to feel the only object there is, and moves away from it."""
    context, gap = stage.context, stage.nominal.gap
    alone = len(context.start_gaps) == 1 and not context.loaded.task.equations
    if gap is None or gap < AT_SURFACE or not alone:
        return
    if context.loaded.task.robot.grasp is not None:
        return
    (contact,) = context.start_gaps
    rates = rates_of(stage)
    leaving = float(stage.normal_of(contact) @ stage.rotation @ rates)
    if leaving <= MOSTLY * float(np.linalg.norm(rates)) or not waits_for_contact(stage):
        return
    axis = max(moved(rates), key=lambda a: abs(rates[a.row]))
    back = -float(rates[axis.row])
    yield warning(
        "TS617",
        f"stage {stage.name!r} begins {show(gap, 'mm', 3)} away from {contact!r}, moves away from "
        "it and waits to feel something: its bound ends it before",
        FILE.stages[stage.name].axes[axis].velocity,
        f"did you mean {show(back, 'mm/s')}? the outward normal points away from the object",
    )


def _short(stage: StagePlan, way: Approach) -> Iterator[Finding]:
    """A bound that ends a stage before it comes to its surface."""
    context, frame, gap = stage.context, stage.frame, way.gap
    named = way.contact in (frame.surface_name, frame.owner)
    goes = stage.longest * way.speed
    others = [g for name, g in context.start_gaps.items() if name != way.contact]
    nothing_else = named or all(other > goes for other in others)
    part = HeldPart.of(context) if _first(stage) else None
    begins = f"stage {stage.name!r} begins"
    if part is not None and context.loaded.task.shapes[way.contact].shape == "plane":
        # It comes there before the tool does; of a plane, its farthest points are the nearest.
        # One that sags that far is there at once.
        gap = max(part.gaps[way.contact] - _sags(stage, way.axis, part), 0.0)
        nothing_else = len(part.gaps) == 1
        begins += f" with {part.name!r}"
    within, base = stage.spec.within, None
    if gap is None and stage.frame.surface_name == way.contact and _first(stage):
        # A frame that follows what moves comes nearer to it at the stage's own rate.
        gap, base = context.start_gaps.get(way.contact), context.moving_bases.get(way.contact)
    if gap is None or within is None or not nothing_else or context.loaded.task.equations:
        return
    time, lasts = gap / way.closing, dwell(stage)
    rises = 0.0 if any(stage.nominal.carried.values()) else BLEND_TIME / 2
    needs = {
        "time": time + rises + dragged(stage, way.axis, time) + _presses(stage, way) + lasts,
        "travel": time * way.speed if base is None else _travels(stage, way, time),
    }
    for key, need in needs.items():
        bound = getattr(within, key)
        if bound is None or bound >= need:
            continue
        comes = "comes there"
        if key == "time" and lasts:
            comes = f"has touched it for {show(lasts, 's', 3)}"
        yield warning(
            "TS617",
            f"{begins} {show(gap, 'mm', 3)} away from {way.contact!r} and "
            f"{comes} after {show(need, Within.dimension_of(key), 3)}: this bound ends it before",
            FILE.stages[stage.name].within[key],
            f"raise it, or begin nearer to {way.contact!r}",
            unless=("TS611",),
            unless_at=FILE.stages[stage.name].until,
        )
        return


def _first(stage: StagePlan) -> bool:
    return stage.name == next(iter(stage.context.loaded.task.stages))


def _travels(stage: StagePlan, way: Approach, time: float) -> float:
    """How far a tool is from where the run began that goes with a moving surface, and to it [m]."""
    context = stage.context
    p, base = context.start_p, context.moving_bases[way.contact]
    (A, a), (A0, a0) = base.pose(time), base.pose(0.0)
    taken = A @ A0.T @ (p - a0) + a
    own = A @ A0.T @ stage.rotation @ way.rates * time
    return float(np.linalg.norm(taken + own - p))


def _sags(stage: StagePlan, axis: Axis, part: HeldPart) -> float:
    """By how much the spring of an axis gives way to the weight of what is held, at most [m]."""
    own = stage.spring_of(axis)
    return float(np.linalg.norm(part.weight)) / own if own > 0 else 0.0


def _presses(stage: StagePlan, way: Approach) -> float:
    """How long it takes to press with what the guard waits for, once it touches [s].

    The axis alone, h x'' = k_m (v t - x) + d_m (v - x') - k x - b x' from x = 0 with the speed v,
    presses with k x + b x'. A damper on the velocity itself lets the reference lead, which is the
    same. 0 where it does not come to that before the bound: another rule tells.
    """
    force, v, axis = force_at_end(stage), way.closing, way.axis
    contact, h = stage.context.compliances[way.contact], striking_mass(stage, way.axis)
    own, damper = stage.spring_of(axis, h), damping_of(stage, axis, h)
    if force <= contact.damping * v or own <= 0:
        return 0.0
    k, b = contact.stiffness, contact.damping
    # x, x' and t, whose rate is 1.
    A = np.array([[0, 1, 0, 0], [-(own + k) / h, -(damper + b) / h, own * v / h, damper * v / h]])
    A = np.vstack([A, [0, 0, 0, 1], [0, 0, 0, 0]])
    period = min(stage.context.period, 0.1 * math.sqrt(h / (k + own)), 0.1 * h / (damper + b))
    B, state = A * period, np.array([0.0, v, 0.0, 1.0])
    one = np.eye(len(B))
    step = one + B @ (one + B @ (one + B / 3) / 2)
    for i in range(math.ceil(min(stage.longest / period, _MOST_STEPS))):
        if k * state[0] + b * state[1] >= force:
            return i * period
        state = step @ state
    return 0.0


def _stiffnesses(context: Context, contact: str) -> list[float]:
    """What `truth` and the ends of `vary` make of a contact's stiffness [N/m]."""
    path, task = f"world.{contact}.stiffness", context.loaded.task
    found = [nominal(context, path, None)] if path in task.true_numbers else []
    for variation in task.vary.get(path, ()):
        if variation is not None:
            found += [max(0.0, end) for end in ends(context, path, None, variation)]
    return found
