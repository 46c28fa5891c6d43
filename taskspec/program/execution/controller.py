"""The controller's part of a tick, in the Python that becomes machine code and C.

A tick that cannot be computed here has no effect: whoever calls decides what becomes of it.
`controller_memory` lists what `c` has.
"""

from __future__ import annotations

import math

from taskspec.control.stopping import slow, stopping, within
from taskspec.native.kernel import Vector
from taskspec.native.quadratic import INFEASIBLE, SOLVED, solve
from taskspec.program.evaluation import evaluate
from taskspec.program.execution.controller_memory import ControllerMemory
from taskspec.program.execution.exits import RESTS, enter, follows
from taskspec.program.execution.gripping import begin_stage, hand_load
from taskspec.program.execution.live_params import move
from taskspec.program.execution.pivots import select
from taskspec.program.execution.stage_solver import EXACT, HELD_TICKS, WORST_RESIDUAL
from taskspec.program.limits.holding import hold
from taskspec.program.limits.relaxing import widen
from taskspec.program.ports import HEALTHY
from taskspec.program.world.estimated_frames import MEASURED

#: Why a run cannot go on: no program has had an answer, or numbers are not those of a sane arm.
UNANSWERED, DIVERGED = -1, -2
#: The frame of a stage that follows has not been estimated; beside `exits.OVER` and `TRIED`.
UNKNOWN = -3


def tick(c: ControllerMemory) -> bool:
    """Evaluates the law into memory of its own; whether the tick may be done here."""
    hand_load(c.grip)
    _estimate_velocity(c)
    _measure(c)
    _renew(c)
    return _law(c)


def first_tick(c: ControllerMemory) -> bool:
    """The same of a stage that has just been opened."""
    _measure(c)
    return _law(c)


def _estimate_velocity(c: ControllerMemory) -> None:
    """The velocities of the joints, where they are not measured."""
    if c.correcting.code != 0:
        evaluate(c.correcting)


def _predict(c: ControllerMemory) -> None:
    """What the estimate of velocities expects of the next tick, after the command of this one."""
    if c.predicting.code != 0:
        evaluate(c.predicting)


def _measure(c: ControllerMemory) -> None:
    """The model's terms, the wrench of the contact, and the time."""
    now = c.now
    evaluate(c.terms)
    if c.zeroed.code != 0:
        copy(c.tip_rotation, c.turned, 9)
        evaluate(c.zeroed)
        copy(c.zeroed_wrench, c.wrench, 6)
    if c.payload.code != 0:
        evaluate(c.payload)
        copy(c.loaded_inertia, c.inertia, c.n_inertia)
        copy(c.loaded_bias, c.bias, c.n)
        copy(c.loaded_gravity, c.gravity, c.n)
    now[0] = float(c.stage_ticks) * c.period
    now[1] = float(c.ticks) * c.period
    move(c.live, now[1])


def _law(c: ControllerMemory) -> bool:
    """The torque of the law, within the limits; whether there is one that may be used here."""
    out = c.new_outputs
    _remember(c)
    evaluate(c.tick)
    if not out[c.i_health] < HEALTHY:
        return False
    limits = c.limit_events
    # A first tick heeds limits alone, and what that leads to is Python's to decide.
    if c.stage_ticks == 0 and out[0] != 0.0 and limits[int(out[0]) - 1] != 0:
        return False
    return c.has_program == 0 or _resolve(c)


def _remember(c: ControllerMemory) -> None:
    """Has the tick know the commands of the two before, where it goes by them."""
    if c.has_last_torque:
        copy(c.torque, c.last_torque, c.n)
    if c.has_earlier_torque:
        copy(c.torque_earlier, c.earlier_torque, c.n)


def _renew(c: ControllerMemory) -> None:
    """Before a tick: the next piece of a move or path, the coordinates that constraints decide."""
    t = float(c.stage_ticks) * c.period
    if t >= c.next_knot:
        refresh(c, t)
    if c.outputs[c.i_conditioning] < c.least_conditioning:
        _choose(c)
        # Of an acceleration that keeps the constraints, elimination changes nothing.
        kept, wanted, held, chosen_at = c.kept, c.wanted, c.held, c.chosen_at
        for i in range(c.n):
            held[i] = kept[i] - wanted[i]
        chosen_at[0] = t
        # Whoever makes this tick once more does not choose once more.
        outputs = c.outputs
        outputs[c.i_conditioning] = 1.0


