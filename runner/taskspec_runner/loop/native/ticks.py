"""The closed loop's ticks on which nothing happens, in the Python that becomes machine code.

A tick that cannot be computed is left to Python before it has had an effect: `run` returns with a
reason, and the machine does that tick. Of a tick that ends the stage it leaves torque and outputs
to the machine, which finds the stage that follows and fills that one's memory; the first tick of
that stage, which is the same one, is then made here again. So this module decides nothing; it is
the order in which a tick's functions read and write the run's memory. What `c` has is listed in
`tick_memory`.
"""

from __future__ import annotations

import math

from taskspec.native.kernel import Vector, Words, call
from taskspec.program.evaluation import evaluate
from taskspec.program.execution import controller
from taskspec.program.execution.controller import copy, furthest, zero
from taskspec_runner.loop.native.tick_memory import TickMemory
from taskspec_runner.plant.joint_servo import enter
from taskspec_runner.plant.rigid_constraints import MOST_ROUNDS
from taskspec_runner.record.block import checksum

#: Why `run` has returned: all ticks are done; the noise is used up; the tick that has been sensed
#: is Python's; the plant is to be looked at; the tick ends its stage; the stage that has been
#: entered is Python's to open.
DONE, NOISE, SENSED, LOOK, ENDS, OPENS = 0, 1, 2, 3, 4, 5
#: A warning's number is the upper half of the 64 bit that MuJoCo has of it.
_ONE_WARNING = 0x100000000


def run(c: TickMemory, todo: int) -> int:
    """Up to `todo` ticks; why it has returned."""
    for _ in range(todo):
        if c.opens:
            if not (controller.opened(c.control) and controller.first_tick(c.control)):
                return OPENS
            c.torque_step = furthest(c.control.new_torque, c.control.last, c.control.n)
            c.opens = 0
        else:
            if c.noisy and c.noise_used == c.noise_drawn:
                return NOISE
            _sense(c)
            if not controller.tick(c.control):
                return SENSED
            if c.control.new_outputs[0] != 0.0 and c.control.stage_ticks > 0:
                controller.end(c.control)
                return ENDS
        controller.commit(c.control)
        _observe(c)
        _step(c)
        _record(c)
        c.control.ticks += 1
        c.control.stage_ticks += 1
        if _alarming(c):
            return LOOK
    return DONE


def _sense(c: TickMemory) -> None:
    """Joint state of this instant, and the wrench of the step before."""
    if c.encoder.code == 0:
        copy(c.true_q, c.control.q, c.control.n)
    else:
        evaluate(c.encoder)
    copy(c.true_v, c.control.v, c.control.n)
    copy(c.true_reactions, c.control.reactions, c.control.n_reactions)
    if c.sensor.code == 0:
        copy(c.true_wrench, c.control.wrench, 6)
        return
    if c.noisy:
        copy(c.noise_rows[6 * c.noise_used :], c.noise, 6)
        c.noise_used += 1
    c.samples[0] = 1.0 if c.sensor_ticks % c.hold_ticks == 0 else 0.0
    c.sensor_ticks += 1
    evaluate(c.sensor)
    copy(c.sensor_kept, c.sensor_memory, c.n_sensor)


def _observe(c: TickMemory) -> None:
    """The tick once more of the joints' true state, where they are not measured as they are."""
    if c.observed.code == 0:
        return
    now, visit, places = c.control.now, c.observed_visit, c.observed_places
    copy(c.true_q, c.observed_q, c.control.n)
    copy(c.true_v, c.observed_v, c.control.n)
    evaluate(c.observed_terms)
    stage, times = float(c.control.stage), now[2 + c.control.stage]
    if visit[0] != stage or visit[1] != times:
        visit[0] = stage
        visit[1] = times
        evaluate(c.observed_entry)
    parameters, entered = c.observed_parameters, c.observed_entered
    copy(c.observed_own, parameters, c.n_observed_parameters)
    for i in range(c.n_observed_places):
        parameters[places[i]] = entered[places[i]]
    evaluate(c.observed)
    copy(c.observed_next_memory, c.observed_memory, c.n_observed)


