"""An environment of robosuite (Zhu et al.) in contact, under its operational space controller.

A Panda of robosuite's lowers its tool onto its own table, presses, and moves in circles: `Wipe`
with its wiping pad, or `Lift` with closed fingers beside the cube. Nothing is rendered. As a
program it is the other side of a benchmark that runs elsewhere: it reads requests and answers each
with a line of JSON, so that two sides in two environments of Python take turns.

    go N        N times `env.step` in contact
    reset N     N times `env.reset`; then the tool is lowered again, which is not measured
    bare N      N bare `mj_step` of the same scene, in the same contact, without control

`seconds` is what they took in processor time of the process, `wall` by the clock. What robosuite
does in an `env.step` at 50 Hz and 1 kHz: 20 times `mj_step1`, controller, `mj_step2` and the
question to every observable whether it is due; then the observation and the reward. The controller
works out the tip's Jacobian, its inertia and the pseudo-inverses in each of the 20. With
`--observe lean` no more than position and velocity of the joints and the pose of the hand are
observed, `Wipe` has one marker instead of 100, and the reward is a constant.

It needs robosuite in an environment of its own, in which this project need not be. With MuJoCo 4.0
robosuite 1.5.2 does not take the type of a hinge for one, and makes no scene.

    make robosuite
    .robosuite/bin/python benchmarks/robosuite_osc.py --env Wipe --control 50 --sim 1000
"""

from __future__ import annotations

import argparse
import json
import logging
import platform
import sys
import time

import numpy as np

try:
    import mujoco
    import robosuite
    from robosuite import macros
    from robosuite.controllers import load_composite_controller_config
    from robosuite.environments.manipulation.wipe import DEFAULT_WIPE_CONFIG
except ImportError as error:
    sys.exit(f"robosuite cannot be imported: {error}; `make robosuite` makes its environment")

#: Shares of the greatest change of a goal: down until it touches, in contact, along the table.
DOWN, PRESSED, ALONG = 0.5, 0.3, 0.1
#: Seconds of a circle; goals until the tool touches, at most, and from then on until measured.
CIRCLE, APPROACH, SETTLING = 2.0, 400, 20
#: Bare steps in a row before the state is put back.
UNCONTROLLED = 100
#: What `lean` observes.
LEAN = {"robot0_joint_pos", "robot0_joint_vel", "robot0_eef_pos", "robot0_eef_quat"}


