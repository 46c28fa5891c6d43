"""The distance of a run from the bounds of the robot's own controller."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.program.program import Program
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.text.units import (
    ANGULAR_VELOCITY,
    FORCE,
    MOMENT,
    VELOCITY,
    Dimension,
    show,
)
from taskspec_runner.record.history import History

Vector = NDArray[np.float64]

#: Of the tip's quantities: group, key, columns of the log that they are the norm of, what they are.
_NORMS: tuple[tuple[str, str, tuple[str, ...], str, Dimension], ...] = (
    ("tip", "speed", ("speed",), "speed of the tip", VELOCITY),
    ("turn", "speed", ("velocity.rx", "velocity.ry", "velocity.rz"), "rate of the tool's turn",
     ANGULAR_VELOCITY),
    *((group, "force", ("force.x", "force.y", "force.z"), words, FORCE)
      for group, words in (("reflex", "force of the reflex"), ("sensor", "force of the sensor"))),
    *((group, "torque", ("torque.rx", "torque.ry", "torque.rz"), words, MOMENT)
      for group, words in (("reflex", "torque of the reflex"), ("sensor", "torque of the sensor"))),
)  # fmt: skip


def protected(program: Program, history: History, period: float) -> dict[str, Any]:
    """The entry of a summary, `protection`; empty for a robot without one.

    A list of what its log has, each with what it `is`, the `bound`, the `most` there was [SI],
    `text` of both, the `share` of the bound, and when [s]. Torque rates are differences of the
    commanded torques over a control period, those of changes of stage among them; an arm that is
    commanded none has none.

    Args:
        program: that ran.
        history: what it recorded.
        period: of control [s].
    """
    protection = program.context.loaded.task.robot.protection
    if protection is None or not len(history):
        return {}
    columns = history.columns
    clock = columns["clock"]
    found = []

    def add(what: str, values: Vector, bound: float, unit: Dimension | str) -> None:
        sizes = np.where(np.isfinite(values), np.abs(values), 0.0)
        i = int(np.argmax(sizes))
        most = float(sizes[i])
        if isinstance(unit, Dimension):
            text = f"{show(most, unit, 3)} of {show(bound, unit, 5)}"
        else:
            text = f"{most:.3g} of {bound:.5g} {unit}"
        found.append(
            {"is": what, "bound": bound, "most": most, "share": most / bound, "text": text}
            | {"clock": float(clock[i])}
        )

    joints, robot = protection.joints, program.context.robot
    for key in ("speed", "torque_rate"):
        values = None if joints is None else getattr(joints, key)
        for i, bound in enumerate(np.broadcast_to(values or (), (robot.n,)) if values else ()):
            turns = turns_at(robot, i)
            name = f"joint.{i + 1}.{'velocity' if key == 'speed' else 'torque'}"
            if name not in columns:
                continue
            if key == "speed":
                add(
                    f"speed of joint {i + 1}",
                    columns[name],
                    float(bound),
                    VELOCITY.on(rotation=turns),
                )
            elif program.context.drives.torques:
                rates = np.diff(columns[name], prepend=np.nan) / period
                unit = "N*m/s" if turns else "N/s"
                add(f"torque rate of joint {i + 1}", rates, float(bound), unit)
    for group, key, names, words, dimension in _NORMS:
        part = getattr(protection, group)
        bound = None if part is None else getattr(part, key)
        there = [name for name in names if name in columns]
        if bound is not None and there:
            values = np.linalg.norm([np.nan_to_num(columns[name]) for name in there], axis=0)
            add(words, values, float(bound), dimension)
    return {"protection": found}


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """The nearest bound, and exceeded torque rates; nothing without a protection."""
    found = summary.get("protection") or []
    if not found:
        return
    nearest = max(found, key=lambda each: each["share"])
    yield (
        f"protection: nearest is the {nearest['is']}, {nearest['text']}, "
        f"at {nearest['clock']:.3f} s"
    )
    for each in found:
        if each["share"] > 1 and each is not nearest:
            yield f"protection: beyond is the {each['is']}, {each['text']}"
