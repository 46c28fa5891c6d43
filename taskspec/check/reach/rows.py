"""What a stage asks for, as rows lower <= Ax <= upper, each with its line of the task file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import Axis
from taskspec.program.context import Context
from taskspec.program.limits.bounds import SPEED_SHARE, VELOCITY_SHARE
from taskspec.program.limits.consistency import FRICTION_SHARE, SET_POINT_SHARE, STATIC_SHARE
from taskspec.spec import FILE
from taskspec.text.source import Span

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Line:
    """What a row comes from.

    Attributes:
        kind: set point, velocity, hold, contact, face (of the tool), limit; torque limit or
            velocity limit of a joint.
        words: as a message says it. span: its place; None where the file does not say it.
        mend: what would make room. value, unit: of what is asked for.
    """

    kind: str
    words: str
    span: Span | None
    mend: str
    value: float = 0.0
    unit: str = ""


@dataclass(frozen=True, slots=True)
class Shares:
    """What a stage may take of its bounds: all under a closed form, less under `solve: qp`.

    Attributes:
        force: of `limits.force`. torque: of the motors, by forces at rest. friction: of a contact.
        speed: of `limits.speed`. velocity: of a joint's.
    """

    force: float = 1.0
    torque: float = 1.0
    friction: float = 1.0
    speed: float = 1.0
    velocity: float = 1.0


_PROGRAM = Shares(SET_POINT_SHARE, STATIC_SHARE, FRICTION_SHARE, SPEED_SHARE, VELOCITY_SHARE)


def shares_of(context: Context, name: str) -> Shares:
    """The shares of stage `name`."""
    law = context.law_of(context.loaded.task.stages[name])
    return _PROGRAM if law.solve == "qp" else Shares()


def kept(share: float) -> str:
    """A share in words that follow the bound; nothing where all of it may be taken."""
    return "" if share == 1.0 else f", of which the program keeps to {100 * share:.0f} %"


@dataclass(slots=True)
class System:
    """Rows lower <= Ax <= upper, the line of each, and an x that may satisfy them."""

    size: int
    rows: list[Vector] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    lines: list[Line] = field(default_factory=list)

    def add(self, row: Vector, lower: float, upper: float, line: Line) -> None:
        """Adds a row (size,)."""
        self.rows.append(row)
        self.lower.append(lower)
        self.upper.append(upper)
        self.lines.append(line)

    def arrays(self) -> tuple[Vector, Vector, Vector]:
        """A (m, size), lower (m,), upper (m,)."""
        A = np.array(self.rows).reshape(-1, self.size)
        return A, np.array(self.lower), np.array(self.upper)


@dataclass(frozen=True, slots=True)
class Asked:
    """What a stage asks for.

    Attributes:
        name: of the stage.
        forces: axis to its steady set point, without those of zero, which ask an axis to yield
            rather than for a force [N, N m].
        normals: object to its outward normal (3,), for all that the tool may lean on; None where
            other things return forces too, so that anything may be returned.
        limited: whether `limits.force` is to be looked at.
    """

    name: str
    forces: Mapping[Axis, float]
    normals: Mapping[str, Vector] | None
    limited: bool


def limit_place(context: Context, name: str, key: str) -> Span | None:
    """Where the limit `key` of stage `name` stands."""
    own = context.loaded.task.stages[name].limits
    if own is not None and getattr(own, key) is not None:
        return context.loaded.span(FILE.stages[name].limits[key])
    return context.loaded.span(FILE.limits[key])
