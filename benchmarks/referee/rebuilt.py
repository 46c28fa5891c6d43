"""An arm's model in any Pinocchio, from the numbers that `Arm.described` has of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin


def model_of(arm: dict[str, Any]) -> pin.Model:
    """Pinocchio's model, without the tip's frame."""
    model = pin.Model()
    kinds = (pin.JointModelPrismaticUnaligned, pin.JointModelRevoluteUnaligned)
    for i, joint in enumerate(arm["joints"]):
        kind, place = kinds[joint["turns"]](np.array(joint["axis"])), np.array(joint["place"])
        number = model.addJoint(joint["parent"], kind, pin.SE3(place), f"joint {i + 1}")
        inertia = pin.Inertia(joint["mass"], np.array(joint["lever"]), np.array(joint["inertia"]))
        model.appendBodyToJoint(number, inertia, pin.SE3.Identity())
    model.armature = np.array(arm["armature"])
    model.gravity = pin.Motion(np.array(arm["gravity"]), np.zeros(3))
    return model
