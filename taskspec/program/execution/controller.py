"""The controller's part of a tick, in the Python that becomes machine code and C.

A tick that cannot be computed here has no effect: whoever calls decides what becomes of it.
`controller_memory` lists what `c` has.
"""

from __future__ import annotations

import math

from taskspec.native.kernel import Vector
from taskspec.native.quadratic import SOLVED, solve
from taskspec.program.evaluation import evaluate
from taskspec.program.execution.controller_memory import ControllerMemory
from taskspec.program.execution.pivots import select
from taskspec.program.execution.stage_solver import EXACT, WORST_RESIDUAL
from taskspec.program.ports import HEALTHY


def tick(c: ControllerMemory) -> bool:
    """Evaluates the law into memory of its own; whether the tick may be done here."""
    now, out = c.now, c.new_outputs
    evaluate(c.terms)
    if c.zeroed.code != 0:
        copy(c.tip_rotation, c.turned, 9)
        evaluate(c.zeroed)
        copy(c.zeroed_wrench, c.wrench, 6)
    now[0] = float(c.stage_ticks) * c.period
    now[1] = float(c.ticks) * c.period
    if c.has_last_torque:
        copy(c.torque, c.last_torque, c.n)
    evaluate(c.tick)
    if not out[c.i_health] < HEALTHY:
        return False
    limits = c.limit_events
    # A first tick heeds limits alone, and what that leads to is Python's to decide.
    if c.stage_ticks == 0 and out[0] != 0.0 and limits[int(out[0]) - 1] != 0:
        return False
    return c.has_program == 0 or _resolve(c)


def chooses_again(c: ControllerMemory) -> bool:
    """Whether the coordinates that constraints decide are to be chosen again."""
    return c.outputs[c.i_conditioning] < c.least_conditioning


def end(c: ControllerMemory) -> None:
    """Leaves the tick that ends a stage to the machine."""
    copy(c.torque, c.torque_before, c.n)
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


def opened(c: ControllerMemory) -> bool:
    """Enters a stage: memory and parameters, coordinates, forces that come back, what is carried.

    Whether it could. Nothing is written that Python would not write anew.
    """
    now = c.now
    now[0] = 0.0
    now[1] = float(c.ticks) * c.period
    copy(c.torque_before, c.torque, c.n)
    evaluate(c.entry)
    c.next_knot = _first_knot(c)
    if c.choice.code != 0:
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
    if c.asks or c.carries:
        evaluate(c.tick)
    if c.asks:
        if not _settled(c):
            return False
        if c.paring:
            evaluate(c.tick)
    if c.carries:
        evaluate(c.carrying)
    return True


def _first_knot(c: ControllerMemory) -> float:
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


def _resolve(c: ControllerMemory) -> bool:
    """Keeps the limits, and takes from set points what contacts do not return; whether it could."""
    out, limited = c.new_outputs, c.limited
    was_limited, was_clear = limited[0], c.clear
    copy(c.cut, c.cut_before, c.n_requests)
    if not _limits_kept(c):
        return False
    if (out[c.i_unsettled] != 0.0 or c.paring != 0) and not _settled(c):
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
    if solve(c.limits) != SOLVED:
        return False
    copy(c.torque, c.solver_last, c.n)
    evaluate(c.accept)
    residual, binding, found, clamped = c.residual, c.binding, c.found_cut, c.clamped_cut
    if not residual[0] <= WORST_RESIDUAL:
        return False
    c.solved += 1
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
        return False
    evaluate(c.left)
    copy(c.left_over, c.unreachable, c.n_requests)
    c.paring = 1
    return True


def commit(c: ControllerMemory) -> None:
    """Makes the tick one that happened."""
    copy(c.new_torque, c.torque, c.n)
    copy(c.new_outputs, c.outputs, c.n_outputs)
    copy(c.new_memory, c.memory, c.n_memory)
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
