"""`follows`: axes that move as a mechanism's geometry couples them to the others.

About the mechanism's axis the tool turns with the angle of the handle's place. Along it the
tool goes by the lead for every angle: that which another axis of the stage commands, so that both
move in step, else the one that is measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.geometry.axis import Axis
from taskspec.modes.coupling import Coupling, UncoupledError
from taskspec.modes.follows_axes import FollowsAxes
from taskspec.modes.mode import (
    AxisMode,
    HandOver,
    OwnReference,
    ReferenceInputs,
    StageStart,
    from_start,
)
from taskspec.modes.stage import PlannedStage

_ALIGNED = 1e-6


@dataclass(frozen=True, slots=True)
class Follows(AxisMode):
    """An axis that moves as a mechanism's geometry couples it to the others.

    Attributes:
        follows: name of the mechanism.
    """

    follows: str

    name = "follows"
    keys = FollowsAxes.keys
    leads = False

    @classmethod
    def of_keys(cls, values: Mapping[str, Any], *, rotation: bool) -> AxisMode:
        """The mode: an expression is one of other axes."""
        followed = values["follows"]
        if isinstance(followed, Expression):
            return FollowsAxes(rotation, followed)
        return cls(rotation, followed)

    def reference(self, at: ReferenceInputs) -> OwnReference:
        """r = r_0 + ratio times the leader's displacement or angle since the stage start.

        A measured angle gives no acceleration.
        """
        coupling = at.plan.couplings[at.axis]
        if coupling.leader is None:
            assert at.tracked is not None
            ratio = coupling.ratio
            turned = ratio * (at.tracked.angle - at.tracked.since)
            return OwnReference(at.start + turned, ratio * at.tracked.rate, ca.SX(0))
        leader = at.others[coupling.leader]
        begin = at.parameters.add(f"begin.{at.axis}")
        return OwnReference(
            at.start + coupling.ratio * (leader.value - begin),
            coupling.ratio * leader.rate,
            coupling.ratio * leader.acceleration,
        )

    def hand_over(self, at: StageStart) -> HandOver:
        """It counts from where its leader starts, at the rate that is handed over to that."""
        coupling = at.plan.couplings[at.axis]
        if coupling.leader is None:
            return from_start(at)
        going = from_start(at, coupling.ratio * at.rates[coupling.leader])
        begin = {f"begin.{at.axis}": at.starts[coupling.leader]}
        return HandOver(
            going.offset, going.slope, going.time, going.pressed, {**begin, **going.parameters}
        )

    def coupling(self, stage: PlannedStage, axis: Axis) -> Coupling:
        """The coupling of the axis to the mechanism.

        Args:
            stage: of the axis.
            axis: which.

        Raises:
            UncoupledError: the geometry gives no motion of this axis, or it is not known.
        """
        context, frame, followed = stage.context, stage.frame, self.follows
        mechanism = context.mechanisms[followed]
        if context.held != followed:
            raise UncoupledError(
                f"the robot does not hold {followed!r}, so its angle is not known",
                f"hold it: robot.grasp: {followed}.handle",
            )
        along = float(stage.rotation[:, axis.column] @ mechanism.rotation[:, 2])
        if abs(along) < 1 - _ALIGNED:
            raise UncoupledError(
                f"{axis!r} of frame {frame.name!r} is not along the axis of {followed!r}",
                f"take a frame whose axis is that of the mechanism, such as {followed}",
            )
        turns = axis.is_rotation
        if turns and not mechanism.swings:
            raise UncoupledError(
                f"the handle of {followed!r} does not go around its axis, so nothing tells an "
                "angle to follow",
                "give the rotation a mode of its own, such as velocity",
            )
        if not turns and mechanism.lead == 0:
            raise UncoupledError(
                f"{followed!r} is a {mechanism.kind}: turning it moves nothing along its axis",
                "write 'hold'",
            )
        if frame.mechanism is not None:
            return Coupling(0.0, None)
        if turns:
            return Coupling(float(np.sign(along)), None)
        leader = Axis(f"r{axis}")
        plan = stage.plans.get(leader)
        if plan is not None and plan.leads:
            return Coupling(mechanism.lead, leader)
        return Coupling(float(np.sign(along)) * mechanism.lead, None)

    @property
    def loop(self) -> tuple[object, ...]:
        """The name of the mechanism that it follows."""
        return (self.follows,)

    def constraint(self, axis: Axis, rate: str, *, turns: bool) -> str:  # noqa: ARG002
        """The artificial constraint in words: the mechanism that it follows."""
        return f"{axis} follows {self.follows}"
