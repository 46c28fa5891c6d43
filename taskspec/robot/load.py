"""From the `robot` section of a task file to the robot's two models."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from taskspec.deferred import mujoco
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.robot.arm import KnownArm, arm_key, keep_arm, known_arm
from taskspec.robot.chain import Chain, find_chain, moves
from taskspec.robot.constraints import coordinates
from taskspec.robot.description import BOUND_MASS, Description, RobotFile, listening
from taskspec.robot.errors import RobotError
from taskspec.robot.files import looks_like_path, noting_files
from taskspec.robot.library import builtin_names, is_builtin, read_builtin
from taskspec.robot.links import links_of
from taskspec.robot.mobility import is_planar, tip_axes
from taskspec.robot.own import read_own, read_packaged
from taskspec.robot.packages import is_packaged
from taskspec.robot.pinocchio_model import Bodies, pinocchio_model
from taskspec.robot.poses import pose_of_rpy
from taskspec.robot.rebuild import rebuild
from taskspec.robot.remarks import remarks
from taskspec.robot.tool import attach, make_tool
from taskspec.robot.twin import Twin
from taskspec.robot.types import MujocoArm, RobotLike, RobotModel, ToolBody
from taskspec.text.codes import register
from taskspec.text.suggest import closest

register({"TS404": "a robot file that does not compile"})

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

_LEAST_INERTIA = 1e-8
#: Of so many robots that are built in the models are kept: many tasks have the same.
_KEPT = 8


def load_robot(robot: RobotLike, base_dir: Path | None = None) -> RobotModel:
    """The models of the robot that a task file names, on its base and with its tool.

    Args:
        robot: The file's `robot` section; lengths in m, angles in rad, masses in kg.
        base_dir: Where a path in `robot.model` begins; None is the working directory.

    Raises:
        RobotError: TS401 to TS408; see `taskspec.text.codes`.
    """
    section = _Section.of(robot)
    if is_builtin(robot.model):
        if robot.xacro:
            raise RobotError(
                "TS402",
                f"'{robot.model}' is built in: it has no arguments",
                "leave `xacro` out",
                ("xacro",),
            )
        return _built_in(section)
    with noting_files() as noted:
        made = _made(section, _read(robot.model, base_dir, robot.xacro))
    absent = frozenset(noted.absent) if noted.whole else None
    return replace(made, files=noted.files, absent=absent)


@dataclass(frozen=True, slots=True)
class _Placed:
    """A hashable `PoseLike`."""

    xyz: tuple[float, ...]
    rpy: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class _Carrier:
    """A hashable `FlangeLike`."""

    body: str | None
    xyz: tuple[float, ...]
    rpy: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class _Mounted:
    """A hashable `ToolLike`."""

    shape: str
    radius: float | None
    size: tuple[float, ...] | None
    thickness: float | None
    length: float | None
    mass: float
    com: tuple[float, ...] | None
    inertia: tuple[float, ...] | None


@dataclass(frozen=True, slots=True)
class _Section:
    """A hashable `RobotLike`."""

    model: str
    flange: _Carrier | None
    base: _Placed
    tool: _Mounted
    balanced: bool
    arguments: tuple[tuple[str, str], ...]

    @property
    def xacro(self) -> dict[str, str]:
        """The arguments by name."""
        return dict(self.arguments)

    @staticmethod
    def of(robot: RobotLike) -> _Section:
        """The inputs of the models of a robot."""
        tool, base, flange = robot.tool, robot.base, robot.flange
        size, com, inertia = (
            None if each is None else tuple(each) for each in (tool.size, tool.com, tool.inertia)
        )
        return _Section(
            robot.model,
            None if flange is None else _Carrier(flange.body, tuple(flange.xyz), tuple(flange.rpy)),
            _Placed(tuple(base.xyz), tuple(base.rpy)),
            _Mounted(
                tool.shape,
                tool.radius,
                size,
                tool.thickness,
                tool.length,
                tool.mass,
                com,
                inertia,
            ),
            robot.balanced,
            tuple(sorted(robot.xacro.items())),
        )


@lru_cache(maxsize=_KEPT)
def _built_in(section: _Section) -> RobotModel:
    """The models of a robot that no file changes; nobody changes them either."""
    return _made(section, read_builtin(section.model))


def _made(section: _Section, source: RobotFile) -> RobotModel:
    """The models of a robot; MuJoCo's are not made yet where the arm is known already."""
    key = None if source.content is None else arm_key(source.name, section, source.content)
    arm = None if key is None else known_arm(key)
    if arm is not None:
        simulated = MujocoArm(lambda: _compiled(section, source.describe())[1])
    else:
        arm, made = _compiled(section, source.describe())
        simulated = MujocoArm(lambda: made)
        if key is not None:
            keep_arm(key, arm)
    twin, tip_joint, tip = _twin(arm.bodies, arm.tip_number, balanced=section.balanced)
    return RobotModel(
        name=arm.name,
        simulated=simulated,
        pin=twin,
        coupling=arm.coupling,
        joint_names=tuple(arm.coupling.names[j] for j in arm.coupling.free),
        hinges=tuple(arm.coupling.hinges[j] for j in arm.coupling.free),
        carried_links=arm.carried_links,
        axes=arm.axes,
        home=arm.home,
        lower=arm.lower,
        upper=arm.upper,
        velocity_limit=arm.velocity_limit,
        torque_limit=arm.torque_limit,
        tip_joint=tip_joint,
        tip=tip,
        tool=arm.tool,
        tool_geoms=arm.tool_geoms,
        tip_body=arm.tip_body,
        tool_body=arm.tool_body,
        links=arm.links,
        source=arm.source,
        flange=arm.flange,
        notes=arm.notes,
        remarks=arm.remarks,
    )


