"""The gains of every stage, to stand beside what came of them, and those that laws share."""

from __future__ import annotations

from typing import Any

from taskspec.laws import LAWS
from taskspec.laws.design import SPRING_DAMPING_RATIO, SPRING_FREQUENCY
from taskspec.laws.law import gain_named
from taskspec.program.program import Program
from taskspec.stability.gain_paths import turns


def equal_bandwidth(law: str) -> dict[str, str]:
    """Gains that a law is given so that it moves as fast as the others, in a file's words.

    The designs of force loops go by one rule under all laws. Springs are designed for
    w = 2 pi 2 Hz and a damping ratio of 0.7. A law that commands accelerations has poles wherever
    its gains put them, s^2 + 2 zeta w s + w^2, so it takes those of the springs.
    """
    has = LAWS[law].gain_names if law in LAWS else ()
    if "bandwidth" not in has:
        return {}
    values = {"bandwidth": f"{SPRING_FREQUENCY:g} Hz", "damping_ratio": f"{SPRING_DAMPING_RATIO:g}"}
    return {name: f"{{linear: {text}, angular: {text}}}" for name, text in values.items()}


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
