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
from taskspec.native.quadratic import SOLVED, solve
from taskspec.program.execution.pivots import select
from taskspec.program.execution.stage_solver import EXACT, WORST_RESIDUAL
from taskspec_runner.loop.closed_loop import HEALTHY
from taskspec_runner.loop.native.tick_memory import Evaluation, TickMemory
from taskspec_runner.plant.rigid_constraints import MOST_ROUNDS
from taskspec_runner.record.block import checksum

#: Why `run` has returned: all ticks are done; the next tick is Python's, from its beginning; the
#: noise is used up; the tick that has been sensed is Python's; the plant is to be looked at; the
#: tick ends its stage; the stage that has been entered is Python's to open; a path or a move comes
#: to its next piece.
DONE, WHOLE, NOISE, SENSED, LOOK, ENDS, OPENS, KNOT = 0, 1, 2, 3, 4, 5, 6, 7
#: A warning's number is the upper half of the 64 bit that MuJoCo has of it.
_ONE_WARNING = 0x100000000


def run(c: TickMemory, todo: int) -> int:
    """Up to `todo` ticks; why it has returned."""
    for _ in range(todo):
        if c.opens:
            if not (_opened(c) and _tick(c)):
                return OPENS
            c.torque_step = _furthest(c.new_torque, c.last, c.n)
            c.opens = 0
        else:
            if float(c.stage_ticks) * c.period >= c.next_knot:
                return KNOT
            if c.outputs[c.i_conditioning] < c.least_conditioning:
                return WHOLE
            if c.noisy and c.noise_used == c.noise_drawn:
                return NOISE
            _sense(c)
            if not _tick(c):
                return SENSED
            if c.new_outputs[0] != 0.0 and c.stage_ticks > 0:
                _end(c)
                return ENDS
        _commit(c)
        _step(c)
        _record(c)
        c.ticks += 1
        c.stage_ticks += 1
        if _alarming(c):
            return LOOK
    return DONE


def _sense(c: TickMemory) -> None:
    """Joint state of this instant, and the wrench of the step before."""
    _copy(c.true_q, c.q, c.n)
    _copy(c.true_v, c.v, c.n)
    _copy(c.true_reactions, c.reactions, c.n_reactions)
    if c.sensor.code == 0:
        _copy(c.true_wrench, c.wrench, 6)
        return
    if c.noisy:
        _copy(c.noise_rows[6 * c.noise_used :], c.noise, 6)
        c.noise_used += 1
    c.samples[0] = 1.0 if c.sensor_ticks % c.hold_ticks == 0 else 0.0
    c.sensor_ticks += 1
    _evaluate(c.sensor)
    _copy(c.sensor_kept, c.sensor_memory, c.n_sensor)


def _tick(c: TickMemory) -> bool:
    """Evaluates the law into memory of its own; whether the tick may be done here."""
    now, out = c.now, c.new_outputs
    _evaluate(c.terms)
    if c.zeroed.code != 0:
        _copy(c.tip_rotation, c.turned, 9)
        _evaluate(c.zeroed)
        _copy(c.zeroed_wrench, c.wrench, 6)
    now[0] = float(c.stage_ticks) * c.period
    now[1] = float(c.ticks) * c.period
    if c.has_last_torque:
        _copy(c.torque, c.last_torque, c.n)
    _evaluate(c.tick)
    if not out[c.i_health] < HEALTHY:
        return False
    limits = c.limit_events
    # A first tick heeds limits alone, and what that leads to is Python's to decide.
    if c.stage_ticks == 0 and out[0] != 0.0 and limits[int(out[0]) - 1] != 0:
        return False
    return c.has_program == 0 or _resolve(c)


def _end(c: TickMemory) -> None:
    """Leaves the tick that ends a stage to the machine."""
    _copy(c.torque, c.torque_before, c.n)
    _copy(c.new_torque, c.torque, c.n)
    _copy(c.new_torque, c.last, c.n)
    _copy(c.new_outputs, c.outputs, c.n_outputs)
    if c.leaving.code != 0:
        _evaluate(c.leaving)
    if c.estimates:
        _add_up(c)


def _add_up(c: TickMemory) -> None:
    """The sum of the forces that were collected last, the oldest first."""
    seen, room, recent, total = c.estimate_ticks, c.estimate_room, c.recent, c.recent_total
    first = seen % room if seen > room else 0
    for i in range(3):
        total[i] = 0.0 if seen == 0 else recent[3 * first + i]
    for k in range(1, min(seen, room)):
        row = recent[3 * ((first + k) % room) :]
        for i in range(3):
            total[i] += row[i]


