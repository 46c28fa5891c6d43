"""A compiled stage under `solve: qp` at states that a run may or may not reach."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from taskspec.compiler import compile_unchecked
from taskspec.control.qp import QuadraticProgram
from taskspec.laws import LAWS
from taskspec.program.ports import fields, slices
from taskspec.program.program import Program
from taskspec.spec import load_text

FIELDS = slices(fields(0))
STARTS = {
    "panda": ("[500 mm, 0, 300 mm]", "z", "[500 mm, 0, 300 mm]", "[0, 0, 0]", -1),
    "ur5e": ("[500 mm, 0, 300 mm]", "z", "[500 mm, 0, 300 mm]", "[0, 0, 0]", -1),
    "planar3": ("[400 mm, 100 mm, 0]", "x", "[400.5 mm, 0, 0]", "[0, -90 deg, 0]", 1),
    "planar2": ("[400 mm, 100 mm, 0]", "x", "[400.5 mm, 0, 0]", "[0, -90 deg, 0]", 1),
}


def press_text(robot: str, law: str, solver: str = "daqp", limits: str = "", **extra: str) -> str:
    """A stage that presses on a plane and moves along it."""
    start, normal, at, turned, sign = STARTS[robot]
    friction = extra.get("friction", "0.2")
    ways = extra.get("ways", f"{normal}: {{force: {sign * 20} N}}, y: {{velocity: 30 mm/s}}")
    velocities = LAWS[law].commands == "velocity"
    rate = ", torque_rate: 1000 N*m/s" if solver and not velocities else ""
    arm = f"model: {robot}, command: velocity" if velocities else f"model: {robot}"
    return f"""\
taskspec: 1
name: press
robot: {{{arm}, start: {{xyz: {start}}}}}
world:
  table: {{shape: plane, xyz: {at}, rpy: {turned}, stiffness: 10 kN/m, friction: {friction}}}
law: {{kind: {law}{f", solve: qp, solver: {solver}" if solver else ""}}}
limits: {{{limits or "force: 60 N, speed: 400 mm/s" + rate}}}
stages:
  press: {{axes: {{{ways}}}, time: 1 s}}
"""


@lru_cache(maxsize=64)
def _compiled(text: str) -> Program:
    return compile_unchecked(load_text(text, "press.yaml"))


class States:
    """One stage's functions, evaluated at states that are written into its arrays."""

    def __init__(self, text: str, seed: int = 0) -> None:
        self.program = _compiled(text)
        self.context, self.robot = self.program.context, self.program.context.robot
        self.stage, self.machine = self.program.stages[0], self.program.machine()
        self.rng = np.random.default_rng(seed)
        self.n = self.robot.pin.nv
        self.machine.q[:] = self.context.start
        self.machine.start()
        self.runner = self.machine.runner
        self.solver = self.runner.solver
        self._entered = (self.runner.memory.copy(), self.runner.parameters.copy())

    def draw(self, *, turned=0.3, fast=0.3, force=15.0, rate=20.0) -> None:
        """A random state: joints near the start, a wrench, a memory, torques of the tick before."""
        self.draw_present(turned=turned, fast=fast, force=force)
        self.draw_past(rate=rate)

    def draw_present(self, *, turned=0.3, fast=0.3, force=15.0) -> None:
        """The part of a random state that the closed form depends on."""
        machine, rng = self.machine, self.rng
        machine.q[:] = self.context.start + rng.uniform(-turned, turned, self.n)
        machine.v[:] = rng.normal(size=self.n) * fast
        machine.wrench[:3], machine.wrench[3:] = rng.normal(size=3) * force, rng.normal(size=3)
        machine.now[0] = rng.uniform(0, 1)
        machine.now[1] = rng.uniform(0, 10)
        memory, parameters = self._entered
        self.runner.memory[:] = memory + rng.normal(size=len(memory)) * 1e-2
        self.runner.parameters[:] = parameters
        machine.update_terms()
        self.evaluate()

    def draw_past(self, *, rate=20.0) -> None:
        """Random torques of the tick before, near those of this one."""
        last = self.torque + self.rng.uniform(-1, 1, self.n) * rate
        if "last_torque" in self.stage.parameters:
            self.runner.remember(last, last)
            self.evaluate()

    def evaluate(self) -> None:
        """The law: `torque` is u* afterwards, `violation` how far it is beyond the limits."""
        self.runner.tick.evaluate()

    @property
    def torque(self):
        return self.machine.torque

    @property
    def violation(self) -> float:
        """How far `torque` is beyond the limits."""
        return float(self.machine.outputs[FIELDS["violation"].start])

    @property
    def clamped(self) -> bool:
        """Whether a push was beyond its bounds, so that `torque` is not the closed form's."""
        return bool(self.machine.outputs[FIELDS["clamped"].start])

    def same_state(self, other: States) -> None:
        """Takes over the state, the memory and the shared parameters of another stage."""
        for mine, theirs in zip(self.machine._inputs, other.machine._inputs, strict=True):
            mine[:] = theirs
        for mine, theirs, ours, their_layout in (
            (self.runner.memory, other.runner.memory, self.stage.memory, other.stage.memory),
            (
                self.runner.parameters,
                other.runner.parameters,
                self.stage.parameters,
                other.stage.parameters,
            ),
        ):
            for name in ours.slots:
                ours.write(mine, name, theirs[their_layout.slots[name]])
        self.machine.update_terms()
        self.evaluate()

    def problem(self) -> QuadraticProgram:
        """The program around the torque of the last evaluation; the solver's own arrays."""
        self.solver.assemble.evaluate()
        return self.solver._problem

    def copy(self) -> QuadraticProgram:
        """The same in arrays of its own."""
        p = self.problem()
        return QuadraticProgram(p.P.copy(), p.g.copy(), p.A.copy(), p.lower.copy(), p.upper.copy())

    def acceptance(self, x, dual) -> tuple[np.ndarray, float]:
        """Torque (n,) and KKT residual of an answer."""
        solver = self.solver
        solver._x[:], solver._dual[:] = x, dual
        # The answer itself is looked at, before a solver's tolerance is cut off at the rate.
        *_, most, step = solver.accept.arguments
        most[:], step[:] = np.inf, np.inf
        solver.accept.evaluate()
        return solver.accepted.copy(), float(solver.residual[0])
