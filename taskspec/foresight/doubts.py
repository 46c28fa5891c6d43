"""Which tasks are worth being run ahead: where other predictions leave a doubt.

A look at a stage by itself is certain where its guard comes early, its limits are far away and a
force loop brings its forces to their set points in time. It is not where a mechanism leads the
arm, where a spring stands for a force loop, or where a bound is near to what is predicted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from taskspec.foresight.approach import approach, dragged, dwell, rates_of, striking_mass
from taskspec.foresight.conditions import names, parts
from taskspec.foresight.force_profile import force_profiles
from taskspec.geometry.axis import ROTATIONS
from taskspec.laws.gains import on_axis
from taskspec.motion.blend import BLEND_TIME
from taskspec.program.flow import followers, leading_to
from taskspec.program.interval import ANY, Interval, IntervalAlgebra, point
from taskspec.program.passage import End, Passage
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.reference.axis_plan import AxisPlan
from taskspec.program.signals import constant
from taskspec.shapes import BoundedSurface
from taskspec.shapes.plate import CutPlate
from taskspec.spec import Mechanism
from taskspec.text.expression import evaluate
from taskspec.text.expression.tree import Compare, Held, Name, Node, Reduce, walk

#: A bound is near where what is predicted takes this share of it.
_TIME, _TRAVEL, _FORCE, _SPEED, _JOINT = 0.8, 0.8, 0.6, 0.7, 0.8
#: A force comes to no more than so many times what it settles at with its blow.
_FAR = 1.3
#: A motion whose way is not known is long from here on [s].
_LONG = 3.0
#: A limit on force below this is little for what a grip bears on the way of a mechanism [N].
_LITTLE = 40.0
#: A force loop that is stable has settled after so long [s], and one with a given integral not
#: before so many of that one's time constants are over.
_SETTLED, _TIME_CONSTANTS = 1.2, 3.0
#: A rate that rises smoothly changes so many times as fast at most as on the average.
_RISE = 1.5
#: Of what a spring could give the tool as it is left, so much of its rate is seen at most.
_THROWN = 0.3
#: Friction is much from here on: it turns the force of a tool that is moved to and fro.
_ROUGH = 0.5
#: A contact gives way by much of what lies behind it from this share on.
_DEEP = 0.6
#: A body is light for its contact where k T^2 is more than so many masses, T the plant's period.
_LIGHT = 0.5
#: A joint is near to its limit [rad, m].
_ROOM = 0.15
#: Of a period of a tool on its contact, at how many instants its force is looked at.
_INSTANTS = 2001
#: Of the instants of a path of joints, at which places is looked whether the tool is in something.
_EVERY = 4


def doubted(task: TaskPlan) -> Iterator[str]:
    """The stages of a task whose end is in doubt, by their names, in the order of the file."""
    for name, stage in task.framed.items():
        if any(doubt(task, stage) for doubt in _DOUBTS):
            yield name


def _protected(task: TaskPlan, stage: StagePlan) -> bool:  # noqa: ARG001
    """The robot's own controller stops it, at what no reference tells: blows, torques' rates."""
    return task.context.loaded.task.robot.protection is not None


def _deviates(task: TaskPlan, stage: StagePlan) -> bool:  # noqa: ARG001
    """World or robot are not what the controller, and what is told of its stages, goes by."""
    loaded = task.context.loaded
    return loaded.true_task is not loaded.task and bool(loaded.task.truth.paths)


def _tracks(task: TaskPlan, stage: StagePlan) -> bool:  # noqa: ARG001
    """What turns its frame is not known before, nor how fast the joints have to follow that."""
    return stage.frame.tracking is not None


def _pushes(task: TaskPlan, stage: StagePlan) -> bool:
    """What it touches goes away on a mechanism, and resists as that does."""
    shapes = task.context.loaded.task.shapes
    return any(shapes[name].on is not None for name in stage.met if name in shapes)


def _holds(task: TaskPlan, stage: StagePlan) -> bool:
    """A mechanism turns under the arm, and presses where its way is not the reference's.

    A loop for the force gives way to that; it is in doubt where the mechanism comes to its stop,
    where a free knob leaves the arm another way, and where little force is allowed.
    """
    if not task.context.held:
        return False
    declared, until = task.context.loaded.task.mechanisms[task.context.held], stage.spec.until
    most = stage.limits.force
    before = [name for name, each in task.stages.items() if _waits_for_effort(task, each)]
    return (
        not stage.law.control_law.force_loop
        or bool(before)
        or _near_stop(task, stage, declared)
        or _late(stage)
        or _leaves_off(task, stage) > _FORCE * _most_force(task, stage)
        or (declared.knob == "free" and (until is not None or _goes_before(task, stage)))
        or (most is not None and most < _LITTLE)
        or _drags(stage) > _FORCE * _most_force(task, stage)
        or _sets_off_with(stage, declared) > _FORCE * _most_force(task, stage)
    )


def _goes_before(task: TaskPlan, stage: StagePlan) -> bool:
    """Whether a stage before moves: where it leaves the arm about a free knob is not known."""
    before = (task.stages[name] for name in _before(task, stage))
    return any(plan.motion and plan.mode.moves for each in before for plan in each.plans.values())


def _near_stop(task: TaskPlan, stage: StagePlan, held: Mechanism) -> bool:
    """Whether a stage brings a mechanism to its stop, or may run into it with what it goes on."""
    passage = stage.nominal.passage
    if passage is None or passage.stopped is not None:
        return passage is not None
    last = passage.last.coordinate
    if held.stop is None or last is None:
        return False
    model = stage.context.mechanisms[stage.context.held]
    lever = model.radius if model.swings else 1.0
    stages = [stage, *(task.stages[name] for name in _before(task, stage))]
    goes_on = max(_handle_speed(each, lever) for each in stages) / lever * BLEND_TIME
    return min(held.stop[1] - last, last - held.stop[0]) < goes_on


def _leaves_off(task: TaskPlan, stage: StagePlan) -> float:
    """What dampers that a stage begins with bear at the speed of the one before [N]."""
    if any(plan.motion and plan.mode.moves for plan in stage.plans.values()):
        return 0.0
    model = stage.context.mechanisms[stage.context.held]
    lever = model.radius if model.swings else 1.0
    speeds = [_handle_speed(task.stages[name], lever) for name in _before(task, stage)]
    law = stage.law.control_law
    damps = [law.loop_damping(on_axis(stage.gains, axis)) for axis in stage.translations]
    return max(speeds, default=0.0) * max(damps, default=0.0)


def _drags(stage: StagePlan) -> float:
    """What dampers of force loops bear at the speed of a mechanism that takes the tool along [N].

    Without an integral a loop rests where d v = (1 + K) f.
    """
    model, law, most = stage.context.mechanisms[stage.context.held], stage.law.control_law, 0.0
    for gains in (on_axis(stage.gains, axis) for axis in stage.forces):
        if not gains.get("force.integral"):
            share = 1.0 + gains.get("force.proportional", 0.0)
            most = max(most, law.loop_damping(gains) / share)
    return most * _handle_speed(stage, model.radius if model.swings else 1.0)


def _late(stage: StagePlan) -> bool:
    """Whether a bound ends the way of a mechanism before its guard, or soon after it.

    The law lags behind the reference: its springs bear what the mechanism resists with.
    """
    passage, within = stage.nominal.passage, stage.spec.within
    if passage is None or within is None or stage.spec.until is None:
        return False
    if passage.end is End.BOUND:
        return True
    travel = math.hypot(*(passage.last.moved[axis] for axis in stage.translations))
    return (within.time is not None and passage.last.time > _TIME * within.time) or (
        within.travel is not None and travel > _TRAVEL * within.travel
    )


def _sets_off_with(stage: StagePlan, held: Mechanism) -> float:
    """The force at its handle that takes a mechanism from rest to a stage's speed, and on [N]."""
    model = stage.context.mechanisms[stage.context.held]
    lever = model.radius if model.angular else 1.0
    if model.angular and not model.swings:
        return 0.0
    mass, speed = held.coordinate_inertia / lever**2, _handle_speed(stage, lever)
    resists = held.damping * speed / lever**2 + held.friction / lever
    return _RISE * mass * speed / BLEND_TIME + resists


