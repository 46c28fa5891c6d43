"""Force set points of a stage, as far as the file alone tells what they are."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from taskspec.geometry.axis import Axis
from taskspec.program.known_value import KnownValues
from taskspec.program.plan.kinematics import StageKinematics
from taskspec.spec import Stage

#: How long a set point that depends on time is followed where its stage has no bound [s], and at
#: how many instants.
_FOLLOWED, _INSTANTS = 10.0, 201


class StageSetPoints:
    """The forces and torques that the axes of a stage are to press with."""

    def __init__(
        self, spec: Stage, kinematics: StageKinematics, known: KnownValues, longest: float
    ) -> None:
        """Of a stage.

        Args:
            spec: its entry in the file.
            kinematics: its axes.
            known: values of expressions before a run.
            longest: after which it has ended whatever happens [s].
        """
        self._spec, self._kinematics = spec, kinematics
        self._known, self._longest = known, longest

    def of(self, axis: Axis) -> float | None:
        """Force along an axis, or torque about it, where the text of the file tells it [N, N m].

        None where it depends on time or signals, and on axes without one or that do not exist.
        """
        entry = self._spec.axes.get(axis) if axis in self._kinematics.axes else None
        force = None if entry is None else entry.set_point
        return None if force is None else self._known(force.wanted)

    @cached_property
    def constant(self) -> dict[Axis, float]:
        """Those that are constant and not zero [N, N m]."""
        return {axis: value for axis in self._spec.axes if (value := self.of(axis))}

    def largest(self, axis: Axis) -> float:
        """The largest size of one that is constant or depends on time alone, else 0 [N, N m]."""
        entry = self._spec.axes[axis].set_point
        if entry is None:
            return 0.0
        lasts = min(self._longest, _FOLLOWED)
        values = [
            self._known(entry.wanted, {"t": float(t)}) for t in np.linspace(0.0, lasts, _INSTANTS)
        ]
        return max((abs(v) for v in values if v is not None and math.isfinite(v)), default=0.0)