def _compiled(
    robot: RobotLike, description: Description
) -> tuple[KnownArm, tuple[mujoco.MjSpec, mujoco.MjModel]]:
    """The arm of a description, and MuJoCo's specification and model of it."""
    m = description.model
    whole = find_chain(m, robot.flange, description.coupled)
    chain = _unlocked(whole, description)
    whole_home = home_configuration(description)
    found = coordinates(description, chain, whole_home)
    whole_home[m.jnt_qposadr[list(chain.joints)]] = found.coupling.joints(found.home)
    base = pose_of_rpy(robot.base.xyz, robot.base.rpy)
    arm = rebuild(description, chain, whole_home, base)
    planar = is_planar(m, chain, whole_home if description.locked else m.qpos0)
    flange = _tool_mount(chain, planar)
    tool = make_tool(robot.tool, planar)
    tip_body, tool_geoms = attach(arm.carrier, flange, tool, set(arm.body_names))
    coupling = replace(found.coupling, names=arm.joint_names)
    _add_motors(arm.spec, [arm.joint_names[j] for j in coupling.free], found.torque)
    if robot.balanced:
        for body in arm.spec.bodies:
            body.gravcomp = 1.0
    model = _compile(arm.spec, description.name)
    bodies, tip_number = Bodies.of(model), model.body(tip_body).id
    twin = Twin(*_twin(bodies, tip_number, balanced=robot.balanced), coupling)
    _check_inertia(twin, found.home, _bare(bodies, tip_number), tool.mass)
    axes = tip_axes(twin)
    known = KnownArm(
        name=description.name,
        bodies=bodies,
        coupling=coupling,
        carried_links=tuple(m.body(m.jnt_bodyid[j]).name for j in chain.joints),
        axes=axes,
        home=found.home,
        lower=found.lower,
        upper=found.upper,
        velocity_limit=found.velocity,
        torque_limit=found.torque,
        tool=tool.geometry,
        tool_geoms=tool_geoms,
        tip_body=tip_body,
        tip_number=tip_number,
        tool_body=ToolBody(
            mass=float(bodies.body_mass[tip_number]),
            lever=bodies.body_ipos[tip_number],
            moments=bodies.body_inertia[tip_number],
            axes=bodies.body_iquat[tip_number],
            mobility=float(model.body_invweight0[tip_number, 0]),
        ),
        links=links_of(
            model, pinocchio_model(bodies)[1], tip_number, end=-2.0 * tool.geometry.middle
        ),
        source=description.source,
        flange=chain.label,
        notes=description.notes + arm.notes + _short_of(axes, m, chain),
        remarks=(
            *(description.locked[j].remark for j in whole.joints if j in description.locked),
            *(each.remark for each in description.unphysical if moves(m, chain, each.link)),
            *found.remarks,
            *(() if planar else remarks(m, chain, whole_home)),
        ),
    )
    return known, (arm.spec, model)


def _twin(bodies: Bodies, tip: int, *, balanced: bool) -> tuple[pin.Model, int, pin.SE3]:
    """Pinocchio's model with the frame `tip` of a body, the joint that carries it, its pose."""
    twin, carried = pinocchio_model(bodies)
    if balanced:
        twin.gravity = pin.Motion.Zero()
    joint, placement = carried[tip]
    twin.addFrame(pin.Frame("tip", joint, 0, placement, pin.FrameType.OP_FRAME))
    return twin, joint, placement


