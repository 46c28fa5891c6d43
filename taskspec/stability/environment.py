"""A stage's environment as springs: contacts, equations, bushings, the grip; with true values."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.geometry.rotation import cross
from taskspec.program.context import Context
from taskspec.program.world.bushings import BushingModel, bushing_models
from taskspec.program.world.stiffness import (
    GRIP,
    added_mass,
    compliance,
    contact_mobility,
    equation_compliance,
)
from taskspec.spec import Mechanism, Task
from taskspec.stability.friction import friction_rows, sliding_rows
from taskspec.stability.plant import LinearPlant, Rows
from taskspec.stability.points import Touched, skew
from taskspec.stability.servo import LinearServo

Matrix = NDArray[np.float64]

#: The axes about which a tool that is held gives way: none.
HELD = np.zeros((3, 0))


def linear_plant(
    context: Context,
    task: Task,
    pressed: Mapping[str, float],
    *,
    sticking: bool = False,
    sliding: Matrix | None = None,
    turns: Matrix = HELD,
) -> LinearPlant:
    """The plant at the start pose.

    Args:
        context: of the nominal task.
        task: whose world and robot are the true ones.
        pressed: what the robot applies to each contact that is there [N]: into a shape, along the
            unit gradient of an equation.
        sticking: whether friction is below its limit, and holds the tool.
        sliding: (3,) else the velocity with which the tool slides, world axes [m/s]; None where it
            is not known, so that friction is left out.
        turns: (3, k) unit axes, across each other, about which the tool gives way, world axes: it
            comes to lie flat.
    """
    n = context.robot.n
    held = task.mechanisms.get(context.held)
    c = n if held is None else n + 1
    H = np.zeros((c, c))
    H[:n, :n] = context.start_inertia
    damping = np.zeros(c)
    damping[:n] = np.broadcast_to(np.array(task.robot.joint_damping, dtype=float), n)
    rows = []
    for name, force in pressed.items():
        if name in context.equations:
            rows.append(_equation(context, task, name, force, c))
        elif name in context.surfaces:
            rows.append(_contact(context, task, name, force, c, turns))
            if task.shapes[name].friction > 0 and sticking:
                rows.append(friction_rows(context, task, name, c, turns))
            elif task.shapes[name].friction > 0 and sliding is not None:
                rows.append(sliding_rows(context, task, name, force, c, sliding, turns))
    rows += [_bushing(context, model, c) for model in bushing_models(task).values()]
    if held is not None:
        H[n, n], damping[n] = held.coordinate_inertia, held.damping
        rows.append(_grip(context, task, held))
    control = task.control
    return LinearPlant(
        n=n,
        H=H,
        damping=damping,
        J=context.start_jacobian,
        rows=tuple(rows),
        period=1.0 / control.plant_rate,
        steps=round(control.plant_rate / control.rate),
        tool=_tool(context) if task.robot.sensor.at == "wrist" else None,
        equations=len(task.reported),
        servo=LinearServo.of(task.robot, control, context.start_inertia),
    )


def _contact(context: Context, task: Task, name: str, force: float, c: int, turns: Matrix) -> Rows:
    """A shape under the tool's surface as it lies, or under every sphere with its share."""
    robot, n, shape = context.robot, context.robot.n, task.shapes[name]
    declared = compliance(shape, robot, context.start, 1.0 / task.control.plant_rate)
    mobility = contact_mobility(robot, shape)
    touched = Touched(context, task, name)
    if touched.whole:
        patch, J = touched.laid(context.start_p, context.start_R, turns), context.start_jacobian
        G, turning, bending = np.zeros((1, c)), np.zeros((6, c)), np.zeros((c, c))
        G[0, :n] = -patch.way @ J
        turning[:, :n] = -force * patch.bending() @ J
        bending[:n] = J.T @ turning
        return Rows(
            name=name,
            G=G,
            W=-patch.way[:, None],
            K=np.array([[declared.stiffness]]),
            B=np.array([[declared.damping]]),
            M=np.array([[added_mass(mobility)]]),
            turning=turning,
            bending=bending,
        )
    centers = robot.tool.centers
    r = len(centers)
    G, W, turning = np.zeros((r, c)), np.zeros((6, r)), np.zeros((6, c))
    for i, (center, radius) in enumerate(zip(centers, robot.tool.radii, strict=True)):
        lever = context.start_R @ center
        normal, bend = touched.normal_at(context.start_p + lever, float(radius))
        at = context.start_jacobian[:3] - skew(lever) @ context.start_jacobian[3:]
        turned = -skew(lever) @ context.start_jacobian[3:]
        G[i, :n] = normal @ at
        W[:3, i], W[3:, i] = normal, cross(lever, normal)
        turning[:3, :n] += force / r * bend @ at
        moment = skew(lever) @ bend @ at - skew(normal) @ turned
        turning[3:, :n] += force / r * moment
    bending = np.zeros((c, c))
    bending[:n] = context.start_jacobian.T @ turning
    each = np.eye(r)
    return Rows(
        name=name,
        G=G,
        W=W,
        K=declared.stiffness / r * each,
        B=declared.damping / r * each,
        M=added_mass(mobility) * each,
        turning=turning,
        bending=bending,
    )


