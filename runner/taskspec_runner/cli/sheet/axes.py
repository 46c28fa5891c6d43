"""Natural and artificial constraints of a stage's axes in words, and who enforces the latter.

v and w are velocity and angular velocity, f and m force and moment that the robot applies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from taskspec.deferred_methods import dataclass
from taskspec.explain import Natural, State
from taskspec.explain.artificial import artificial, force_symbol, rate_symbol, turns
from taskspec.geometry.axis import Axis
from taskspec.program.program import Program
from taskspec.program.reference.axis_plan import AxisPlan
from taskspec.program.reference.joint_motion import JointMotion
from taskspec.program.stages.stage import CompiledStage
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.spec import Screw, SetPoint
from taskspec.text.units import LENGTH, STIFFNESS, number, scaled, show

#: Stands below the tables.
LEGEND = "v, w: velocity along and about an axis; f, m: force and moment that the robot applies"


@dataclass(frozen=True, slots=True)
class AxisRow:
    """An axis or an equation: what the world imposes, what the law asks, and how it gets it."""

    axis: str
    natural: str
    artificial: str
    by: str


def axis_row(program: Program, stage: CompiledStage, world: Natural) -> AxisRow:
    """One axis of a stage's frame, and what the world imposes there."""
    axis, plan = world.axis, stage.plan.plans[world.axis]
    by = ", ".join([_enforcer(stage, plan, world), *_remarks(stage, plan, world)])
    return AxisRow(axis, _natural(program, world), artificial(stage.plan, axis), by)


def equation_row(program: Program, stage: CompiledStage, name: str) -> AxisRow:
    """A constraint: its force, along the unit gradient of its equation."""
    wanted = stage.plan.spec.constraints.get(name)
    model = program.context.equations[name]
    declared = program.context.loaded.task.equations[name]
    side = "" if model.constraint.relation == "=" else " (pushes only)"
    artificial = f"{'m' if model.angular else 'f'} = {_set_point(wanted)} along its gradient"
    return AxisRow(name, f"{declared.equation}{side}", artificial, "force control")


def joint_rows(stage: CompiledStage) -> Iterator[AxisRow]:
    """The joints of a stage with a path of joints: where each goes."""
    path, robot = stage.plan.joint_path, stage.plan.context.robot
    by = "motion control" + (", as far as constraints leave it" if stage.plan.active else "")
    for i in range(robot.n if path is not None else 0):
        if isinstance(path, JointMotion):
            yield AxisRow(f"q{i + 1}", "", f"q{i + 1} = {path.positions[i]}", by)
            continue
        assert path is not None
        unit = LENGTH.on(rotation=turns_at(robot, i))
        targets = ", then to ".join(scaled(target[i], unit) for target in path.targets)
        yield AxisRow(f"q{i + 1}", "", f"q{i + 1} to {targets}", by)


def _set_point(point: SetPoint | None) -> str:
    if point is None:
        return "0"
    if point.wanted is None:
        return f"that of [{', '.join(map(str, point.expressions))}] on the joints"
    return str(point.wanted)


def _natural(program: Program, world: Natural) -> str:
    screw = isinstance(program.context.loaded.task.world.get(world.by), Screw)
    if world.decides == "force":
        return _natural_force(program, world, screw)
    own = rate_symbol(world.axis)
    total = _sum(world, rate_symbol, screw) or "0"
    if world.pushes and world.state is State.MAYBE:
        return f"{own} {'>=' if world.pushes > 0 else '<='} {total} ({world.by})"
    if world.state is State.MET:
        return f"{force_symbol(world.axis)} = 0, then {own} = {total} ({world.by})"
    here = ", where it begins" if world.turns else ""
    return f"{own} = {total} ({world.by}{', pushes only' if world.pushes else ''}{here})"