def _unlocked(chain: Chain, description: Description) -> Chain:
    """The chain without the joints that its file locks, which are part of the link before them."""
    joints = tuple(j for j in chain.joints if j not in description.locked)
    if not joints:
        names = ", ".join(f"'{description.locked[j].name}'" for j in chain.joints)
        raise RobotError(
            "TS405",
            f"every joint of the arm is locked: lower and upper limit are equal of {names}",
            "give the joints that move their ranges",
        )
    return replace(chain, joints=joints)


def home_configuration(description: Description) -> Array:
    """The configuration (nq,) of the file's keyframe `home`, of its first one, or its zero.

    A joint that would be out of its range there is put in the middle of it.
    """
    m = description.model
    key = max(mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_KEY, "home"), 0)
    q = np.array(m.key_qpos[key] if m.nkey else m.qpos0)
    for j in range(m.njnt):
        lower, upper = m.jnt_range[j]
        if m.jnt_limited[j] and not lower <= q[m.jnt_qposadr[j]] <= upper:
            q[m.jnt_qposadr[j]] = (lower + upper) / 2
    for j, locked in description.locked.items():
        q[m.jnt_qposadr[j]] = locked.value
    return q


def _compile(spec: mujoco.MjSpec, name: str) -> mujoco.MjModel:
    try:
        with listening([]):
            return spec.compile()
    except ValueError as error:
        reason = ", ".join(str(error).split("\n"))
        raise RobotError("TS404", f"MuJoCo cannot compile the arm of '{name}': {reason}") from None


def _short_of(axes: tuple[Axis, ...], m: mujoco.MjModel, chain: Chain) -> tuple[str, ...]:
    turns = (m.jnt_type[list(chain.joints)] == mujoco.mjtJoint.mjJNT_HINGE).any()
    if not turns or len(axes) < 3 or any(axis.is_rotation for axis in axes):
        return ()
    return (f"only {', '.join(axes)} of the tool tip can be controlled: orientations follow",)


def _bare(bodies: Bodies, tip: int) -> str:
    """The count of bodies of an arm without mass, in words; empty where all have one."""
    masses = np.delete(bodies.body_mass, [0, tip])
    bare = int((masses <= 2 * BOUND_MASS).sum())
    return f": {bare} of the robot's {len(masses)} bodies have none" if bare else ""


def _check_inertia(twin: Twin, home: Array, bare: str, tool: float) -> None:
    """Refuses an arm of which a joint moves nothing that has a mass.

    Args:
        twin: The arm with its tool.
        home: (n,) its configuration.
        bare: How many of its bodies have no mass, in words.
        tool: The tool's mass [kg].
    """
    moments, directions = np.linalg.eigh(twin.inertia(home))
    if moments[0] < _LEAST_INERTIA:
        name = twin.coupling.names[twin.coupling.free[int(np.abs(directions[:, 0]).argmax())]]
        raise RobotError(
            "TS405",
            f"joint '{name}' moves nothing that has a mass{bare}",
            "give the bodies behind it an <inertial> with mass and inertia"
            + ("" if tool else ", or the tool a mass"),
        )


def _read(name: str, base_dir: Path | None, arguments: Mapping[str, str]) -> RobotFile:
    if is_packaged(name):
        return read_packaged(name, arguments)
    if looks_like_path(name):
        return read_own(name, base_dir or Path.cwd(), arguments)
    # A ur10e is no slip of ur5e: numbers tell robots apart.
    close = closest(name, (each for each in builtin_names() if _digits(each) == _digits(name)))
    raise RobotError(
        "TS401",
        f"there is no robot '{name}'",
        f"did you mean '{close}'?"
        if close
        else f"built in are {', '.join(builtin_names())}; or give the path of an MJCF or URDF "
        "file, or PACKAGE:NAME of one that pip has installed",
    )


def _digits(name: str) -> list[str]:
    return re.findall(r"\d+", name)


def _tool_mount(chain: Chain, planar: bool) -> pin.SE3:
    """The flange with z where the tool goes: a planar link's x, unless a frame says otherwise."""
    if chain.explicit or not planar:
        return chain.flange
    return chain.flange * pin.SE3(pin.utils.rotate("y", np.pi / 2), np.zeros(3))


def _add_motors(spec: mujoco.MjSpec, joints: Sequence[str], limits: Array) -> None:
    for name, limit in zip(joints, limits, strict=True):
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.ctrllimited = bool(np.isfinite(limit))
        motor.ctrlrange = [-limit, limit] if np.isfinite(limit) else [0.0, 0.0]
