"""The gains of every stage, to stand beside what came of them."""

from __future__ import annotations

from typing import Any

from taskspec.laws.law import gain_named
from taskspec.program.program import Program
from taskspec.stability.gain_paths import turns


def stage_gains(program: Program) -> dict[str, list[dict[str, Any]]]:
    """Stage to its gains: `name`, `axes` that share a value, `value` [SI], `text` and `origin`."""
    found: dict[str, list[dict[str, Any]]] = {}
    for stage in program.stages:
        rows = found.setdefault(stage.name, [])
        for name, by_axis in stage.plan.gains.items():
            groups: dict[tuple[float, str], list[str]] = {}
            for axis, gain in by_axis.items():
                text = gain_named(name).text(
                    gain.value, angular=turns(program.context, axis), entry=axis
                )
                groups.setdefault((gain.value, text), []).append(axis)
            for (value, text), axes in groups.items():
                origin = by_axis[axes[0]].origin
                rows.append({"name": name, "axes": axes, "value": value, "text": text,
                             "origin": origin})  # fmt: skip
    return found
