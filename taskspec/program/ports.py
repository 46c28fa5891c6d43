"""Inputs and outputs of a stage's functions, in order."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.robot.model_terms import TermSymbols
from taskspec.signals import SCALARS, VECTORS
from taskspec.signals.table import REFERENCE
from taskspec.spec import Task

Fields = tuple[tuple[str, int], ...]


def slices(fields: Iterable[tuple[str, int]]) -> dict[str, slice]:
    """The slice of each named field of a flat vector."""
    found, at = {}, 0
    for name, length in fields:
        found[name] = slice(at, at + length)
        at += length
    return found


#: The output `health`, squared joint torques, velocities and positions, stays far below this in a
#: sane run.
HEALTHY = 1e12
#: What every stage puts out each tick before its signals, in this order: name and length.
INTERNAL: Fields = (
    ("event", 1),
    ("event_value", 1),
    ("health", 1),
    ("tip", 3),
    ("tip_rotation", 9),
    ("offset", 3),
    ("frame", 9),
    ("angle", 1),
    ("track", 9),
    ("tracks", 1),
    ("conditioning", 1),
    ("violation", 1),
    ("clamped", 1),
    ("unsettled", 1),
    ("limits", 1),
    ("residual", 1),
)


def groups() -> dict[str, tuple[str, ...]]:
    """The vectors of six numbers among the signals, each with what the log has beside it."""
    vectors = itertools.groupby(VECTORS.values(), key=lambda signal: signal.group)
    return {group: next(signals).beside for group, signals in vectors}


def signals() -> Fields:
    """The outputs that are signals, as measured, and the references of vectors."""
    vectors = [
        (name, 6)
        for group, beside in groups().items()
        for name in (group, *([f"{group}_ref"] if REFERENCE in beside else []))
    ]
    return (*vectors, *((name, 1) for name, signal in SCALARS.items() if signal.port))


def fields(
    equations: int, followed: int = 0, gains: int = 0, live: int = 0, rubbed: int = 0
) -> Fields:
    """The outputs of a task's stages; last are those of equations, joints, gains and params.

    Args:
        equations: how many there are. Each has a set point, a measurement, the distance of the
            joints' references from it, and what its constraint cannot make of joint torques.
        followed: joints that follow references in a stage; 0 where none has a path of joints.
        gains: how many of any stage vary.
        live: params that may be set while a stage runs.
        rubbed: joints whose friction is compensated.
    """
    on_equations = ("reaction_ref", "reaction", "gap_ref", "reaction_residual")
    return (
        *INTERNAL,
        *signals(),
        *((name, equations) for name in on_equations),
        ("joint_ref", followed),
        *((("gain", gains),) if gains else ()),
        *((("param", live),) if live else ()),
        *((("friction", rubbed),) if rubbed else ()),
    )


def fields_of(task: Task, joints: int) -> Fields:
    """The outputs of the stages of a task, of an arm with some joints."""
    followed = joints if task.in_joints else 0
    rubbed = 0 if task.control.friction is None else joints
    return fields(len(task.equations), followed, len(task.varying_gains), len(task.live), rubbed)


def now_at_start(task: Task) -> NDArray[np.float64]:
    """A tick's input `now` before the first one.

    Stage time, run time [s], how often each stage has been entered; then the params that may be set
    as they are declared, and their rates.
    """
    live = [param.value for param in task.live.values()]
    return np.array([*np.zeros(first_live(task)), *live, *np.zeros(len(live))])


def first_live(task: Task) -> int:
    """Where in `now` the params are that may be set while a stage runs."""
    return 2 + len(task.stages)


#: Inputs of a stage when it is entered, in this order: name and length.
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


#: What is known of a law's references beside what it commands, in this order: name and length.
LAW: Fields = (("error", 6), ("force_ref", 6))

#: What goes from stage to stage, in this order: name and length. The one reference pose of the tip
#: (p, R by columns) and its velocity (twist), where axes that a force set point has moved are where
#: they were measured; the wrench that the robot applied on axes with a force set point (held), and
#: what was commanded there; all in world axes. Last the angle of a mechanism that the
#: stage kept track of, and whether the next one keeps track of the same; what a frame that tracks
#: the force or the motion has in its memory (track), and which of these (tracks, 0 for none).
HANDED: Fields = (
    *(("p", 3), ("R", 9), ("twist", 6), ("held", 6), ("commanded", 6)),
    *(("angle", 1), ("same", 1), ("track", 9), ("tracks", 1)),
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