def _choose(c: ControllerMemory) -> None:
    """Chooses the coordinates that constraints decide."""
    evaluate(c.choice)
    select(
        c.gradient,
        c.selection,
        c.pivot_rows,
        c.pivot_columns,
        c.pivots_left,
        c.n_constraints,
        c.n_coordinates,
    )


def end(c: ControllerMemory) -> None:
    """Leaves the tick that ends a stage to the machine."""
    copy(c.torque, c.torque_before, c.n)
    _hand_on(c)


def _hand_on(c: ControllerMemory) -> None:
    """Hands on what the next stage takes up."""
    copy(c.new_torque, c.torque, c.n)
    copy(c.new_torque, c.last, c.n)
    copy(c.new_outputs, c.outputs, c.n_outputs)
    if c.leaving.code != 0:
        evaluate(c.leaving)
    if c.estimates:
        _add_up(c)


def _add_up(c: ControllerMemory) -> None:
    """The sum of the forces that were collected last, the oldest first."""
    seen, room, recent, total = c.estimate_ticks, c.estimate_room, c.recent, c.recent_total
    first = seen % room if seen > room else 0
    for i in range(3):
        total[i] = 0.0 if seen == 0 else recent[3 * first + i]
    for k in range(1, min(seen, room)):
        row = recent[3 * ((first + k) % room) :]
        for i in range(3):
            total[i] += row[i]


def start(c: ControllerMemory) -> None:
    """Begins the task at its first stage, whose memory this is, from rest at what is measured."""
    if c.correcting.code != 0:
        copy(c.q, c.predicted, c.n)
        zero(c.predicted[c.n :], c.n)
        zero(c.v, c.n)
    _measure(c)
    if c.positions:
        copy(c.q, c.rest, c.n)
    copy(c.rest, c.torque, c.n)
    copy(c.rest, c.torque_before, c.n)
    copy(c.rest, c.torque_earlier, c.n)
    zero(c.handed, c.n_handed)
    copy(c.tip_position, c.handed[c.i_handed_p :], 3)
    copy(c.tip_rotation, c.handed[c.i_handed_R :], 9)
    begin(c, c, 0)
    c.carries = 0
    opened(c)
    evaluate(c.tick)
    copy(c.new_outputs, c.outputs, c.n_outputs)


def control(c: ControllerMemory) -> int:
    """One period of the current stage, on what is measured, where nobody else decides anything.

    The event that ends the stage, for `leave`; 0 for none; UNANSWERED where the program has had no
    answer for too long, DIVERGED where numbers are not those of a sane arm.
    """
    hand_load(c.grip)
    _estimate_velocity(c)
    _measure(c)
    _renew(c)
    copy(c.torque, c.torque_before, c.n)
    return _decided(c)


def open_stage(c: ControllerMemory) -> int:
    """The same of a stage that `begin` has handed the run to, at the same instant."""
    opened(c)
    memory = c.memory
    for k in range(c.n_rests):
        if c.rests[k] > 0.0 and c.resting[k] >= 0:
            memory[c.resting[k]] = c.rests[k]
    return _decided(c)


def _decided(c: ControllerMemory) -> int:
    """Makes the tick; see `control`."""
    out, fading = c.new_outputs, c.fading
    _remember(c)
    evaluate(c.tick)
    answered = c.has_program == 0 or _resolve(c)
    event = int(out[0])
    limit = event != 0 and c.limit_events[event - 1] != 0
    if answered:
        fading[0] = 0
    else:
        if c.payload.code != 0:
            zero(c.payload_memory[c.n_theta :], c.n_payload - c.n_theta)
        over = _fade(c)
        if over or not limit:
            copy(c.torque, c.torque_earlier, c.n)
            copy(c.new_torque, c.torque, c.n)
            copy(out, c.outputs, c.n_outputs)
            c.stage_ticks += 1
            _predict(c)
            return UNANSWERED if over else 0
    if limit or (event != 0 and c.stage_ticks > 0):
        _hand_on(c)
        return event
    commit(c)
    c.stage_ticks += 1
    return 0 if out[c.i_health] < HEALTHY else DIVERGED


