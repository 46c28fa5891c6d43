"""Bodies that the jaws hold in a stage: what they weigh, and what friction holds of that.

Two pads that press with N hold of a body what it needs for its weight and acceleration, w across
their axis n and f along it, and about the tool's axis a moment tau, where each bears its share:

    hypot(w/2, tau / 2h) <= mu (N - f/2),    w = m |g + a| without its part f along n,

h half of the body's width. Under f one pad presses with N - f/2, the other with N + f/2; a body
that is not to turn between them bears on both alike, so that the weaker one counts. A flat face
that has slid a little rocks on its pads and may hold more (`plant.pads`); that is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import product

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.conditions import bounds_of, names
from taskspec.program.flow import followers
from taskspec.program.interval import ANY, Interval, IntervalAlgebra
from taskspec.program.plan import StagePlan
from taskspec.program.signals import constant
from taskspec.robot.rebuild import GRAVITY
from taskspec.shapes import BoundedSurface
from taskspec.spec import Task
from taskspec.spec.gripper import GripCommand
from taskspec.text.units import LINEAR_ACCELERATION, grams, scaled, show

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class HeldBody:
    """A body that the jaws may hold while a stage moves it.

    Attributes:
        grip: the command that it was gripped by.
        mass: of the body [kg].
        friction: mu, of the pads on it.
        across, along: w and f, of weight and planned acceleration, where these need the most [N].
        moment: tau, of a thread that it is turned on [N m].
        half: its half width between the jaws [m].
    """

    grip: GripCommand
    mass: float
    friction: float
    across: float
    along: float
    moment: float
    half: float

    @property
    def load(self) -> float:
        """Weight and acceleration together [N]."""
        return math.hypot(self.across, self.along)

    @property
    def needed(self) -> float:
        """With which each jaw has to press [N]; 0 without friction."""
        borne = math.hypot(self.across / 2, self.moment / (2 * self.half))
        return borne / self.friction + self.along / 2 if self.friction else 0.0

    @property
    def holds(self) -> float:
        """mu (2 N - f), the most that the pads bear across their axis without a moment [N]."""
        return self.friction * max(2 * self.grip.force - self.along, 0.0)

    def rows(self) -> Iterator[tuple[str, str]]:
        """What is held, and what makes it slip."""
        force = show(self.grip.force, "N", 3)
        yield "holds", f"{self.grip.object} of {grams(self.mass)}, each jaw presses with {force}"
        text = f"beyond {show(self.holds, 'N', 3)} across the jaws"
        if self.mass > 0:
            most = scaled(self.holds / self.mass, LINEAR_ACCELERATION, 3)
            text += f", which is |g + a| = {most}"
        yield "slips", f"{text}; the stage takes {show(self.across, 'N', 3)}{self._turned()}"

    def _turned(self) -> str:
        if not self.moment:
            return ""
        about = f"{show(self.moment, 'N*m', 3)} on a half width of {show(self.half, 'mm', 3)}"
        return f", and {about}: {show(self.needed, 'N', 3)} at each jaw are enough"


@dataclass(frozen=True, slots=True)
class JawCommand:
    """What a stage commands the jaws as it begins.

    Attributes:
        grip: what they close on; None where they open.
        released: what they let go of; empty for whatever they hold.
    """

    grip: GripCommand | None
    released: str = ""

    def rows(self) -> Iterator[tuple[str, str]]:
        """It in words."""
        if self.grip is None:
            yield "releases", self.released or "whatever the jaws hold"
            return
        yield "grips", f"{self.grip.object}, each jaw to press with {show(self.grip.force, 'N', 3)}"


def jaw_command(stage: StagePlan) -> JawCommand | None:
    """What a stage commands the jaws; None where they stay as they were commanded."""
    grip, released = stage.spec.grip, stage.spec.release
    return None if grip is None and released is None else JawCommand(grip, released or "")


def held_bodies(stage: StagePlan, plans: Mapping[str, StagePlan]) -> list[HeldBody]:
    """The bodies that the jaws may hold throughout a stage, one for each grip before it.

    Args:
        stage: that moves them.
        plans: of the stages that are known, by name.
    """
    task = stage.context.loaded.task
    if not task.gripped or stage.spec.grip is not None or stage.spec.release is not None:
        return []
    held = held_as_begins(task).get(stage.name, set())
    found = []
    for grip in in_order(held):
        if grip is not None:
            closed = plans.get(gripping_stage(task, grip), stage)
            found.append(_held(stage, grip, closing_axis(closed)))
    return found


def gripping_stage(task: Task, grip: GripCommand) -> str:
    """The first stage that commands it."""
    return next(name for name, stage in task.stages.items() if stage.grip == grip)


def _held(stage: StagePlan, grip: GripCommand, closed: Vector) -> HeldBody:
    """A body as a stage moves it; the jaws closed on it along `closed` (3,), world axes."""
    shape, n = stage.context.loaded.task.shapes[grip.object], closing_axis(stage)
    moment, half = _moment(stage, grip), half_width(stage, grip.object, closed)
    mass = shape.mass or 0.0
    loads = [mass * (a - np.array(GRAVITY)) for a in _accelerations(stage)]
    bodies = [
        HeldBody(
            grip,
            mass,
            shape.friction,
            across=float(np.linalg.norm(load - n * (n @ load))),
            along=abs(float(n @ load)),
            moment=moment,
            half=half,
        )
        for load in loads
    ]
    return max(bodies, key=lambda body: body.needed)


def in_order(held: set[GripCommand | None]) -> list[GripCommand | None]:
    """By name and force, nothing first."""
    return sorted(held, key=lambda g: ("", 0.0) if g is None else (g.object, g.force))


def held_as_begins(task: Task) -> dict[str, set[GripCommand | None]]:
    """What the jaws may hold as each stage begins that a run may come to; None for nothing.

    What slips out is not counted.
    """
    first = next(iter(task.stages))
    found: dict[str, set[GripCommand | None]] = {first: {None}}
    waiting = [first]
    while waiting:
        name = waiting.pop()
        stage = task.stages[name]
        after: set[GripCommand | None] = set(found[name]) if stage.release is None else {None}
        if stage.grip is not None:
            after = {stage.grip}
        for to in followers(task, name):
            known = found.setdefault(to, set())
            if not after <= known:
                known |= after
                waiting.append(to)
    return {name: found[name] for name in task.stages if name in found}


def closing_axis(stage: StagePlan) -> Vector:
    """(3,) along which the jaws close as the stage begins, world axes."""
    passage = stage.nominal.passage
    R = passage.instants[0].R if passage is not None and passage.instants else stage.context.start_R
    return np.asarray(R[:, stage.context.loaded.task.robot.gripper.row])


def half_width(stage: StagePlan, name: str, n: Vector) -> float:
    """Of a body between the jaws [m], as it lies in the file."""
    solid = stage.context.surfaces[name]
    assert isinstance(solid, BoundedSurface)
    return float(ca.evalf(ca.SX(solid.support(ca.SX(solid.rotation.T @ n)))))


def _accelerations(stage: StagePlan) -> list[Vector]:
    """(3,) what planned moves accelerate by at most, all axes at once, either way; world axes."""
    peaks = []
    for axis, plan in stage.plans.items():
        if axis.is_rotation or not plan.motion:
            continue
        cubic = plan.mode.track(0.0, 0.0)
        if cubic is None:
            continue
        knots, c = (np.asarray(ca.evalf(ca.SX(x))) for x in (cubic.knots, cubic.coefficients))
        spans = np.diff(knots.ravel())
        most = max(np.max(np.abs(2 * c[:, 2])), np.max(np.abs(2 * c[:, 2] + 6 * c[:, 3] * spans)))
        peaks.append(most * stage.nominal.rotation[:, axis.column])
    signs = product((1.0, -1.0), repeat=len(peaks))
    return [
        np.zeros(3) + sum(s * peak for s, peak in zip(each, peaks, strict=True)) for each in signs
    ]


def _moment(stage: StagePlan, grip: GripCommand) -> float:
    """What a stage that turns a body on a thread needs of moment about its axis [N m]."""
    task = stage.context.loaded.task
    screws = [s for s in task.mechanisms.values() if getattr(s, "takes", None) == grip.object]
    turning = [a for a, p in stage.plans.items() if a.is_rotation and p.motion and p.mode.moves]
    if not screws or not turning or stage.spec.until is None:
        return 0.0

    def known(name: object) -> Interval:
        found = constant(stage.context, name)  # type: ignore[arg-type]
        return ANY if found is None else found

    most = max(screw.friction for screw in screws)
    bounds = bounds_of([stage.spec.until.tree], IntervalAlgebra(), known)
    for node, bound in bounds.items():
        about = {str(name) for name in names(node)}
        if about & {f"torque.{axis}" for axis in turning}:
            beyond = max(bound.low, -bound.high)
            most = max(most, beyond if math.isfinite(beyond) else 0.0)
    return most
