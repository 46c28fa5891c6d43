"""What goes into a stage's functions and what comes out of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import casadi as ca

from taskspec.control.model_terms import TermSymbols
from taskspec.program import kinematics
from taskspec.program.believed import Believed
from taskspec.program.carriers import Instant
from taskspec.program.references import ReferenceSet
from taskspec.program.signals import SignalTable, applied

Fields = tuple[tuple[str, int], ...]


def slices(fields: Iterable[tuple[str, int]]) -> dict[str, slice]:
    """Where each named field of a flat vector lies."""
    found, at = {}, 0
    for name, length in fields:
        found[name] = slice(at, at + length)
        at += length
    return found


#: What every stage puts out each tick, in this order: name and length.
OUTPUTS: Fields = (
    ("event", 1),
    ("event_value", 1),
    ("health", 1),
    ("tip", 3),
    ("tip_rotation", 9),
    ("offset", 3),
    ("frame", 9),
    ("position", 6),
    ("velocity", 6),
    ("error", 6),
    ("position_ref", 6),
    ("velocity_ref", 6),
    ("force_ref", 6),
    ("measured", 6),
    ("tilt", 1),
    ("speed", 1),
    ("travel", 1),
    ("path_done", 1),
    ("angle", 1),
    ("conditioning", 1),
    ("violation", 1),
    ("clamped", 1),
    ("unsettled", 1),
    ("force_inconsistent", 1),
    ("limited", 1),
    ("limits", 1),
    ("residual", 1),
)


def fields(equations: int) -> Fields:
    """The outputs of a task's stages: `OUTPUTS`, and set point and measurement of each equation."""
    return (*OUTPUTS, ("reaction_ref", equations), ("reaction", equations))


#: What a stage is asked when it is entered, in this order: name and length.
PROBE: Fields = (
    ("frame", 9),
    ("offset", 3),
    ("lever", 3),
    ("here", 3),
    ("rate_map", 9),
    ("turning", 3),
    ("angle", 1),
    ("coordinate", 6),
    ("measured", 6),
)


@dataclass(frozen=True, slots=True)
class Inputs:
    """The symbols of a tick's inputs, in the order of the function's arguments."""

    now: ca.SX
    q: ca.SX
    v: ca.SX
    terms: TermSymbols
    wrench: ca.SX
    reactions: ca.SX

    def symbols(self) -> list[ca.SX]:
        """Arguments before memory and parameters."""
        return [self.now, self.q, self.v, *self.terms.inputs, self.wrench, self.reactions]


def probe(
    arguments: list[ca.SX],
    table: SignalTable,
    references: ReferenceSet,
    believed: Believed | None,
    at: kinematics.FrameState,
    tool: kinematics.ToolPoint,
    point: kinematics.ControlPoint,
    reactions: ca.SX,
    carrier: Instant | None,
) -> ca.Function:
    """Where the tool is in the stage's frame; its last input is the tool point's velocity (3,).

    That is its velocity against what carries the frame. All are in world axes but `here`, which is
    in the coordinates of the frame's carrier.

    Its outputs are the numbers of `PROBE` and the measured reactions (equations,).
    """
    way = ca.SX.sym("way", 3)
    values = {
        "frame": ca.vec(_world(at.R, carrier)),
        "offset": _world(point.offset, carrier),
        "lever": _world(tool.lever if at.foot is not None else ca.SX.zeros(3), carrier),
        "here": point.p if at.foot is None else at.foot,
        "rate_map": ca.vec(at.rate_map),
        "turning": at.turning(way if carrier is None else carrier.A.T @ way),
        "angle": _angle(believed),
        "coordinate": references.six(references.coordinate),
        "measured": references.six(_applied(table)),
    }
    return ca.Function(
        "probe", [*arguments, way], [ca.vertcat(*(values[name] for name, _ in PROBE), reactions)]
    )


def _world(local: ca.SX, carrier: Instant | None) -> ca.SX:
    """Columns given in a carrier's axes, in the world's."""
    return local if carrier is None else carrier.A @ local


def _angle(believed: Believed | None) -> ca.SX:
    return ca.SX(0) if believed is None else believed.angle


def _applied(table: SignalTable) -> dict[str, ca.SX]:
    """Measured force and moment that the robot applies, by axis."""
    return {a: table.scalars[applied(a)] for a in table.axes}


def outputs(
    index: ca.SX,
    value: ca.SX,
    wanted: ca.SX,
    inputs: Inputs,
    point: kinematics.ControlPoint,
    at: kinematics.FrameState,
    table: SignalTable,
    references: ReferenceSet,
    conditioning: ca.SX,
    limited: tuple[ca.SX, ca.SX, ca.SX],
    reactions: tuple[ca.SX, ca.SX],
    believed: Believed | None,
    carrier: Instant | None,
) -> ca.SX:
    """A tick's outputs: the numbers of `fields`.

    Args:
        index, value: the event. wanted: (n,) torque before saturation. inputs: of the tick.
        point, at: of the tool. table: signals. references: of the axes.
        conditioning: of the choice of reduced coordinates.
        limited: how far the closed form is beyond its limits, which pushes have been clamped, and
            whether the force set points have to be held against what contacts return; what comes
            of it is filled in later.
        reactions: (equations,) set points, and what was measured.
        believed: the mechanism that the stage keeps track of. carrier: of the stage's frame.
    """
    terms, scalars = inputs.terms, table.scalars
    six = references.six
    values = {
        "event": index,
        "event_value": value,
        # One number that is not finite as soon as any of these is not. Before saturation: the
        # smaller of a limit and NaN is the limit.
        "health": ca.sumsqr(wanted) + ca.sumsqr(inputs.v) + ca.sumsqr(inputs.q),
        "tip": terms.p,
        "tip_rotation": ca.vec(terms.R),
        "offset": _world(point.offset, carrier),
        "frame": ca.vec(_world(at.R, carrier)),
        "position": six(references.position),
        "velocity": six({a: scalars[f"velocity.{a}"] for a in table.axes}),
        "error": six(references.error),
        "position_ref": six(references.position_ref),
        "velocity_ref": six(references.velocity_ref),
        "force_ref": six(references.force_ref),
        "measured": six(_applied(table)),
        "tilt": scalars["tilt"],
        "speed": scalars["speed"],
        "travel": scalars["travel"],
        "path_done": scalars["path_done"],
        "angle": _angle(believed),
        "conditioning": conditioning,
        "violation": limited[0],
        "clamped": limited[1],
        "unsettled": limited[2],
        "force_inconsistent": scalars["force_inconsistent"],
        "limited": ca.SX(0),
        "limits": ca.SX(0),
        "residual": ca.SX(0),
    }
    return ca.vertcat(*(values[name] for name, _ in OUTPUTS), *reactions)