def _fade(c: ControllerMemory) -> bool:
    """Has the torque fade to what carries the arm; whether its time is over."""
    fading, out, wanted = c.fading, c.new_outputs, c.holding.wanted
    before, earlier, fades = c.torque_before, c.torque_earlier, c.fade_from
    if fading[0] == 0:
        for i in range(c.n):
            fades[i] = before[i] - earlier[i] if c.positions else before[i]
    fading[0] += 1
    share = max(0.0, 1.0 - float(fading[0]) / float(HELD_TICKS))
    for i in range(c.n):
        if c.positions:
            wanted[i] = before[i] + share * fades[i]
        else:
            wanted[i] = c.rest[i] + share * (fades[i] - c.rest[i])
    copy(c.new_torque, c.holding.law, c.n)
    copy(c.torque_before, c.holding.before, c.n)
    c.holding.finite = int(math.isfinite(out[c.i_violation]))
    hold(c.holding, c.limits)
    copy(c.holding.near, c.new_torque, c.n)
    # What the tick could not compute is no reason to stop yet.
    out[c.i_health] = 0.0
    return fading[0] > HELD_TICKS


def leave(c: ControllerMemory) -> int:
    """Ends the stage by the event of its tick, on which it has handed on what it has to.

    The number of the stage that follows, for `begin`; OVER where the task is at its end, TRIED
    where that stage has had its attempts, UNKNOWN where its frame has not been estimated.
    """
    event, handed, rests = int(c.outputs[0]), c.handed, c.rests
    to = follows(c.exits, c.stage, event)
    if to < 0:
        _predict(c)
        return to
    handed[c.i_handed_same] = float(c.alike[to])
    _estimate(c)
    for k in range(c.needs[to], c.needs[to + 1]):
        if c.estimated[c.needed[k]] != MEASURED:
            _predict(c)
            return UNKNOWN
    t = float(c.stage_ticks) * c.period
    for k in range(c.n_rests):
        rests[k] = 0.0
        if c.resting[k] >= 0:
            rests[k] = max(0.0, c.memory[c.resting[k]] - t)
    if c.reactions_of[event - 1] >= 0:
        rests[c.reactions_of[event - 1]] = RESTS
    return to


def _estimate(c: ControllerMemory) -> None:
    """Takes what the stage has estimated: frames, and the sensor's zero."""
    count, left = c.estimate_count, c.taring_zero
    if c.measuring.code != 0:
        count[0] = float(min(c.estimate_ticks, c.estimate_room))
        copy(c.tip_position, c.estimate_tip, 3)
        evaluate(c.measuring)
    if c.tares:
        if c.taring_count[0] != 0.0:
            for i in range(c.n_zero):
                left[i] = c.taring_total[i] / c.taring_count[0]
        copy(c.tip_rotation, c.turned, 9)
        evaluate(c.zeroed)
        copy(c.zeroed_wrench, c.wrench, 6)


def begin(c: ControllerMemory, after: ControllerMemory, again: int) -> None:
    """Hands a run on to the stage that follows; `again` where that is the same, repeated."""
    now, count = c.now, c.taring_count
    after.carries = c.carries_of[max(int(c.outputs[0]), 1) - 1]
    enter(c.exits, after.stage, again != 0)
    now[2 + after.stage] += 1.0
    begin_stage(c.grip, after.stage)
    after.ticks, after.stage_ticks, after.estimate_ticks = c.ticks, 0, 0
    if c.zeroed.code != 0:
        zero(c.taring_total, c.n_zero)
        count[0] = 0.0


def stop(c: ControllerMemory) -> None:
    """The command that brings the arm to rest, on what is measured."""
    _estimate_velocity(c)
    copy(c.torque, c.torque_before, c.n)
    if c.positions:
        position, before, rate = c.torque, c.torque_before, c.rate
        slow(rate, c.stop_step, c.n)
        for i in range(c.n):
            position[i] = before[i] + c.period * rate[i]
        return
    if c.velocities:
        slow(c.torque, c.stop_step, c.n)
        return
    _measure(c)
    stopping(c.inertia, c.gravity, c.v, c.most, c.unheard, c.decay, c.new_torque, c.n)
    within(c.new_torque, c.torque_before, c.stop_step, c.most, c.torque, c.n)
    _predict(c)