class OscLoop:
    """robosuite's environment by its Panda, in contact.

    Attributes:
        env: Of robosuite.
        every: Steps of physics in an `env.step`.
    """

    def __init__(
        self,
        name: str = "Wipe",
        control: int = 20,
        sim: int = 500,
        lean: bool = False,
        hard_reset: bool = False,
    ) -> None:
        """Makes the scene, with the tool on the table.

        Args:
            name: `Wipe` or `Lift`.
            control: Goals a second.
            sim: Steps of physics a second, a multiple of `control`.
            lean: Whether little is observed and no reward worked out.
            hard_reset: Whether a reset makes the model anew, which is robosuite's default.
        """
        macros.SIMULATION_TIMESTEP = 1 / sim
        task = {}
        if name == "Wipe":
            markers = {"num_markers": 1, "use_contact_obs": False} if lean else {}
            task["task_config"] = DEFAULT_WIPE_CONFIG | markers
        self.env = robosuite.make(
            name, robots="Panda", has_renderer=False, has_offscreen_renderer=False,
            controller_configs=load_composite_controller_config(controller="BASIC", robot="Panda"),
            use_camera_obs=False, use_object_obs=not lean, control_freq=control,
            horizon=10**9, ignore_done=True, hard_reset=hard_reset, **task,
        )  # fmt: skip
        if lean:
            for observable in set(self.env._observables) - LEAN:
                self.env.modify_observable(observable, "enabled", False)
            self.env.reward = lambda _: 0.0
        # robosuite rounds down, see findings/robosuite_control_rate_rounded_down.sh.
        self.every = int(self.env.control_timestep / self.env.model_timestep)
        assert self.every * control == sim, "the rate of control has to divide that of physics"
        self._circle = round(CIRCLE * control)
        self.begin()

    def begin(self) -> None:
        """Lowers the tool onto the table, from the start."""
        self.env.reset()
        self.model, self.data = self.env.sim.model._model, self.env.sim.data._data
        self._goals = 0
        for _ in range(APPROACH):
            if self.touches:
                break
            self.env.step(self._padded(np.array([0.0, 0.0, -DOWN, 0.0, 0.0, 0.0])))
        for _ in range(SETTLING):
            self.env.step(self._action())
        assert self.touches, "the tool has not come to the table"

    @property
    def touches(self) -> bool:
        """Whether the tool is on the table."""
        return self.env.check_contact(self.env.robots[0].gripper["right"], "table_collision")

    def controlled(self, steps: int) -> None:
        """Steps with the controller alone."""
        sim, robot = self.env.sim, self.env.robots[0]
        for i in range(steps):
            if i % self.every == 0:
                action = self._action()
            sim.step1()
            robot.control(action, policy_step=i % self.every == 0)
            sim.step2()
        assert self.touches, "the tool has left the table"

    def whole(self, steps: int) -> None:
        """Steps as its users make them, with what it observes and rewards."""
        for _ in range(steps // self.every):
            self.env.step(self._action())
        assert self.touches, "the tool has left the table"

    def bare(self, steps: int, clock=time.thread_time) -> float:
        """Seconds of so many steps without control; the state is put back every so often."""
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        state, taken = np.zeros(mujoco.mj_stateSize(self.model, kind)), 0.0
        mujoco.mj_getState(self.model, self.data, state, kind)
        for _ in range(steps // UNCONTROLLED):
            began = clock()
            for _ in range(UNCONTROLLED):
                mujoco.mj_step(self.model, self.data)
            taken += clock() - began
            mujoco.mj_setState(self.model, self.data, state, kind)
            mujoco.mj_forward(self.model, self.data)
        return taken

    def _action(self) -> np.ndarray:
        """The next goal: in circles along the table, and into it."""
        self._goals += 1
        phase = 2 * np.pi * self._goals / self._circle
        along = ALONG * np.cos(phase), ALONG * np.sin(phase)
        return self._padded(np.array([*along, -PRESSED, 0.0, 0.0, 0.0]))

    def _padded(self, goal: np.ndarray) -> np.ndarray:
        """The goal, and fingers that close, where there are any."""
        return np.concatenate([goal, np.ones(self.env.action_dim - len(goal))])


def answer(loop: OscLoop, request: str) -> dict[str, float]:
    """What a request took, as a line of the answer has it."""
    word, _, number = request.partition(" ")
    count = int(number)
    spent, clock = time.process_time(), time.perf_counter()
    if word == "go":
        loop.whole(count * loop.every)
    elif word == "reset":
        for _ in range(count):
            loop.env.reset()
    elif word == "bare":
        return {"bare": count, "seconds": loop.bare(count, time.process_time)}
    else:
        raise ValueError(f"{request!r} is none of: go N, reset N, bare N")
    taken = {"seconds": time.process_time() - spent, "wall": time.perf_counter() - clock}
    if word == "reset":
        loop.begin()
        return {"resets": count, **taken}
    return {"steps": count, **taken}


def main() -> None:
    """Answers requests until there are no more."""
    parser = argparse.ArgumentParser(description="robosuite's OSC environment, step by request")
    parser.add_argument("--env", choices=["Wipe", "Lift"], default="Wipe")
    parser.add_argument("--control", type=int, default=50, help="goals a second")
    parser.add_argument("--sim", type=int, default=1000, help="steps of physics a second")
    parser.add_argument("--observe", choices=["all", "lean"], default="all")
    parser.add_argument("--hard-reset", action="store_true")
    given = parser.parse_args()
    # robosuite's messages shall not stand among the answers.
    answers, sys.stdout = sys.stdout, sys.stderr
    logging.disable(logging.INFO)
    loop = OscLoop(given.env, given.control, given.sim, given.observe == "lean", given.hard_reset)
    about = {
        "env": given.env, "observe": given.observe, "hard_reset": given.hard_reset,
        "control_hz": given.control, "sim_hz": given.sim, "contacts": int(loop.data.ncon),
        "degrees_of_freedom": int(loop.model.nv),
        "versions": {"robosuite": robosuite.__version__, "mujoco": mujoco.__version__,
                     "numpy": np.__version__, "python": platform.python_version()},
    }  # fmt: skip
    print(json.dumps(about), file=answers, flush=True)
    for line in sys.stdin:
        print(json.dumps(answer(loop, line.strip())), file=answers, flush=True)


if __name__ == "__main__":
    main()
