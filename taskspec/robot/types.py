"""The robot for the rest of the language: both models, its limits, its tool."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Protocol

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.robot.links import Links
from taskspec.shapes import BoundedSurface

if TYPE_CHECKING:
    import mujoco
    import numpy.typing as npt
    import pinocchio as pin

    Array = npt.NDArray[np.float64]


class PoseLike(Protocol):
    """A pose as a task file gives it: `xyz` (3,) [m], `rpy` (3,) [rad] about fixed x, y, z."""

    @property
    def xyz(self) -> Sequence[float]: ...  # noqa: D102
    @property
    def rpy(self) -> Sequence[float]: ...  # noqa: D102


class FlangeLike(PoseLike, Protocol):
    """The flange: a frame of the robot's file, and a pose in it, z along the tool."""

    @property
    def body(self) -> str | None: ...  # noqa: D102


class ToolLike(Protocol):
    """A tool as a task file gives it; lengths [m], mass [kg], inertia [kg m^2]."""

    @property
    def shape(self) -> str: ...  # noqa: D102
    @property
    def radius(self) -> float | None: ...  # noqa: D102
    @property
    def size(self) -> Sequence[float] | None: ...  # noqa: D102
    @property
    def thickness(self) -> float | None: ...  # noqa: D102
    @property
    def length(self) -> float | None: ...  # noqa: D102
    @property
    def mass(self) -> float: ...  # noqa: D102
    @property
    def com(self) -> Sequence[float] | None: ...  # noqa: D102
    @property
    def inertia(self) -> Sequence[float] | None: ...  # noqa: D102


class RobotLike(Protocol):
    """The part of a task file's `robot` section from which the models are made."""

    @property
    def model(self) -> str: ...  # noqa: D102
    @property
    def flange(self) -> FlangeLike | None: ...  # noqa: D102
    @property
    def base(self) -> PoseLike: ...  # noqa: D102
    @property
    def tool(self) -> ToolLike: ...  # noqa: D102
    @property
    def balanced(self) -> bool: ...  # noqa: D102


@dataclass(frozen=True, slots=True)
class FileRemark:
    """A remark about a robot's file that loads.

    Attributes:
        code: Its diagnostic code.
        message: What it is, without a full stop.
        hint: What to do about it, or empty.
        field: Where in a task file's `robot` section it belongs.
        line: Of that section, which settles it; or empty.
    """

    code: str
    message: str
    hint: str
    field: tuple[str, ...]
    line: str = ""


@dataclass(frozen=True, slots=True)
class ToolGeometry:
    """The spheres with which a tool touches, in the tip frame.

    Attributes:
        centers: (k, 3) [m], tip frame; the lowest points lie in the plane z = 0.
        radii: (k,) [m].
        flat: Whether the spheres stand for a flat face.
        solid: The end itself, which is what touches a shape with a cut.
        middle: Height of its centre [m], negative is towards the flange.
    """

    centers: Array
    radii: Array
    flat: bool
    solid: BoundedSurface
    middle: float

    @property
    def reach(self) -> float:
        """The distance from its axis at which it touches [m]."""
        return float(np.max(np.linalg.norm(self.centers[:, :2], axis=1) + self.radii))


@dataclass(frozen=True, slots=True, eq=False)
class ToolBody:
    """The tool as MuJoCo's body; its frame is the tip frame.

    Attributes:
        mass: [kg]
        lever: (3,) its centre of mass [m].
        moments: (3,) of inertia about that [kg·m²].
        axes: (4,) of the moments, a quaternion, scalar first.
        mobility: What MuJoCo takes for the inverse mass that pushes the tool meet [1/kg].
    """

    mass: float
    lever: Array
    moments: Array
    axes: Array
    mobility: float


class MujocoArm:
    """An arm as MuJoCo's specification and model, made at their first use."""

    def __init__(self, make: Callable[[], tuple[mujoco.MjSpec, mujoco.MjModel]]) -> None:
        """Takes what makes them; it is called once at most."""
        self._make: Callable[[], tuple[mujoco.MjSpec, mujoco.MjModel]] | None = make
        self._made: tuple[mujoco.MjSpec, mujoco.MjModel] | None = None
        self._lock = Lock()

    @property
    def made(self) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
        """Specification and model."""
        with self._lock:
            if self._made is None:
                assert self._make is not None
                self._made = self._make()
                # It holds the robot's files.
                self._make = None
            return self._made


@dataclass(frozen=True, slots=True, eq=False)
class RobotModel:
    """An arm on its base with its tool, as MuJoCo's model and as Pinocchio's.

    Attributes:
        name: The built-in name, or the stem of the file.
        simulated: The arm as MuJoCo has it; see `spec` and `model`.
        pin: Pinocchio's model, rebuilt from `model`.
        joint_names: Names in the order of `q`.
        hinges: Whether each joint turns; else it slides.
        axes: World axes along and about which the tip can move independently, of `x y z rx ry rz`.
        home: (n,) configuration from which inverse kinematics starts [rad or m].
        lower: (n,) joint position limits [rad or m], -inf where there is none.
        upper: (n,) joint position limits [rad or m], inf where there is none.
        velocity_limit: (n,) [rad/s or m/s], inf where there is none.
        torque_limit: (n,) [N·m or N], inf where there is none.
        tip_joint: Index of the joint in `pin` that carries the tip.
        tip: Pose of the tip frame in that joint: origin at the control point, which is the tool's
            extreme point on its axis; z out of the tool.
        tool: The tool's contact spheres, in the tip frame.
        tool_geoms: MuJoCo's names of those spheres, in order. They collide with nothing unless a
            `<pair>` says so.
        tip_body: MuJoCo's body that carries the tool; its frame is the tip frame.
        tool_body: What MuJoCo makes of the tool.
        links: What of the arm may run into something.
        flange: The body, site or frame of the robot's file on which the tool is mounted.
        source: Where the numbers come from.
        notes: What was left out of the robot's file, or changed, one sentence each.
        remarks: What is worth saying of the file, for rules.
        files: SHA-256 of every file that was read for it, by its path; of a built-in robot none.
        absent: Paths at which files were searched in vain; None where a program has searched.
    """

    name: str
    simulated: MujocoArm
    pin: pin.Model
    joint_names: tuple[str, ...]
    hinges: tuple[bool, ...]
    axes: tuple[Axis, ...]
    home: Array
    lower: Array
    upper: Array
    velocity_limit: Array
    torque_limit: Array
    tip_joint: int
    tip: pin.SE3
    tool: ToolGeometry
    tool_geoms: tuple[str, ...]
    tip_body: str
    tool_body: ToolBody
    links: Links
    source: str
    flange: str = ""
    notes: tuple[str, ...] = ()
    remarks: tuple[FileRemark, ...] = ()
    files: Mapping[Path, str] = field(default_factory=dict)
    absent: frozenset[Path] | None = frozenset()

    @property
    def spec(self) -> mujoco.MjSpec:
        """Arm, base pose, tool and torque motors, nothing else.

        The plant copies it and adds the world.
        """
        return self.simulated.made[0]

    @property
    def model(self) -> mujoco.MjModel:
        """MuJoCo's model, compiled from `spec`."""
        return self.simulated.made[1]


@dataclass(frozen=True, slots=True)
class RobotSummary:
    """One line about a built-in robot.

    Attributes:
        name: What `robot.model` says.
        about: A few words.
        joints: Number of joints.
        axes: World axes of the tip that exist.
        source: Where the numbers come from.
    """

    name: str
    about: str
    joints: int
    axes: tuple[Axis, ...]
    source: str