def opened(c: ControllerMemory) -> bool:
    """Enters a stage: memory and parameters, coordinates, forces that come back, what is carried.

    Whether it could. Nothing is written that Python would not write anew.
    """
    now = c.now
    now[0] = 0.0
    now[1] = float(c.ticks) * c.period
    copy(c.torque_before, c.torque, c.n)
    for k in range(c.needs[c.stage], c.needs[c.stage + 1]):
        pose = c.entry_poses[12 * (k - c.needs[c.stage]) :]
        copy(c.estimated_poses[12 * c.needed[k] :], pose, 12)
    evaluate(c.entry)
    _remember(c)
    c.next_knot = _next_knot(c, 0.0)
    if c.choice.code != 0:
        _choose(c)
    if c.asks or c.carries:
        evaluate(c.tick)
    if c.asks:
        if not _settled(c) and c.alone == 0:
            return False
        if c.paring:
            evaluate(c.tick)
    if c.carries:
        evaluate(c.carrying)
    return True


def _next_knot(c: ControllerMemory, t: float) -> float:
    """When a move or the stage's path comes to its next piece, after stage time t [s]."""
    known, places = c.known_knots, c.cubic_places
    own = c.path_time[0] if c.slowed else t
    first, along = math.inf, math.inf
    for i in range(c.n_cubics):
        knots, count = c.cubics[places[4 * i] :], places[4 * i + 1]
        if places[4 * i + 2] == 0:
            first = min(first, _after(knots, count, t))
        else:
            along = min(along, _after(knots, count, own))
    along = min(along, _after(known, c.n_known_knots, own))
    # The path's time goes at most as fast as the stage's.
    return min(first, t + (along - own)) if c.slowed else min(first, along)


def _after(knots: Vector, count: int, x: float) -> float:
    """The first of ascending knots that is beyond x; infinite for none."""
    i = _passed(knots, count, x)
    return knots[i] if i < count else math.inf


def _passed(knots: Vector, count: int, x: float) -> int:
    """How many of ascending knots are not beyond x."""
    low, high = 0, count
    while low < high:
        middle = (low + high) // 2
        if x < knots[middle]:
            high = middle
        else:
            low = middle + 1
    return low


def refresh(c: ControllerMemory, t: float) -> None:
    """Writes the pieces that hold at stage time t [s] into the parameters."""
    places, known = c.cubic_places, c.known_places
    own = c.path_time[0] if c.slowed else t
    for i in range(c.n_cubics):
        x = t if places[4 * i + 2] == 0 else own
        cubic, slot = c.cubics[places[4 * i] :], c.parameters[places[4 * i + 3] :]
        _write_piece(cubic, places[4 * i + 1], x, slot)
    if c.n_known:
        # The first is the path's timing; the others are tables over what that gives.
        timing = c.parameters[known[2] :]
        _write_piece(c.known_cubics[known[0] :], known[1], own, timing)
        s = own - timing[0]
        s = timing[1] + s * (timing[2] + s * (timing[3] + s * timing[4]))
        for i in range(1, c.n_known):
            cubic, slot = c.known_cubics[known[3 * i] :], c.parameters[known[3 * i + 2] :]
            _write_piece(cubic, known[3 * i + 1], s, slot)
    c.next_knot = _next_knot(c, t)


def _write_piece(cubic: Vector, count: int, x: float, slot: Vector) -> None:
    """The piece that holds x of a cubic with some knots, before its coefficients; ends extend."""
    i = min(max(_passed(cubic, count, x) - 1, 0), count - 2)
    slot[0] = cubic[i]
    for k in range(4):
        slot[1 + k] = cubic[count + 4 * i + k]


def _resolve(c: ControllerMemory) -> bool:
    """Keeps the limits, and takes from set points what contacts do not return; whether it could."""
    out, limited = c.new_outputs, c.limited
    was_limited, was_clear = limited[0], c.clear
    copy(c.cut, c.cut_before, c.n_requests)
    if not _limits_kept(c):
        return False
    settled = (out[c.i_unsettled] == 0.0 and c.paring == 0) or _settled(c)
    if not settled and c.alone == 0:
        # Python makes this tick, from what there was before.
        copy(c.cut_before, c.cut, c.n_requests)
        limited[0] = was_limited
        c.clear = was_clear
        return False
    return True