def _handle_speed(stage: StagePlan, lever: float) -> float:
    """How fast a stage moves the handle of what it holds: along, or about its axis [m/s]."""
    turns = [stage.plans[a].mode for a in ROTATIONS if a in stage.plans and a in stage.spec.axes]
    rates = [mode.settled_rate(stage.known) or 0.0 for mode in turns if mode.moves]
    about = max(map(abs, rates), default=0.0)
    return max(float(np.linalg.norm(rates_of(stage))), about * lever)


def _waits_for_effort(task: TaskPlan, stage: StagePlan) -> bool:
    """Whether a guard waits for what the held mechanism bears."""
    until, held = stage.spec.until, task.context.held
    efforts = ((held, "torque"), (held, "force"))
    return until is not None and any(name.path in efforts for name in names(until.tree))


def _enters(task: TaskPlan, stage: StagePlan) -> bool:  # noqa: ARG001
    """A tool goes into what is cut into a plate: it touches walls that no stage declares."""
    touched, surfaces = {stage.contact, *stage.met}, stage.context.surfaces
    return any(isinstance(each, CutPlate) for name, each in surfaces.items() if name in touched)


def _guard(task: TaskPlan, stage: StagePlan) -> bool:
    """A guard that is bounded, and that no approach tells of or that comes late."""
    spec, within = stage.spec, stage.spec.within
    if spec.fail_if is not None and _may_fail(task, stage, spec.fail_if.tree):
        return True
    if spec.until is None or within is None or not _measures(spec.until.tree):
        return False
    if task.context.held:
        return not stage.law.control_law.force_loop
    if stage.moving_base is not None:
        return True  # The tool goes with what it follows, and does not come to rest.
    if _settles_there(stage, spec.until.tree) or not _acts(stage):
        return False
    way, gap = approach(stage, stage.nominal.gap), None
    if way is not None:
        gap = way.gap
        if gap is None and stage.name == next(iter(task.stages)):
            gap = stage.context.start_gaps.get(way.contact)
    if way is None or gap is None:
        return within.time is not None or within.travel is not None
    comes = gap / way.closing
    time = comes + BLEND_TIME / 2 + dragged(stage, way.axis, comes) + dwell(stage)
    if within.time is not None and time > _TIME * within.time:
        return True
    goes = comes * way.speed
    return within.travel is not None and goes > _TRAVEL * within.travel


