"""Shapes that move by themselves: driven by the clock, and by nothing that touches them.

A driven body has joints of so much inertia that no contact moves it. Their positions, velocities
and accelerations are set from the file's expressions before every step, so that a contact sees the
true relative velocity, along the normal as well as in friction.
"""

from __future__ import annotations

import casadi as ca
import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction
from taskspec.program.world.moving_base import displacements
from taskspec.spec import Shape, Task
from taskspec.spec.world import MOTION
from taskspec_runner.plant.names import PREFIX, placed

Vector = NDArray[np.float64]

#: Of each driven coordinate [kg, kg m^2]: 100 N move it by 5e-13 m in a step of 1 ms.
INERTIA = 1e8


def moving(task: Task) -> dict[str, Shape]:
    """The shapes that move by themselves."""
    return {name: shape for name, shape in task.shapes.items() if shape.motion is not None}


def add_moving_base(spec: mujoco.MjSpec, name: str, shape: Shape) -> mujoco.MjsBody:
    """Adds the body that carries a moving shape, with a joint for each of its axes."""
    assert shape.motion is not None
    body = spec.worldbody.add_body(name=PREFIX + name, **placed(shape))
    body.explicitinertial = True
    body.mass, body.inertia = 1.0, [1.0, 1.0, 1.0]
    for axis in shape.motion.axes:
        turns = axis.is_rotation
        body.add_joint(
            name=f"{PREFIX}{name}/{axis}",
            type=mujoco.mjtJoint.mjJNT_HINGE if turns else mujoco.mjtJoint.mjJNT_SLIDE,
            axis=[float(axis[-1] == other) for other in "xyz"],
            armature=INERTIA,
        )
    return body


class MovingBases:
    """Drives all moving shapes of a scene.

    Attributes:
        positions, dofs: where each driven coordinate is in `qpos`, its rate in `qvel`.
        clock: (1,) of the simulator [s].
        place, rate, bend: of each coordinate at the clock, with its rate and acceleration.
        function: clock -> these three.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, task: Task) -> None:
        self._data, self.clock = data, np.zeros(1)
        joints, places = [], []
        clock = ca.SX.sym("clock")
        for name, shape in moving(task).items():
            by_axis = displacements(task, shape, clock)
            # Displacements come before the rotation, whatever the file's order.
            for axis in (a for a in MOTION if a in by_axis):
                joints.append(model.joint(f"{PREFIX}{name}/{axis}").id)
                places.append(by_axis[axis])
        place = ca.vertcat(*places)
        rate = ca.jacobian(place, clock)
        function = ca.Function(
            "motion", [clock], [ca.densify(x) for x in (place, rate, ca.jacobian(rate, clock))]
        )
        self.positions = np.array(model.jnt_qposadr[joints], dtype=int)
        self.dofs = np.array(model.jnt_dofadr[joints], dtype=int)
        self.place, self.rate, self.bend = (np.zeros(len(joints)) for _ in range(3))
        self.function = BoundFunction(function, [self.clock], [self.place, self.rate, self.bend])

    def drive(self) -> None:
        """Puts all driven coordinates where they are at the clock, with rate and acceleration."""
        data = self._data
        self.clock[0] = data.time
        self.function.evaluate()
        data.qpos[self.positions] = self.place
        data.qvel[self.dofs] = self.rate
        data.qfrc_applied[self.dofs] = INERTIA * self.bend