def _limits_kept(c: ControllerMemory) -> bool:
    """Keeps the limits: by clamping, which the tick has done, or by the program."""
    out, limited = c.new_outputs, c.limited
    if out[c.i_violation] <= EXACT:
        if out[c.i_clamped] != 0.0:
            _report(c, c.clamped_cut, out[c.i_clamped])
        elif c.clear == 0:
            zero(c.cut, c.n_requests)
            limited[0] = 0.0
            c.clear = 1
        return True
    if c.solves == 0 or not math.isfinite(out[c.i_violation]):
        return False
    evaluate(c.assemble)
    state, relaxed = solve(c.limits), 0
    if state == INFEASIBLE:
        relaxed = 1
        if widen(c.relaxing, c.limits) != 0:
            state = solve(c.limits)
    if state != SOLVED:
        return False
    copy(c.torque, c.solver_last, c.n)
    evaluate(c.accept)
    residual, binding, found, clamped = c.residual, c.binding, c.found_cut, c.clamped_cut
    if not residual[0] <= WORST_RESIDUAL:
        return False
    c.solved += 1
    c.relaxed += relaxed
    c.worst = max(c.worst, residual[0])
    copy(c.accepted, c.new_torque, c.n)
    out[c.i_residual] = residual[0]
    for i in range(c.n_requests):
        found[i] += clamped[i]
    _report(c, found, float(int(binding[0]) | int(out[c.i_clamped])))
    return True


def _report(c: ControllerMemory, cut: Vector, binding: float) -> None:
    """Has the next tick know what limits have taken, and the log which."""
    out, limited = c.new_outputs, c.limited
    copy(cut, c.cut, c.n_requests)
    limited[0] = 1.0
    c.clear = 0
    out[c.i_limited] = 1.0
    out[c.i_limits] = binding


def _settled(c: ControllerMemory) -> bool:
    """Has the next tick take from the set points what contacts cannot return; whether it could."""
    out = c.new_outputs
    if c.asks == 0:
        return True
    if out[c.i_unsettled] == 0.0:
        zero(c.unreachable, c.n_requests)
        c.paring = 0
        return True
    if c.solves == 0:
        return False
    evaluate(c.look)
    if solve(c.nearest) != SOLVED:
        # Where nobody else tries, requests stay cut as they are.
        c.paring = c.alone
        return False
    evaluate(c.left)
    copy(c.left_over, c.unreachable, c.n_requests)
    c.paring = 1
    return True


def commit(c: ControllerMemory) -> None:
    """Makes the tick one that happened."""
    copy(c.torque, c.torque_earlier, c.n)
    copy(c.new_torque, c.torque, c.n)
    copy(c.new_outputs, c.outputs, c.n_outputs)
    copy(c.new_memory, c.memory, c.n_memory)
    if c.tares:
        total, left, count = c.taring_total, c.taring_left, c.taring_count
        for i in range(c.n_zero):
            total[i] += left[i]
        count[0] += 1.0
    if c.payload.code != 0:
        if c.adapts:
            copy(c.payload_kept, c.payload_memory, c.n_payload)
        else:
            zero(c.payload_memory[c.n_theta :], c.n_payload - c.n_theta)
    if c.estimates:
        recent, at, seen = c.recent, c.estimate_ticks % c.estimate_room, c.wrench
        for i in range(3):
            recent[3 * at + i] = seen[i]
        c.estimate_ticks += 1
    _predict(c)


def copy(source: Vector, target: Vector, n: int) -> None:
    """Copies n numbers."""
    for i in range(n):
        target[i] = source[i]


def furthest(a: Vector, b: Vector, n: int) -> float:
    """The largest of n differences."""
    most = 0.0
    for i in range(n):
        most = max(most, abs(a[i] - b[i]))
    return most


def zero(target: Vector, n: int) -> None:
    """Makes n numbers zero."""
    for i in range(n):
        target[i] = 0.0
