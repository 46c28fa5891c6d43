"""The plant's contact as a function of motion: what it exerts on a tool that moves as a log says.

In a step from (q, v) with the acceleration a of the joints, the contact of a ball has the depth
-d, and its point the velocity (v_n, v_t) and J a = (a_n, a_t), along and across the normal. By
MuJoCo's soft constraint with a constant impedance, m = `added_mass`, a contact that sticks exerts

    f_n = -(k d + b v_n + m a_n),    f_t = -I (m a_t + c v_t / I),

I the impratio and c the creep. Beyond the cone, |f_t| > mu f_n, the solver's cost is the squared
distance to the elliptic cone, which gives with u = mu / sqrt(I)

    f_n = (f_n0 + mu |f_t0| / I) / (1 + u^2),    f_t = mu f_n f_t0 / |f_t0|.

As a is known from the log, no solver is needed: every tick is a closed form.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.geometry.rotation import from_rpy
from taskspec.program.bound import RowFunction
from taskspec.program.world.stiffness import IMPEDANCE, added_mass, friction_ratio, settling_rate
from taskspec.shapes import SHAPES, Surface
from taskspec.shapes.overlap import LEAST_FRICTION
from taskspec.spec import Shape, Task
from taskspec_runner.identify.motion import LoggedMotion
from taskspec_runner.identify.rows import cross_rows

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class BallContact:
    """The contact of a ball-ended tool with one shape that stands still.

    Attributes:
        name: of the shape.
        height: (n, 3) places in its own axes -> distances and their gradients.
    """

    name: str
    height: RowFunction

    @classmethod
    def of(cls, name: str, shape: Shape) -> BallContact:
        """That of a declared shape."""
        own: Surface = SHAPES[shape.shape].placed(np.zeros(3), np.eye(3), shape.sizes)
        x = ca.SX.sym("x", 3)
        distance = own.height(x)
        outputs = [ca.densify(distance), ca.densify(ca.gradient(distance, x))]
        return cls(name, RowFunction(ca.Function("height", [x], outputs)))

    def surroundings(self, center: Vector, shape: Shape) -> tuple[Vector, Vector]:
        """(n,) distances of world places (n, 3) from a shape [m], (n, 3) its normals there."""
        R = from_rpy(shape.rpy)
        d, n = self.height((center - np.array(shape.xyz)) @ R)
        return d[:, 0], np.asarray(n @ R.T)

    def touching(
        self,
        motion: LoggedMotion,
        center: Vector,
        radius: float,
        shape: Shape,
        near: NDArray[np.int64],
    ) -> Touching:
        """Where and how a ball touches a shape.

        Args:
            motion: of the arm.
            center: (n, 3) of the ball, world [m].
            radius: of the ball [m].
            shape: with its place.
            near: (m,) the ticks in which they may touch.
        """
        d, n = self.surroundings(center[near], shape)
        depth = radius - d
        there = depth > 0
        rows, depth, n = near[there], depth[there], n[there]
        lever = center[rows] - n * (radius - depth / 2)[:, None] - motion.p[rows]
        v, a = _at(motion.twist[rows], lever), _at(motion.push[rows], lever)
        return Touching(len(center), rows, depth, n, lever, v, a)


@dataclass(frozen=True)
class Touching:
    """The ticks in which a ball touches a shape, which depend on its place alone.

    Attributes:
        ticks: of the log.
        rows: (k,) in which they touch.
        depth: (k,) [m].
        n: (k, 3) normals of the shape.
        lever: (k, 3) from the tip to the contact, world axes [m].
        v, a: (k, 3) of the tool there, world axes [m/s, m/s^2].
    """

    ticks: int
    rows: NDArray[np.int64]
    depth: Vector
    n: Vector
    lever: Vector
    v: Vector
    a: Vector

    def wrench(self, shape: Shape, setting: Setting) -> Vector:
        """(ticks, 6) what the shape exerts on the tip, world axes, moments about the tip [N, N m].

        Args:
            shape: with its contact.
            setting: what else the contact depends on.
        """
        found = np.zeros((self.ticks, 6))
        if len(self.rows):
            force = setting.force(shape, self.depth, self.n, self.v, self.a)
            found[self.rows, :3] = force
            found[self.rows, 3:] = cross_rows(self.lever, force)
        return found


@dataclass(frozen=True)
class Setting:
    """What a contact depends on beside its shape.

    Attributes:
        mobility: of the tool, as MuJoCo counts it [1/kg].
        period: step of the plant [s].
        ratio: how much stiffer friction is against a slip.
        firm: whether friction creeps as little as it may, whatever the damping is.
    """

    mobility: float
    period: float
    ratio: float
    firm: bool

    @classmethod
    def of(cls, task: Task, mobility: float, *, firm: bool) -> Setting:
        """That of a task."""
        return cls(mobility, 1.0 / task.control.plant_rate, friction_ratio(task), firm)

    def force(self, shape: Shape, depth: Vector, n: Vector, v: Vector, a: Vector) -> Vector:
        """(k, 3) on the tool, for depths (k,) [m], normals, velocities, accelerations (k, 3)."""
        k, b = float(shape.stiffness), shape.damping
        m = added_mass(self.mobility)
        b = 0.2 * np.sqrt(k) if b is None else b
        along_v, along_a = (v * n).sum(axis=1), (a * n).sum(axis=1)
        normal = k * depth - b * along_v - m * along_a
        if shape.friction == 0:
            return np.asarray(np.maximum(normal, 0.0)[:, None] * n)
        mu = max(shape.friction, LEAST_FRICTION)
        damping = np.inf if self.firm else max(b, 0.0)
        rate = settling_rate(damping, self.mobility, self.period)
        across = (
            -self.ratio
            * m
            * ((a - along_a[:, None] * n) + rate / IMPEDANCE * (v - along_v[:, None] * n))
        )
        size = np.linalg.norm(across, axis=1)
        u2 = mu**2 / self.ratio
        slides = size > mu * normal
        apart = normal + mu * size / self.ratio <= 0
        sliding = (normal + mu * size / self.ratio) / (1 + u2)
        f_n = np.where(slides, sliding, normal)
        scale = np.where(slides, mu * sliding / np.maximum(size, 1e-300), 1.0)
        force = f_n[:, None] * n + scale[:, None] * across
        force[apart] = 0.0
        return np.asarray(force)


def _at(twist: Vector, lever: Vector) -> Vector:
    """(k, 3) the linear part of twists (k, 6) at levers (k, 3) from what they are of."""
    return np.asarray(twist[:, :3] + cross_rows(twist[:, 3:], lever))