def _opened(c: TickMemory) -> bool:
    """Enters a stage: memory and parameters, coordinates, forces that come back, what is carried.

    Whether it could. Nothing is written that Python would not write anew.
    """
    now = c.now
    now[0] = 0.0
    now[1] = float(c.ticks) * c.period
    _copy(c.torque_before, c.torque, c.n)
    _evaluate(c.entry)
    c.next_knot = _first_knot(c)
    if c.choice.code != 0:
        _evaluate(c.choice)
        select(
            c.gradient,
            c.selection,
            c.pivot_rows,
            c.pivot_columns,
            c.pivots_left,
            c.n_constraints,
            c.n_coordinates,
        )
    if c.asks or c.carries:
        _evaluate(c.tick)
    if c.asks:
        if not _settled(c):
            return False
        if c.paring:
            _evaluate(c.tick)
    if c.carries:
        _evaluate(c.carrying)
    return True


def _first_knot(c: TickMemory) -> float:
    """When the stage that has been entered comes to the next piece of a move or of its path."""
    path_time, known, places = c.path_time, c.known_knots, c.cubic_places
    own = path_time[0] if c.slowed else 0.0
    first, along = math.inf, math.inf
    for i in range(c.n_cubics):
        knots = c.cubics[places[3 * i] :]
        for k in range(places[3 * i + 1]):
            if places[3 * i + 2] == 0 and knots[k] > 0.0:
                first = min(first, knots[k])
            if places[3 * i + 2] != 0 and knots[k] > own:
                along = min(along, knots[k])
    for k in range(c.n_known_knots):
        if known[k] > own:
            along = min(along, known[k])
            break
    # The path's time goes at most as fast as the stage's.
    return min(first, along - own)


def _resolve(c: TickMemory) -> bool:
    """Keeps the limits, and takes from set points what contacts do not return; whether it could."""
    out, limited = c.new_outputs, c.limited
    was_limited, was_clear = limited[0], c.clear
    _copy(c.cut, c.cut_before, c.n_requests)
    if not _limits_kept(c):
        return False
    if (out[c.i_unsettled] != 0.0 or c.paring != 0) and not _settled(c):
        # Python makes this tick, from what there was before.
        _copy(c.cut_before, c.cut, c.n_requests)
        limited[0] = was_limited
        c.clear = was_clear
        return False
    return True


def _limits_kept(c: TickMemory) -> bool:
    """Keeps the limits: by clamping, which the tick has done, or by the program."""
    out, limited = c.new_outputs, c.limited
    if out[c.i_violation] <= EXACT:
        if out[c.i_clamped] != 0.0:
            _report(c, c.clamped_cut, out[c.i_clamped])
        elif c.clear == 0:
            _zero(c.cut, c.n_requests)
            limited[0] = 0.0
            c.clear = 1
        return True
    if c.solves == 0 or not math.isfinite(out[c.i_violation]):
        return False
    _evaluate(c.assemble)
    if solve(c.limits) != SOLVED:
        return False
    _copy(c.torque, c.solver_last, c.n)
    _evaluate(c.accept)
    residual, binding, found, clamped = c.residual, c.binding, c.found_cut, c.clamped_cut
    if not residual[0] <= WORST_RESIDUAL:
        return False
    c.solved += 1
    c.worst = max(c.worst, residual[0])
    _copy(c.accepted, c.new_torque, c.n)
    out[c.i_residual] = residual[0]
    for i in range(c.n_requests):
        found[i] += clamped[i]
    _report(c, found, float(int(binding[0]) | int(out[c.i_clamped])))
    return True


def _report(c: TickMemory, cut: Vector, binding: float) -> None:
    """Has the next tick know what limits have taken, and the log which."""
    out, limited = c.new_outputs, c.limited
    _copy(cut, c.cut, c.n_requests)
    limited[0] = 1.0
    c.clear = 0
    out[c.i_limited] = 1.0
    out[c.i_limits] = binding


def _settled(c: TickMemory) -> bool:
    """Has the next tick take from the set points what contacts cannot return; whether it could."""
    out = c.new_outputs
    if c.asks == 0:
        return True
    if out[c.i_unsettled] == 0.0:
        _zero(c.unreachable, c.n_requests)
        c.paring = 0
        return True
    if c.solves == 0:
        return False
    _evaluate(c.look)
    if solve(c.nearest) != SOLVED:
        return False
    _evaluate(c.left)
    _copy(c.left_over, c.unreachable, c.n_requests)
    c.paring = 1
    return True


