"""The grasp: tool tip and handle held together by a spring and damper in six directions.

MuJoCo's weld has one stiffness and one damping for all of its rows, scaled alike for rotation, so
it carries the rotation and half of the translation, and a connect carries the rest. Both are
calibrated as contacts are (see `contact`): with an impedance d they have the virtual mass
d / ((1 - d) A). Here that mass is meant: as large as damping times step, which is what taking
the damping at the step's end comes to, so that the lightest knob is held without ringing.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.world.grip import GRIP
from taskspec.robot import RobotModel
from taskspec.spec import Mechanism, Task
from taskspec_runner.plant.names import KNOB, PREFIX

Vector = NDArray[np.float64]

_TIP, _HELD = PREFIX + "grip/tip", PREFIX + "grip/held"
_ROWS = 9
#: Share of the translational stiffness that the weld carries.
_SHARE = 0.5


def add_grip(spec: mujoco.MjSpec, robot: RobotModel, task: Task, start: Vector) -> None:
    """Adds the coupling of the tool and what `robot.grasp` names, before any other equality.

    Tip and handle coincide when the coupling is relaxed, and the tool has the orientation to the
    handle that it has at `start` (n,) with the mechanism at zero; a loose body is held as it lies.
    """
    grasp = task.robot.grasp
    assert grasp is not None
    name = grasp.partition(".")[0]
    held = task.world[name]
    R, p = _pose(robot.model, robot.tip_body, start)
    spec.body(robot.tip_body).add_site(name=_TIP, group=5)
    body, at = PREFIX + name, None
    if isinstance(held, Mechanism):
        at = np.array(held.handle)
        if held.knob == "free":
            body, at = body + KNOB, np.zeros(3)
    own = spec.compile()
    R_held, p_held = _pose(own, body, own.qpos0)
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(R_held.T @ R).ravel())
    place = R_held.T @ (p - p_held) if at is None else at
    spec.body(body).add_site(name=_HELD, pos=place, quat=quaternion, group=5)
    for kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
        spec.add_equality(
            name=f"{PREFIX}grip/{kind.name}",
            type=kind,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=_TIP,
            name2=_HELD,
        )


def _pose(model: mujoco.MjModel, body: str, qpos: Vector) -> tuple[Vector, Vector]:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    return data.body(body).xmat.reshape(3, 3).copy(), data.body(body).xpos.copy()


def calibrate(model: mujoco.MjModel) -> None:
    """Sets the coupling's parameters once MuJoCo has found the bodies' inverse weights."""
    period = model.opt.timestep
    bodies = [int(model.site_bodyid[model.site(name).id]) for name in (_TIP, _HELD)]
    linear, angular = (float(a) for a in model.body_invweight0[bodies].sum(axis=0))
    ratio = GRIP.angular_stiffness / (_SHARE * GRIP.stiffness)
    k = _SHARE * GRIP.stiffness
    b = GRIP.angular_damping / ratio
    weld, connect = (model.equality(f"{PREFIX}grip/mjEQ_{kind}").id for kind in ("WELD", "CONNECT"))
    _set(model, weld, k, b, b * period, linear)
    rest = GRIP.damping - b
    _set(model, connect, GRIP.stiffness - k, rest, rest * period, linear)
    # A weld's rotation counts as half its angle.
    model.eq_data[weld, 10] = 2.0 * np.sqrt(ratio * angular / linear)


def _set(model: mujoco.MjModel, number: int, k: float, b: float, mass: float, A: float) -> None:
    d = mass * A / (1.0 + mass * A)
    model.eq_solimp[number] = [d, d, 0.001, 0.5, 2.0]
    model.eq_solref[number] = [-k * (1 - d) * A, -b * (1 - d) * A]


class Grip:
    """What the coupling exerts.

    Attributes:
        wrench: (6,) by what is held on the tool, moment about the tip, world axes [N, N m].
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, task: Task) -> None:
        self._data = data
        name = (task.robot.grasp or "").partition(".")[0]
        held = task.world[name]
        self.wrench = np.zeros(6)
        tip, handle = model.site(_TIP).id, model.site(_HELD).id
        self._tip_quat = data.xquat[model.site_bodyid[tip]]
        self._held_quat = data.xquat[model.site_bodyid[handle]]
        self._mount = np.array(model.site_quat[handle])
        self._point = data.site_xpos[handle]
        weld = model.equality(f"{PREFIX}grip/mjEQ_WELD").id
        self._half_scale = 0.5 * float(model.eq_data[weld, 10])
        self._mechanism = held if isinstance(held, Mechanism) else None
        self._axis = data.xmat[model.body(PREFIX + name).id].reshape(3, 3)[:, 2]
        self._center = data.xpos[model.body(PREFIX + name).id]
        self._quats = [np.zeros(4) for _ in range(3)]

    def read(self) -> None:
        """Reads the wrench of the last step, at the pose where that began."""
        rows = self._data.efc_force[:_ROWS]
        self.wrench[:3] = rows[:3] + rows[3:6]
        product, other, force = self._quats
        force[1:] = rows[6:9]
        # The rows are s/2 times the vector part of conj(held) * rate * tip, rate the relative
        # angular velocity: the moment is the transposed map of their forces.
        mujoco.mju_mulQuat(other, self._held_quat, self._mount)
        mujoco.mju_mulQuat(product, other, force)
        mujoco.mju_negQuat(other, self._tip_quat)
        mujoco.mju_mulQuat(force, product, other)
        self.wrench[3:] = self._half_scale * force[1:]
        force[0] = 0.0

    @property
    def effort(self) -> float:
        """What the robot applies to the held mechanism's coordinate [N m, N], 0 to a loose body.

        The moment about the axis of the handle's force, of a fixed knob its own moment too, and of
        a screw its axial force times the lead.
        """
        held = self._mechanism
        if held is None:
            return 0.0
        # Scalars: at this size they cost a third of the same in array operations.
        fx, fy, fz, mx, my, mz = (-self.wrench).tolist()
        x, y, z = self._axis.tolist()
        along = x * fx + y * fy + z * fz
        if not held.angular:
            return float(along)
        rx, ry, rz = (self._point - self._center).tolist()
        about = x * (ry * fz - rz * fy) + y * (rz * fx - rx * fz) + z * (rx * fy - ry * fx)
        if held.knob == "fixed":
            about += x * mx + y * my + z * mz
        return float(about + held.lead * along)
