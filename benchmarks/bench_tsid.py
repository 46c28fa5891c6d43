"""TSID's closed loop beside this project's, on the same wipe, in one process.

TSID (task space inverse dynamics, Del Prete et al.) solves a program with accelerations and contact
force as variables in every tick. It drives the same plant at the same rate; joint positions,
velocities, torques and the wrench of every tick go into an array. All loops are given as multiples
of a bare `mj_step` of the same scene in the same contact, in processor time of their thread; rounds
alternate. TSID is called from Python through its bindings, which its figure includes; beside it
stands what TSID itself does in a tick: terms, program, solution, torques.

What TSID is given, and how well it wipes, is printed with the figures. Its contacts stick, so that
the one here is a task of low weight against the motion along the table, and its force task holds
15 N open loop: it does not read the wrench.

It needs TSID and the Pinocchio it was built with. tsid 1.7.1 is the last wheel that has its library
in it (libtsid, which later ones need, is compiled on installation), and it goes with pin 3.4, which
is older than what this project asks for but runs this benchmark. An environment of its own with
this project in it gets them by

    pip install --only-binary :all: tsid==1.7.1 pin==3.4.0 eiquadprog==1.2.9
    pip install "cmeel-urdfdom<5" "cmeel-tinyxml2<11"

The last two are what the wheel of Pinocchio was linked with and does not bound: with newer ones it
finds no liburdfdom_sensor.so.4.0.

    python benchmarks/bench_tsid.py
"""

from __future__ import annotations

import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pinocchio as pin
from bench_loop import AFTER, QP, ROUNDS, STEPS, WIPE, Case, Loop

try:
    # Wheels of 1.7 have the module beside the package that should import it.
    from tsid import tsid_pywrap as tsid
except ImportError as error:
    sys.exit(f"TSID cannot be imported: {error}; install a wheel of `tsid` with its own `pin`")

CLOSED_FORM = Case("closed form", "wipe-table", "wipe", WIPE)
PROGRAM = Case("program", "wipe-table", "wipe", WIPE | QP)
#: What `tasks/wipe-table.yaml` says: force [N], friction, sizes [m] and rates [rad/s] of the eight.
PRESS, FRICTION = 15.0, 0.2
SIZE, RATE = np.array([0.06, 0.03]), np.array([2 * np.pi / 4, 4 * np.pi / 4])


