"""Paths of joints that the arm's motors cannot follow."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from taskspec.program.plan import StagePlan
from taskspec.program.walk.joint_walk import joint_states, torques
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.rules import Finding, rule, warning
from taskspec.rules.places import motion_of
from taskspec.text.units import FORCE, show


@rule("TS427", "a path of joints that needs more torque than there is")
def weak_motors(stage: StagePlan) -> Iterator[Finding]:
    """Where H q'' + C q' + g of the reference is first beyond what a joint's motor has."""
    path, passage = stage.joint_path, stage.nominal.passage
    if path is None or passage is None:
        return
    robot = stage.context.robot
    for state in joint_states(path, passage.instants[0].q):
        needed = np.abs(torques(robot, state))
        i = int(np.argmax(needed / robot.torque_limit))
        if needed[i] <= robot.torque_limit[i]:
            continue
        unit = FORCE.on(rotation=turns_at(robot, i))
        yield warning(
            "TS427",
            f"in stage {stage.name!r}, at t = {show(state.time, 's', 3)}, joint {i + 1} "
            f"({robot.joint_names[i]}) needs {show(float(needed[i]), unit, 3)} on its path, and "
            f"its motor has {show(float(robot.torque_limit[i]), unit, 3)}: the arm falls behind",
            motion_of(stage),
            "go slower, lead the arm past with less of it stretched out, or take a lighter tool",
        )
        return
