"""Pinocchio's model, rebuilt from what MuJoCo compiled.

Neither MJCF nor URDF is parsed twice: defaults, frames, `ref`, inferred inertias and armature are
read off the compiled arrays, so both engines hold the same arm by construction.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin

from taskspec.robot.poses import pose

_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)


def pinocchio_model(m: mujoco.MjModel) -> tuple[pin.Model, list[tuple[int, pin.SE3]]]:
    """Pinocchio's twin of a MuJoCo model whose joints are all hinges and slides.

    Bodies without joints are merged into the joint that carries them. Pinocchio's `q` equals
    MuJoCo's `qpos`, joint by joint, whatever the `ref`.

    Args:
        m: The compiled model. Lengths in m, masses in kg.

    Returns:
        The model, and for every MuJoCo body the Pinocchio joint that carries it with the body
        frame's pose in that joint's frame.
    """
    model = pin.Model()
    model.name = "robot"
    model.gravity = pin.Motion(np.array(m.opt.gravity), np.zeros(3))
    carried: list[tuple[int, pin.SE3]] = [(0, pin.SE3.Identity())]
    for body in range(1, m.nbody):
        joint, placement = carried[m.body_parentid[body]]
        placement = placement * pose(m.body_pos[body], m.body_quat[body])
        first = m.body_jntadr[body]
        for j in range(first, first + m.body_jntnum[body]):
            joint, placement = _add_joint(model, m, j, joint, placement)
        carried.append((joint, placement))
        if joint:
            R = pose(np.zeros(3), m.body_iquat[body]).rotation
            inertia = R @ np.diag(m.body_inertia[body]) @ R.T
            model.appendBodyToJoint(
                joint,
                pin.Inertia(float(m.body_mass[body]), np.array(m.body_ipos[body]), inertia),
                placement,
            )
    model.armature = np.array(m.dof_armature)
    return model, carried


def _add_joint(
    model: pin.Model, m: mujoco.MjModel, j: int, parent: int, placement: pin.SE3
) -> tuple[int, pin.SE3]:
    """Appends joint `j`, met at `placement`; returns it and the body frame's pose in it."""
    axis, anchor = np.array(m.jnt_axis[j]), np.array(m.jnt_pos[j])
    ref = float(m.qpos0[m.jnt_qposadr[j]])
    # A displacement by -ref along the joint itself makes Pinocchio's zero MuJoCo's ref.
    if m.jnt_type[j] == _HINGE:
        kind = pin.JointModelRevoluteUnaligned(axis)
        to_zero = pin.SE3(pin.exp3(-ref * axis), anchor)
    else:
        kind = pin.JointModelPrismaticUnaligned(axis)
        to_zero = pin.SE3(np.eye(3), anchor - ref * axis)
    limited = bool(m.jnt_limited[j])
    lower, upper = m.jnt_range[j] if limited else (-np.inf, np.inf)
    free = np.full(1, np.inf)
    joint = model.addJoint(
        parent,
        kind,
        placement * to_zero,
        m.joint(j).name,
        free,
        free,
        np.full(1, lower),
        np.full(1, upper),
    )
    return joint, pin.SE3(np.eye(3), -anchor)