def _bounces(task: TaskPlan, stage: StagePlan) -> bool:  # noqa: ARG001
    """A touch that has to last for longer than the blow: the tool may lift off before."""
    way, time = approach(stage, stage.nominal.gap), dwell(stage)
    if way is None or time == 0.0:
        return False
    h, k = striking_mass(stage, way.axis), stage.context.compliances[way.contact].stiffness
    return time > math.pi * math.sqrt(h / k)


def _again(task: TaskPlan, stage: StagePlan) -> bool:
    """A stage that goes back to one whose bounds do not reach as far as it takes the tool."""
    spec = task.context.loaded.task
    order = list(spec.stages)
    before = order[: order.index(stage.name)]
    for name in before:
        within = spec.stages[name].within
        if within is None or name not in followers(spec, stage.name):
            continue
        speed = float(np.linalg.norm(rates_of(task.stages[name])))
        travel, time = within.travel or math.inf, within.time or math.inf
        if speed > 0 and _goes(stage) > min(_TRAVEL * travel, _TIME * time * speed):
            return True
    return False


def _goes(stage: StagePlan) -> float:
    """How far the moves of a stage take the tool at most [m]."""
    ways = [stage.plans[a].mode.distance for a in stage.translations if a in stage.plans]
    longest = stage.longest
    return math.hypot(*(min(way, speed * longest) for way, speed in filter(None, ways)))


def _acts(stage: StagePlan) -> bool:
    """Whether a stage moves or presses; one that does neither waits for what is not its own."""
    forces = any(entry.has_force for entry in stage.spec.axes.values())
    return _moves(stage) or forces or bool(stage.spec.constraints)


def _settles_there(stage: StagePlan, guard: Node) -> bool:
    """Whether a guard holds at the set points of a force loop that has long enough to settle.

    How long one needs whose gains the file gives is not known here.
    """
    node = guard.x if isinstance(guard, Held) else guard
    if not stage.law.control_law.force_loop or stage.longest < _SETTLED + dwell(stage):
        return False
    if any(name.startswith("force.") for axis in stage.forces for name in stage.law.given(axis)):
        return False
    there = {f"{a.effort}.{a}": point(value) for a, value in stage.set_points.items()}
    there["speed"] = point(0.0)
    return evaluate(node, IntervalAlgebra(), lambda n: there.get(str(n), ANY)).always


def _measures(guard: Node) -> bool:
    """Whether a guard waits for more than time and visits."""
    return any(n.path[-1] not in ("t", "clock", "visits") for n in names(guard))


