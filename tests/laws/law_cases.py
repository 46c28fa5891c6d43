"""Laws filled in with numbers, without a task."""

from __future__ import annotations

import casadi as ca
import numpy as np

from taskspec.control.reference import Reference
from taskspec.laws import LAWS
from taskspec.laws.case import Case
from taskspec.laws.gains import Gain


def gains_on(names, **values):
    """Gains by name (with __ for a dot) and axis, from one number for each axis or for all."""
    return {
        gain.replace("__", "."): {
            name: Gain(float(v), "file")
            for name, v in zip(names, np.broadcast_to(value, len(names)), strict=True)
        }
        for gain, value in values.items()
    }


def as_reference(error, velocity, acceleration, force=None, integral=None, released=None):
    zero = np.zeros(len(error))
    rest = (zero if x is None else x for x in (force, integral, released))
    return Reference(*(ca.SX(x) for x in (error, velocity, acceleration, *rest)))


def command_of(kind, state, reference, gains, joint_velocity=None, **more):
    """What a law asks for; `gains` by name and axis."""
    v = ca.SX(0, 1) if joint_velocity is None else joint_velocity
    return LAWS[kind].command(Case(state, reference, gains, v, **more))
