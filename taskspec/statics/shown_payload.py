"""The payload that a stage adapts to, and what of it gravity alone shows in its planned motion."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES
from taskspec.laws.adaptation import PARAMETERS, SHOWN, Adaptation, described, gramian
from taskspec.program.execution.payload_estimate import adaptation
from taskspec.program.plan import StagePlan

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ShownPayload:
    """A payload in a stage of a task that adapts to one.

    Attributes:
        adaptation: its equations.
        estimates: whether the stage goes on with the estimate.
        why_not: why it does not, in words.
        shown: (4,) share of an error of each parameter that gravity shows within the stage.
    """

    adaptation: Adaptation
    estimates: bool
    why_not: str
    shown: Vector

    def rows(self) -> Iterator[tuple[str, str]]:
        """The adaptation, and what of the payload the stage shows."""
        if not self.estimates:
            yield "payload", f"goes by its estimate and leaves it as it is: {self.why_not}"
            return
        yield from self.adaptation.rows()
        by = {name: share >= SHOWN for name, share in zip(PARAMETERS, self.shown, strict=True)}
        excited = described([name for name, yes in by.items() if yes]) or "nothing of it"
        hidden = described([name for name, yes in by.items() if not yes])
        rest = f"; {hidden} by its accelerations at most" if hidden else ""
        yield "excites", f"by gravity along its planned motion {excited}{rest}"


def shown_payload(stage: StagePlan) -> ShownPayload | None:
    """The payload in a stage; None in a task that adapts to none."""
    context = stage.context
    adapted = adaptation(context.loaded.task, context.period)
    if adapted is None:
        return None
    why_not = "its law has no 'adapt'"
    if stage.adapt is not None:
        why_not = "the sensor at the wrist takes contact and payload for one"
    return ShownPayload(adapted, stage.adapts, why_not, _shown(stage, adapted))


def _shown(stage: StagePlan, adapted: Adaptation) -> Vector:
    """(4,) by gravity alone, over the planned motion; of a hold, over the time that it lasts."""
    passage, g = stage.nominal.passage, ca.SX(ca.DM(adapted.gravity))
    instants = () if passage is None else passage.instants
    times = [each.time for each in instants] or [0.0]
    turned = [each.R for each in instants] or [stage.context.start_R]
    rows = [AXES.index(axis) for axis in stage.context.robot.axes]
    none = ca.SX.zeros(3)
    at = [np.array(ca.evalf(gramian(-g, none, none, ca.SX(R), rows, adapted.g))) for R in turned]
    lasts = max(times[-1], stage.longest if np.isfinite(stage.longest) else 0.0)
    # The last pose lasts until the stage ends.
    spans = np.diff([*times, lasts])
    total = float(spans.sum())
    mean = sum((s * G for s, G in zip(spans, at, strict=True)), np.zeros((4, 4)))
    return adapted.shown(mean / total if total else at[-1], total or np.inf)