def _commit(c: TickMemory) -> None:
    """Makes the tick one that happened."""
    bus = c.bus
    _copy(c.new_torque, c.torque, c.n)
    _copy(c.new_outputs, c.outputs, c.n_outputs)
    _copy(c.new_memory, c.memory, c.n_memory)
    bus[c.i_clock] = float(c.ticks) * c.period
    bus[c.i_t] = float(c.stage_ticks) * c.period
    bus[c.i_stage] = float(c.stage)
    if c.tares:
        total, left, count = c.taring_total, c.taring_left, c.taring_count
        for i in range(6):
            total[i] += left[i]
        count[0] += 1.0
    if c.estimates:
        recent, at, seen = c.recent, c.estimate_ticks % c.estimate_room, c.wrench
        for i in range(3):
            recent[3 * at + i] = seen[i]
        c.estimate_ticks += 1


def _step(c: TickMemory) -> None:
    """Holds the torque for one period, and reads the forces of its last step."""
    _gather(c.qpos, c.mechanism_at, c.mechanism_positions, c.n_mechanisms)
    _gather(c.qvel, c.mechanism_dof, c.mechanism_rates, c.n_mechanisms)
    _gather(c.qpos, c.loose_at, c.loose, c.n_loose)
    _copy(c.torque, c.motors, c.n)
    for _ in range(c.substeps):
        if c.simple:
            call(c.mj_step, c.model, c.data)
        else:
            _zero(c.applied, c.n_applied)
            _drive(c)
            call(c.mj_step1, c.model, c.data)
            _apply(c)
            _constrain(c)
            call(c.mj_step2, c.model, c.data)
    if c.grip_rows:
        words = c.data_words
        call(c.memcpy, c.grip_rows, words[c.at_efc_force] + c.grip_first, c.grip_bytes)
    _evaluate(c.forces)


def _drive(c: TickMemory) -> None:
    """Puts what moves by itself where it is at the simulator's clock."""
    if c.moving.code == 0:
        return
    clock, time = c.moving_clock, c.time
    clock[0] = time[0]
    _evaluate(c.moving)
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
        _evaluate(c.equations)
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
    if c.detents.code != 0:
        _evaluate(c.detents)
        applied, where, forces = c.applied, c.detent_dof, c.detent_forces
        for i in range(c.n_detents):
            applied[where[i]] += forces[i]


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
    _copy(joints, others, k)
    _copy(c.constraint_forces, c.rigid_exerted, k)
    _evaluate(c.rigid)
    for i in range(1, MOST_ROUNDS + 1):
        for j in range(k):
            joints[j] = others[j] + torques[j]
        _copy(c.rigid_multipliers, c.rigid_before, m)
        _copy(c.rigid_next_step, c.rigid_step, m)
        _copy(c.rigid_next_multipliers, c.rigid_multipliers, m)
        _copy(c.rigid_next_broyden, c.rigid_broyden, m * m)
        call(c.mj_fwdAcceleration, c.model, c.data)
        call(c.mj_fwdConstraint, c.model, c.data)
        if _same(c.constraint_forces, c.rigid_exerted, k):
            return
        _copy(c.constraint_forces, c.rigid_exerted, k)
        number[0] = float(i)
        _evaluate(c.rigid)
        if settled[0] != 0.0:
            return


def _record(c: TickMemory) -> None:
    """The tick into the next row of the block, in a file with its checksum."""
    if not c.keeps:
        return
    _copy(c.bus, c.rows[c.row * c.n_bus :], c.n_bus)
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
    if c.ticks % c.look_every != 0:
        return False
    warnings, time = c.warnings, c.time
    for i in range(c.n_warnings):
        if warnings[i] >= _ONE_WARNING:
            return True
    if not time[0] > c.last_time:
        return True
    c.last_time = time[0]
    velocity, momentum = c.velocity, c.momentum
    _copy(c.joint_rates, c.arm_velocity, c.n_joints)
    call(c.mj_mulM, c.model, c.data, c.momentum, c.velocity)
    twice = 0.0
    for i in range(c.n_applied):
        twice += velocity[i] * momentum[i]
    return not 0.5 * twice < c.energy_bound or not math.isfinite(twice)


def _evaluate(f: Evaluation) -> None:
    call(f.code, f.arguments, f.results, f.instructions, f.work, 0)


def _copy(source: Vector, target: Vector, n: int) -> None:
    for i in range(n):
        target[i] = source[i]


def _furthest(a: Vector, b: Vector, n: int) -> float:
    most = 0.0
    for i in range(n):
        most = max(most, abs(a[i] - b[i]))
    return most


def _same(a: Vector, b: Vector, n: int) -> bool:
    same = True
    for i in range(n):
        if a[i] != b[i]:
            same = False
    return same


def _gather(source: Vector, places: Words, target: Vector, n: int) -> None:
    for i in range(n):
        target[i] = source[places[i]]


def _zero(target: Vector, n: int) -> None:
    for i in range(n):
        target[i] = 0.0
