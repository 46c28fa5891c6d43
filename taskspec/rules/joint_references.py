"""Joint references against constraints: motions q_d and joint torques u_phi,d, (4.101)-(4.103)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.program.plan import StagePlan
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.rules import Finding, error, rule, warning
from taskspec.spec import FILE, SetPoint
from taskspec.text.units import FORCE, LENGTH, describe, in_si, show

Vector = NDArray[np.float64]

#: References of joints may be this far off an equation [m, rad]: what three digits leave.
_OFF = 1e-4
#: Share of joint torques that no multiplier has to make, and as much [N m].
_LEFT, _LEAST = 1e-3, 1e-3


@rule("TS252", "joint references that leave a constraint")
def joints_off_a_constraint(stage: StagePlan) -> Iterator[Finding]:
    """Paths of joints on which phi(q_d(t)) = 0 does not hold: where it is farthest from that."""
    if stage.joint_path is None:
        return
    path, context = _path(stage), stage.context
    for name, model in context.equations.items():
        if not path or model.moves:
            continue
        row, relation = model.on_joints(context.robot), model.constraint.relation
        both = relation == "=" or name in stage.active
        off = np.array([float(row(q, 0.0)[0]) for _, q in path])
        off = np.abs(off) if both else np.maximum(off if relation == "<=" else -off, 0.0)
        if not np.isfinite(off).all() or off.max() <= _OFF:
            continue
        time, q = path[int(np.argmax(off))]
        decided = int(np.argmax(np.abs(np.array(row(q, 0.0)[1]))))
        wins = f"the constraint wins, a joint does not follow; joint {decided + 1} moves it most"
        presses = "the arm presses against it with the gains of its joints"
        yield warning(
            "TS252",
            f"the references of the joints leave {name!r} by up to "
            f"{show(float(off.max()), LENGTH.on(rotation=model.angular), 3)}, at "
            f"t = {show(time, 's', 3)}: {wins if name in stage.active else presses}",
            FILE.stages[stage.name].path.joints,
            "plan joints that keep it, phi(q_d(t)) = 0 (4.101)",
        )


@rule(
    {
        "TS253": "joint torques that no force of their constraint makes",
        "TS254": "joint torques that are not those of the robot's joints",
    },
)
def joint_torques_off_a_constraint(stage: StagePlan) -> Iterator[Finding]:
    """Set points u_phi,d = J_phi^T lambda_d that hold for no lambda_d: where most is left."""
    for name in stage.spec.generalised:
        point = stage.spec.constraints[name]
        wrong = list(_not_of_the_joints(stage, name, point))
        yield from wrong
        if not wrong and not stage.context.equations[name].moves:
            yield from _left(stage, name, point)


def _left(stage: StagePlan, name: str, point: SetPoint) -> Iterator[Finding]:
    """What is left of u_phi,d at the instant where that is most."""
    row = stage.context.equations[name].on_joints(stage.context.robot)
    most: tuple[float, float, Vector, Vector] | None = None
    for time, q in _path(stage):
        found = [stage.known(each, {"t": time}) for each in point.expressions]
        u = np.array([value for value in found if value is not None])
        J = np.array(row(q, 0.0)[1]).ravel()
        if len(u) != len(found) or not np.isfinite([*u, *J]).all() or not J @ J > 0:
            return
        made = J * (J @ u) / (J @ J)
        left = float(np.linalg.norm(u - made))
        if left > max(_LEAST, _LEFT * float(np.linalg.norm(u))) and (not most or left > most[0]):
            most = left, time, u, made
    if most is None:
        return
    left, time, u, made = most
    hinges = [turns_at(stage.context.robot, i) for i in range(len(u))]
    fits = ", ".join(
        in_si(float(f"{value:.3g}"), FORCE.on(rotation=hinge))
        for value, hinge in zip(made, hinges, strict=True)
    )
    size = show(float(np.linalg.norm(u)), "N*m", 3)
    yield warning(
        "TS253",
        f"no force of {name!r} makes these joint torques: of {size}, {show(left, 'N*m', 3)} are "
        f"left of u_phi,d - J_phi^T lambda_d at t = {show(time, 's', 3)} (4.102)",
        FILE.stages[stage.name].constraints[name].generalised,
        f"the law applies their part along the gradient alone, there [{fits}]",
    )


def _not_of_the_joints(stage: StagePlan, name: str, point: SetPoint) -> Iterator[Finding]:
    """Lists that are too long or too short, and moments of joints that slide."""
    robot, place = stage.context.robot, FILE.stages[stage.name].constraints[name].generalised
    if len(point.expressions) != robot.n:
        yield error(
            "TS254",
            f"{len(point.expressions)} joint torques, and {robot.name!r} has {robot.n} joints",
            place,
            f"in this order: {', '.join(robot.joint_names)}",
        )
        return
    for i, each in enumerate(point.expressions):
        needed = FORCE.on(rotation=turns_at(robot, i))
        if each.dimension != needed and stage.known(each) != 0:
            moves = "turns" if turns_at(robot, i) else "slides"
            yield error(
                "TS254",
                f"joint {i + 1} ({robot.joint_names[i]!r}) {moves}, and this is "
                f"{describe(each.dimension)}",
                each.span or place,
                f"give it {describe(needed)}",
            )


def _path(stage: StagePlan) -> list[tuple[float, Vector]]:
    """Times [s] and joint positions (n,) of a stage, as far as they are known before it runs."""
    nominal = stage.nominal
    passage = nominal.passage or nominal.about
    if stage.joint_path is not None:
        return [(at.time, at.q) for at in passage.instants if at.q is not None] if passage else []
    return [(0.0, place.q) for place in nominal.places[:1] if place.q is not None]
