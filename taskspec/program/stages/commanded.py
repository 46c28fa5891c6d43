"""The command of a stage's law: its references, its constraints, and the torque of its equation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import casadi as ca

from taskspec.control import resolution
from taskspec.control.command import Command
from taskspec.deferred_methods import dataclass
from taskspec.laws import energy
from taskspec.laws.case import Case
from taskspec.laws.disturbance import TORQUE, observe
from taskspec.laws.energy import Energy
from taskspec.laws.tank import TankStep
from taskspec.laws.uncertainty import Uncertainty
from taskspec.program.events import Condition
from taskspec.program.last_commands import last_command, last_velocity
from taskspec.program.plan import StagePlan
from taskspec.program.reference import orientation
from taskspec.program.reference.constraints import (
    ConstraintSet,
    constraint_set,
    joint_constraint_set,
)
from taskspec.program.reference.joint_reference import joint_reference
from taskspec.program.reference.measurement import Measurement
from taskspec.program.reference.reference_set import ReferenceSet
from taskspec.program.reference.references import build_references
from taskspec.program.stages import carried_torque
from taskspec.program.stages.free_directions import free_directions
from taskspec.program.stages.multipliers import EquationForces, constrain, equation_forces
from taskspec.program.stages.null_space import null_space_command
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.spec import Law


@dataclass(frozen=True, slots=True)
class Commanded:
    """The command of a stage's law, as expressions.

    Attributes:
        references: as the law sees them.
        forces: set points and integrals of the equations.
        chosen: what constrains the stage under a law with multipliers, else None.
        case: what the law was filled in with.
        command: of the law.
        closed_form: (n,) torque of its closed form [N m].
        friction: (n,) what is added against the joints' friction [N m]; None for nothing.
        torque: (n,) the same with what is left of the last stage's.
        conditions: that come with the angles in which the law is stated.
        tank: what its tank makes of the torque; None without one.
    """

    references: ReferenceSet
    forces: EquationForces
    chosen: ConstraintSet | None
    case: Case
    command: Command
    closed_form: ca.SX
    friction: ca.SX | None
    torque: ca.SX
    conditions: list[Condition]
    tank: TankStep | None = None

    @property
    def own(self) -> ca.SX:
        """(n,) the closed form's torque, with what is added against friction."""
        return self.closed_form if self.friction is None else self.closed_form + self.friction

    @property
    def set_points(self) -> dict[str, ca.SX]:
        """Of every force by axis or equation, as the robot applies it [N, N m]."""
        found: dict[str, ca.SX] = dict(self.references.force_ref.items())
        return found | self.forces.desired


def command(plan: StagePlan, measurement: Measurement) -> Commanded:
    """Fills in the law of a stage; the signals of its references join the table."""
    context = plan.context
    law, inputs = plan.law, measurement.inputs
    built = build_references(plan, measurement)
    measured = measurement.state
    if plan.spec.tare:  # What the sensor reads now is its own error, and moves nothing.
        measured = replace(measured, f=ca.SX.zeros(len(measured.axes)))
    state, references, conditions = orientation.restate(
        law, measured, built, measurement.at.R.T @ measurement.terms.R, measurement.table
    )
    joints = None
    if plan.joint_path is not None:
        joints = joint_reference(plan.joint_path, measurement)
        measurement.table.situation.joint_error = ca.mmax(ca.fabs(joints.error))
    forces = equation_forces(plan, measurement, joints)
    on_path = plan.path.axes if plan.path is not None else ()
    chosen = control = None
    rows = {name: measurement.rows[name] for name in plan.active}
    if joints is not None:
        turns = [turns_at(context.robot, i) for i in range(context.robot.n)]
        chosen = joint_constraint_set(rows, measurement.reactions, turns, measurement.parameters)
    elif law.control_law.multipliers:
        chosen = constraint_set(
            state=state,
            forced=[a for a in plan.axes if plan.plans[a].force],
            named=[*plan.spec.axes, *on_path],
            rows=rows,
            measured=measurement.reactions,
            references=references.law,
            parameters=measurement.parameters,
        )
    if chosen:
        control = constrain(chosen, forces, references, measurement.clock, measurement.parameters)
    posture = None
    if joints is None:  # Else all joints are led.
        posture = null_space_command(
            law, context, measurement.state, measurement.world, inputs.q, inputs.v
        )
    left = carried = None
    if measurement.moving_base is not None:
        carried = state.velocity - state.J @ inputs.v
    if law.solve == "qp" and law.control_law.commands == "velocity":
        moved = state.J @ last_velocity(context, measurement.parameters)
        left = moved if carried is None else moved + carried, measurement.table.situation.limited
    plans = plan.plans
    case = Case(
        state=state,
        reference=references.law,
        gains=plan.gains,
        joint_velocity=inputs.v,
        force=tuple(a for a in state.axes if plans[a].force),
        soft=tuple(a for a in state.axes if plans[a].soft),
        normal=tuple(a for a in state.axes if plans[a].yields),
        posture=posture,
        constraints=control,
        free=free_directions(plan, measurement) if plan.consistent else None,
        joints=joints,
        period=context.period,
        carried=carried,
        left=left,
        bias=measurement.terms.bias,
        uncertainty=Uncertainty() if law.sliding is None else law.sliding.bounds,
        remembered=measurement.memory.add,
    )
    measurement.table.situation.energies = partial(energies, plan, case)
    wanted = law.control_law.command(case)
    closed_form = _closed_form(law, measurement, case, wanted)
    if law.disturbance_observer is not None:
        wanted, closed_form = _observed(plan, measurement, case, wanted, closed_form)
    fading = carried_torque.fading(measurement.parameters, measurement.clock, closed_form.shape[0])
    if context.drives.positions:  # It is carried as what a period adds to a position.
        fading = fading / context.period
    friction = None if context.friction is None else context.friction.torque(case)
    own = closed_form if friction is None else closed_form + friction
    commanded = own + fading
    step = None if law.tank is None else _tank_step(plan, measurement, case, commanded)
    return Commanded(
        references,
        forces,
        chosen,
        case,
        wanted,
        closed_form,
        friction,
        commanded if step is None else step.torque,
        conditions,
        step,
    )


