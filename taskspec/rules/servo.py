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
from taskspec.spec.servo import Servo
from taskspec.text.units import show

#: Halvings in the search of the bound that a message names.
_HALVINGS = 20


@rule({}, also=("TS118", "TS414"), phase=Phase.TASK, bars=True)
def fitting_servos(task: TaskPlan) -> Iterator[Finding]:
    """Servos with another number of values than the robot has joints, or not stable."""
    loaded, robot = task.context.loaded, task.context.robot
    if loaded.task.robot.takes_torques:
        return
    true = loaded.true_task.robot.servo
    servos: dict[KeyPath, Servo] = {FILE.robot.servo: loaded.task.robot.servo}
    if true != loaded.task.robot.servo:
        servos[FILE.truth] = true
    if (stiffest := _stiffest(true, loaded.task)) != true:
        servos[FILE.vary] = stiffest
    for place, servo in servos.items():
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
            yield from _unstable(task, servo, place)


def _stiffest(true: Servo, task: Task) -> Servo:
    """The true servo with the greatest values that `vary` gives to what makes it stiff."""
    changed: dict[str, object] = {}
    for key in ("bandwidth", "damping", "stiffness"):
        for each in task.vary.get(f"robot.servo.{key}", ()):
            if each is not None:
                own = getattr(true, key)
                most = each.ends(0.0 if own is None else float(np.max(own)))[1]
                changed[key] = (most,) if key == "stiffness" else most
    return true.model_copy(update=changed)


def _unstable(task: TaskPlan, servo: Servo, place: KeyPath) -> Iterator[Finding]:
    """A servo whose samples come too seldom for how stiff it is, with the arm at its start."""
    H = task.context.start_inertia
    steps = round(task.context.loaded.task.control.plant_rate / servo.rate)

    def grows(share: float) -> bool:
        """Whether it is unstable with a share of its stiffness."""
        w, own = 2 * math.pi * servo.bandwidth * math.sqrt(share), servo.stiffness
        given = None if own is None else share * np.array(own)
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
    """Where a key of a servo stands: in the robot, or by its path in `truth` or `vary`."""
    return place[key] if place == FILE.robot.servo else place[f"robot.servo.{key}"]
