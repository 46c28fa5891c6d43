"""Stiffness and damping of contacts, `rigid` included, and of the grip."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.rotation import cross, from_rpy
from taskspec.program.world import frames
from taskspec.program.world.equations import EquationModel
from taskspec.robot import RobotModel
from taskspec.shapes.plate import CutPlate
from taskspec.spec import EquationObject, Mechanism, Shape, Task

Vector = NDArray[np.float64]

#: Impedance d with which the simulator makes every contact.
IMPEDANCE = 0.02
#: Share of a sticking contact's slip that friction may take away in one step of the plant.
SETTLING = 0.5
#: How much stiffer friction is against a slip than the contact is damped along its normal.
IMPRATIO = 100.0
#: The same in a world with a hole, slot or groove, where a jammed tool is to stay where it is.
CUT_IMPRATIO = 1e4
#: `rigid` is a contact that turns half a radian of its own oscillation in one step of the plant.
RIGID_PHASE = 0.5
#: The inertia [kg m^2] for which an equation on angles has a tenth of critical damping.
ANGULAR_UNIT = 0.05
#: Beyond this many radians in a step the plant does not resolve the contact any more.
RESOLVED_PHASE = 1.0


@dataclass(frozen=True, slots=True)
class Compliance:
    """A contact's spring and damper.

    Attributes:
        stiffness: [N/m]; without bounds where an equation holds exactly.
        damping: [N s/m].
        phase: T sqrt(k / m) [rad], what one step of the plant makes of it with the mass m that the
            tool has along the normal at the start.
    """

    stiffness: float
    damping: float
    phase: float

    @property
    def exact(self) -> bool:
        """Whether there is no spring: it holds exactly."""
        return math.isinf(self.stiffness)


@dataclass(frozen=True, slots=True)
class GripCompliance:
    """A spring and damper in six directions between the tool tip and what it holds.

    Attributes:
        stiffness: [N/m].
        damping: [N s/m].
        angular_stiffness: [N m/rad].
        angular_damping: [N m s/rad].
    """

    stiffness: float
    damping: float
    angular_stiffness: float
    angular_damping: float

    @property
    def lever(self) -> float:
        """The lever at which a force strains it as much as its moment does [m]."""
        return math.sqrt(self.angular_stiffness / self.stiffness)


#: Every grasp's.
GRIP = GripCompliance(stiffness=50e3, damping=300.0, angular_stiffness=500.0, angular_damping=1.5)


def compliance(shape: Shape, robot: RobotModel, start: Vector, plant_period: float) -> Compliance:
    """The contact of the tool with an object as its declaration means it.

    Args:
        shape: the object.
        robot: the arm.
        start: (n,) where the run begins.
        plant_period: step of the plant [s].
    """
    mass = normal_mass(robot, start, shape)
    if shape.mass is not None:
        mass = 1.0 / (1.0 / mass + 1.0 / shape.mass)
    if shape.carrier is not None:
        mass = 1.0 / (1.0 / mass + _carried_mobility(robot, start, shape, shape.carrier))
    return pair_compliance(shape, mass, plant_period)


def pair_compliance(shape: Shape, mass: float, plant_period: float) -> Compliance:
    """The contact of something with an object, `mass` [kg] what moves in it."""
    return _meant(shape.stiffness, shape.damping, mass, plant_period, unit=1.0)


def equation_compliance(
    model: EquationModel,
    robot: RobotModel,
    start: Vector,
    declared: EquationObject,
    plant_period: float,
) -> Compliance:
    """The compliance of an equation along its unit gradient.

    Args:
        model: the equation.
        robot: the arm.
        start: (n,) where the run begins.
        declared: its object.
        plant_period: step of the plant [s].

    Returns:
        In N/m and N s/m; for an equation on angles alone in N m/rad and N m s/rad.
    """
    mass = equation_mass(model, robot, start)
    unit = ANGULAR_UNIT if model.angular else 1.0
    return _meant(declared.stiffness, declared.damping, mass, plant_period, unit)


def _meant(
    stiffness: float | str, damping: float | None, mass: float, plant_period: float, unit: float
) -> Compliance:
    if stiffness == "exact":
        return Compliance(math.inf, 0.0, 0.0)
    rigid = stiffness == "rigid"
    k = mass * (RIGID_PHASE / plant_period) ** 2 if rigid else float(stiffness)
    b = damping
    if b is None:
        # A tenth of critical for a unit mass; a rigid contact is critical for the mass it meets.
        b = 2 * math.sqrt(k * mass) if rigid else 0.1 * 2 * math.sqrt(k * unit)
    return Compliance(k, b, plant_period * math.sqrt(k / mass))


def normal_mass(robot: RobotModel, q: Vector, shape: Shape) -> float:
    """Lambda_n = 1 / (a^T J H^-1 J^T a) [kg] at q (n,) along the normal a of an object.

    Where the arm cannot move along the normal at all, the mean over what it can.
    """
    tip, mobility = _tip(robot, q)
    return _along(frames.normal_at(shape, tip)[0], mobility)


def mass_along(robot: RobotModel, q: Vector, normal: Vector) -> float:
    """The mass [kg] that the tip has at q (n,) along a unit direction (3,), world axes."""
    return _along(normal, _tip(robot, q)[1])


def inertia_about(robot: RobotModel, q: Vector, axis: Vector) -> float:
    """The inertia [kg m^2] that the tip has at q (n,) about a unit direction (3,), world axes."""
    twin = robot.twin()
    J = twin.jacobian(q)[3:]
    return _along(axis, J @ np.linalg.solve(twin.inertia(q), J.T))


def equation_mass(model: EquationModel, robot: RobotModel, q: Vector) -> float:
    """The mass [kg], on angles the inertia [kg m^2], at q (n,) along an equation's unit gradient.

    Where the arm cannot move along it, or where there is none, the mean over what it can.
    """
    twin = robot.twin()
    tip = twin.tip(q)
    place = model.place(ca.SX(q), ca.SX(tip.translation), ca.SX(tip.rotation))
    if model.joints:
        mobility = np.asarray(np.linalg.inv(twin.inertia(q)), dtype=np.float64)
    elif model.turns:
        J = twin.jacobian(q)
        mobility = J @ np.linalg.solve(twin.inertia(q), J.T)
    else:
        mobility = _tip(robot, q)[1]
    return _along(model.unit_normal(place), mobility)


def _along(a: Vector, mobility: Vector) -> float:
    """Mass along a unit direction (d,) of a mobility (d, d)."""
    along = float(a @ mobility @ a)
    return 1.0 / (along if along > 1e-6 else float(np.trace(mobility)) / len(a))


def _tip(robot: RobotModel, q: Vector) -> tuple[Vector, Vector]:
    """(3,) tip position [m] and its mobility J H^-1 J^T (3, 3) [1/kg] at q (n,), world axes."""
    twin = robot.twin()
    J = twin.jacobian(q)[:3]
    mobility = J @ np.linalg.solve(twin.inertia(q), J.T)
    return np.array(twin.tip(q).translation), mobility


def virtual_mass_scale(robot: RobotModel) -> float:
    """Mean effective mass [kg] of a contact at the tool, as MuJoCo counts it (1/invweight0)."""
    return 1.0 / robot.tool_body.mobility


def mobility_of(shape: Shape) -> float:
    """Inverse mass [1/kg] of an object as MuJoCo counts it; 0 for what stands still or is driven.

    What rides on a mechanism has that one's at its origin: on its axis, which a hinge leaves where
    it is. MuJoCo takes the mean over three directions, but for a body that only slides and carries
    no other it takes the mass.
    """
    carrier = shape.carrier
    if carrier is not None:
        mass = getattr(carrier, "mass", None)
        alone = carrier.mechanism == "slide" and carrier.knob == "fixed"
        return 0.0 if mass is None else 1.0 / (mass if alone else 3.0 * mass)
    return 1.0 / shape.mass if shape.free and shape.mass else 0.0


def _carried_mobility(robot: RobotModel, q: Vector, shape: Shape, mechanism: Mechanism) -> float:
    """Inverse mass [1/kg] of a shape on a mechanism, along its normal towards the tip at q (n,)."""
    normal = frames.normal_at(shape, _tip(robot, q)[0])[0]
    moves = from_rpy(mechanism.rpy)[:, 2]
    if mechanism.angular:
        lever = np.array(shape.xyz) - np.array(mechanism.xyz)
        moves = cross(moves, lever) + mechanism.lead * moves
    return float(normal @ moves) ** 2 / mechanism.coordinate_inertia


def contact_mobility(robot: RobotModel, shape: Shape) -> float:
    """A [1/kg] of a contact of the tool, the sum of both inverse masses as MuJoCo counts them."""
    return 1.0 / virtual_mass_scale(robot) + mobility_of(shape)


def added_mass(mobility: float) -> float:
    """d/((1 - d) A) [kg]: what the simulator adds to a contact between bodies of mobility A [1/kg].

    A is the sum of their translational `invweight0`.
    """
    return IMPEDANCE / ((1 - IMPEDANCE) * mobility)


def settling_rate(damping: float, mobility: float, plant_period: float) -> float:
    """At which friction takes a slip away [1/s], as MuJoCo's `solreffriction` counts it.

    Friction rows would take the contact's damping for it. Past one over the step they overshoot,
    and the friction force flips between the cone's limits.

    Args:
        damping: of one point of the contact [N s/m].
        mobility: A [1/kg].
        plant_period: [s].
    """
    return min(damping * (1 - IMPEDANCE) * mobility, IMPEDANCE * SETTLING / plant_period)


def settled_damping(mobility: float, plant_period: float) -> float:
    """From which on friction creeps no less [N s/m]: `settling_rate` is then as fast as it may be.

    Args:
        mobility: A [1/kg].
        plant_period: [s].
    """
    return IMPEDANCE * SETTLING / plant_period / ((1 - IMPEDANCE) * mobility)


def friction_ratio(task: Task) -> float:
    """How much stiffer friction is against a slip than a contact is damped along its normal."""
    cut = any(isinstance(frames.surface(shape), CutPlate) for shape in task.shapes.values())
    return CUT_IMPRATIO if cut else IMPRATIO


def creep(
    damping: float, mobility: float, plant_period: float, ratio: float = IMPRATIO
) -> tuple[float, float]:
    """What friction below its limit is at one point: force over slip [N s/m], and added mass [kg].

    Args:
        damping: of the point [N s/m].
        mobility: A [1/kg].
        plant_period: [s].
        ratio: of the world, as `friction_ratio` has it.
    """
    rate = settling_rate(damping, mobility, plant_period)
    return ratio * rate / ((1 - IMPEDANCE) * mobility), ratio * added_mass(mobility)
