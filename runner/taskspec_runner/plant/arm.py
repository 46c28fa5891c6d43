"""An arm of a scene: its models, what the file says of it, and where it begins.

All that a scene has of an arm, or adds for it, is made of one of these: the models name the joints,
the tip and the tool as MuJoCo does, and what is added is named after the tip's body.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.robot import RobotModel
from taskspec.spec import Robot
from taskspec_runner.plant.names import PREFIX

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SceneArm:
    """An arm that a scene is built with.

    Attributes:
        robot: its models.
        declared: what is true of it, as a file says it.
        start: (n,) joint positions where the run begins [rad, m].
    """

    robot: RobotModel
    declared: Robot
    start: Vector

    @property
    def held(self) -> str:
        """The object that it holds; empty for none."""
        return (self.declared.grasp or "").partition(".")[0]

    def element(self, name: str) -> str:
        """MuJoCo's name of what a scene adds for this arm."""
        return f"{PREFIX}{self.robot.tip_body}/{name}"

    def places(self, model: mujoco.MjModel) -> ArmPlaces:
        """Indices of the arm's numbers in a compiled scene."""
        joints = [model.joint(name).id for name in self.robot.coupling.names]
        motors = [model.actuator(name).id for name in self.robot.joint_names]
        return ArmPlaces(
            positions=_run(model.jnt_qposadr[joints]),
            velocities=_run(model.jnt_dofadr[joints]),
            motors=_run(motors),
            tip=model.body(self.robot.tip_body).id,
        )


@dataclass(frozen=True, slots=True)
class ArmPlaces:
    """Indices of an arm's numbers in a compiled scene.

    Attributes:
        positions: (k,) of its joints, those that follow others among them, in `qpos`.
        velocities: (k,) of these, in `qvel` and all that is by degree of freedom.
        motors: (n,) in `ctrl`, of the joints that move by themselves.
        tip: the body of its tip.
    """

    positions: slice
    velocities: slice
    motors: slice
    tip: int


def _run(numbers: object) -> slice:
    """A run of consecutive numbers as a slice, of which views can be made."""
    found = np.asarray(numbers)
    assert np.array_equal(found, np.arange(found[0], found[0] + len(found)))
    return slice(int(found[0]), int(found[0]) + len(found))
