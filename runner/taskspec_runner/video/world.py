"""The scene of a recorded run, and the state of everything in it at any of its ticks."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

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


class RecordedWorld:
    """The robot in its world.

    Attributes:
        recording: of the run.
        model, data: MuJoCo's, as far as pictures need them.
        links: pairs of bodies of the arm between which nothing is drawn by the robot's file.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        context = recording.program.context
        task = recording.true
        start = truly_holding(context, task)
        scene = build_scene(SceneArm(context.robot, task.robot, start), task, drawn=True)
        model = scene.model
        self.model, self.data = model, mujoco.MjData(model)
        model.vis.quality.offsamples = _SAMPLES
        model.vis.quality.shadowsize = _SHADOW
        self.links = bare_links(model, context.robot.tip_body)
        self._joints = scene.arm.places(model).positions
        self._coupling = context.robot.coupling
        self._moving_bases = MovingBases(model, self.data, task) if moving(task) else None
        self._coordinates = _coordinates(model, task, recording)
        self._loose_at = np.array(
            [int(model.joint(PREFIX + name).qposadr[0]) for name in loose(task)], dtype=int
        )
        self._loose = _loose_poses(recording) if len(self._loose_at) else np.zeros((0, 0))
        settle(model, self.show(0), task, recording.tip)

    def show(self, row: int) -> mujoco.MjData:
        """Puts everything where it was at a row of the log."""
        data, recording = self.data, self.recording
        data.time = float(recording.clock[row])
        data.qpos[self._joints] = self._coupling.joints(recording.q[row])
        for at, values in self._coordinates:
            data.qpos[at] = values[row]
        for i, at in enumerate(self._loose_at):
            data.qpos[at : at + 7] = self._loose[row, 7 * i : 7 * i + 7]
        if self._moving_bases is not None:
            self._moving_bases.drive()
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)
        mujoco.mj_camlight(self.model, data)
        return data


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


def _coordinates(
    model: mujoco.MjModel, task: Task, recording: Recording
) -> list[tuple[int, Vector]]:
    """Of every mechanism's joint: its place in qpos, and its position at every row."""
    columns, found = recording.history.columns, []
    for name, declared in task.mechanisms.items():
        joint = coordinate_joint(name, declared)
        signal = "angle" if declared.angular else "travel"
        found.append((int(model.joint(joint).qposadr[0]), columns[f"{name}.{signal}"]))
        if declared.mechanism == "screw":
            shift = model.joint(f"{PREFIX}{name}/shift")
            found.append((int(shift.qposadr[0]), columns[f"{name}.travel"]))
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
