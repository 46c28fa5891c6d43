"""How well a stage was tracked under a law: its metrics, told by what is comparable across laws.

A force axis of one law may have a motion reference under another: without a force loop the force
comes from a reference below the surface. So a stage's force axes are those of all laws together,
and only the others count as motion.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import ROTATIONS
from taskspec.text.units import ANGLE, FORCE, LENGTH, MOMENT, Dimension

Json = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class TrackedKind:
    """What can be compared across laws.

    Attributes:
        signal: the part of a signal's name before its axis.
        rotation: whether the axis is a rotation.
        dimension: of its errors.
    """

    signal: str
    rotation: bool
    dimension: Dimension


KINDS = {
    "force": TrackedKind("force", rotation=False, dimension=FORCE),
    "torque": TrackedKind("torque", rotation=True, dimension=MOMENT),
    "motion": TrackedKind("position", rotation=False, dimension=LENGTH),
    "rotation": TrackedKind("position", rotation=True, dimension=ANGLE),
}
_STATISTICS = ("rms_error", "max_error", "final_error")
#: How a visit of a stage ends that went as planned.
_PLANNED = ("until", "done")


def force_axes(summaries: Sequence[Json]) -> dict[str, list[str]]:
    """Stage to the axes that have a force or moment to reach under some law.

    Args:
        summaries: of the runs.
    """
    found: dict[str, list[str]] = {}
    for summary in summaries:
        for stage, signals in summary["metrics"].items():
            axes = found.setdefault(stage, [])
            named = (name.partition(".") for name in signals)
            axes += [a for kind, _, a in named if kind in ("force", "torque") and a not in axes]
    return found


def tracking(summary: Json, forces: Mapping[str, Sequence[str]]) -> dict[str, dict[str, Any]]:
    """What a run came to in each stage that it visited, in SI.

    Args:
        summary: of the run.
        forces: stage to its force axes under some law.

    Returns:
        Stage to `duration`, `planned` (no visit of it was broken off), `peak_force`, and for each
        kind of `KINDS` the largest root mean square, absolute and final errors with the axis of
        the first; None where nothing of the kind had a reference.
    """
    return {
        stage: {
            **_visits(summary, stage),
            "peak_force": summary["peaks"][stage]["force"],
            **{kind: _worst(signals, kind, forces.get(stage, ())) for kind in KINDS},
        }
        for stage, signals in summary["metrics"].items()
    }


def _visits(summary: Json, stage: str) -> dict[str, Any]:
    visits = [v for v in summary["stages"] if v["name"] == stage]
    return {
        "duration": sum(v["end"] - v["start"] for v in visits),
        "planned": all(v["ended_by"]["kind"] in _PLANNED for v in visits),
    }


def _worst(signals: Json, kind: str, forces: Sequence[str]) -> dict[str, Any] | None:
    prefix, turning = KINDS[kind].signal, KINDS[kind].rotation
    errors: dict[str, Any] = {
        name.removesuffix(f".{prefix}"): values
        for name, values in signals.items()
        if name.endswith(f".{prefix}")
    }
    errors |= {
        axis: values
        for name, values in signals.items()
        if (axis := name.removeprefix(f"{prefix}.")) != name
        and (axis in ROTATIONS) == turning
        and (prefix != "position" or axis not in forces)
    }
    if not errors:
        return None
    largest = {s: max(abs(values[s]) for values in errors.values()) for s in _STATISTICS}
    return {"axis": max(errors, key=lambda axis: errors[axis]["rms_error"]), **largest}


def best(rows: Mapping[str, Json | None], *path: str) -> set[str]:
    """The laws whose value is the least among those that went through the stage as planned.

    Args:
        rows: law to what it came to in a stage, None if it was not there.
        path: to the value.

    Returns:
        No law where fewer than two have the value.
    """
    found: dict[str, float] = {}
    for law, row in rows.items():
        value: Any = row if row is not None and row["planned"] else None
        for key in path:
            value = None if value is None else value.get(key)
        if value is not None:
            found[law] = float(value)
    if len(found) < 2:
        return set()
    least = min(found.values())
    return {law for law, value in found.items() if value == least}
