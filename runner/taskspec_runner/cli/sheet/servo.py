"""What the joints are commanded, and the servo that follows it, for `explain`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from taskspec.spec import Robot
from taskspec.spec.servo import PLURALS, Servo
from taskspec.text.units import scaled


def servo_rows(robot: Robot) -> Iterator[tuple[str, str]]:
    """Pairs of what and how, a row for each number with its source; none of torques."""
    if robot.takes_torques:
        return
    servo = robot.servo
    yield "commanded", f"joint {PLURALS[robot.command]}"
    if servo.about:
        yield "servo", servo.about
    for key, values in servo.numbers.items():
        shown = [
            scaled(float(value), Servo.dimension_of(key), 5) for value in np.atleast_1d(values)
        ]
        text = ", ".join(shown[:1] if len(set(shown)) == 1 else shown)
        yield f"servo: {key}", f"{text} (from: {servo.sources.get(key, 'an assumption')})"
