"""What the joints are commanded, and the servo that follows it, for `explain`."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.spec import Robot
from taskspec.spec.servo import PLURALS


def servo_rows(robot: Robot) -> Iterator[tuple[str, str]]:
    """Pairs of what and how, a row for each number with its source; none of torques."""
    if robot.takes_torques:
        return
    servo = robot.servo
    yield "commanded", f"joint {PLURALS[robot.command]}"
    if servo.about:
        yield "servo", servo.about
    for key, text in servo.written:
        yield f"servo: {key}", f"{text} (from: {servo.sources.get(key, 'an assumption')})"
