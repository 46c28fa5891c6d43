"""What a stage takes from the energy tank of its law at least, by its text and the arm's masses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.laws.gains import value_of
from taskspec.program.kept_forces import before
from taskspec.program.plan import StagePlan
from taskspec.program.trajectory import Course
from taskspec.program.world.stiffness import inertia_about, mass_along
from taskspec.spec import Task
from taskspec.spec.tank import Tank
from taskspec.text.units import POWER, VELOCITY, joules, scaled

Vector = NDArray[np.float64]

#: Instants of a planned motion at which it is taken.
_SAMPLES = 401


@dataclass(frozen=True, slots=True)
class FirstContact:
    """The bound on the first contact of a stage whose tank has a limit on its power.

    Attributes:
        contact: the object.
        axis: along which the tool comes to it.
        speed: at most, of an arm that starts from rest [m/s].
        power: that it takes at most [W].
    """

    contact: str
    axis: Axis
    speed: float
    power: float

    def rows(self) -> Iterator[tuple[str, str]]:
        """It in words."""
        speed, power = scaled(self.speed, VELOCITY, 3), scaled(self.power, POWER, 3)
        yield (
            "first contact",
            f"from rest along {self.axis} with at most {speed}; {self.contact} takes at most "
            f"{power} of it",
        )


@dataclass(frozen=True, slots=True)
class TankDemand:
    """What a stage takes from its tank.

    Attributes:
        tank: of its law.
        moving: the most that moves the arm, 1/2 m v^2, and stretches springs that dampers drag
            behind, 1/2 (d v)^2 / k, along axes and about them [J].
        pressing: into what it presses on, 1/2 f^2 / k_e, and springs that a force stretches [J].
        rubbing: by friction, mu f s [J].
        power: the most that its reference takes, m v a + d v^2 + mu f v [W].
        there: what its tank has at most as it begins [J].
        continues: whether that is what a stage before has left.
    """

    tank: Tank
    moving: float
    pressing: float
    rubbing: float
    power: float
    there: float
    continues: bool

    @property
    def energy(self) -> float:
        """All of it [J]."""
        return self.moving + self.pressing + self.rubbing

    def rows(self) -> Iterator[tuple[str, str]]:
        """What the tank holds, lets out, and what the stage takes of it."""
        begins = (
            f"begins with what the stage before has left, at most {joules(self.there)}"
            if self.continues
            else f"begins with {joules(self.there)}"
        )
        power = self.tank.power
        lets = "" if power is None else f"; at most {scaled(power, POWER, 3)} leave it"
        yield "tank", f"holds {joules(self.tank.energy)}, {begins}{lets}"
        if self.energy > 0:
            yield "takes of it", f"about {joules(self.energy)}"


def tank_demand(stage: StagePlan) -> TankDemand | None:
    """The demand of a stage; None without a tank."""
    tank = stage.law.tank
    if tank is None:
        return None
    moving, way, power = _motion(stage)
    rub, goes_on = _friction(stage), continues(stage.context.loaded.task, stage.name)
    return TankDemand(
        tank,
        moving,
        _pressing(stage),
        rub * float(np.sum(way)),
        float(np.max(power + rub * way / _step(stage), initial=0.0)),
        tank.energy if goes_on else tank.first,
        goes_on,
    )


def continues(task: Task, name: str) -> bool:
    """Whether a stage that leads to one has a tank, of which this goes on with what is left."""
    return any(has_tank(task, each) for each in before(task, name))


def has_tank(task: Task, name: str) -> bool:
    """Whether the law of a stage has a tank."""
    stage = task.stages[name]
    law = task.law if stage.law is None else stage.law
    return law.tank is not None and (stage.path is None or stage.path.joints is None)


def first_contact(stage: StagePlan) -> FirstContact | None:
    """The bound on its first contact; None without a limit on the power, or a surface ahead.

    A force loop leads there, against the law's damper along its axis. Where a reference leads, its
    spring lends what it has stored, and there is no such bound.
    """
    tank, contact = stage.law.tank, stage.contacts.main
    if tank is None or tank.power is None or contact is None or not stage.translations:
        return None
    normal = stage.contacts.normal(contact)
    axis = max(stage.translations, key=lambda a: abs(stage.kinematics.along(a, normal)))
    damping = value_of(stage.gains, "damping", axis)
    plan = stage.plans[axis]
    if not plan.force or plan.mode.moves or not damping > 0:
        return None
    context = stage.context
    surface = context.compliances[contact]
    mass = mass_along(context.robot, context.start, normal)
    if not stage.law.control_law.natural:
        damping /= 1 + context.period * damping / mass  # See `laws.tank`.
    bound = tank.of_law.first_contact(damping, mass, surface.stiffness, surface.damping)
    return FirstContact(contact, axis, tank.of_law.speed(damping), bound)


def _motion(stage: StagePlan) -> tuple[float, Vector, Vector]:
    """The most that the motion stores [J], its ways (steps,) [m], and powers (steps,) [W]."""
    course = stage.nominal.course
    if course is None or not 0 < course.duration < np.inf:
        return 0.0, np.zeros(1), np.zeros(1)
    velocity, step = _velocities(stage, course), _step(stage)
    energy, power = np.zeros(_SAMPLES - 1), np.zeros(_SAMPLES - 1)
    for axis, v in velocity.items():
        along = stage.nominal.rotation[:, axis.column]
        moved = inertia_about if axis.is_rotation else mass_along
        mass = moved(stage.context.robot, stage.context.start, along)
        gains = {n: value_of(stage.gains, n, axis) for n in ("damping", "stiffness")}
        drag = stage.law.control_law.drag(gains) or 0.0
        energy += mass * v**2 / 2
        if drag and gains["stiffness"] > 0:
            energy += (drag * v) ** 2 / gains["stiffness"] / 2
        # A tank pays for what leads the arm against a damper at rest, which gives that back to it.
        power += mass * v * np.gradient(v, step) + gains["damping"] * v**2
    lengths = (v for axis, v in velocity.items() if not axis.is_rotation)
    way = step * np.sqrt(sum((v**2 for v in lengths), np.zeros(_SAMPLES - 1)))
    return float(np.max(energy)), way, power


def _velocities(stage: StagePlan, course: Course) -> dict[Axis, Vector]:
    """(steps,) of each axis whose motion is planned [m/s, rad/s]."""
    times = np.linspace(0.0, course.duration, _SAMPLES).tolist()
    found = {}
    for axis, displacement in course.displacements.items():
        moved = np.array([displacement(t) for t in times])
        if np.isfinite(moved).all():
            found[axis] = np.diff(moved) / _step(stage)
    return found


def _step(stage: StagePlan) -> float:
    """Between two instants of its planned motion [s]."""
    course = stage.nominal.course
    return 1.0 if course is None else course.duration / (_SAMPLES - 1)


def _pressing(stage: StagePlan) -> float:
    """What forces store that the stages before did not have [J]."""
    task, found = stage.context.loaded.task, 0.0
    earlier = before(task, stage.name)
    for axis, force in stage.set_points.constant.items():
        k = stage.environment.stiffness_of(axis)
        held = [task.stages[each].axes.get(axis) for each in earlier]
        if axis.is_rotation or not k > 0 or (held and all(h and h.has_force for h in held)):
            continue
        found += force**2 / k / 2
        own = value_of(stage.gains, "stiffness", axis)
        if stage.plans[axis].open_loop and own > 0:
            found += force**2 / own / 2
    return found


def _friction(stage: StagePlan) -> float:
    """What rubs where it presses [N]."""
    shapes = stage.context.loaded.task.shapes
    return sum(
        abs(force) * shapes[contact].friction
        for axis, force in stage.set_points.constant.items()
        if not axis.is_rotation and (contact := stage.contacts.of(axis)) in shapes
    )