def _may_fail(task: TaskPlan, stage: StagePlan, guard: Node) -> bool:
    """Whether a failure is one of forces that the stage may come to, or of anything else."""
    paths = [n.path for n in names(guard)]
    if any(path[0] not in ("force", "touching", "t") for path in paths):
        return not all(path[-1] in ("visits", "t", "clock") for path in paths)
    most = _FAR * (_settles(stage) + _blows(task, stage))
    algebra = IntervalAlgebra()
    node = guard.x if isinstance(guard, Held) else guard

    def find(name: Name) -> Interval:
        if name.path[0] == "force" and name.frame is None:
            return Interval(-most, most)
        return point(1.0) if name.path == ("touching",) else ANY

    return not evaluate(node, algebra, find).never


def _force(task: TaskPlan, stage: StagePlan) -> bool:
    """A limit on force that set points and the blow before them come near to."""
    blows = _blows(task, stage)
    comes = _settles(stage) + max(blows, _falls(stage) if blows else 0.0)
    return comes > _FORCE * _most_force(task, stage)


def _falls(stage: StagePlan) -> float:
    """By how much a force loop exceeds its set point that a blow has lifted off, falling back [N].

    In the air it goes as fast as its damper lets it, d v = (1 + K) f. On the contact c = k x + b x'
    it goes on by h x'' = (1 + K) (f - c) - d x', from x = 0 and x' = v on.
    """
    law, most = stage.law.control_law, 0.0
    for axis, force in stage.set_points.items():
        gains = on_axis(stage.gains, axis)
        damper = law.loop_damping(gains) if law.force_loop else 0.0
        contact = None if axis.is_rotation else stage.contact_of(axis)
        if contact is None or damper <= 0:
            continue
        compliance = stage.context.compliances[contact]
        loop = 1.0 + gains.get("force.proportional", 0.0)
        h, d = striking_mass(stage, axis) / loop, damper / loop
        unit = math.sqrt(h * compliance.stiffness)
        beyond = _rebound(unit / d, compliance.damping / unit, d / unit)
        most = max(most, abs(force) * beyond)
    return most


def _rebound(speed: float, contact_damper: float, loop_damper: float) -> float:
    """The largest c - 1, c = x + contact_damper x', of x'' = 1 - c - loop_damper x'.

    Args:
        speed: x' as x is zero.
        contact_damper: see above.
        loop_damper: see above.
    """
    zeta, times = (contact_damper + loop_damper) / 2, np.linspace(0.0, 2 * math.pi, _INSTANTS)
    # Of a critically damped motion the two roots are one: they are set apart by little.
    apart = np.emath.sqrt(zeta**2 - 1.0 - 1e-12)
    slow, fast = apart - zeta, -apart - zeta
    share = (speed + fast) / (slow - fast)
    x = share * np.exp(slow * times) - (1 + share) * np.exp(fast * times)
    rate = share * slow * np.exp(slow * times) - (1 + share) * fast * np.exp(fast * times)
    return max(float((x + contact_damper * rate).real.max()), 0.0)


def _most_force(task: TaskPlan, stage: StagePlan) -> float:
    """What forces of a stage are to stay below [N]."""
    bounds = [stage.limits.force, *_expected_peaks(task, stage)]
    return min((bound for bound in bounds if bound is not None), default=math.inf)


def _expected_peaks(task: TaskPlan, stage: StagePlan) -> Iterator[float]:
    """What the greatest force of a stage is expected to stay below [N]."""
    for expectation in task.context.loaded.task.expect:
        for part in parts(expectation.expression.tree):
            if not isinstance(part, Compare) or not isinstance(part.left, Reduce):
                continue
            paths = [n.path for n in names(part.left)]
            if part.left.reducer != "max" or not all("force" in path for path in paths):
                continue
            if all(path[0] in ("force", stage.name) for path in paths):
                algebra = IntervalAlgebra()
                most = evaluate(part.right, algebra, lambda n: constant(task.context, n) or ANY)
                yield most.high


def _settles(stage: StagePlan) -> float:
    """The largest force that a stage settles at [N]."""
    forces = [*_pressing(stage)]
    profiles = [p.values for p in force_profiles(stage) if not p.axis.is_rotation]
    settles = max((abs(f) for values in (forces, *profiles) for f in values), default=0.0)
    if not stage.law.control_law.force_loop and stage.approached is not None:
        settles = max(settles, _spring_force(stage))
    return settles


def _pressing(stage: StagePlan) -> Iterator[float]:
    """Constant forces along axes and equations [N]."""
    yield from (force for axis, force in stage.set_points.items() if not axis.is_rotation)
    for constraint in stage.spec.constraints.values():
        force = stage.known(constraint.wanted)
        if force is not None:
            yield force


