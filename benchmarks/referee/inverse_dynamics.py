"""TSID: task space inverse dynamics, as the library `tsid` formulates it.

A. Del Prete, F. Nori, G. Metta, L. Natale, "Prioritized motion-force control of constrained
fully-actuated robots", Robotics and Autonomous Systems 63 (2015). In every tick it solves

    min  w_m |J a + J' q' - a_d|^2 + w_c |J_c a + J_c' q' + k_c v|^2
         + w_f |f - f_d|^2 + w_0 |a - a_0|^2
    with M a + C q' + g = tau + J_c^T f,  f in its friction cone,  tau within the arm's limits

where a_d = k_p e + k_d e' on the axes that are led. An axis with a set point of force is that of a
point contact; its force is commanded open loop, since the formulation reads no wrench. Contacts of
TSID stick: the motion along the surface is commanded with more weight than that.

The library's wheels need an older Pinocchio, so this runs in an environment of its own:

    python -m referee.inverse_dynamics ARM.json PORT
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from tsid import tsid_pywrap as tsid

from referee.rebuilt import model_of
from referee.session import Sample, Session

Vector = NDArray[np.float64]

#: Weights of the motion, of the contact with its force, and of the posture.
MOTION, CONTACT, REST = 100.0, 1.0, 1e-4
#: Of the contact: damping [1/s], friction, least and most force [N]; of the posture: gain [1/s^2].
DAMPING, FRICTION, LEAST, MOST, POSTURE = 60.0, 0.2, 0.1, 100.0, 25.0


class InverseDynamics:
    """The law."""

    def __init__(self, arm: dict[str, Any], bandwidth: float) -> None:
        """Takes an arm as `Arm.described` has it, and the bandwidth of its motion [Hz]."""
        self._arm, self._gain = arm, (2 * np.pi * bandwidth) ** 2
        self._visit: tuple[int, list[bool]] | None = None
        self._stage: _Formulation | None = None
        self._time = 0.0
        self._rest: Vector | None = None

    def command(self, sample: Sample) -> Vector:
        """(n,) joint torques [N m]."""
        if not sample.visit:
            return sample.extras["gravity"]
        self._rest = sample.q.copy() if self._rest is None else self._rest
        key = (sample.visit, sample.on_force.tolist())
        if self._stage is None or key != self._visit or sample.time < self._time:
            self._visit = key
            self._stage = _Formulation(self._arm, self._gain, self._rest, sample)
        self._time = sample.time
        return self._stage.torque(sample)


class _Formulation:
    """Tasks and contact of a stage, in axes that turn with the tool.

    As the stage begins they are those of the stage's frame.
    """

    def __init__(self, arm: dict[str, Any], gain: float, rest: Vector, sample: Sample) -> None:
        model = model_of(arm)
        n = model.nv
        tip = _turn(sample.extras["tip_rotation"])
        own = pin.SE3(tip.T @ _turn(sample.extras["frame"]), np.zeros(3))
        self._turned = own.rotation
        place = pin.SE3(np.array(arm["tip"])) * own
        model.addFrame(pin.Frame("tip", arm["tip_joint"], 0, place, pin.FrameType.OP_FRAME))
        self._robot = tsid.RobotWrapper(model, tsid.FIXED_BASE_SYSTEM, False)
        problem = tsid.InverseDynamicsFormulationAccForce("stage", self._robot, False)
        problem.computeProblemData(0.0, sample.q, sample.v)
        self._problem = problem
        self._motion = tsid.TaskSE3Equality("tip", self._robot, "tip")
        self._motion.useLocalFrame(True)
        self._motion.setMask(np.where(sample.on_force, 0.0, 1.0))
        self._motion.setKp(np.full(6, gain))
        self._motion.setKd(np.full(6, 2 * np.sqrt(gain)))
        problem.addMotionTask(self._motion, MOTION, 1, 0.0)
        posture = tsid.TaskJointPosture("posture", self._robot)
        posture.setKp(np.full(n, POSTURE))
        posture.setKd(np.full(n, 2 * np.sqrt(POSTURE)))
        resting = tsid.TrajectorySample(n)
        resting.value(rest)
        posture.setReference(resting)
        problem.addMotionTask(posture, REST, 1, 0.0)
        self._contact, self._along = None, np.flatnonzero(sample.on_force[:3])
        if self._along.size:
            self._press(sample)
        torques = tsid.TaskActuationBounds("torque", self._robot)
        torques.setBounds(-np.array(arm["torque"]), np.array(arm["torque"]))
        problem.addActuationTask(torques, 1.0, 0, 0.0)
        self._kept = posture, torques
        self._solver = tsid.SolverHQuadProgFast("qp")
        self._solver.resize(problem.nVar, problem.nEq, problem.nIn)
        self._wanted = tsid.TrajectorySample(12, 6)

    def _press(self, sample: Sample) -> None:
        normal = np.zeros(3)
        normal[self._along[0]] = 1.0
        contact = tsid.ContactPoint("surface", self._robot, "tip", normal, FRICTION, LEAST, MOST)
        contact.useLocalFrame(True)
        contact.setKp(np.zeros(3))
        contact.setKd(DAMPING * normal)
        contact.setReference(self._pose(sample))
        # Its default gives the normal force a thousandth of the weight of friction.
        contact.setRegularizationTaskWeightVector(np.ones(3))
        self._problem.addRigidContact(contact, CONTACT, CONTACT, 1)
        self._contact = contact

    def _pose(self, sample: Sample) -> pin.SE3:
        tip = _turn(sample.extras["tip_rotation"])
        return pin.SE3(tip @ self._turned, sample.extras["tip"].copy())

    def command(self, sample: Sample) -> Vector:
        """(n,) joint torques [N m]."""
        here, T = self._pose(sample), sample.frame
        off = T @ np.where(sample.on_force, 0.0, sample.off)
        turned = pin.exp3(off[3:]) @ here.rotation
        self._wanted.value(tsid.SE3ToVector(pin.SE3(turned, here.translation + off[:3])))
        self._wanted.derivative(sample.jacobian @ sample.v + T @ sample.off_rate)
        self._wanted.second_derivative(np.zeros(6))
        self._motion.setReference(self._wanted)
        if self._contact is not None:
            # In the contact's axes, by the surface on the tool.
            by_surface = -here.rotation.T @ (T[:3, :3] @ sample.feed[:3])
            self._contact.setForceReference(by_surface)
        program = self._problem.computeProblemData(sample.time, sample.q, sample.v)
        solution = self._solver.solve(program)
        if solution.status != 0:
            sys.exit(f"the program has status {solution.status} at {sample.time:.3f} s of a stage")
        return np.asarray(self._problem.getActuatorForces(solution))


def _turn(values: Vector) -> Vector:
    return values.reshape(3, 3).T.copy()


if __name__ == "__main__":
    described = json.loads(Path(sys.argv[1]).read_text("utf-8"))
    law = InverseDynamics(described, float(sys.argv[3]))
    Session(int(sys.argv[2]), "TSID").drive(law)
