"""The grasp: tool tip and handle held together by a spring and damper in six directions.

MuJoCo's weld has one stiffness and one damping for all of its rows, scaled alike for rotation, so
it carries the rotation and half of the translation, and a connect carries the rest. Both are
calibrated as contacts are (see `contact`): with an impedance d they have the virtual mass
d / ((1 - d) A). Here that mass is meant: as large as damping times step, which is what taking
the damping at the step's end comes to, so that the lightest knob is held without ringing.
"""

from __future__ import annotations

import casadi as ca
import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.control.reference import opposite
from taskspec.program.bound import Wiring
from taskspec.program.world.stiffness import GRIP
from taskspec.spec import Mechanism, Task
from taskspec_runner.plant.arm import SceneArm
from taskspec_runner.plant.names import KNOB, PREFIX

Vector = NDArray[np.float64]

_TIP, _HELD, _CONNECT, _WELD = "grip/tip", "grip/held", "grip/connect", "grip/weld"
#: Rows among the constraints' of a connect, which comes first, and of a weld.
_CONNECT_ROWS, _WELD_ROWS = 3, 6
#: Share of the translational stiffness that the weld carries.
_SHARE = 0.5


def add_grip(spec: mujoco.MjSpec, arm: SceneArm, task: Task) -> None:
    """Adds the coupling of an arm's tool and what it holds, before any equality but other grips'.

    Tip and handle coincide when the coupling is relaxed, and the tool has the orientation to the
    handle that it has at the arm's start with the mechanism at zero; a loose body is held as it
    lies.
    """
    held, robot = task.world[arm.held], arm.robot
    R, p = _pose(robot.model, robot.tip_body, robot.coupling.joints(arm.start))
    spec.body(robot.tip_body).add_site(name=arm.element(_TIP), group=5)
    body, at = PREFIX + arm.held, None
    if isinstance(held, Mechanism):
        at = np.array(held.handle)
        if held.knob == "free":
            body, at = body + KNOB, np.zeros(3)
    own = spec.compile()
    R_held, p_held = _pose(own, body, own.qpos0)
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(R_held.T @ R).ravel())
    place = R_held.T @ (p - p_held) if at is None else at
    spec.body(body).add_site(name=arm.element(_HELD), pos=place, quat=quaternion, group=5)
    for name, kind in ((_CONNECT, mujoco.mjtEq.mjEQ_CONNECT), (_WELD, mujoco.mjtEq.mjEQ_WELD)):
        spec.add_equality(
            name=arm.element(name),
            type=kind,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=arm.element(_TIP),
            name2=arm.element(_HELD),
        )


def _pose(model: mujoco.MjModel, body: str, qpos: Vector) -> tuple[Vector, Vector]:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    return data.body(body).xmat.reshape(3, 3).copy(), data.body(body).xpos.copy()


def calibrate(model: mujoco.MjModel, arm: SceneArm) -> None:
    """Sets the coupling's parameters once MuJoCo has found the bodies' inverse weights."""
    period = model.opt.timestep
    sites = [model.site(arm.element(name)).id for name in (_TIP, _HELD)]
    bodies = [int(model.site_bodyid[site]) for site in sites]
    linear, angular = (float(a) for a in model.body_invweight0[bodies].sum(axis=0))
    ratio = GRIP.angular_stiffness / (_SHARE * GRIP.stiffness)
    k = _SHARE * GRIP.stiffness
    b = GRIP.angular_damping / ratio
    weld, connect = (model.equality(arm.element(name)).id for name in (_WELD, _CONNECT))
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
    """Wrench of the coupling of an arm's tool, from MuJoCo's numbers after a step.

    Attributes:
        rows: (9,) forces of the coupling's rows among the constraints', copied by `read`.
        first: the first of these rows.
        wrench: (6,) expression of what the held thing exerts on the tool, at the pose where the
            step began, moment about the tip, world axes [N, N m].
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, arm: SceneArm, task: Task, wiring: Wiring
    ) -> None:
        self._data, self.rows = data, np.zeros(_CONNECT_ROWS + _WELD_ROWS)
        self._held = task.world[arm.held]
        tip, handle = (model.site(arm.element(name)).id for name in (_TIP, _HELD))
        weld = model.equality(arm.element(_WELD)).id
        # Nothing but grips comes before a grip among the equalities, two of them each.
        self.first = (weld - 1) // 2 * len(self.rows)
        rows = wiring.reads("rows", self.rows)
        tip_axes = wiring.reads("tip_axes", data.xquat[model.site_bodyid[tip]])
        body_axes = wiring.reads("body_axes", data.xquat[model.site_bodyid[handle]])
        mount = wiring.numbers("mount", *model.site_quat[handle])
        # The rows are s/2 times the vector part of conj(held) * rate * tip, rate the relative
        # angular velocity: the moment is the transposed map of their forces.
        moved = _product(_product(body_axes, mount), ca.vertcat(0, rows[6:9]))
        moment = _product(moved, ca.vertcat(tip_axes[0], -tip_axes[1:]))[1:]
        half_scale = wiring.numbers("half_scale", 0.5 * model.eq_data[weld, 10])
        self.wrench = ca.vertcat(rows[:3] + rows[3:6], half_scale * moment)
        held = model.body(PREFIX + arm.held).id
        axis = wiring.reads("held_axes", data.xmat[held])[2::3]
        point = wiring.reads("point", data.site_xpos[handle])
        lever = point - wiring.reads("center", data.xpos[held])
        lead = self._held.lead if isinstance(self._held, Mechanism) else 0.0
        self._effort = self._on_coordinate(
            axis, lever, wiring.numbers("lead", lead) if lead else ca.SX(0)
        )

    def read(self) -> None:
        """Takes the forces of the last step."""
        first = self.first
        self.rows[:] = self._data.efc_force[first : first + len(self.rows)]

    @property
    def effort(self) -> ca.SX:
        """Effort of the robot on the held mechanism's coordinate [N m, N].

        The moment about the axis of the handle's force, of a fixed knob its own moment too, and of
        a screw its axial force times the lead. Of a loose body it is the force's magnitude [N].
        """
        return self._effort

    def _on_coordinate(self, axis: ca.SX, lever: ca.SX, lead: ca.SX) -> ca.SX:
        held, applied = self._held, opposite(self.wrench)
        if not isinstance(held, Mechanism):
            return ca.norm_2(self.wrench[:3])
        along = ca.dot(axis, applied[:3])
        if not held.angular:
            return along
        about = ca.dot(axis, ca.cross(lever, applied[:3]))
        if held.knob == "fixed":
            about += ca.dot(axis, applied[3:])
        return about + lead * along


def _product(a: ca.SX, b: ca.SX) -> ca.SX:
    """Product of two quaternions (4,), w x y z."""
    w = a[0] * b[0] - ca.dot(a[1:], b[1:])
    return ca.vertcat(w, a[0] * b[1:] + b[0] * a[1:] + ca.cross(a[1:], b[1:]))
