"""The signals of a stage, by the names that task files, guards and logs use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca

from taskspec.control.model_terms import TermSymbols
from taskspec.control.reference import opposite
from taskspec.geometry.axis import AXES, ROTATIONS, Axis
from taskspec.program.layout import Layout
from taskspec.program.world import felt, kinematics
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.moving_base import MovingBase
from taskspec.robot import RobotModel
from taskspec.shapes import Surface
from taskspec.text.expression.tree import Name

#: |force| above which the tool touches [N] (docs/language.md).
TOUCHING = 0.5
_VECTORS = ("force", "torque", "position", "velocity", "error")


class UnknownSignalError(LookupError):
    """A name that this stage cannot evaluate; the message says why."""


@dataclass(slots=True)
class SignalTable:
    """Measured signals as expressions; grows while the stage is put together.

    Attributes:
        scalars: by full name, such as `force.z` or `gap`.
        axes: axes that exist in the stage's frame.
        elsewhere: resolves `signal in FRAME`.
    """

    scalars: dict[str, ca.SX]
    axes: tuple[Axis, ...]
    elsewhere: Callable[[str, str], ca.SX]

    def lookup(self, name: Name) -> ca.SX:
        """A signal or a constant."""
        text = ".".join(name.path)
        if name.frame is not None:
            return self.elsewhere(text, name.frame)
        if text in self.scalars:
            return self.scalars[text]
        if name.path[0] in _VECTORS and len(name.path) == 2:
            # A component of `norm(...)` that this stage does not have; alone, it has been reported.
            return ca.SX(0)
        raise UnknownSignalError(text)


def applied(axis: Axis) -> str:
    """The signal of what the robot applies on an axis: `force.z`, `torque.rx`."""
    return f"{'torque' if axis.startswith('r') else 'force'}.{axis}"


def wrench_signals(axes: tuple[Axis, ...], wrench: ca.SX) -> dict[str, ca.SX]:
    """`force.*` and `torque.*` of a (6,) wrench that the robot applies, in frame axes."""
    return {applied(a): wrench[AXES.index(a)] for a in axes}


@dataclass(frozen=True, slots=True)
class Resolver:
    """Resolves a signal in another frame than the stage's, at the stage's control point."""

    robot: RobotModel
    frames: Mapping[str, FrameModel]
    terms: TermSymbols
    wrench: ca.SX
    offset: ca.SX | None
    moving_bases: Mapping[str, MovingBase]
    clock: ca.SX
    parameters: Layout

    def __call__(self, signal: str, frame_name: str) -> ca.SX:
        """The component or vector `signal` in the axes of frame `frame_name`."""
        frame = self.frames[frame_name]
        surface = frame.surface
        if surface is not None and surface.parts:
            raise UnknownSignalError(
                f"{signal} in {frame_name}: the {surface.parts} of a {surface.name} are followed "
                "only by the stage's own frame"
            )
        face = felt.symbols(self.parameters, frame) if frame.kind == "estimated" else None
        base = self.moving_bases.get(frame.base_name)
        terms, wrench = self.terms, self.wrench
        if base is not None:
            now = base.at(self.clock)
            terms, wrench = now.relative(terms), now.wrench(wrench)
        tool = kinematics.tool_point(self.robot, terms)
        point = kinematics.control_point(terms, wrench, self.offset)
        at = kinematics.frame_state(frame, terms, tool, face)
        R = at.R
        kind, _, axis = signal.partition(".")
        if kind in ("force", "torque"):
            wrench = opposite(point.wrench)
            vector = ca.vertcat(R.T @ wrench[:3], R.T @ wrench[3:])
        elif kind == "velocity":
            vector = ca.vertcat(R.T @ point.twist[:3], R.T @ point.twist[3:])
        elif kind == "position" and frame.still and axis not in ROTATIONS:
            vector = R.T @ (point.p - at.origin)
        else:
            raise UnknownSignalError(f"{signal} in {frame_name}")
        if axis:
            return vector[AXES.index(axis)]
        return vector[3:6] if kind == "torque" else vector[:3]


def gaps(
    robot: RobotModel,
    surfaces: Mapping[str, Surface],
    p: ca.SX,
    R: ca.SX,
    moving_bases: Mapping[str, MovingBase] | None = None,
    clock: ca.SX | None = None,
) -> dict[str, ca.SX]:
    """Signed distance [m] of the tool's shape from every object, by object name.

    Args:
        robot: for the tool. surfaces: as declared. p, R: (3,), (3, 3) pose of the tip.
        moving_bases: of the objects that move; None has all of them where they are declared.
        clock: [s].
    """
    found = {}
    for name, surface in surfaces.items():
        if moving_bases is not None and name in moving_bases:
            assert clock is not None
            now = moving_bases[name].at(clock)
            found[name] = kinematics.gap(robot, surface, now.place(p), now.A.T @ R)
        else:
            found[name] = kinematics.gap(robot, surface, p, R)
    return found


def normal(
    surface: Surface, point: ca.SX, moving_bases: Mapping[str, MovingBase], name: str, clock: ca.SX
) -> ca.SX:
    """Outward normal (3,) of object `name` at a point (3,), world."""
    if name not in moving_bases:
        return surface.gradient(point)
    now = moving_bases[name].at(clock)
    return now.A @ surface.gradient(now.place(point))
