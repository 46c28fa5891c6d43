"""One flat vector for a tick: everything that is sensed, computed and recorded, side by side.

The controller's function reads and writes views of it in place, and a tick is recorded by one copy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.program.ports import INTERNAL, slices
from taskspec.program.ports import fields as fields_of
from taskspec.spec import Task
from taskspec_runner.plant.views import PlantViews, view_fields

Vector = NDArray[np.float64]


class Bus:
    """Named slices of one vector.

    Attributes:
        array: (size,) the whole tick.
        slices: by name.
        truth: the views that the plant fills.
    """

    def __init__(self, joints: int, task: Task) -> None:
        truth = view_fields(task)
        fields = [
            ("clock", 1),
            ("t", 1),
            ("stage", 1),
            ("q", joints),
            ("v", joints),
            ("torque", joints),
            *truth,
            *fields_of(len(task.equations)),
        ]
        self.slices = slices(fields)
        self.array: Vector = np.zeros(sum(length for _, length in fields))
        self.truth = PlantViews(*(self.view(name) for name, _ in truth))

    def view(self, name: str) -> Vector:
        """A view of one field."""
        return self.array[self.slices[name]]

    @property
    def outputs(self) -> Vector:
        """A view of all outputs of a stage's function."""
        start = self.slices[INTERNAL[0][0]].start
        return self.array[start:]
