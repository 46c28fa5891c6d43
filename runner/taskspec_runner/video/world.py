"""The scene of a recorded run, and the state of everything in it at any of its ticks."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.context import Context
from taskspec.program.world.holding import truly_holding
from taskspec.spec import Task
from taskspec_runner.plant.arm import SceneArm
from taskspec_runner.plant.looks import settle
from taskspec_runner.plant.loose import loose
from taskspec_runner.plant.mechanisms import coordinate_joint
from taskspec_runner.plant.moving_base import MovingBases, moving
from taskspec_runner.plant.names import PREFIX
from taskspec_runner.plant.plant import Plant
from taskspec_runner.plant.scene import build_scene
from taskspec_runner.video.recording import Recording

Vector = NDArray[np.float64]

#: Samples that multisampling takes of a pixel.
_SAMPLES = 4
#: Edge of the map of the shadows [px].
_SHADOW = 2048


class DrawnWorld:
    """The robot in its world as it is drawn, in any state.

    Attributes:
        model, data: MuJoCo's, as far as pictures need them.
        links: pairs of bodies of the arm between which nothing is drawn by the robot's file.
    """

    def __init__(self, context: Context, true: Task) -> None:
        """The world of a plant, which is that of a task; the arm is of the task's context."""
        start = truly_holding(context, true)
        scene = build_scene(SceneArm(context.robot, true.robot, start), true, drawn=True)
        model = scene.model
        self.model, self.data = model, mujoco.MjData(model)
        model.vis.quality.offsamples = _SAMPLES
        model.vis.quality.shadowsize = _SHADOW
        self.links = bare_links(model, context.robot.tip_body)
        self._task = true
        self._joints = scene.arm.places(model).positions
        self._coupling = context.robot.coupling
        self._moving_bases = MovingBases(model, self.data, true) if moving(true) else None
        self._coordinates = _coordinate_places(model, true)
        self._loose_at = [int(model.joint(PREFIX + name).qposadr[0]) for name in loose(true)]

    def place_arm(self, q: Vector) -> None:
        """Gives the arm its joints' positions (joints,) [rad or m]."""
        self.data.qpos[self._joints] = self._coupling.joints(q)

    def put(
        self, clock: float, q: Vector, coordinates: Sequence[float], loose: Vector
    ) -> mujoco.MjData:
        """Puts everything where it is.

        Args:
            clock: run time, by which bases move [s].
            q: (joints,) of the arm [rad or m].
            coordinates: of mechanisms, each as `coordinate_signals` names it [rad or m].
            loose: (7 bodies,) position [m] and quaternion of each loose body.
        """
        data = self.data
        data.time = clock
        self.place_arm(q)
        data.qpos[self._coordinates] = coordinates
        for i, at in enumerate(self._loose_at):
            data.qpos[at : at + 7] = loose[7 * i : 7 * i + 7]
        if self._moving_bases is not None:
            self._moving_bases.drive()
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_camlight(self.model, data)
        return data

    def settle(self, tip: Vector) -> None:
        """Draws what is endless where the tool goes over it, and stands; see `looks.settle`.

        Args:
            tip: (n, 3) the tool's path in the world [m].
        """
        settle(self.model, self.data, self._task, tip)


class RecordedWorld(DrawnWorld):
    """The robot in its world at any row of a recorded run.

    Attributes:
        recording: of the run.
    """

    def __init__(self, recording: Recording) -> None:
        super().__init__(recording.program.context, recording.true)
        self.recording = recording
        columns = recording.history.columns
        self._columns = [columns[name] for name in coordinate_signals(recording.true)]
        some = bool(loose(recording.true))
        self._loose = _loose_poses(recording) if some else np.zeros((len(recording), 0))
        self.show(0)
        self.settle(recording.tip)

    def show(self, row: int) -> mujoco.MjData:
        """Puts everything where it was at a row of the log."""
        recording = self.recording
        coordinates = [float(column[row]) for column in self._columns]
        return self.put(
            float(recording.clock[row]), recording.q[row], coordinates, self._loose[row]
        )


def bare_links(model: mujoco.MjModel, tip_body: str) -> tuple[tuple[int, int], ...]:
    """Bodies from the tip to the base of which the upper one has no shape of its own.

    A tool that has a shape is drawn as it is: nothing is drawn between it and its flange.
    """
    found = []
    body = model.body(tip_body).id
    if model.body_geomnum[body] > 0:
        body = int(model.body_parentid[body])
    while body > 0:
        parent = int(model.body_parentid[body])
        if parent > 0 and model.body_geomnum[parent] == 0:
            found.append((parent, body))
        body = parent
    return tuple(found)


def coordinate_signals(task: Task) -> list[str]:
    """The columns of a log that place what is on mechanisms, in the order of `DrawnWorld.put`.

    A screw is placed by two: it turns and it travels.
    """
    found = []
    for name, declared in task.mechanisms.items():
        found.append(f"{name}.{'angle' if declared.angular else 'travel'}")
        if declared.mechanism == "screw":
            found.append(f"{name}.travel")
    return found


def _coordinate_places(model: mujoco.MjModel, task: Task) -> list[int]:
    """Their places in `qpos`."""
    found = []
    for name, declared in task.mechanisms.items():
        joints = [coordinate_joint(name, declared)]
        if declared.mechanism == "screw":
            joints.append(f"{PREFIX}{name}/shift")
        found += [int(model.joint(joint).qposadr[0]) for joint in joints]
    return found


def _loose_poses(recording: Recording) -> Vector:
    """(n, 7 bodies) where loose bodies were, which the log does not hold.

    The plant goes through the run once more under the logged torques; the arm is put to where the
    log has it at every tick, so that only what lies about follows from the plant alone.
    """
    context, columns = recording.program.context, recording.history.columns
    true = recording.true
    plant = Plant(context.robot, true, truly_holding(context, true))
    joints = range(1, recording.q.shape[1] + 1)
    v = np.column_stack([columns[f"joint.{i}.velocity"] for i in joints])
    torque = np.column_stack([columns[f"joint.{i}.torque"] for i in joints])
    poses = np.empty((len(recording), len(plant.views.loose)))
    for row in range(len(recording)):
        plant.arm.put(recording.q[row], v[row])
        plant.step(torque[row])
        poses[row] = plant.views.loose
    return poses
