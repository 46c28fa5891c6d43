"""What a stage asks for, as rows lower <= Ax <= upper, each with its cause in the task file."""

from __future__ import annotations

from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.limits.bounds import SPEED_SHARE, VELOCITY_SHARE
from taskspec.program.limits.consistency import FRICTION_SHARE, SET_POINT_SHARE, STATIC_SHARE
from taskspec.program.plan import StagePlan
from taskspec.spec import FILE, KeyPath
from taskspec.text.units import NUMBER, Dimension

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RowCause:
    """What a row comes from.

    Attributes:
        kind: set point, velocity, hold, contact, face (of the tool), limit; torque limit or
            velocity limit of a joint.
        text: as a message has it.
        place: where it stands; None where the file does not say it.
        remedy: what would make room.
        value: of what is asked for.
        dimension: of the value.
    """

    kind: str
    text: str
    place: KeyPath | None
    remedy: str
    value: float = 0.0
    dimension: Dimension = NUMBER


@dataclass(frozen=True, slots=True)
class Shares:
    """What a stage may take of its bounds: all under a closed form, less under `solve: qp`.

    Attributes:
        force: of `limits.force`.
        torque: of the motors, by forces at rest.
        friction: of a contact.
        speed: of `limits.speed`.
        velocity: of a joint's.
    """

    force: float = 1.0
    torque: float = 1.0
    friction: float = 1.0
    speed: float = 1.0
    velocity: float = 1.0


_PROGRAM = Shares(SET_POINT_SHARE, STATIC_SHARE, FRICTION_SHARE, SPEED_SHARE, VELOCITY_SHARE)


def shares_of(stage: StagePlan) -> Shares:
    """The shares of a stage."""
    return _PROGRAM if stage.law.solve == "qp" else Shares()


def kept(share: float) -> str:
    """A share in words that follow the bound; nothing where all of it may be taken."""
    return "" if share == 1.0 else f", of which the program keeps to {100 * share:.0f} %"


@dataclass(slots=True)
class RowSystem:
    """Rows lower <= Ax <= upper.

    Attributes:
        size: of x.
        rows: of A.
        lower: bound of each.
        upper: bound of each.
        causes: what each comes from.
    """

    size: int
    rows: list[Vector] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    causes: list[RowCause] = field(default_factory=list)

    def add(self, row: Vector, lower: float, upper: float, cause: RowCause) -> None:
        """Add a row (size,)."""
        self.rows.append(row)
        self.lower.append(lower)
        self.upper.append(upper)
        self.causes.append(cause)

    def arrays(self) -> tuple[Vector, Vector, Vector]:
        """A (m, size), lower (m,), upper (m,)."""
        A = np.array(self.rows).reshape(-1, self.size)
        return A, np.array(self.lower), np.array(self.upper)


def limit_place(stage: StagePlan, key: str) -> KeyPath:
    """Where a limit of a stage stands."""
    own = stage.spec.limits
    given = own is not None and getattr(own, key) is not None
    return (FILE.stages[stage.name].limits if given else FILE.limits)[key]