def _before(task: TaskPlan, stage: StagePlan) -> list[str]:
    """The stages from which a stage is entered."""
    return leading_to(task.context.loaded.task.stages, stage.name)


def _blows(task: TaskPlan, stage: StagePlan) -> float:
    """The blow with which a stage meets its contact, or the one before it [N]."""
    before = [task.stages[n] for n in _before(task, stage)]
    return max((_blow(each) for each in (stage, *before)), default=0.0)


def _spring_force(stage: StagePlan) -> float:
    passage = stage.nominal.passage
    if passage is None:
        return math.inf
    deepest = [max(abs(i.moved[a]) for i in passage.instants) for a in stage.translations]
    springs = [stage.spring_of(a) for a in stage.translations]
    return max((d * k for d, k in zip(deepest, springs, strict=True)), default=0.0)


def _blow(stage: StagePlan) -> float:
    way = approach(stage, stage.nominal.gap)
    if way is None:
        return 0.0
    contact = stage.context.compliances[way.contact]
    h = striking_mass(stage, way.axis)
    return way.closing * max(math.sqrt(h * contact.stiffness), contact.damping)


def _speed(task: TaskPlan, stage: StagePlan) -> bool:
    """A limit on speed, or of a joint, that the way comes near to; a way that is not known."""
    passage, most, robot = _passage(stage), stage.limits.speed, stage.context.robot
    speed = max(float(np.linalg.norm(rates_of(stage))), _reached(stage))
    released = _released(task, stage)
    if passage is not None:
        for here in passage.instants:
            speed = max(speed, float(np.linalg.norm(here.twist[:3])))
            if (np.abs(here.v) > _JOINT * robot.velocity_limit).any():
                return True
            if (np.minimum(here.q - robot.lower, robot.upper - here.q) < _ROOM).any():
                return True
    else:
        speed = max(speed, _along_path(stage))
    if passage is None and any(_lasts(stage, plan) > _LONG for plan in stage.plans.values()):
        return True
    return most is not None and speed + released > _SPEED * most


def _passage(stage: StagePlan) -> Passage | None:
    """What the arm goes through in a stage; about so where a path of joints starts anywhere."""
    nominal = stage.nominal
    return nominal.about if nominal.passage is None else nominal.passage


def _leads_in(task: TaskPlan, stage: StagePlan) -> bool:
    """What gives way to nothing leads the tool into something, or off an equation that holds it.

    A path of joints does; so do the motion axes of a law without multipliers where an equation
    pulls the tool back.
    """
    context, joints = task.context, stage.joint_path is not None
    if joints or (_moves(stage) and not stage.law.control_law.multipliers):
        models = (model for model in context.equations.values() if not model.joints)
        if any(joints or model.constraint.relation == "=" for model in models):
            return True
    passage = _passage(stage)
    return (
        joints
        and passage is not None
        and any(
            context.obstacles.gap(name, place.p, place.R) < 0
            for name in context.surfaces
            for place in passage.instants[::_EVERY]
        )
    )


def _lags(task: TaskPlan, stage: StagePlan) -> bool:  # noqa: ARG001
    """A limit on deviation: friction holds back what a law takes along, and blows throw it off."""
    return stage.limits.deviation is not None and _moves(stage)


def _moves(stage: StagePlan) -> bool:
    """Whether a stage moves the tool along axes, or along a path of them."""
    moves = any(plan.motion and plan.mode.moves for plan in stage.plans.values())
    return moves or stage.path is not None


def _reached(stage: StagePlan) -> float:
    """How fast moves along axes get [m/s]."""
    modes = [stage.plans[axis].mode for axis in stage.translations if axis in stage.plans]
    return math.hypot(*(mode.reached_rate(stage.known) or 0.0 for mode in modes if mode.moves))


def _along_path(stage: StagePlan) -> float:
    """About how fast a path gets [m/s]; 0 without one, or where its length is not known."""
    path = stage.path
    if path is None or path.speed is not None:
        return 0.0 if path is None or path.speed is None else path.speed
    if path.time is None or path.form.unknown_length:
        return 0.0
    return _RISE * float(path.length(dict.fromkeys(path.axes, 0.0))) / path.time


