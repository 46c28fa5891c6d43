"""Servos that do not fit their robot: the number of their values, and drives that are too stiff."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from taskspec.control.servo import drive_gains, growth
from taskspec.program.plan import TaskPlan
from taskspec.rules import Finding, Phase, error, rule
from taskspec.spec import FILE, Task
from taskspec.spec.key_path import KeyPath
from taskspec.text.units import show

#: Halvings in the search of the bound that a message names.
_HALVINGS = 20


@rule({}, also=("TS118", "TS414"), phase=Phase.TASK, bars=True)
def fitting_servos(task: TaskPlan) -> Iterator[Finding]:
    """Servos with another number of values than the robot has joints, or not stable."""
    loaded, robot = task.context.loaded, task.context.robot
    if loaded.task.robot.takes_torques:
        return
    worlds: dict[KeyPath, Task] = {FILE.robot.servo: loaded.task}
    if loaded.true_task.robot.servo != loaded.task.robot.servo:
        worlds[FILE.truth] = loaded.true_task
    for place, world in worlds.items():
        servo = world.robot.servo
        wrong = [
            key
            for key, values in servo.numbers.items()
            if isinstance(values, tuple) and len(values) not in (1, robot.n)
        ]
        for key in wrong:
            yield error(
                "TS414",
                f"{np.size(servo.numbers[key])} values for the {robot.n} joints of {robot.name!r}",
                _at(place, key),
                "one value for all joints, or one for each",
            )
        if not wrong:
            yield from _unstable(task, world, place)


def _unstable(task: TaskPlan, world: Task, place: KeyPath) -> Iterator[Finding]:
    """A servo whose samples come too seldom for how stiff it is, with the arm at its start."""
    servo, H = world.robot.servo, task.context.start_inertia
    steps = round(world.control.plant_rate / servo.rate)

    def grows(share: float) -> bool:
        """Whether it is unstable with a share of its stiffness."""
        w, own = 2 * math.pi * servo.bandwidth * math.sqrt(share), servo.stiffness
        given = None if own is None else share * np.broadcast_to(own, len(H))
        return growth(H, *drive_gains(H, w, servo.damping, given), 1 / servo.rate, steps) > 1

    if not grows(1.0):
        return
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if grows(middle) else (middle, high)
    if servo.stiffness is None:
        key, most = "bandwidth", f"{show(servo.bandwidth * math.sqrt(low), 'Hz', 3)} would be"
    else:
        key, most = "stiffness", f"{100 * low:.0f} % of it would be"
    yield error(
        "TS118",
        f"the servo is not stable: its {key} is too high for its rate of {show(servo.rate, 'Hz')}, "
        f"with the arm's inertia at the start; {most}",
        _at(place, key),
        f"lower the {key}, or raise robot.servo.rate, where control.plant_rate is that high",
    )


def _at(place: KeyPath, key: str) -> KeyPath:
    """Where a key of a servo stands: in the robot, or by its path in truth."""
    return place[f"robot.servo.{key}"] if place == FILE.truth else place[key]
