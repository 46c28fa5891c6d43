"""Inputs and outputs of a stage's functions, in order."""

from __future__ import annotations

import itertools
from collections.abc import Iterable

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.laws.adaptation import PARAMETERS
from taskspec.laws.tank import OUTPUTS as TANK
from taskspec.robot.model_terms import TermSymbols
from taskspec.robot.rebuild import GRAVITY
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


#: What a stage has of the stiffness that it, or one before it, has estimated along each axis.
ESTIMATE: Fields = (
    *(("stiffness", 6), ("stiffness_deviation", 6), ("stiffness_followed", 6)),
    ("stiffness_of", 6),
)
#: The signals that are among these.
ESTIMATED = {
    "stiffness": "stiffness",
    "deviation": "stiffness_deviation",
    "followed": "stiffness_followed",
}


def fields(equations: int, followed: int = 0, more: Fields = ()) -> Fields:
    """The outputs of a task's stages; last are those that not every task has.

    Args:
        equations: how many there are. Each has a set point, a measurement, the distance of the
            joints' references from it, and what its constraint cannot make of joint torques.
        followed: joints that follow references in a stage; 0 where none has a path of joints.
        more: see `optional`.
    """
    on_equations = ("reaction_ref", "reaction", "gap_ref", "reaction_residual")
    return (
        *INTERNAL,
        *signals(),
        *((name, equations) for name in on_equations),
        ("joint_ref", followed),
        *more,
    )


def optional(task: Task, joints: int) -> Fields:
    """Outputs that not every task has, in their order.

    Gains that vary, params that may be set, joints whose friction is compensated or whose
    disturbance is estimated, an energy tank, a payload that laws adapt to, command and load of the
    gripper, stiffness that is estimated.
    """
    found = (
        ("gain", len(task.varying_gains)),
        ("param", len(task.live)),
        ("friction", 0 if task.control.friction is None else joints),
        ("disturbance", joints if task.observes else 0),
        ("tank", len(TANK) if task.tanks else 0),
        ("payload", payload_size(task)),
        ("grip", 2 if task.gripped else 0),
        *(ESTIMATE if task.estimates else ()),
    )
    return tuple((name, size) for name, size in found if size)


def fields_of(task: Task, joints: int) -> Fields:
    """The outputs of the stages of a task, of an arm with some joints."""
    followed = joints if task.in_joints else 0
    return fields(len(task.equations), followed, optional(task, joints))


def now_at_start(task: Task) -> NDArray[np.float64]:
    """A tick's input `now` before the first one.

    Stage time, run time [s], how often each stage has been entered; then the params that may be set
    as they are declared, and their rates; the payload that the controller knows of, and in a task
    that grips command and load of the gripper.
    """
    live = [param.value for param in task.live.values()]
    after = len(live) + payload_size(task) + (2 if task.gripped else 0)
    return np.array([*np.zeros(first_live(task)), *live, *np.zeros(after)])


def first_live(task: Task) -> int:
    """Where in `now` the params are that may be set while a stage runs."""
    return 2 + len(task.stages)


def payload_size(task: Task) -> int:
    """Numbers of a payload that laws adapt to: mass and centre; 0 without any."""
    return 0 if task.adapt is None else len(PARAMETERS)


def payload_place(task: Task) -> slice:
    """Where `now` has them: after the rates of params."""
    first = first_live(task) + 2 * len(task.live)
    return slice(first, first + payload_size(task))


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


def handed_of(task: Task, joints: int) -> Fields:
    """`HANDED`, and what only some tasks hand on.

    The estimate of a disturbance; what is in the tank of the law and in its springs [J], and 1
    where the law had a tank, 0 elsewhere; by axis the stiffness that was estimated, its standard
    deviation, that which gains followed, and the number of the object that it is of, 0 for none.
    """
    more = (
        ("disturbance", joints if task.observes else 0),
        ("tank", 3 if task.tanks else 0),
        *(ESTIMATE if task.estimates else ()),
    )
    return (*HANDED, *((name, size) for name, size in more if size))


@dataclass(frozen=True, slots=True)
class Inputs:
    """The symbols of a tick's inputs, in the order of the function's arguments.

    In a task that `grips`, the last numbers of `now` and `reactions` are the gripper's.
    """

    now: ca.SX
    q: ca.SX
    v: ca.SX
    terms: TermSymbols
    wrench: ca.SX
    reactions: ca.SX
    grips: bool = False

    @property
    def contact(self) -> ca.SX:
        """(6,) the wrench without the weight of what the gripper holds, as far as that is known."""
        if not self.grips:
            return self.wrench
        weight = self.now[-1] * ca.DM([float(g) for g in GRAVITY])
        return ca.vertcat(self.wrench[:3] - weight, self.wrench[3:])

    @property
    def grip(self) -> dict[str, ca.SX]:
        """Signals of the gripper; empty in a task that does not grip."""
        if not self.grips:
            return {}
        force, slip = self.reactions[-2], self.reactions[-1]
        return {"force": force, "slip": slip, "command": self.now[-2], "load": self.now[-1]}

    def symbols(self) -> list[ca.SX]:
        """Arguments before memory and parameters."""
        return [self.now, self.q, self.v, *self.terms.inputs, self.wrench, self.reactions]
