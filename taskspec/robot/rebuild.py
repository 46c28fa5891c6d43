"""A robot's file made clean: the arm alone, everything explicit, nothing that is not wanted.

What MuJoCo compiled is written down anew, body by body. So defaults, includes, keyframes,
actuators, sensors, tendons, world objects and collisions of the file cannot reach the plant, and
both engines are made from one source of numbers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from taskspec.deferred import mujoco
from taskspec.deferred_methods import dataclass
from taskspec.robot.chain import Chain
from taskspec.robot.description import BOUND_MASS, Description
from taskspec.robot.poses import pose, quaternion

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

_DRAWN = ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX", "MESH")
_HIDDEN_GROUP = 3
GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True, slots=True)
class Rebuilt:
    """The clean arm.

    Attributes:
        spec: Bodies, chain joints and geoms; no tool and no motors yet.
        carrier: The body that carries the flange.
        joint_names: Names of the chain's joints, in order.
        body_names: Names of all bodies.
        notes: What was left out, one sentence each.
    """

    spec: mujoco.MjSpec
    carrier: mujoco.MjsBody
    joint_names: tuple[str, ...]
    body_names: tuple[str, ...]
    notes: tuple[str, ...]


def rebuild(description: Description, chain: Chain, home: Array, base: pin.SE3) -> Rebuilt:
    """Writes the arm of a file down anew.

    Joints that do not move the flange are locked where `home` has them. Geoms are kept for
    pictures.

    Args:
        description: The robot's file.
        chain: Its joints to keep.
        home: (nq,) configuration of the whole file.
        base: Pose of the file's world in the task's world.
    """
    m = description.model
    data = mujoco.MjData(m)
    data.qpos[:] = home
    mujoco.mj_kinematics(m, data)
    spec = mujoco.MjSpec()
    spec.modelname = "robot"
    spec.compiler.degree = False
    spec.compiler.fusestatic = False
    spec.option.gravity = GRAVITY
    root = m.body_rootid[chain.body]
    bodies = {0: spec.worldbody}
    names: dict[int, str] = {}
    joint_names: list[str] = []
    taken = {m.body(i).name for i in range(m.nbody)} | {m.joint(j).name for j in range(m.njnt)}
    meshes = _Meshes(spec, m)
    for i in range(1, m.nbody):
        if m.body_rootid[i] != root:
            continue
        parent = int(m.body_parentid[i])
        first = m.body_jntadr[i]
        joints = range(first, first + m.body_jntnum[i])
        kept = [j for j in joints if j in chain.joints]
        placement = pose(m.body_pos[i], m.body_quat[i])
        if len(kept) < len(joints):
            placement = _body_pose(data, parent).inverse() * _body_pose(data, i)
        if parent == 0:
            placement = base * placement
        names[i] = m.body(i).name or _fresh("body", taken)
        body = bodies[parent].add_body(
            name=names[i], pos=placement.translation, quat=quaternion(placement.rotation)
        )
        bodies[i] = body
        _copy_inertial(m, i, body, moves=bool(kept))
        for j in kept:
            joint_names.append(m.joint(j).name or _fresh("joint", taken))
            _copy_joint(m, j, body, joint_names[-1])
        _copy_looks(m, i, body, meshes)
    return Rebuilt(
        spec,
        bodies[chain.body],
        tuple(joint_names),
        tuple(names.values()),
        _notes(description, chain, home),
    )


def _fresh(stem: str, taken: set[str]) -> str:
    """A name that nothing has yet, for what has none in the file."""
    name = next(f"{stem}{i}" for i in range(1, len(taken) + 2) if f"{stem}{i}" not in taken)
    taken.add(name)
    return name


def _body_pose(data: mujoco.MjData, i: int) -> pin.SE3:
    return pose(data.xpos[i], data.xquat[i])


def _copy_inertial(m: mujoco.MjModel, i: int, body: mujoco.MjsBody, *, moves: bool) -> None:
    massless = m.body_mass[i] <= BOUND_MASS and not moves
    body.explicitinertial = True
    body.mass = 0.0 if massless else m.body_mass[i]
    body.ipos = m.body_ipos[i]
    body.iquat = m.body_iquat[i]
    body.inertia = np.zeros(3) if massless else m.body_inertia[i]


def _copy_joint(m: mujoco.MjModel, j: int, body: mujoco.MjsBody, name: str) -> None:
    limited = bool(m.jnt_limited[j])
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint(m.jnt_type[j]),
        pos=m.jnt_pos[j],
        axis=m.jnt_axis[j],
        limited=limited,
        range=m.jnt_range[j] if limited else [0.0, 0.0],
        ref=m.qpos0[m.jnt_qposadr[j]],
        armature=m.dof_armature[m.jnt_dofadr[j]],
    )


def _copy_looks(m: mujoco.MjModel, i: int, body: mujoco.MjsBody, meshes: _Meshes) -> None:
    first = m.body_geomadr[i]
    drawn = {int(getattr(mujoco.mjtGeom, f"mjGEOM_{kind}")) for kind in _DRAWN}
    geoms = [
        g
        for g in range(first, first + m.body_geomnum[i])
        if m.geom_group[g] < _HIDDEN_GROUP and m.geom_type[g] in drawn
    ]
    for g in geoms:
        material = m.geom_matid[g]
        looks = {} if material < 0 else {"material": meshes.material(material)}
        geom = body.add_geom(
            type=mujoco.mjtGeom(m.geom_type[g]),
            pos=m.geom_pos[g],
            quat=m.geom_quat[g],
            rgba=m.geom_rgba[g] if material < 0 else [0.5, 0.5, 0.5, 1.0],
            group=1,
            contype=0,
            conaffinity=0,
            **looks,
        )
        if m.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH:
            geom.meshname = meshes.mesh(m.geom_dataid[g])
        else:
            geom.size = m.geom_size[g]


class _Meshes:
    """Meshes and materials of the file that are in use, written down as they are needed."""

    def __init__(self, spec: mujoco.MjSpec, m: mujoco.MjModel) -> None:
        self._spec, self._m = spec, m
        self._names: set[str] = set()

    def material(self, i: int) -> str:
        """The name of a copy of material `i`."""
        name, m = f"robot:{i}", self._m
        if name not in self._names:
            self._names.add(name)
            self._spec.add_material(
                name=name,
                rgba=m.mat_rgba[i],
                specular=m.mat_specular[i],
                shininess=m.mat_shininess[i],
                reflectance=m.mat_reflectance[i],
                emission=m.mat_emission[i],
            )
        return name

    def mesh(self, i: int) -> str:
        """The name of a copy of mesh `i`."""
        name, m = f"robot:mesh{i}", self._m
        if name not in self._names:
            self._names.add(name)
            v, f = m.mesh_vertadr[i], m.mesh_faceadr[i]
            self._spec.add_mesh(
                name=name,
                uservert=m.mesh_vert[v : v + m.mesh_vertnum[i]].ravel(),
                userface=m.mesh_face[f : f + m.mesh_facenum[i]].ravel(),
                inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            )
        return name


def _notes(description: Description, chain: Chain, home: Array) -> tuple[str, ...]:
    m, notes = description.model, []
    root = m.body_rootid[chain.body]
    locked = [
        j
        for j in range(m.njnt)
        if j not in (*chain.joints, *description.locked) and m.body_rootid[m.jnt_bodyid[j]] == root
    ]
    if locked:
        at = ", ".join(f"{m.joint(j).name} at {home[m.jnt_qposadr[j]]:g}" for j in locked)
        notes.append(f"joints that do not move the flange are locked: {at}")
    if description.locked:
        at = ", ".join(f"{each.name} at {each.value:g}" for each in description.locked.values())
        notes.append(f"joints whose limits are one value are locked: {at}")
    dofs = [int(m.jnt_dofadr[j]) for j in chain.joints]
    passive = {
        "joint damping": m.dof_damping[dofs],
        "joint friction": m.dof_frictionloss[dofs],
        "joint springs": m.jnt_stiffness[list(chain.joints)],
        "gravity compensation": m.body_gravcomp,
    }
    found = [what for what, values in passive.items() if np.any(values)]
    if found:
        notes.append(f"left out, since the controller's model has none: {', '.join(found)}")
    if not np.allclose(m.opt.gravity, GRAVITY):
        notes.append("the file's gravity is not used: it is 9.81 m/s² along the world's -z")
    others = [m.body(i).name for i in range(1, m.nbody) if m.body_rootid[i] != root]
    others += ["shapes that stand still"] if m.body_geomnum[0] else []
    if others:
        notes.append(f"left out, since the world is the task file's: {', '.join(others)}")
    return tuple(notes)
