"""Pinocchio's model, rebuilt from what MuJoCo compiled.

Neither MJCF nor URDF is parsed twice: defaults, frames, `ref`, inferred inertias and armature are
read off the compiled arrays, so both engines hold the same arm by construction.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from taskspec.deferred import mujoco
from taskspec.deferred_methods import dataclass
from taskspec.robot.poses import pose

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[Any]


@dataclass(frozen=True, slots=True)
class Bodies:
    """The numbers of a MuJoCo model whose joints are all hinges and slides, by MuJoCo's names.

    The world is the first body. `hinge`, `limited` and `ref` are of each joint.
    """

    gravity: Array
    body_parentid: Array
    body_pos: Array
    body_quat: Array
    body_ipos: Array
    body_iquat: Array
    body_inertia: Array
    body_mass: Array
    body_jntadr: Array
    body_jntnum: Array
    jnt_axis: Array
    jnt_pos: Array
    jnt_range: Array
    hinge: Array
    limited: Array
    ref: Array
    armature: Array
    joint_names: tuple[str, ...]

    @staticmethod
    def of(m: mujoco.MjModel) -> Bodies:
        """Those of a model. Lengths in m, masses in kg."""
        own = {
            name: np.array(getattr(m, name))
            for name in Bodies.__match_args__
            if name.startswith(("body_", "jnt_"))
        }
        return Bodies(
            gravity=np.array(m.opt.gravity),
            hinge=np.array(m.jnt_type == mujoco.mjtJoint.mjJNT_HINGE),
            limited=np.array(m.jnt_limited, dtype=bool),
            ref=np.array(m.qpos0[m.jnt_qposadr]),
            armature=np.array(m.dof_armature),
            joint_names=tuple(m.joint(j).name for j in range(m.njnt)),
            **own,
        )


def pinocchio_model(m: Bodies) -> tuple[pin.Model, list[tuple[int, pin.SE3]]]:
    """Pinocchio's twin of a MuJoCo model whose joints are all hinges and slides.

    Bodies without joints are merged into the joint that carries them. Pinocchio's `q` equals
    MuJoCo's `qpos`, joint by joint, whatever the `ref`.

    Args:
        m: Its numbers.

    Returns:
        The model, and for every MuJoCo body the Pinocchio joint that carries it with the body
        frame's pose in that joint's frame.
    """
    model = pin.Model()
    model.name = "robot"
    model.gravity = pin.Motion(m.gravity, np.zeros(3))
    carried: list[tuple[int, pin.SE3]] = [(0, pin.SE3.Identity())]
    for body in range(1, len(m.body_mass)):
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
                pin.Inertia(float(m.body_mass[body]), m.body_ipos[body], inertia),
                placement,
            )
    model.armature = m.armature
    return model, carried


def _add_joint(
    model: pin.Model, m: Bodies, j: int, parent: int, placement: pin.SE3
) -> tuple[int, pin.SE3]:
    """Appends joint `j`, met at `placement`; returns it and the body frame's pose in it."""
    axis, anchor = m.jnt_axis[j], m.jnt_pos[j]
    ref = float(m.ref[j])
    # A displacement by -ref along the joint itself makes Pinocchio's zero MuJoCo's ref.
    if m.hinge[j]:
        kind = pin.JointModelRevoluteUnaligned(axis)
        to_zero = pin.SE3(pin.exp3(-ref * axis), anchor)
    else:
        kind = pin.JointModelPrismaticUnaligned(axis)
        to_zero = pin.SE3(np.eye(3), anchor - ref * axis)
    lower, upper = m.jnt_range[j] if m.limited[j] else (-np.inf, np.inf)
    free = np.full(1, np.inf)
    joint = model.addJoint(
        parent,
        kind,
        placement * to_zero,
        m.joint_names[j],
        free,
        free,
        np.full(1, lower),
        np.full(1, upper),
    )
    return joint, pin.SE3(np.eye(3), -anchor)
