"""A robot with its symbols, and numbers for them at random states."""

from __future__ import annotations

from types import SimpleNamespace

import casadi as ca
import numpy as np

from taskspec.program.clock import Clock
from taskspec.program.execution.compiled_terms import CompiledTerms
from taskspec.robot import load_robot, model_terms

_POSE = SimpleNamespace(xyz=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0))
_TOOL = SimpleNamespace(
    shape="sphere",
    radius=0.01,
    size=None,
    thickness=None,
    length=0.12,
    mass=0.3,
    com=None,
    inertia=None,
)


class MovingArm:
    """Evaluates expressions of the tip's kinematics and of the clock along a motion."""

    def __init__(self, name: str, seed: int) -> None:
        robot = SimpleNamespace(
            model=name, flange=None, base=_POSE, tool=_TOOL, balanced=False
        )  # fmt: skip
        self.robot = load_robot(robot)
        n = self.n = self.robot.pin.nv
        self.q, self.v = ca.SX.sym("q", n), ca.SX.sym("v", n)
        self.clock = Clock(ca.SX.sym("t"), ca.SX.sym("clock"))
        self.terms = model_terms.symbols(self.robot, self.v)
        self._numeric = CompiledTerms(self.robot)
        self._rng = np.random.default_rng(seed)

    def random(self):
        """(q, v) near home, and a time."""
        q = self.robot.home + self._rng.uniform(-0.4, 0.4, self.n)
        return q, self._rng.normal(size=self.n), self._rng.uniform(0.1, 2.0)

    def __call__(self, expressions, state):
        q, v, t = state
        clocks = [self.clock.t, self.clock.clock]
        function = ca.Function("f", [*clocks, self.q, self.v, *self.terms.inputs], expressions)
        self._numeric.at(q, v)
        found = function(t, t, q, v, *self._numeric.arrays)
        found = found if isinstance(found, (tuple, list)) else (found,)
        return [np.array(x).squeeze() for x in found]

    def rate(self, expressions, state, h=1e-6):
        """Central differences along q' = v with v constant, time going on."""
        q, v, t = state
        low, high = (self(expressions, (q + s * h * v, v, t + s * h)) for s in (-1, 1))
        return [(b - a) / (2 * h) for a, b in zip(low, high, strict=True)]
