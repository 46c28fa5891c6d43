"""A stage of a task about its predicted equilibrium."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.gains import DEAD_BAND
from taskspec.program.axes import MOSTLY
from taskspec.program.components import true_task_with
from taskspec.program.context import Context
from taskspec.program.passage import Instant
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.prepare import arm_at
from taskspec.program.program import compiled_stage
from taskspec.program.sensor import SensorModel
from taskspec.program.stages.stage import CompiledStage
from taskspec.spec import AxisEntry, Task
from taskspec.stability.controller import LinearController, Operating
from taskspec.stability.environment import HELD, linear_plant
from taskspec.stability.loop import Mode, modes, poles
from taskspec.stability.plant import LinearPlant
from taskspec.stability.points import Touched, touching

Matrix = NDArray[np.float64]

#: Poles, energies and directions that differ by less than this part are one.
_ALIKE = 1e-6
#: A contact that a stage meets, or presses on without force, is looked at under this force [N].
LEAST_PRESS = 1.0
#: Slower than this is the creep of a tool that friction holds [m/s].
_SLIDES = 1e-5


@dataclass(frozen=True, slots=True)
class Attitude:
    """Where a stage's way leads the arm.

    Attributes:
        q: (n,) its joints.
        normals: (3,) of what it presses on, world axes, by name.
    """

    q: Matrix
    normals: Mapping[str, Matrix]

    def like(self, other: Attitude, far: float) -> bool:
        """Whether no joint, and no line of a normal, differs by so much [rad, m]."""
        turned = [
            float(np.linalg.norm(np.cross(normal, other.normals[name])))
            for name, normal in self.normals.items()
        ]
        return max([float(np.abs(self.q - other.q).max()), *turned]) < far


@dataclass(frozen=True, slots=True)
class SampledStage:
    """A stage as a sampled linear system.

    Attributes:
        context: of the nominal task.
        stage: the compiled one.
        rotation: (3, 3) its frame at the start pose.
        pressed: what the robot applies to each contact at the equilibrium [N, N m].
        meets: the contact is one that the stage may come to, not one that it is in.
        at: the equilibrium, entered.
        controller: its law there.
        nominal: what it drives in the world of the file.
        sticking: friction holds the tool; else it slides.
        sliding: (3,) as fast as this, world axes [m/s]; None where that is not known.
        turns: (3, k) world axes about which the tool gives way, and comes to lie flat.
        kept: its gains stay, though they would follow the stiffness of another world.
    """

    context: Context
    stage: CompiledStage
    rotation: Matrix
    pressed: Mapping[str, float]
    meets: bool
    at: Operating
    controller: LinearController
    nominal: LinearPlant
    sticking: bool = False
    sliding: Matrix | None = None
    turns: Matrix = field(default_factory=lambda: HELD)
    kept: bool = False

    def plant(self, task: Task | None = None) -> LinearPlant:
        """What it drives; `task` is the one whose world and robot are true."""
        if task is None or task is self.context.loaded.task:
            return self.nominal
        return self._plant(self.context, task)

    def _plant(self, context: Context, task: Task) -> LinearPlant:
        return linear_plant(
            context,
            task,
            self.pressed,
            sticking=self.sticking,
            sliding=self.sliding,
            turns=self.turns,
        )

    def modes(self, task: Task | None = None, plant: LinearPlant | None = None) -> tuple[Mode, ...]:
        """Modes of the closed loop, the least stable first.

        Args:
            task: whose world and robot are true.
            plant: that of `task`, if it is known.
        """
        return modes(*self._loop(task, plant))

    def poles(self, task: Task, plant: LinearPlant) -> NDArray[np.complex128]:
        """Poles of the closed loop, neutral chains among them; quicker than `modes`.

        Args:
            task: whose world and robot are true.
            plant: that of `task`.
        """
        return poles(*self._loop(task, plant))

    def _loop(
        self, task: Task | None, plant: LinearPlant | None
    ) -> tuple[LinearController, LinearPlant, SensorModel, float]:
        nominal = self.context.loaded.task
        task = nominal if task is None else task
        sensor = SensorModel.of(task.robot.sensor, self.context.period)
        plant = self.plant(task) if plant is None else plant
        stage = self
        if self.estimating and task is not nominal:
            stage = self.designed_for(self.stiffness(task))
        return stage.controller, plant, sensor, self.context.period

    @property
    def estimating(self) -> bool:
        """Whether its gains follow the stiffness of its contacts, whatever that is."""
        return bool(self.stage.plan.estimates.schedules) and not self.kept

    def stiffness(self, task: Task) -> dict[Axis, float]:
        """The stiffness along each axis that it estimates, in a world [N/m]."""
        plan, found = self.stage.plan, {}
        for axis, each in plan.estimates.axes.items():
            name = plan.contacts.of(axis)
            assert name is not None
            nominal = self.context.compliances[name].stiffness
            true = getattr(task.world[name], "stiffness", nominal)
            found[axis] = each.declared * (nominal if true == "rigid" else true) / nominal
        return found

    def designed_for(self, stiffness: Mapping[Axis, float]) -> SampledStage:
        """The same stage, whatever it drives, with gains for other stiffnesses of its contacts.

        Args:
            stiffness: by axis, as far as it is another one [N/m].
        """
        plan = self.stage.plan
        gains = plan.estimates.gains(plan.gains, stiffness)
        stage = replace(self.stage, plan=plan.but(gains=gains))
        at = self.at.under(gains)
        return replace(self, stage=stage, at=at, controller=at.linear(), kept=True)

    def on(self, stiffness: float) -> Task:
        """The true world with this stiffness of every contact that it estimates [N/m]."""
        plan = self.stage.plan
        values: dict[tuple[str, int | None], float] = {}
        for axis, each in plan.estimates.axes.items():
            name = plan.contacts.of(axis)
            assert name is not None
            share = self.context.compliances[name].stiffness / each.declared
            values[f"world.{name}.stiffness", None] = stiffness * share
        return true_task_with(self.context, values)

    def free(self) -> SampledStage:
        """The same stage before it meets its contact."""
        plant = linear_plant(self.context, self.context.loaded.task, {})
        return replace(self, pressed={}, meets=False, nominal=plant, sliding=None)

    def at_ends(self) -> Iterator[tuple[str, SampledStage]]:
        """The same stage with gains that vary at the ends of their ranges, and which end that is.

        A gain without such an end, or with one that is not positive, stays nominal.
        """
        plan = self.stage.plan
        for which in ("least", "greatest") if plan.law.varying else ():

            def worth(expression: Expression, which: str = which) -> float:
                within = plan.gain_range.of(expression)
                end = within.low if which == "least" else within.high
                sound = math.isfinite(end) and end > 0
                return end if sound else plan.gain_range.nominal(expression)

            gains = plan.gains | plan.design_rules.design(worth=worth).gains
            at = self.at.under(gains)
            stage = replace(self.stage, plan=plan.but(gains=gains))
            yield which, replace(self, stage=stage, at=at, controller=at.linear())

    def there(self, here: Instant) -> SampledStage:
        """The same stage, with its gains, where its way leads the arm and the held mechanism."""
        context = replace(self.context, **arm_at(self.context.robot, here.q))
        if context.held and here.coordinate:
            moved = context.mechanisms[context.held].moved(here.coordinate)
            context = replace(context, mechanisms={**context.mechanisms, context.held: moved})
        context = _at_contact(context, self.pressed)
        at = self.at.there(context)
        plant = self._plant(context, context.loaded.task)
        return replace(self, context=context, at=at, controller=at.linear(), nominal=plant)

    def place(self, q: Matrix, p: Matrix) -> Attitude:
        """Where the arm is on a stage's way, and how what it presses on lies there.

        Args:
            q: (n,) its joints.
            p: (3,) its tip, world axes.
        """
        task, context = self.context.loaded.task, self.context
        normals = {}
        for name in self.pressed:
            if name in context.surfaces:
                normals[name] = Touched(context, task, name).off(p, 0.0)[0]
            elif context.start_equations[name].gradient is not None:
                normals[name] = context.equations[name].unit_normal(ca.SX(p))
        return Attitude(q, normals)

    def stuck(self) -> SampledStage | None:
        """The same stage while friction holds the tool; None where there is none."""
        context, task = self.context, self.context.loaded.task
        shapes = [task.shapes[name] for name in self.pressed if name in context.surfaces]
        if not any(shape.friction > 0 for shape in shapes):
            return None
        plant = linear_plant(context, task, self.pressed, sticking=True, turns=self.turns)
        return replace(self, nominal=plant, sticking=True)

    def axis(self, mode: Mode, modes: Sequence[Mode] = ()) -> str:
        """The equation or task axis that moves most in a mode, by its energy.

        Modes whose poles are one to rounding have no shapes of their own, but span a space: what
        counts is then the energy of an axis in all of that. Of axes that move alike it is the
        first. `null space` if none moves.

        Args:
            mode: the mode.
            modes: those among which there may be more with its pole.
        """
        context = self.context
        both = np.kron(np.eye(2), self.rotation.T)
        J = both @ context.start_jacobian
        H = context.start_inertia
        rows = [AXES.index(a) for a in self.stage.plan.axes]
        mobility = J[rows] @ np.linalg.solve(H, J[rows].T)
        # Compared by z: a pole at -1 has two logarithms, and rounding decides which is taken.
        near = _ALIKE * abs(mode.z) * min(abs(mode.s) * context.period, 1.0)
        alike = [m.shape for m in modes if m is not mode and abs(m.z - mode.z) < near]
        if modes and 2 * abs(mode.z.imag) < near:
            # Two real poles that rounding has made a pair, of which only one is among the modes.
            alike.append(mode.shape.conj())
        shapes = _orthonormal(np.array([mode.shape, *alike]).T, H)
        motion = J[rows] @ shapes
        for i, name in enumerate(context.equations):
            if name not in self.stage.plan.active:
                continue
            normal = context.start_equations[name].normal
            if context.compliances[name].exact:
                # Nothing moves along it: its force alone changes, by more than motion would take.
                moved = float(np.real(np.vdot(mode.shape, H @ mode.shape)))
                inertial = abs(mode.s) ** 2 * np.sqrt(moved / (normal @ np.linalg.solve(H, normal)))
                if abs(mode.reactions[i]) > inertial:
                    return name
                continue
            share = float(np.sum(np.abs(normal @ shapes) ** 2))
            if share > (normal @ np.linalg.solve(H, normal)) / 2:
                return name
        inside = float(np.real(np.vdot(motion, np.linalg.solve(mobility, motion))))
        if inside < 0.1 * shapes.shape[1]:
            return "null space"
        energy = np.sum(np.abs(motion) ** 2, axis=1) / np.diag(mobility)
        return self.stage.plan.axes[int(np.argmax(energy > (1 - _ALIKE) * energy.max()))]


def _orthonormal(shapes: Matrix, H: Matrix) -> Matrix:
    """(n, r) what spans the columns (n, k), with unit energy each and none between them: H is I."""
    factor = np.linalg.cholesky(H).T
    U, sizes, _ = np.linalg.svd(factor @ shapes, full_matrices=False)
    return np.asarray(np.linalg.solve(factor, U[:, sizes > _ALIKE * sizes[0]]))


def loop_of(task: TaskPlan, name: str) -> SampledStage | None:
    """A stage of a task at its equilibrium, analysed once for all who ask; see `analyse`."""
    if name not in task.loops:
        stage = task.stages[name]
        task.loops[name] = stage.design.loop or analyse(compiled_stage(task, name))
    found: SampledStage | None = task.loops[name]
    return found


def control_of(stage: StagePlan) -> str:
    """What the stability of a stage depends on: stages that have it in common need one look."""
    axes = {
        name: _kind(axis)
        for name, axis in stage.spec.axes.items()
        if _kind(axis) != _kind(AxisEntry())
    }
    law = repr(stage.law)
    # After a path of joints the arm is another.
    arm = stage.context.start.tobytes()
    return repr((sorted(axes.items()), stage.frame.name, law, sorted(stage.spec.constraints), arm))


def _kind(axis: AxisEntry) -> tuple[object, ...]:
    return (
        axis.has_force,
        axis.mode.loop,
        axis.stiffness,
        axis.damping,
    )


def loop_like(task: TaskPlan, name: str) -> SampledStage | None:
    """The loop of a stage, or that of an earlier one with its control that presses on the same."""
    stage = task.stages[name]
    control = control_of(stage)
    for earlier in task.loops:
        other: SampledStage | None = task.loops[earlier]
        if other is None or other.meets or {*other.pressed} != {*stage.contacts.pressed}:
            continue
        if control_of(task.stages[earlier]) == control:
            return other
    return loop_of(task, name)


def analyse(stage: CompiledStage) -> SampledStage | None:
    """A stage at its equilibrium; None where its torque has no derivative there.

    What is analysed is the closed form, which limits and saturation do not change while none of
    them binds.
    """
    stage = _outside_dead_bands(stage)
    plan = stage.plan
    context, rotation = plan.context, plan.rotation
    at = Operating(context, stage)
    pressed, meets = _pressed(context, stage, rotation, at)
    there = _at_contact(context, pressed)
    if there is not context:
        context, at = there, at.there(there)
    wrench, reactions = np.zeros(6), np.zeros(len(context.loaded.task.reported))
    sliding = None if meets else _slides(plan, pressed)
    turns = rotation[:, [a.column for a, p in plan.plans.items() if a.is_rotation and p.force]]
    plant = linear_plant(context, context.loaded.task, pressed, sliding=sliding, turns=turns)
    for row in plant.rows:
        if row.equation is not None:
            reactions[row.equation] = pressed[row.name]
            wrench += row.W @ [-pressed[row.name]]
        elif row.name in pressed and not row.rubs:
            wrench += row.W @ np.full(len(row.G), pressed[row.name] / len(row.G))
    for bushing in context.bushings.values():
        wrench += bushing.spring(context.start_p, context.start_R).wrench
    at.press(wrench, reactions)
    controller = at.linear()
    if not controller.finite:
        return None
    return SampledStage(
        context,
        stage,
        rotation,
        pressed,
        meets,
        at,
        controller,
        plant,
        sliding=sliding,
        turns=turns,
    )


def _outside_dead_bands(stage: CompiledStage) -> CompiledStage:
    """A stage that a force error moves however small it is: within a dead band nothing would ring.

    What swings beyond a dead band sees the loop as it is, less what the band takes.
    """
    gains = stage.plan.gains
    bands = gains.get(DEAD_BAND.name)
    if not bands:
        return stage
    none = {axis: replace(band, value=0.0) for axis, band in bands.items()}
    return replace(stage, plan=stage.plan.but(gains=gains | {DEAD_BAND.name: none}))


def _at_contact(context: Context, pressed: Mapping[str, float]) -> Context:
    """The context with the tip where it touches what it presses on; itself where all is flat.

    J, H and the joints stay as they are.
    """
    shapes = [name for name in pressed if name in context.surfaces]
    p = touching(context, context.loaded.task, shapes) if shapes else None
    return context if p is None else replace(context, start_p=p)


def _slides(stage: StagePlan, pressed: Mapping[str, float]) -> Matrix | None:
    """(3,) how fast the tool slides on the one object that it presses on; None if not known."""
    if len(pressed) != 1 or stage.path is not None:
        return None
    [name], rates = pressed, np.zeros(3)
    if name not in stage.context.surfaces or name in stage.context.moving_bases:
        return None
    for axis, plan in stage.plans.items():
        rate = plan.mode.constant_rate(stage.known) if plan.mode.moves else 0.0
        if rate is None or (axis.is_rotation and rate):
            return None
        if not axis.is_rotation:
            rates[axis.row] = rate
    normal, velocity = stage.contacts.normal(name), stage.rotation @ rates
    velocity = velocity - normal * float(normal @ velocity)
    return velocity if float(np.linalg.norm(velocity)) > _SLIDES else None


def _along_equation(context: Context, name: str, applied: Matrix) -> float:
    """What the robot applies along an equation's unit gradient with a force (3,) on the tip [N]."""
    gradient = context.start_equations[name].gradient
    assert gradient is not None
    along, relation = float(gradient @ applied), context.equations[name].constraint.relation
    # One that lets pass on a side is pressed on from that side.
    if relation == "=":
        return along
    return max(along, LEAST_PRESS) if relation == "<=" else min(along, -LEAST_PRESS)


