"""The closed loop of robosuite's operational space controller, beside bare physics, in one process.

robosuite (Zhu et al.) drives its own Panda, which presses its wiping tool onto its own table and
moves it in circles. A new goal is set every 25 steps; in each step the controller is evaluated, as
`env.step` has it. Neither states nor rewards are worked out and nothing is recorded: that is what
`env.step` adds, which is given beside it. All are multiples of a bare `mj_step` of the same scene
in the same contact, in processor time; rounds alternate, medians are printed.

It needs robosuite in an environment of its own, in which this project need not be:

    pip install robosuite==1.5.2 mujoco==3.3.0

With MuJoCo 4.0 robosuite 1.5.2 does not take the type of a hinge for one, and makes no scene.

    python benchmarks/bench_osc.py
"""

from __future__ import annotations

import statistics
import sys
import time

import numpy as np

try:
    import mujoco
    import robosuite
    from robosuite.controllers import load_composite_controller_config
except ImportError as error:
    sys.exit(f"robosuite cannot be imported: {error}; the first lines of this script say how")

#: Steps of physics from one goal to the next, and those of a round.
GOAL_EVERY, STEPS, ROUNDS = 25, 1000, 9
#: Bare steps in a row before the state is put back.
UNCONTROLLED = 100
#: Shares of the greatest change of a goal: down until it touches, in contact, along the table.
DOWN, PRESSED, ALONG = 0.5, 0.3, 0.1
#: Goals until the tool touches, at most, and from then on until it is measured.
APPROACH, SETTLING = 200, 20


class OscLoop:
    """robosuite's wipe by its Panda, in contact."""

    def __init__(self) -> None:
        """Makes the scene, with the tool on the table."""
        config = load_composite_controller_config(controller="BASIC", robot="Panda")
        self._env = robosuite.make(
            "Wipe", robots="Panda", controller_configs=config, has_renderer=False,
            has_offscreen_renderer=False, use_camera_obs=False, control_freq=20, horizon=10**9,
            ignore_done=True,
        )  # fmt: skip
        assert round(self._env.control_timestep / self._env.model_timestep) == GOAL_EVERY
        self.begin()

    def begin(self) -> None:
        """Lowers the tool onto the table, from the start."""
        self._env.reset()
        self.model, self.data = self._env.sim.model._model, self._env.sim.data._data
        self._goals = 0
        for _ in range(APPROACH):
            if self.data.ncon:
                break
            self._env.step(np.array([0.0, 0.0, -DOWN, 0.0, 0.0, 0.0]))
        for _ in range(SETTLING):
            self._env.step(self._action())

    def controlled(self, steps: int) -> None:
        """Steps with the controller alone."""
        sim, robot = self._env.sim, self._env.robots[0]
        for i in range(steps):
            if i % GOAL_EVERY == 0:
                action = self._action()
            sim.step1()
            robot.control(action, policy_step=i % GOAL_EVERY == 0)
            sim.step2()
        assert self.data.ncon, "the tool has left the table"

    def whole(self, steps: int) -> None:
        """Steps as its users make them, with what it observes and rewards."""
        for _ in range(steps // GOAL_EVERY):
            self._env.step(self._action())
        assert self.data.ncon, "the tool has left the table"

    def bare(self, steps: int) -> float:
        """Seconds of so many steps without control; the state is put back every so often."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state, taken = np.zeros(mujoco.mj_stateSize(self.model, kind)), 0.0
        mujoco.mj_getState(self.model, self.data, state, kind)
        for _ in range(steps // UNCONTROLLED):
            taken += cost(self._bare, UNCONTROLLED)
            mujoco.mj_setState(self.model, self.data, state, kind)
            mujoco.mj_forward(self.model, self.data)
        return taken

    def _bare(self, steps: int) -> None:
        for _ in range(steps):
            mujoco.mj_step(self.model, self.data)

    def _action(self) -> np.ndarray:
        """The next goal: in circles along the table, and into it."""
        self._goals += 1
        phase = 2 * np.pi * self._goals / 40
        along = ALONG * np.cos(phase), ALONG * np.sin(phase)
        return np.array([*along, -PRESSED, 0.0, 0.0, 0.0])


def cost(run, steps: int) -> float:
    """Processor time of this thread [s]."""
    began = time.thread_time()
    run(steps)
    return time.thread_time() - began


def main() -> None:
    """Prints the ratios."""
    loop = OscLoop()
    found: dict[str, list[float]] = {}
    for _ in range(ROUNDS):
        loop.begin()
        bare = loop.bare(STEPS)
        found.setdefault("bare step [us]", []).append(1e6 * bare / STEPS)
        for name, run in (("controller and step", loop.controlled), ("env.step", loop.whole)):
            taken = cost(run, STEPS)
            found.setdefault(f"{name}, x bare step", []).append(taken / bare)
            found.setdefault(f"{name}, beyond that [us]", []).append(1e6 * (taken - bare) / STEPS)
    print(f"robosuite {robosuite.__version__}, mujoco {mujoco.__version__}")
    print(f"contacts {loop.data.ncon}, rows of constraints {loop.data.nefc}")
    for name, values in found.items():
        print(f"{name:36} {statistics.median(values):9.2f}")


if __name__ == "__main__":
    main()
