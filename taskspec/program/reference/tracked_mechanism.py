"""Where a mechanism is nominally: what follows from the tool that holds it."""

from __future__ import annotations

import casadi as ca

from taskspec.control.reference import opposite
from taskspec.deferred_methods import dataclass
from taskspec.program.clock import Clock
from taskspec.program.context import Context
from taskspec.program.slots import Slots
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.mechanisms import MechanismModel
from taskspec.robot.model_terms import TermSymbols
from taskspec.signals import ObjectState


@dataclass(frozen=True, slots=True)
class TrackedMechanism:
    """A mechanism's coordinate, computed from the tool.

    Attributes:
        mechanism: its geometry.
        angle: [rad], with whole turns counted since the run began.
        since: the angle at which the stage was entered.
        rate: of the angle [rad/s].
        travel: along the axis [m].
    """

    mechanism: MechanismModel
    angle: ca.SX
    since: ca.SX
    rate: ca.SX
    travel: ca.SX

    def updates(self) -> dict[str, ca.SX]:
        """Memory after this tick."""
        return {"angle": self.angle} if self.mechanism.angular else {}


def tracked_mechanism(
    context: Context,
    frame: FrameModel,
    terms: TermSymbols,
    clock: Clock,
    memory: Slots,
    parameters: Slots,
) -> TrackedMechanism | None:
    """The mechanism that a stage in `frame` keeps track of; takes a slot for its angle.

    Args:
        context: for what the robot holds.
        frame: of the stage.
        terms: of the tip, in the world.
        clock: of the stage.
        memory, parameters: where the angle takes its slots.
    """
    mechanism = context.tracked(frame)
    if mechanism is None:
        return None
    if not mechanism.angular:
        zero = ca.SX(0)
        return TrackedMechanism(mechanism, zero, zero, zero, mechanism.travel(terms.p))
    turned = terms.R @ ca.DM(context.start_R.T)
    angle = mechanism.angle(terms.p, turned, memory.add("angle"))
    return TrackedMechanism(
        mechanism=mechanism,
        angle=angle,
        since=parameters.add("angle_at_entry"),
        rate=clock.total_rate(angle, terms),
        travel=mechanism.travel(terms.p),
    )


def mechanism_state(
    tracked: TrackedMechanism | None, held: str, terms: TermSymbols, wrench: ca.SX
) -> dict[str, ObjectState]:
    """What is known of the mechanism that the robot holds, by its name; no other one is known.

    Args:
        tracked: what the stage keeps track of.
        held: name of the mechanism that is held.
        terms: of the tip, in the world.
        wrench: (6,) by the environment about the tip, world axes.
    """
    if tracked is None or tracked.mechanism.name != held:
        return {}
    mechanism, applied = tracked.mechanism, opposite(wrench)
    effort = mechanism.effort(terms.p, applied[:3], applied[3:])
    angle = tracked.angle if mechanism.angular else None
    state = ObjectState(mechanism.kind, coordinate=angle, travel=tracked.travel, effort=effort)
    return {held: state}