def _pressed(
    context: Context, stage: CompiledStage, rotation: Matrix, at: Operating
) -> tuple[dict[str, float], bool]:
    """What the robot applies to each contact, and whether these are only met."""
    outputs = at.outputs()
    found: dict[str, float] = {}
    for i, name in enumerate(context.equations):
        relation = context.equations[name].constraint.relation
        if name in stage.plan.active or relation == "=":
            wanted = float(outputs["reaction_ref"][i])
            found[name] = wanted if np.isfinite(wanted) else 0.0
    local = np.nan_to_num(outputs["force_ref"][:3])
    applied = rotation @ local
    for name in stage.plan.contacts.touched:
        if name in stage.plan.contacts.pressed:
            found[name] = max(-float(context.start_normals[name] @ applied), LEAST_PRESS)
    for name in stage.plan.environment.bearers.values():
        found[name] = _along_equation(context, name, applied)
    if found or stage.plan.contacts.held:
        return found, False
    if stage.plan.met:
        return {stage.plan.met[0]: LEAST_PRESS}, True
    return found, False


def along(context: Context, rotation: Matrix, name: str, axis: Axis) -> bool:
    """Whether an axis of a stage is along the normal of object `name`."""
    if axis.is_rotation:
        return False
    normal = context.start_normals[name]
    return abs(float(rotation[:, AXES.index(axis)] @ normal)) > MOSTLY
