"""The plant about an equilibrium, stepped as the simulator steps it.

Arm and held mechanism have coordinates y = (q, s). The environment is a set of springs and dampers
along rows G y, each with the mass that the simulator's constraint adds,

    f = -(K G y + B G y' + M G y''),    wrench on the tool tip = W f + (dW/dy f_0) y,

and a plant step of length h is semi-implicit Euler, with the joints' own damping D taken at its
end:

    H a = tau - D y' + G^T f + (d(G^T f_0)/dy) y,    y' += h (H + h D)^-1 H a,    y += h y'.

Along exact rows there is no spring: f is what keeps G (y + h y') = 0 at the end of each step.

H, G and the tip's Jacobian stay as they are at the equilibrium; so do C and g, which the arm's own
model cancels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.stability.servo import LinearServo

Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Rows:
    """Some of the environment's springs, r of them.

    Attributes:
        name: of the object, the equation or the grip.
        G: (r, n + c) rate of their deformations per rate of the coordinates.
        W: (6, r) wrench on the tip, world axes, per force along them.
        K, B, M: (r, r) stiffness, damping, added mass.
        turning: (6, n + c) how the wrench at the equilibrium turns with the pose.
        bending: (n + c, n + c) the same for what it does to the coordinates.
        equation: number of the equation that they are, whose reaction is measured; else None.
        exact: they give way not at all; K, B and M are zero.
        rubs: they are friction, which damps as much as the force on the contact is large.
    """

    name: str
    G: Matrix
    W: Matrix
    K: Matrix
    B: Matrix
    M: Matrix
    turning: Matrix
    bending: Matrix
    equation: int | None = None
    exact: bool = False
    rubs: bool = False


@dataclass(frozen=True, slots=True)
class LinearPlant:
    """Arm, held mechanism and environment.

    Attributes:
        n: joints of the arm.
        H: (n + c, n + c) inertia.
        damping: (n + c,) of the joints.
        J: (6, n) of the tip, world axes.
        rows: the environment.
        period: step of the plant [s].
        steps: of them in one period of control.
        tool: (6, 6) inertia of the tool about the tip, where the sensor feels it; else None.
        equations: how many reactions the task measures, those of a gripper among them.
        servo: that follows velocities; None where torques are commanded.
    """

    n: int
    H: Matrix
    damping: Matrix
    J: Matrix
    rows: tuple[Rows, ...]
    period: float
    steps: int
    tool: Matrix | None
    equations: int
    servo: LinearServo | None = None

    @property
    def states(self) -> int:
        """Coordinates, rates, and what the servo remembers."""
        return 2 * self.size + (0 if self.servo is None else self.servo.states)

    @property
    def size(self) -> int:
        """Coordinates, those of a mechanism included."""
        return len(self.H)

    def step(self) -> tuple[Matrix, Matrix]:
        """One period of control with the command held.

        Returns:
            A (s + 6 + e, s) and B (s + 6 + e, n): from the s states and from the command (n,), a
            torque or what a servo follows, to the next ones, the wrench that a sensor at the tip
            has in the last step of the plant, and what the robot applies along each of the e
            equations.
        """
        c, h, n = self.size, self.period, self.n
        G = np.vstack([np.zeros((0, c)), *(r.G for r in self.rows)])
        K, B, M = (_blocks([getattr(r, k) for r in self.rows]) for k in "KBM")
        turning = sum((r.turning for r in self.rows), np.zeros((6, c)))
        bending = sum((r.bending for r in self.rows), np.zeros((c, c)))
        now = np.eye(self.states + n)
        position, rate, command = now[:c], now[c : 2 * c], now[self.states :]
        servo = None if self.servo is None else self.servo.begin(now[2 * c : self.states], command)
        on_joints = np.vstack([command, np.zeros((c - n, now.shape[1]))])
        inertia = self.H + G.T @ M @ G
        implicit = self.H + h * np.diag(self.damping)
        exact = np.array([row.exact for row in self.rows for _ in row.G], dtype=bool)
        E = G[exact]
        yields = h * np.linalg.solve(implicit, self.H @ np.linalg.solve(inertia, E.T))
        # Rows that depend on each other share what they exert.
        keeps = -np.linalg.pinv(E @ yields)
        y, v = position, rate
        for i in range(self.steps):
            if servo is not None and i % servo.servo.every == 0:
                on_joints[:n] = servo.tick(i // servo.servo.every, y[:n], v[:n])
            spring = K @ G @ y + B @ G @ v
            free = on_joints - self.damping[:, None] * v + bending @ y
            a = np.linalg.solve(inertia, free - G.T @ spring)
            if len(E):
                ahead = v + h * np.linalg.solve(implicit, self.H @ a)
                held = keeps @ (E @ (ahead + y / h))
                a = a + np.linalg.solve(inertia, E.T @ held)
            f = -(spring + M @ G @ a)
            if len(E):
                f[exact] = held
            wrench = turning @ y
            a = np.linalg.solve(implicit, self.H @ a)
            v = v + h * a
            y = y + h * v
        wrench = wrench + self._wrench(f)
        if self.tool is not None:
            wrench = wrench - self.tool @ self.J @ a[: self.n]
        kept = [] if servo is None else [servo.end]
        out = np.vstack([y, v, *kept, wrench, self._reactions(f)])
        return out[:, : self.states], out[:, self.states :]

    def _wrench(self, f: Matrix) -> Matrix:
        W = np.hstack([np.zeros((6, 0)), *(r.W for r in self.rows)])
        return W @ f

    def _reactions(self, f: Matrix) -> Matrix:
        """What the robot applies along equations, the opposite of what they exert."""
        found, at = np.zeros((self.equations, f.shape[1])), 0
        for row in self.rows:
            if row.equation is not None:
                found[row.equation] = -f[at]
            at += len(row.G)
        return found


def pressing(plant: LinearPlant, forces: Mapping[str, float]) -> LinearPlant:
    """A plant of unit forces under other ones: what turns with the pose grows with the force.

    Args:
        plant: with 1 N or 1 N m on each contact.
        forces: what the robot applies to them.
    """
    rows = tuple(
        replace(
            row,
            turning=forces[row.name] * row.turning,
            bending=forces[row.name] * row.bending,
            B=forces[row.name] * row.B if row.rubs else row.B,
            M=forces[row.name] * row.M if row.rubs else row.M,
        )
        if row.name in forces
        else row
        for row in plant.rows
    )
    return replace(plant, rows=rows)


def _blocks(parts: list[Matrix]) -> Matrix:
    size = sum(len(part) for part in parts)
    found, at = np.zeros((size, size)), 0
    for part in parts:
        found[at : at + len(part), at : at + len(part)] = part
        at += len(part)
    return found
