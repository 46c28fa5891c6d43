"""The reference of a path of joints."""

from __future__ import annotations

import casadi as ca

from taskspec.laws.case import JointReference
from taskspec.motion import blend, polynomial
from taskspec.motion.joint_path import JointPath
from taskspec.program.reference.measurement import Measurement

#: Slots of the joints' positions and rates as the stage is entered, and of the path's timing.
START, RATE, TIMING = "joint_start", "joint_rate", "segment.path"


def joint_reference(path: JointPath, measurement: Measurement) -> JointReference:
    """q_d - q, q'_d and q''_d (n,) of a path; its slots join the parameters.

    It begins where the joints are measured, with the rates that they have there; these fade as
    those of any reference do that is handed over.
    """
    inputs, clock, parameters = measurement.inputs, measurement.clock, measurement.parameters
    n = inputs.q.shape[0]
    timing = parameters.add(TIMING, polynomial.SEGMENT_SIZE)
    start, rate = parameters.add(START, n), parameters.add(RATE, n)
    own = path.at(start, polynomial.evaluate(timing, clock.t))
    stops = rate * (blend.BLEND_TIME / 2)
    place = own + blend.added(clock.t, stops, rate, blend.BLEND_TIME)
    velocity = ca.jtimes(place, clock.t, 1)
    return JointReference(
        error=place - inputs.q, velocity=velocity, acceleration=ca.jtimes(velocity, clock.t, 1)
    )