def _closed_form(law: Law, measurement: Measurement, case: Case, wanted: Command) -> ca.SX:
    """What the joints are commanded (n,), torques or velocities."""
    terms, state, posture = measurement.terms, case.state, case.posture
    if law.control_law.commands != "velocity":
        return resolution.torque(wanted, state, terms.H, terms.bias, terms.gravity, posture)
    if wanted.joint_velocity is not None:
        return wanted.joint_velocity
    assert wanted.velocity is not None
    return resolution.resolved(case.by_the_arm(wanted.velocity), state, posture)


def _observed(
    plan: StagePlan, measurement: Measurement, case: Case, wanted: Command, torque: ca.SX
) -> tuple[Command, ca.SX]:
    """What a stage with a disturbance observer commands, with what that remembers."""
    context, t, observer = plan.context, measurement.clock.t, plan.observer
    assert observer is not None
    observed = observe(
        case,
        observer,
        applied=last_command(context, measurement.parameters),
        begins=t <= 0,
    )
    measurement.memory.add(TORQUE, context.robot.n)
    measurement.table.situation.disturbance = observed.estimate
    torque = torque + observed.torque
    memory = {**wanted.memory, **observed.memory, TORQUE: torque}
    return replace(wanted, memory=memory), torque


def _tank_step(plan: StagePlan, measurement: Measurement, case: Case, commanded: ca.SX) -> TankStep:
    """What a stage's tank makes of the torque (n,) that its law commands."""
    assert plan.law.tank is not None
    step = plan.law.tank.of_law.step(
        case,
        commanded,
        measurement.terms.gravity,
        last_command(plan.context, measurement.parameters),
        measurement.memory.once,
        plan.law.control_law,
    )
    situation = measurement.table.situation
    situation.tank = step.named()
    situation.energies = partial(energies, plan, case, step)
    return step


def energies(plan: StagePlan, case: Case, step: TankStep | None = None) -> Mapping[str, ca.SX]:
    """The energies and powers of a stage's law by name; none where it states none."""
    tank = () if step is None else (step.named()[n] for n in ("tank.spring", "tank.filled"))
    found = stage_energy(plan, case, *tank)
    return {} if found is None else found.signals()


def stage_energy(
    plan: StagePlan, case: Case, granted: ca.SX | None = None, filled: ca.SX | None = None
) -> Energy | None:
    """What the law of a stage stores; None where it states no storage function.

    Of a law in Euler angles that turns the tool there is none: a log has no rates of these angles.
    Nor is there one of gains that follow an estimate.

    Args:
        plan: of the stage.
        case: its law's.
        granted: the share that its tank grants the springs; None without a tank.
        filled: power of the dampers, which fill it [W]; None likewise.
    """
    turns = any(axis.is_rotation for axis in case.state.axes)
    unstated = plan.joint_path is not None or plan.estimates.axes
    if unstated or (turns and plan.law.orientation != "so3"):
        return None
    if granted is not None and filled is not None:
        return energy.beside_a_tank(case, granted, filled)
    return plan.law.control_law.energy(case)
