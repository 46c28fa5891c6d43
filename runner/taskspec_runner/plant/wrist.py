"""The force sensor between flange and tool: it measures the contact and the weight of the tool."""

from __future__ import annotations

import casadi as ca
import mujoco

from taskspec.program.bound import Wiring
from taskspec_runner.plant.arm import SceneArm

#: What is measured of how the tool's own body moves, by the names of the sensors.
_MOTION = {
    "wrist/linear": mujoco.mjtSensor.mjSENS_FRAMELINACC,
    "wrist/angular": mujoco.mjtSensor.mjSENS_FRAMEANGACC,
    "wrist/turning": mujoco.mjtSensor.mjSENS_FRAMEANGVEL,
}


def add_wrist(spec: mujoco.MjSpec, arm: SceneArm) -> None:
    """Adds sensors of how the tool's own body accelerates."""
    for name, kind in _MOTION.items():
        spec.add_sensor(
            name=arm.element(name),
            type=kind,
            objtype=mujoco.mjtObj.mjOBJ_BODY,
            objname=arm.robot.tip_body,
        )


def wrist_wrench(
    model: mujoco.MjModel, data: mujoco.MjData, arm: SceneArm, on_tip: ca.SX, wiring: Wiring
) -> ca.SX:
    """(6,) wrench by all that is beyond the flange on the flange, about the tip, world axes.

    The tool's weight is in it also where a counterweight carries the arm: that hangs on the joints,
    not on the tool.

    Args:
        model, data: of the scene.
        arm: whose wrist it is.
        on_tip: (6,) what the environment exerts on the tool, about the tip, in the same step.
        wiring: of the function that it is part of.
    """
    body = model.body(arm.robot.tip_body).id
    mass = wiring.numbers("mass", model.body_mass[body])
    moments = wiring.numbers("moments", *model.body_inertia[body])
    axes = ca.reshape(wiring.reads("inertia_axes", data.ximat[body]), 3, 3).T
    R = ca.reshape(wiring.reads("flange_axes", data.xmat[body]), 3, 3).T
    addresses = [int(model.sensor(arm.element(name)).adr[0]) for name in _MOTION]
    linear, angular, turning = (
        wiring.reads(name, data.sensordata[at : at + 3])
        for name, at in zip(("linear", "angular", "turning"), addresses, strict=True)
    )
    if (by_damping := _by_damping(model, data, arm, wiring)) is not None:
        linear, angular = linear + by_damping[:3], angular + by_damping[3:]
    # MuJoCo's acceleration of a frame has gravity in it: it is that of a body held still.
    force = -mass * linear
    turned, spin = axes.T @ angular, axes.T @ turning
    moment = axes @ (-moments * turned - ca.cross(spin, moments * spin))
    lever = R @ wiring.numbers("lever", *model.body_ipos[body])
    return on_tip + ca.vertcat(force, moment + ca.cross(lever, force))


def _by_damping(
    model: mujoco.MjModel, data: mujoco.MjData, arm: SceneArm, wiring: Wiring
) -> ca.SX | None:
    """(6,) what the damping of joints adds to the acceleration of the tool's body, world axes.

    MuJoCo's sensors have q'' = H^-1 u, with the damping of the step's beginning in u; its Euler
    step takes it at the step's end, and goes by (H + T D)^-1 u. The difference is
    -(H + T D)^-1 T D q''. None where no joint is damped.
    """
    dofs = arm.places(model).velocities
    damping = model.dof_damping[dofs]
    if not damping.any():
        return None
    count, first = len(damping), dofs.start
    H = ca.SX(count, count)
    for i in range(count):
        at, size = model.M_rowadr[first + i], model.M_rownnz[first + i]
        entries = wiring.reads(f"inertia_{i}", data.M[at : at + size])
        for entry, column in enumerate(model.M_colind[at : at + size] - first):
            H[i, column] = H[column, i] = entries[entry]
    late = model.opt.timestep * wiring.numbers("joint_damping", *damping)
    change = -ca.solve(H + ca.diag(late), late * wiring.reads("q_acceleration", data.qacc[dofs]))
    body = model.body(arm.robot.tip_body).id
    place = wiring.reads("tool_place", data.xipos[body])
    origin = wiring.reads("root_place", data.subtree_com[model.body_rootid[body]])
    added = ca.SX(6, 1)
    for i in range(count):
        twist = wiring.reads(f"motion_{i}", data.cdof[first + i])
        turn, go = twist[:3], twist[3:]
        added += change[i] * ca.vertcat(go + ca.cross(turn, place - origin), turn)
    return added
