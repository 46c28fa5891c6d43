"""Loose bodies that are gripped and screwed on: forces at the state in which a step begins."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction, Wiring
from taskspec.spec import Mechanism, Task
from taskspec_runner.plant import pads, thread
from taskspec_runner.plant.arm import SceneArm
from taskspec_runner.plant.equations import XBODY
from taskspec_runner.plant.names import PREFIX
from taskspec_runner.plant.pads import Body

Vector = NDArray[np.float64]


def taken(task: Task) -> dict[str, tuple[Mechanism, str]]:
    """The screws that take a loose body, and that."""
    takes = {name: (m, getattr(m, "takes", None)) for name, m in task.mechanisms.items()}
    return {name: (m, body) for name, (m, body) in takes.items() if body is not None}


def handles(task: Task) -> bool:
    """Whether anything is gripped or screwed on."""
    return bool(task.gripped or taken(task))


class Handling:
    """What grips and what takes loose bodies in the plant.

    Attributes:
        source: (1,) what each jaw is commanded to press with [N]; it is the controller's.
        command: (1,) the same, while the plant is stepped.
        reported: (2,) what each jaw presses with [N], how far the body has slipped [m]; empty
            where nothing is gripped.
        on_tip, about_tip: (3,) force and moment of the pads on the tool tip, world axes [N, N m].
        object_forces: (gripped,) magnitude of what the pads exert on each body [N].
        efforts: (taken,) what the robot applies to each screw that takes a body [N m].
        forces: on the degrees of freedom `dofs`.
        memory, kept: before a step, and after it.
        twist: (6,) of the tip, its angular part first; `body` is the tip's, `tip` its place.
        function: writes these.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, arm: SceneArm, task: Task, report: Vector
    ) -> None:
        """The bodies of a scene; `report` takes what the gripper reports."""
        self._model, self._data, self._task = model, data, task
        places = arm.places(model)
        self.body, self.tip = places.tip, data.xpos[places.tip]
        self.twist, self.command, self.source = np.zeros(6), np.zeros(1), np.zeros(1)
        self.on_tip, self.about_tip = np.zeros(3), np.zeros(3)
        self.reported = report
        screws = taken(task)
        self.object_forces, self.efforts = np.zeros(len(task.gripped)), np.zeros(len(screws))
        gripper, period = arm.declared.gripper, model.opt.timestep
        starts = [pads.start(gripper) for _ in task.gripped] + [thread.start() for _ in screws]
        self._begin = np.concatenate([np.zeros(0), *starts])
        self.memory, self.kept = self._begin.copy(), np.zeros(len(self._begin))
        wiring = Wiring()
        rates = wiring.reads("tip_rates", self.twist)
        axes = ca.reshape(wiring.reads("tip_axes", data.xmat[places.tip]), 3, 3).T
        tip = Body(wiring.reads("tip", self.tip), axes, rates[3:], rates[:3])
        command, memory = wiring.reads("command", self.command), wiring.reads("memory", self.memory)
        bodies = {name: _body(wiring, model, data, name) for name in self._loose()}
        forces = {name: ca.SX.zeros(3) for name in bodies}
        moments = {name: ca.SX.zeros(3) for name in bodies}
        on_tip, about_tip, kept, at = ca.SX.zeros(3), ca.SX.zeros(3), [], 0
        magnitudes, reports, efforts = [], ca.SX.zeros(2), []
        for name in task.gripped:
            held = pads.hold(
                gripper, task.shapes[name], tip, bodies[name], memory[at : at + pads.MEMORY],
                command, wiring, name, arm.robot.tool_body.mobility, period,
            )  # fmt: skip
            at += pads.MEMORY
            kept.append(held.memory)
            forces[name] += held.force
            moments[name] += held.moment
            on_tip -= held.force
            about_tip -= held.at_tip
            magnitudes.append(ca.sqrt(ca.sumsqr(held.force)))
            # Of several bodies the jaws hold one; what has slipped stays reported.
            reports += ca.vertcat(held.presses, held.slipped)
        on_screws = []
        for name, (screw, taking) in screws.items():
            shape = task.shapes[taking]
            place, rate = (
                wiring.reads(f"{which}_{name}", array)
                for which, array in zip(("place", "rate"), self._screw(name), strict=True)
            )
            found = thread.screw_on(
                screw, shape, bodies[taking], place, rate,
                memory[at : at + thread.MEMORY], wiring, name, period,
            )  # fmt: skip
            at += thread.MEMORY
            kept.append(found.memory)
            forces[taking] += found.force
            moments[taking] += found.moment
            on_screws.append(found.on_screw)
            efforts.append(found.effort)
        on_bodies = [
            # A free joint's turning degrees of freedom are about the body's own axes.
            ca.vertcat(forces[name], each.R.T @ moments[name])
            for name, each in bodies.items()
        ]
        dofs = [self._dofs(f"{PREFIX}{name}", 6) for name in bodies]
        dofs += [self._dofs(f"{PREFIX}{name}/shift", 2) for name in screws]
        self.dofs = np.concatenate(dofs)
        self.forces = np.zeros(len(self.dofs))
        wiring.writes(ca.vertcat(*on_bodies, *on_screws), self.forces)
        wiring.writes(ca.vertcat(*kept), self.kept)
        if task.gripped:
            wiring.writes(on_tip, self.on_tip)
            wiring.writes(about_tip, self.about_tip)
            wiring.writes(ca.vertcat(*magnitudes), self.object_forces)
            wiring.writes(reports, self.reported)
        if screws:
            wiring.writes(ca.vertcat(*efforts), self.efforts)
        self.function: BoundFunction = wiring.bound("handling")
        self._applied = data.qfrc_applied

    def _loose(self) -> Iterator[str]:
        """The bodies, each once, in the order of the world."""
        named = {*self._task.gripped, *(body for _, body in taken(self._task).values())}
        return (name for name in self._task.world if name in named)

    def _dofs(self, joint: str, count: int) -> NDArray[np.int64]:
        first = int(self._model.joint(joint).dofadr[0])
        return np.arange(first, first + count, dtype=np.int64)

    def _screw(self, name: str) -> tuple[Vector, Vector]:
        """(2,) views of travel and angle of a screw, and of their rates."""
        joint = self._model.joint(f"{PREFIX}{name}/shift")
        at, dof = int(joint.qposadr[0]), int(joint.dofadr[0])
        return self._data.qpos[at : at + 2], self._data.qvel[dof : dof + 2]

    def apply(self) -> None:
        """Adds the generalised forces at the pose and velocity that `mj_step1` has left."""
        model, data = self._model, self._data
        mujoco.mj_objectVelocity(model, data, XBODY, self.body, self.twist, 0)
        self.function.evaluate()
        mujoco.mj_applyFT(
            model, data, self.on_tip, self.about_tip, self.tip, self.body, data.qfrc_applied
        )
        self._applied[self.dofs] += self.forces
        self.memory[:] = self.kept

    def begin(self) -> None:
        """Opens the jaws, as before a run."""
        self.memory[:] = self._begin


def _body(wiring: Wiring, model: mujoco.MjModel, data: mujoco.MjData, name: str) -> Body:
    """A loose body as its free joint has it."""
    joint = model.joint(PREFIX + name)
    at, dof = int(joint.qposadr[0]), int(joint.dofadr[0])
    place = wiring.reads(f"pose_{name}", data.qpos[at : at + 7])
    rate = wiring.reads(f"rates_{name}", data.qvel[dof : dof + 6])
    q = place[3:] / ca.norm_2(place[3:])
    w, v = q[0], q[1:]
    R = ca.SX.eye(3) + 2 * w * ca.skew(v) + 2 * ca.mtimes(ca.skew(v), ca.skew(v))
    return Body(place[:3], R, rate[:3], R @ rate[3:])