class TsidLoop:
    """TSID on the plant of a loop that has come to the wipe.

    Attributes:
        problem: TSID's formulation.
        rows: (ticks, 3 n + 6) what has been recorded: q, v, torque, wrench.
        errors: (ticks, 2) of the tip along x and y [m].
    """

    def __init__(self, loop: Loop) -> None:
        """Sets up tasks, contact and bounds where the arm is."""
        robot = loop.parts.program.context.robot
        self._arm, self._plant = loop.parts.plant.arm, loop.parts.plant
        self._period = loop.parts.program.context.period
        q, v = np.array(self._arm.q), np.array(self._arm.v)
        model = robot.pin.copy()
        frame = pin.Frame("tip", robot.tip_joint, 0, robot.tip, pin.FrameType.OP_FRAME)
        self._tip = model.addFrame(frame)
        self._robot = tsid.RobotWrapper(model, tsid.FIXED_BASE_SYSTEM, False)
        self.problem = problem = tsid.InverseDynamicsFormulationAccForce("wipe", self._robot, False)
        problem.computeProblemData(0.0, q, v)
        pose = self._robot.framePosition(problem.data(), self._tip)
        n = model.nv
        # Along x, y and about all axes of the world; the force has z.
        self._motion = tsid.TaskSE3Equality("tip", self._robot, "tip")
        self._motion.useLocalFrame(False)
        self._motion.setMask(np.array([1.0, 1, 0, 1, 1, 1]))
        self._motion.setKp(np.full(6, 2500.0))
        self._motion.setKd(np.full(6, 100.0))
        problem.addMotionTask(self._motion, 100.0, 1, 0.0)
        posture = tsid.TaskJointPosture("posture", self._robot)
        posture.setKp(np.full(n, 25.0))
        posture.setKd(np.full(n, 10.0))
        problem.addMotionTask(posture, 1e-4, 1, 0.0)
        resting = tsid.TrajectorySample(n)
        resting.value(q)
        posture.setReference(resting)
        up = np.array([0.0, 0, 1])
        contact = tsid.ContactPoint("table", self._robot, "tip", up, FRICTION, 0.1, 60.0)
        contact.useLocalFrame(False)
        contact.setKp(np.zeros(3))
        contact.setKd(np.array([0.0, 0, 60]))
        contact.setReference(pose)
        contact.setForceReference(PRESS * up)
        # Its default gives the normal force a thousandth of the weight of friction.
        contact.setRegularizationTaskWeightVector(np.ones(3))
        problem.addRigidContact(contact, 1.0, 1.0, 1)
        torques = tsid.TaskActuationBounds("torque", self._robot)
        torques.setBounds(-robot.torque_limit, robot.torque_limit)
        problem.addActuationTask(torques, 1.0, 0, 0.0)
        speeds = tsid.TaskJointBounds("speed", self._robot, self._period)
        speeds.setVelocityBounds(-robot.velocity_limit, robot.velocity_limit)
        problem.addMotionTask(speeds, 1.0, 0, 0.0)
        self._kept = posture, contact, torques, speeds
        self._solver = tsid.SolverHQuadProgFast("qp")
        self._solver.resize(problem.nVar, problem.nEq, problem.nIn)
        self._sample, self._ticks = tsid.TrajectorySample(12, 6), 0
        self.rows = np.zeros(((ROUNDS + 5) * STEPS, 3 * n + 6))
        self.errors = np.zeros((len(self.rows), 2))
        # Planned before, so that a tick only looks it up.
        times = AFTER + self._period * np.arange(len(self.rows))
        angles = RATE * times[:, np.newaxis]
        self._references = np.tile(tsid.SE3ToVector(pose), (len(times), 1))
        self._references[:, :2] += SIZE * (np.sin(angles) - np.sin(RATE * AFTER))
        self._rates, self._bends = np.zeros((len(times), 6)), np.zeros((len(times), 6))
        self._rates[:, :2] = SIZE * RATE * np.cos(angles)
        self._bends[:, :2] = -SIZE * RATE**2 * np.sin(angles)

    def run(self, steps: int) -> None:
        """So many ticks with recording."""
        arm, problem, n = self._arm, self.problem, len(self._arm.q)
        for _ in range(steps):
            k = self._ticks
            self._sample.value(self._references[k])
            self._sample.derivative(self._rates[k])
            self._sample.second_derivative(self._bends[k])
            self._motion.setReference(self._sample)
            program = problem.computeProblemData(self._ticks * self._period, arm.q, arm.v)
            solution = self._solver.solve(program)
            if solution.status != 0:
                sys.exit(f"TSID's program has status {solution.status} in tick {self._ticks}")
            torque = problem.getActuatorForces(solution)
            row = self.rows[k]
            row[:n], row[n : 2 * n], row[2 * n : 3 * n] = arm.q, arm.v, torque
            row[3 * n :] = arm.wrench
            self.errors[k] = self._motion.position_error[:2]
            self._plant.step(torque)
            self._ticks += 1

    def solve(self, steps: int) -> None:
        """So many times what TSID does in a tick, and nothing else, in this state."""
        arm, problem = self._arm, self.problem
        for _ in range(steps):
            program = problem.computeProblemData(self._ticks * self._period, arm.q, arm.v)
            problem.getActuatorForces(self._solver.solve(program))

    def says(self) -> str:
        """What TSID is given, and what it has done."""
        p, done = self.problem, slice(STEPS, self._ticks)
        force = self.rows[done, -4]
        error = 1e3 * float(np.sqrt(np.mean(self.errors[done] ** 2)))
        return (
            "TSID: motion of the tip (5 rows), posture (7), point contact (3) with a force (3), "
            "bounds of torque and speed;\n"
            f"{p.nVar} variables, {p.nEq} equality and {p.nIn} inequality rows\n"
            f"it presses with {force.mean():.2f} N (deviation {force.std():.2f} N) "
            f"and is {error:.2f} mm off (rms)"
        )


def main() -> None:
    """Measures the loops in turns."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        base = Loop(CLOSED_FORM, folder / "tsid", native=False)
        foreign = TsidLoop(base)
        runs = {
            "TSID, recorded in an array": (base, foreign.run),
            "TSID's own part of a tick": (base, foreign.solve),
        }
        for case in (CLOSED_FORM, PROGRAM):
            for kind in ("native", "python"):
                loop = Loop(case, folder / f"{case.name} {kind}", native=kind == "native")
                runs[f"{case.name}, {kind}, with log"] = loop, loop.run
        ratios: dict[str, list[float]] = {name: [] for name in runs}
        for _ in range(ROUNDS):
            for name, (loop, run) in runs.items():
                bare = loop.bare_step(STEPS)
                begin = time.thread_time()
                run(STEPS)
                ratios[name].append((time.thread_time() - begin) / STEPS / bare)
        for loop, _ in runs.values():
            loop.recorder.close()
    print(foreign.says())
    for name, values in ratios.items():
        print(f"{name:32} {statistics.median(values):6.2f} x bare mj_step")


if __name__ == "__main__":
    main()
