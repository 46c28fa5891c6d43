"""The part of a stage that a mode depends on: protocols, which `program.plan.StagePlan` fits."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import TYPE_CHECKING, Protocol

from taskspec.geometry.axis import Axis
from taskspec.laws.gains import Gains
from taskspec.modes.coupling import Coupling

if TYPE_CHECKING:
    import casadi as ca
    import numpy as np
    from numpy.typing import NDArray


class HeldMechanism(Protocol):
    """The nominal geometry of a mechanism.

    Attributes:
        kind: hinge, slide or screw.
        rotation: (3, 3) its frame in the world; z is its axis.
        lead: along z per angle about it [m/rad].
        swings: whether the handle goes around the axis.
    """

    @property
    def kind(self) -> str: ...  # noqa: D102
    @property
    def rotation(self) -> NDArray[np.float64]: ...  # noqa: D102
    @property
    def lead(self) -> float: ...  # noqa: D102
    @property
    def swings(self) -> bool: ...  # noqa: D102


class HoldingRobot(Protocol):
    """The mechanisms of a task, and which of them the robot holds.

    Attributes:
        held: its name; empty for none.
        mechanisms: by name.
    """

    @property
    def held(self) -> str: ...  # noqa: D102
    @property
    def mechanisms(self) -> Mapping[str, HeldMechanism]: ...  # noqa: D102


class StageFrame(Protocol):
    """The frame of a stage.

    Attributes:
        name: as in the file.
        mechanism: that it turns with; None for none.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def mechanism(self) -> HeldMechanism | None: ...  # noqa: D102


class PlannedAxis(Protocol):
    """An axis of the stage.

    Attributes:
        leads: whether another axis may follow its reference.
    """

    @property
    def leads(self) -> bool: ...  # noqa: D102


class StageStiffness(Protocol):
    """What returns the forces of the stage."""

    def stiffness_of(self, axis: Axis) -> float:
        """Nominal stiffness [N/m] of what a force on an axis acts on, 0 without any."""


class PlannedStage(Protocol):
    """The stage of an axis.

    Attributes:
        context: what the robot holds.
        frame: of the stage.
        rotation: (3, 3) its frame in the world at the start pose.
        plans: who controls each axis.
        environment: what returns forces on its axes.
        gains: of its axes.
        from_rest: axes whose references start from rest in a time of their own.
        couplings: of the axes that follow a mechanism.
    """

    @property
    def context(self) -> HoldingRobot: ...  # noqa: D102
    @property
    def frame(self) -> StageFrame: ...  # noqa: D102
    @property
    def rotation(self) -> NDArray[np.float64]: ...  # noqa: D102
    @property
    def plans(self) -> Mapping[Axis, PlannedAxis]: ...  # noqa: D102
    @property
    def environment(self) -> StageStiffness: ...  # noqa: D102
    @property
    def gains(self) -> Gains: ...  # noqa: D102
    @property
    def from_rest(self) -> Container[Axis]: ...  # noqa: D102
    @property
    def couplings(self) -> Mapping[Axis, Coupling]: ...  # noqa: D102


class StageClock(Protocol):
    """Time in the functions of a stage.

    Attributes:
        t: since the stage began [s].
    """

    @property
    def t(self) -> ca.SX: ...  # noqa: D102

    def rate(self, expression: ca.SX) -> ca.SX:
        """Partial derivative by time."""

    def apart(self, expression: ca.SX) -> tuple[ca.SX, ...]:
        """The summands of an expression, where one of two follows from live params alone."""


class StageSlots(Protocol):
    """Named numbers of a stage's functions."""

    def add(self, name: str, length: int = 1) -> ca.SX:
        """A new slot of `length` numbers; its symbol is a column vector."""


class TrackedAngle(Protocol):
    """The angle of the mechanism that the stage keeps track of.

    Attributes:
        angle: [rad], with whole turns counted since the run began.
        since: the angle at which the stage was entered [rad].
        rate: of the angle [rad/s].
    """

    @property
    def angle(self) -> ca.SX: ...  # noqa: D102
    @property
    def since(self) -> ca.SX: ...  # noqa: D102
    @property
    def rate(self) -> ca.SX: ...  # noqa: D102
