"""The model terms of a loop: the arm's own expressions as one function, evaluated in place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction
from taskspec.robot import RobotModel
from taskspec.robot.model_terms import ModelTerms
from taskspec.robot.rigid_body import rigid_body

Vector = NDArray[np.float64]


class CompiledTerms(ModelTerms):
    """The model terms as `RigidBody` writes them down."""

    def __init__(
        self,
        robot: RobotModel,
        q: Vector | None = None,
        v: Vector | None = None,
        load: Vector | None = None,
    ) -> None:
        super().__init__(robot, q, v, load)
        body = rigid_body(robot)
        given = (self.q, self.v) if load is None else (self.q, self.v, load)
        function = body.function if load is None else body.loaded_function
        self.bound = BoundFunction(function, given, self.arrays)

    def update(self) -> None:
        """Evaluates all terms at `q` and `v`."""
        self.bound.evaluate()

    def group(self) -> None:
        """Groups the instructions."""
        self.bound.group()
