"""The contact stiffness that the stages of a run have estimated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from taskspec.program.program import Program
from taskspec.text.units import STIFFNESS, scaled
from taskspec_runner.record.history import History


def estimated(program: Program, history: History) -> dict[str, Any]:
    """The entry of a summary, `estimates`; empty for a task that estimates nothing.

    By stage and axis the stiffness that its last visit ended with, its standard deviation, that
    which its gains were those for [N/m], the object, and a text; where the force never changed as
    much as the estimate needs, `excited` is false, and the stiffness is what it began with.

    Args:
        program: that ran.
        history: what it recorded.
    """
    found: dict[str, Any] = {}
    for stage in program.stages:
        rows = np.flatnonzero(history.window(stage.name))
        for axis, each in stage.plan.estimates.axes.items() if len(rows) else ():
            names = ("stiffness", "deviation", "followed")
            k, deviation, followed = (
                float(history.columns[f"estimate.{name}.{axis}"][rows[-1]]) for name in names
            )
            excited = deviation < each.undecided
            text = scaled(k, STIFFNESS, 3)
            text += f" +- {scaled(deviation, STIFFNESS, 2)}" if excited else ", as declared"
            found.setdefault(stage.name, {})[str(axis)] = {
                "stiffness": k,
                "deviation": deviation if excited else None,
                "followed": followed,
                "excited": excited,
                "object": stage.plan.contacts.of(axis),
                "text": text,
            }
    return {"estimates": found} if found else {}


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """What was estimated along each axis of each stage."""
    for stage, by_axis in summary.get("estimates", {}).items():
        for axis, each in by_axis.items():
            text = f"{stage}: stiffness of {each['object']} along {axis} {each['text']}"
            yield text if each["excited"] else f"{text}: the force changed too little to tell"