def _step(c: TickMemory) -> None:
    """Holds the command for one period, and reads the forces of its last step."""
    _gather(c.qpos, c.mechanism_at, c.mechanism_positions, c.n_mechanisms)
    _gather(c.qvel, c.mechanism_dof, c.mechanism_rates, c.n_mechanisms)
    _gather(c.qpos, c.loose_at, c.loose, c.n_loose)
    n = c.control.n
    if c.servo.code == 0:
        copy(c.control.torque, c.motors, n)
    if c.handling.code != 0:
        copy(c.grip_source, c.grip_command, 1)
    for number in range(c.substeps):
        if c.simple:
            call(c.mj_step, c.model, c.data)
        else:
            zero(c.applied, c.n_applied)
            _drive(c)
            call(c.mj_step1, c.model, c.data)
            _apply(c)
            _serve(c, number)
            _constrain(c)
            call(c.mj_step2, c.model, c.data)
    if c.servo.code != 0:
        copy(c.servo_wanted, c.servo_exerted, n)
        copy(c.servo_state[n:], c.servo_shown, n)
    if c.grip_rows:
        words = c.data_words
        call(c.memcpy, c.grip_rows, words[c.at_efc_force] + c.grip_first, c.grip_bytes)
    evaluate(c.forces)


def _drive(c: TickMemory) -> None:
    """Puts what moves by itself where it is at the simulator's clock."""
    if c.moving.code == 0:
        return
    clock, time = c.moving_clock, c.time
    clock[0] = time[0]
    evaluate(c.moving)
    at, dof, applied, bend = c.moving_at, c.moving_dof, c.applied, c.moving_bend
    place, rate, qpos, qvel = c.moving_place, c.moving_rate, c.qpos, c.qvel
    for i in range(c.n_moving):
        qpos[at[i]] = place[i]
        qvel[dof[i]] = rate[i]
        applied[dof[i]] = c.moving_inertia * bend[i]


def _apply(c: TickMemory) -> None:
    """Adds the forces that depend on the pose of this instant."""
    if c.equations.code != 0:
        clock, time = c.equations_clock, c.time
        clock[0] = time[0]
        if c.cartesian:
            call(c.mj_objectVelocity, c.model, c.data, c.body_kind, c.tip_body, c.tip_twist, 0)
        evaluate(c.equations)
        if c.cartesian:
            call(
                c.mj_applyFT,
                c.model,
                c.data,
                c.on_tip,
                c.about_tip,
                c.tip,
                c.tip_body,
                c.applied_at,
            )
        joints, extra = c.applied_joints, c.on_joints
        for i in range(c.n_joints):
            joints[i] += extra[i]
    _handle(c)
    if c.detents.code != 0:
        evaluate(c.detents)
        applied, where, forces = c.applied, c.detent_dof, c.detent_forces
        for i in range(c.n_detents):
            applied[where[i]] += forces[i]


def _handle(c: TickMemory) -> None:
    """Adds what grips loose bodies, and what takes them."""
    if c.handling.code == 0:
        return
    call(c.mj_objectVelocity, c.model, c.data, c.body_kind, c.tip_body, c.handling_twist, 0)
    evaluate(c.handling)
    call(
        c.mj_applyFT,
        c.model,
        c.data,
        c.handling_on_tip,
        c.handling_about_tip,
        c.tip,
        c.tip_body,
        c.applied_at,
    )
    applied, where, forces = c.applied, c.handled_dof, c.handling_forces
    for i in range(c.n_handled):
        applied[where[i]] += forces[i]
    copy(c.handling_kept, c.handling_memory, c.n_handling)


def _serve(c: TickMemory, step: int) -> None:
    """Has the servo of the joints set the torques, if it ticks in this step."""
    if c.servo.code == 0 or step % c.servo_every != 0:
        return
    enter(
        c.control.torque,
        c.servo_before,
        c.servo_queue,
        c.servo_delayed,
        c.servo_place,
        c.servo_rows,
        c.control.n,
        c.servo_ticks,
        c.servo_positions,
        step // c.servo_every + 1,
    )
    call(c.mj_fullM, c.model, c.data, c.servo_H)
    if c.servo_unknown:
        call(c.mj_jacBody, c.model, c.data, c.servo_J, c.servo_turning_J, c.tip_body)
    evaluate(c.servo)
    copy(c.servo_next_state, c.servo_state, 4 * c.control.n)
    copy(c.servo_wanted, c.motors, c.control.n)