def _equation(context: Context, task: Task, name: str, force: float, c: int) -> Rows:
    model, n = context.equations[name], context.robot.n
    period = 1.0 / task.control.plant_rate
    declared = equation_compliance(
        model, context.robot, context.start, task.equations[name], period
    )
    p, R = context.start_p, context.start_R
    place = ca.evalf(model.place(ca.SX(context.start), ca.SX(p), ca.SX(R)))
    x = ca.SX.sym("x", place.shape[0])
    terms = model.terms(x, ca.SX(0))
    parts = ca.Function("unit", [x], [terms.normal.T, model.turning(terms, x)])(place)
    normal, bend = (np.array(part) for part in parts)
    on = np.eye(n) if model.joints else context.start_jacobian[model.on]
    G, W, turning = np.zeros((1, c)), np.zeros((6, 1)), np.zeros((6, c))
    bending = np.zeros((c, c))
    G[0, :n] = normal.ravel() @ on
    bending[:n, :n] = -force * on.T @ bend @ on
    if not model.joints:
        W[model.on] = normal
        turning[model.on, :n] = -force * bend @ on
    return Rows(
        name=name,
        G=G,
        W=W,
        K=np.array([[0.0 if declared.exact else declared.stiffness]]),
        B=np.array([[declared.damping]]),
        M=np.zeros((1, 1)),
        turning=turning,
        bending=bending,
        equation=list(context.equations).index(name),
        exact=declared.exact,
    )


def _bushing(context: Context, model: BushingModel, c: int) -> Rows:
    """The spring about the pose, and how the wrench that it exerts there turns."""
    n, J = context.robot.n, context.start_jacobian
    spring = model.spring(context.start_p, context.start_R)
    G, turning, bending = np.zeros((6, c)), np.zeros((6, c)), np.zeros((c, c))
    G[:, :n] = spring.J @ J
    turning[:, :n] = spring.geometric(model.stiffness) @ J
    bending[:n] = J.T @ turning
    return Rows(
        name=model.name,
        G=G,
        W=spring.J.T,
        K=model.stiffness,
        B=model.damping,
        M=np.zeros((6, 6)),
        turning=turning,
        bending=bending,
    )


def _grip(context: Context, task: Task, held: Mechanism) -> Rows:
    """The coupling of the tool and a handle; a free knob turns in it."""
    n, model = context.robot.n, context.mechanisms[context.held]
    axis = model.rotation[:, 2]
    moves = model.lead * axis if model.angular else axis
    if model.angular:
        moves = moves + cross(axis, model.grip - model.origin)
    turns = axis if model.angular else np.zeros(3)
    G = np.zeros((6, n + 1))
    G[:, :n], G[:, n] = context.start_jacobian, -np.concatenate([moves, turns])
    ways = np.eye(6)
    if held.knob == "free":
        across = np.linalg.svd(axis[None, :])[2][1:]
        ways = np.vstack([ways[:3], np.hstack([np.zeros((2, 3)), across])])
    turning = len(ways) - 3
    stiffness = [GRIP.stiffness] * 3 + [GRIP.angular_stiffness] * turning
    damping = np.diag([GRIP.damping] * 3 + [GRIP.angular_damping] * turning)
    return Rows(
        name=context.held,
        G=ways @ G,
        W=ways.T,
        K=np.diag(stiffness),
        B=damping,
        # The simulator takes the grip's damping at the step's end.
        M=damping / task.control.plant_rate,
        turning=np.zeros((6, n + 1)),
        bending=np.zeros((n + 1, n + 1)),
    )


def _tool(context: Context) -> Matrix:
    """(6, 6) inertia of the tool's body about the tip, world axes."""
    tool = context.robot.tool_body
    R, mass = context.start_R, tool.mass
    lever = skew(R @ tool.lever)
    own = R @ pin.Quaternion(*(float(part) for part in tool.axes)).matrix()
    about = own @ np.diag(tool.moments) @ own.T - mass * lever @ lever
    return np.block([[mass * np.eye(3), -mass * lever], [mass * lever, about]])
