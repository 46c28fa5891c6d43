"""Where the robot's own controller stops, for `explain`."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.robot import RobotModel
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.spec.protection import ProtectedJoints, ProtectedTip, Protection
from taskspec.text.units import POWER, show

_WORDS = {"torque_rate": "torque rate"}


def protection_rows(protection: Protection | None, robot: RobotModel) -> Iterator[tuple[str, str]]:
    """Pairs of what and how, a row for each group with its source; none without a protection."""
    if protection is None:
        return
    if protection.about:
        yield "protection", protection.about
    for key, group in protection.groups:
        texts = []
        for name, bound in group.given:
            dimension = type(group).dimension_of(name)
            values = bound if isinstance(bound, tuple) else (bound,)
            shown = []
            for i, value in enumerate(values):
                slides = isinstance(group, ProtectedJoints) and not turns_at(robot, i)
                if dimension == POWER:
                    shown.append(f"{value:g} {'N/s' if slides else 'N*m/s'}")
                else:
                    own = ProtectedTip.dimension_of(name) if slides else dimension
                    shown.append(show(value, own, 5))
            if len(set(shown)) == 1:
                shown = shown[:1]
            texts.append(f"{_WORDS.get(name, name)} {', '.join(shown)}")
        yield f"protection: {key}", f"{'; '.join(texts)} (from: {protection.source_of(group)})"
