"""The reference of a path of joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.laws.case import JointReference
from taskspec.modes import HandOver
from taskspec.motion import blend, polynomial
from taskspec.motion.joint_path import JointPath
from taskspec.motion.polynomial import PiecewiseCubic
from taskspec.program.clock import Clock
from taskspec.program.ports import Inputs
from taskspec.program.reference.joint_motion import JointMotion
from taskspec.program.reference.measurement import Measurement

#: Slots of the joints' positions and rates as the stage is entered, and of the path's timing.
START, RATE, TIMING = "joint_start", "joint_rate", "segment.path"
#: Slots of the hand-over to a motion that a file states.
OFFSET, SLOPE, TIME, WAIT = "joint_offset", "joint_slope", "joint_blend", "joint_wait"


@dataclass(frozen=True, slots=True)
class JointStart:
    """The numbers by which a path of joints is entered.

    Attributes:
        parameters: by slot.
        timing: of a path to joint positions; None of a motion that a file states.
        lasts: how long it takes [s].
    """

    parameters: Mapping[str, ca.SX]
    timing: PiecewiseCubic | None
    lasts: ca.SX


def joint_reference(path: JointPath | JointMotion, measurement: Measurement) -> JointReference:
    """q_d - q, q'_d and q''_d (n,) of a path; its slots join the parameters.

    It begins where the joints are measured, with the rates that they have there; these fade as
    those of any reference do that is handed over.
    """
    inputs, clock, parameters = measurement.inputs, measurement.clock, measurement.parameters
    if isinstance(path, JointMotion):
        place = _in_motion(path, measurement)
        velocity = clock.rate(place)
        return JointReference(place, place - inputs.q, velocity, clock.rate(velocity))
    n = inputs.q.shape[0]
    timing = parameters.add(TIMING, polynomial.SEGMENT_SIZE)
    start, rate = parameters.add(START, n), parameters.add(RATE, n)
    own = path.at(start, polynomial.evaluate(timing, clock.t))
    stops = rate * (blend.BLEND_TIME / 2)
    place = own + blend.added(clock.t, stops, rate, blend.BLEND_TIME)
    velocity = ca.jtimes(place, clock.t, 1)
    return JointReference(
        position=place,
        error=place - inputs.q,
        velocity=velocity,
        acceleration=ca.jtimes(velocity, clock.t, 1),
    )


def _in_motion(path: JointMotion, measurement: Measurement) -> ca.SX:
    parameters, n = measurement.parameters, len(path.turns)
    handed = HandOver(
        offset=parameters.add(OFFSET, n),
        slope=parameters.add(SLOPE, n),
        time=parameters.add(TIME),
        pressed=0.0,
        wait=parameters.add(WAIT),
    )
    return path.reference(path.stated(measurement.translate), measurement.clock, handed)


def joint_start(
    path: JointPath | JointMotion,
    inputs: Inputs,
    clock: Clock,
    translate: Callable[[Expression], ca.SX],
) -> JointStart:
    """The start of a path where the joints are measured.

    Args:
        path: of the joints.
        inputs: of the tick at which the stage is entered.
        clock: of the stage.
        translate: makes CasADi of an expression of the file.
    """
    if isinstance(path, JointPath):
        timing = path.timing(inputs.q)
        return JointStart({START: inputs.q, RATE: inputs.v}, timing, timing.rests)
    stated = path.stated(translate)
    first, rate = (ca.substitute(each, clock.t, 0) for each in (stated, clock.rate(stated)))
    handed = path.hand_over(inputs.q, inputs.v, first, rate)
    numbers = {OFFSET: handed.offset, SLOPE: handed.slope, TIME: handed.time, WAIT: handed.wait}
    return JointStart({n: ca.SX(x) for n, x in numbers.items()}, None, path.lasts(handed.wait))
