"""One flat vector for a tick: everything that is sensed, computed and recorded, side by side.

The controller's function reads and writes views of it in place, and a tick is recorded by one copy.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.faults import TORQUE
from taskspec.program.ports import INTERNAL, fields_of, slices
from taskspec.spec import Task
from taskspec_runner.plant.views import PlantViews, view_fields

Vector = NDArray[np.float64]

TRUE = "true."
"""What fields begin with that have the truth of what is measured or commanded otherwise."""


class Bus:
    """Named slices of one vector.

    Attributes:
        array: (size,) the whole tick.
        slices: by name.
        truth: the views that the plant fills.
        commanded: (n,) view of what the joints are commanded: the field `torque`, or `command` of
            an arm that takes no torques.
        linked: whether plant and controller meet at the wall clock, so that ticks have a `link`:
            how late what came for it came [s], and how many in a row did not come.

    Where joints are not measured as they are, it also has their true state, and what stages would
    put out if they measured that, each field as `true.` and its name; where torques fail, those
    that the motors exert.
    """

    def __init__(self, joints: int, task: Task, *, linked: bool = False) -> None:
        truth, self.linked = view_fields(task, joints), linked
        command = "torque" if task.robot.takes_torques else "command"
        outputs = fields_of(task, joints)
        fields = [
            ("clock", 1),
            ("t", 1),
            ("stage", 1),
            ("q", joints),
            ("v", joints),
            (command, joints),
            *([("link", 2)] if linked else ()),
            *truth,
            *outputs,
        ]
        self._outputs = sum(length for _, length in outputs)
        if not task.joints_exact:
            state = (("q", joints), ("v", joints), *outputs)
            fields += [(f"{TRUE}{name}", length) for name, length in state]
        if task.truth.of(TORQUE):
            fields.append((f"{TRUE}torque", joints))
        self.slices = slices(fields)
        self.array: Vector = np.zeros(sum(length for _, length in fields))
        self.truth = PlantViews(*(self.view(name) for name, _ in truth))
        self.commanded = self.view(command)

    def view(self, name: str) -> Vector:
        """A view of one field."""
        return self.array[self.slices[name]]

    def forget_truth(self) -> None:
        """Makes unknown what only a plant knows: nobody fills it where there is none."""
        truth = self.truth
        for unknown in (
            truth.objects,
            truth.mechanism_positions,
            truth.mechanism_rates,
            truth.mechanism_efforts,
            truth.bushings,
            truth.loose,
            truth.exerted,
            truth.servo,
        ):
            unknown[:] = np.nan

    @property
    def outputs(self) -> Vector:
        """A view of all outputs of a stage's function."""
        return self._outputs_from(INTERNAL[0][0])

    @property
    def true_outputs(self) -> Vector:
        """A view of what they would be of the true state; where joints are not exact."""
        return self._outputs_from(f"{TRUE}{INTERNAL[0][0]}")

    def _outputs_from(self, name: str) -> Vector:
        start = self.slices[name].start
        return self.array[start : start + self._outputs]