def _released(task: TaskPlan, stage: StagePlan) -> float:
    """How fast a spring that the stage before presses on may throw the tool off [m/s]."""
    if stage.set_points:
        return 0.0
    most = 0.0
    for before in (task.stages[n] for n in _before(task, stage)):
        for axis, force in before.set_points.items():
            contact = None if axis.is_rotation else before.contact_of(axis)
            if contact is not None:
                k = task.context.compliances[contact].stiffness
                most = max(most, abs(force) / math.sqrt(k * striking_mass(before, axis)))
        for name, constraint in before.spec.constraints.items():
            push = before.known(constraint.wanted)
            if push is not None:
                k = task.context.compliances[name].stiffness
                normal, H = task.context.start_equations[name].normal, task.context.start_inertia
                lightness = float(normal @ np.linalg.solve(H, normal))
                most = max(most, abs(push) * math.sqrt(lightness / k))
    return _THROWN * most


def _lasts(stage: StagePlan, plan: AxisPlan) -> float:
    """How long an axis takes for its motion [s]; 0 for one that has no end."""
    lasts = plan.mode.duration(0.0) if plan.motion and stage.spec.until is None else None
    return 0.0 if lasts is None else lasts


def _expected(task: TaskPlan, stage: StagePlan) -> bool:
    """A force that is expected of a stage in which no integral brings it there."""
    law, context = stage.law.control_law, task.context
    estimated = any(f.kind == "estimated" for f in context.frames.values())
    shapes = context.loaded.task.shapes
    friction = max((shape.friction for shape in shapes.values()), default=0.0)
    rubs = friction > 0
    if law.kind == "hybrid-reaction" and stage.spec.constraints and stage.path is not None:
        return True
    bare = law.kind == "hybrid-reaction" and rubs and stage.nominal.passage is not None
    slides = any(plan.motion and plan.mode.moves for plan in stage.plans.values())
    bare = (bare or friction > _ROUGH) and slides
    presses = bool(stage.set_points or stage.spec.constraints)
    if not law.force_loop and presses and not (slides and friction > _ROUGH):
        # What a spring presses with at rest, and as it comes there, is predicted by itself; not how
        # it comes back from a blow that lifts the tool off.
        return stage.path is not None or _blows(task, stage) > _settles(stage)
    equations = [model.constraint.residual.tree for model in context.equations.values()]
    sways = any(name.path == ("clock",) for tree in equations for name in names(tree))
    loose = any(shape.free for shape in shapes.values())
    if law.force_loop and not (bare or estimated or sways or loose or _slow(stage)):
        return False
    for expectation in task.context.loaded.task.expect:
        for node in walk(expectation.expression.tree):
            for name in names(node):
                if name.path[0] == stage.name and set(name.path) & {"force", "torque"}:
                    return True
                if name.path[0] in task.context.equations:
                    return True
    return False


def _slow(stage: StagePlan) -> bool:
    """Whether a force loop is not at its set point as its stage ends, by the integral alone."""
    rates = [on_axis(stage.gains, axis).get("force.integral", 0.0) for axis in stage.set_points]
    return any(0 < rate * stage.longest < _TIME_CONSTANTS for rate in rates)


def _deep(task: TaskPlan, stage: StagePlan) -> bool:
    """A body is pressed in so far that the side behind may be the nearer one."""
    for axis, force in stage.set_points.items():
        contact = None if axis.is_rotation else stage.contact_of(axis)
        surface = None if contact is None else task.context.surfaces.get(contact)
        if contact is None or not isinstance(surface, BoundedSurface):
            continue
        points, radius = surface.extremes()
        normal = surface.rotation.T @ stage.normal_of(contact)
        reaches = float(np.abs(points @ normal).max()) + radius
        if abs(force) > _DEEP * reaches * task.context.compliances[contact].stiffness:
            return True
    return False


def _light(task: TaskPlan, stage: StagePlan) -> bool:
    """A loose body that the plant's steps hardly resolve between two contacts."""
    spec = task.context.loaded.task
    if not _presses_or_stays(stage):
        return False
    period = 1.0 / spec.control.plant_rate
    return any(
        shape.free
        and task.context.compliances[name].stiffness * period**2 > _LIGHT * (shape.mass or math.inf)
        for name, shape in spec.shapes.items()
        if name in task.context.compliances
    )


def _presses_or_stays(stage: StagePlan) -> bool:
    """Whether a stage lasts on a contact: until its time is over, not until it is met."""
    return stage.spec.until is None and stage.contact is not None


_DOUBTS: tuple[Callable[[TaskPlan, StagePlan], bool], ...] = (
    _protected,
    _deviates,
    _tracks,
    _pushes,
    _holds,
    _enters,
    _guard,
    _bounces,
    _again,
    _force,
    _speed,
    _lags,
    _leads_in,
    _expected,
    _deep,
    _light,
)