def _natural_force(program: Program, world: Natural, screw: bool) -> str:
    own, total = force_symbol(world.axis), _sum(world, force_symbol, screw)
    rubs = f"{world.friction:.3g} |{force_symbol(Axis(world.against))}|" if world.friction else ""
    if rubs and not total:
        return f"|{own}| <= {rubs} ({world.by})"
    if world.effort:
        angular = program.context.loaded.task.mechanisms[world.by].angular
        lever = int(world.axis.is_rotation) - int(angular)
        effort = f"{world.by}.{'torque' if angular else 'force'}"
        return f"{own} = {_product(effort, world.effort, lever)}{_signed(total)}"
    by = f" ({world.by})" if world.by else ""
    if world.springs:
        spring = f"{own} of the spring{total and _signed(total)}"
        return f"{spring}{f' +- {rubs}' if rubs else ''} ({', '.join(world.springs)})"
    return f"{own} = {total or '0'}{f' +- {rubs}' if rubs else ''}{by}"


def _sum(world: Natural, name: Callable[[Axis], str], screw: bool) -> str:
    """The terms that a velocity or a force is the sum of; empty for none."""
    turns = int(world.axis.is_rotation)
    text = ""
    for axis, factor in world.terms:
        lever = int(axis.is_rotation) - turns
        lever = lever if name is rate_symbol else -lever
        pitch = screw and {axis, world.axis} == {axis[-1], f"r{axis[-1]}"}
        term = _product(name(axis), factor, lever, pitch=pitch)
        text = term if not text else text + _signed(term)
    return text


def _signed(term: str) -> str:
    if not term:
        return ""
    return f" - {term[1:]}" if term.startswith("-") else f" + {term}"


def _product(symbol: str, factor: float, lever: int, *, pitch: bool = False) -> str:
    """A symbol times a number (lever 0), times a length (1), or by a length (-1)."""
    sign, size = "-" if factor < 0 else "", abs(factor)
    if lever > 0:
        return f"{sign}{show(size, 'mm/turn' if pitch else 'mm', 3)} {symbol}"
    if lever < 0:
        return f"{sign}{symbol} / {show(1 / size, 'mm', 3)}"
    rounded = number(size, 3)
    return f"{sign}{symbol}" if rounded == "1" else f"{sign}{rounded} {symbol}"


def _turns_along(stage: CompiledStage, axis: Axis, plan: AxisPlan) -> bool:
    """Whether a rotation is held in a frame that turns as the tool moves."""
    held = not plan.mode.moves and axis.is_rotation and not plan.world
    return held and turns(stage.plan)


def _enforcer(stage: CompiledStage, plan: AxisPlan, world: Natural) -> str:
    """Who sees to the artificial constraint."""
    if not plan.force and _by_equation(stage, plan, world):
        return f"the world ({world.by})"
    return stage.plan.law.control_law.enforces(
        force=plan.force,
        motion=plan.motion,
        open_loop=plan.open_loop,
        soft=plan.soft,
        lets_go=plan.mode.lets_go,
    )


def _by_equation(stage: CompiledStage, plan: AxisPlan, world: Natural) -> bool:
    """Whether an axis that the stage does not name gives way to an equation."""
    named = world.axis in stage.plan.spec.axes or plan.mode.moves
    return world.by in stage.plan.active and world.decides == "velocity" and not named


def _remarks(stage: CompiledStage, plan: AxisPlan, world: Natural) -> Iterator[str]:
    """What becomes of an axis on which world and law decide the same, or neither does."""
    if world.decides == "velocity" and plan.motion:
        if plan.force or _by_equation(stage, plan, world):
            return
        turned = world.terms and _turns_along(stage, world.axis, plan)
        if turned or world.axis in stage.plan.couplings:
            yield f"as {world.by} goes"
        elif world.by in stage.plan.active:
            yield f"along {world.by}"
        elif plan.yields:
            yield f"yields to {world.by}"
        else:
            yield f"{world.by} holds it too" if not plan.mode.moves else f"against {world.by}"
    if world.decides == "force" and plan.set_point and not world.effort:
        yield "held by friction" if world.friction else "free to move"
    if plan.soft and "stiffness" in stage.plan.gains:
        yield f"a spring of {scaled(stage.plan.gains['stiffness'][world.axis].value, STIFFNESS)}"