def _constrain(c: TickMemory) -> None:
    """Adds the torques of equations that hold exactly."""
    if c.rigid.code == 0:
        return
    clock, number, time, settled = c.rigid_clock, c.rigid_round, c.time, c.rigid_settled
    clock[0], number[0] = time[0], 0.0
    if c.rigid_cartesian:
        call(c.mj_jacBody, c.model, c.data, c.rigid_J, c.rigid_turning_J, c.tip_body)
        rate, turning = c.rigid_J_rate, c.rigid_turning_J_rate
        call(c.mj_jacDot, c.model, c.data, rate, turning, c.tip, c.tip_body)
    call(c.mj_fullM, c.model, c.data, c.rigid_H)
    call(c.mj_fwdActuation, c.model, c.data)
    k, m, joints = c.n_joints, c.n_rigid, c.applied_joints
    others, torques = c.rigid_others, c.rigid_on_joints
    copy(joints, others, k)
    copy(c.constraint_forces, c.rigid_exerted, k)
    evaluate(c.rigid)
    for i in range(1, MOST_ROUNDS + 1):
        for j in range(k):
            joints[j] = others[j] + torques[j]
        copy(c.rigid_multipliers, c.rigid_before, m)
        copy(c.rigid_next_step, c.rigid_step, m)
        copy(c.rigid_next_multipliers, c.rigid_multipliers, m)
        copy(c.rigid_next_broyden, c.rigid_broyden, m * m)
        call(c.mj_fwdAcceleration, c.model, c.data)
        call(c.mj_fwdConstraint, c.model, c.data)
        if _same(c.constraint_forces, c.rigid_exerted, k):
            return
        copy(c.constraint_forces, c.rigid_exerted, k)
        number[0] = float(i)
        evaluate(c.rigid)
        if settled[0] != 0.0:
            return


def _record(c: TickMemory) -> None:
    """The tick into the next row of the block, in a file with its checksum."""
    bus = c.bus
    bus[c.i_clock] = float(c.control.ticks) * c.control.period
    bus[c.i_t] = float(c.control.stage_ticks) * c.control.period
    bus[c.i_stage] = float(c.control.stage)
    if not c.keeps:
        return
    copy(c.bus, c.rows[c.row * c.n_bus :], c.n_bus)
    if c.checks:
        sums = c.sums
        sums[c.row] = checksum(c.bus_words, c.weights, c.n_bus, c.recorded)
    c.recorded += 1
    c.row += 1
    if c.row == c.room:
        c.row = 0


def _alarming(c: TickMemory) -> bool:
    """Whether the simulator may have an alarm: a force, a warning, a clock that stands, energy."""
    w = c.true_wrench
    if not w[0] * w[0] + w[1] * w[1] + w[2] * w[2] < c.force_bound * c.force_bound:
        return True
    if c.control.ticks % c.look_every != 0:
        return False
    warnings, time = c.warnings, c.time
    for i in range(c.n_warnings):
        if warnings[i] >= _ONE_WARNING:
            return True
    if not time[0] > c.last_time:
        return True
    c.last_time = time[0]
    velocity, momentum = c.velocity, c.momentum
    copy(c.joint_rates, c.arm_velocity, c.n_joints)
    call(c.mj_mulM, c.model, c.data, c.momentum, c.velocity)
    twice = 0.0
    for i in range(c.n_applied):
        twice += velocity[i] * momentum[i]
    return not 0.5 * twice < c.energy_bound or not math.isfinite(twice)


def _same(a: Vector, b: Vector, n: int) -> bool:
    same = True
    for i in range(n):
        if a[i] != b[i]:
            same = False
    return same


def _gather(source: Vector, places: Words, target: Vector, n: int) -> None:
    for i in range(n):
        target[i] = source[places[i]]
