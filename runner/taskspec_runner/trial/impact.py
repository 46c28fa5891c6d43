"""How the tool meets an object: a mass with a speed on a spring."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.laws.gains import Gain
from taskspec.program.plan import StagePlan
from taskspec.program.world.stiffness import mass_along
from taskspec_runner.trial.moment import Moment

Vector = NDArray[np.float64]

#: Ticks before the touch over which the gap is differentiated.
CLOSING_TICKS = 4


@dataclass(frozen=True, slots=True)
class Impact:
    """A tool that meets an object.

    Attributes:
        contact: the object.
        row: of the first tick at which it touches.
        speed: closing, along the normal [m/s].
        mass: that strikes along the normal [kg]: the arm's, or the apparent one of its law.
        stiffness: of the contact [N/m].
    """

    contact: str
    row: int
    speed: float
    mass: float
    stiffness: float

    @property
    def peak(self) -> float:
        """The blow v sqrt(k m) [N]: what the mass presses with if no damper takes its energy."""
        return self.speed * math.sqrt(self.mass * self.stiffness)

    @property
    def half_period(self) -> float:
        """Of the mass on the contact [s]."""
        return math.pi * math.sqrt(self.mass / self.stiffness)


def impact_at(moment: Moment, row: int, contact: str) -> Impact | None:
    """The touch of an object that begins in a row; None where its gap before is not known.

    Args:
        moment: in the stage that meets it.
        row: the first that touches.
        contact: the object.
    """
    context = moment.stage.context
    first, last = max(0, row - CLOSING_TICKS), row - 1
    gaps = [moment.value(f"{contact}.gap", each) for each in (first, last)]
    if last <= first or not all(map(math.isfinite, gaps)):
        return None
    speed = (gaps[0] - gaps[1]) / ((last - first) * context.period)
    joints = range(1, context.robot.n + 1)
    q = np.array([moment.value(f"joint.{i}.position", row) for i in joints])
    normal = moment.stage.contacts.normal(contact)
    mass = _striking_mass(moment.stage, normal, mass_along(context.robot, q, normal))
    return Impact(contact, row, speed, mass, context.compliances[contact].stiffness)


def _striking_mass(stage: StagePlan, normal: Vector, arm: float) -> float:
    """The mass [kg] that strikes along a normal (3,), of an arm's mass along it [kg]."""
    axis = max(stage.translations, key=lambda a: abs(stage.kinematics.along(a, normal)))
    gains: dict[str, Gain] = {n: by[axis] for n, by in stage.gains.items() if axis in by}
    return stage.law.control_law.strikes_with(gains, arm)


def first_impact(moment: Moment) -> Impact | None:
    """The first touch that begins in a visit, up to a moment; None where none does."""
    touching = moment.trial.history.columns["touching"][: moment.row + 1] > 0
    begins = np.flatnonzero(touching[1:] & ~touching[:-1]) + 1
    begins = begins[begins >= moment.visit.first]
    if not len(begins):
        return None
    row = int(begins[0])
    contact = moment.pressed_at(row)
    return impact_at(moment, row, contact) if contact else None
