"""The memory of a machine's stages, as the kernel of the controller has it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from taskspec.control.stopping import decay_time
from taskspec.native.kernel import Vector, Words
from taskspec.native.quadratic import Workspace
from taskspec.program.evaluation import Evaluation, Evaluations
from taskspec.program.events import FAIL_IF, REACTION
from taskspec.program.execution.compiled_terms import CompiledTerms
from taskspec.program.execution.exits import ExitTable
from taskspec.program.execution.gripping import GripTable
from taskspec.program.execution.live_params import LiveTable
from taskspec.program.execution.payload_estimate import KEPT, PayloadEstimate
from taskspec.program.limits.holding import Holding
from taskspec.program.limits.relaxing import Relaxing
from taskspec.program.ports import HANDED, fields, slices
from taskspec.program.stages.conditions import resting
from taskspec.program.stages.stage import CompiledStage
from taskspec.spec.limits import REACTING

if TYPE_CHECKING:
    from taskspec.program.execution.machine import Machine
    from taskspec.program.execution.stage_runner import StageRunner


class ControllerMemory(Evaluations):
    """The memory of one stage of a run. A number that tells whether is 1 or 0.

    What all stages share, they have the addresses of.
    """

    PROGRAMS: ClassVar = frozenset({"assemble", "accept", "look", "left"})
    ONCE: ClassVar = frozenset({"entry", "carrying", "leaving", "measuring"})
    #: What the beginning of a stage needs.
    OPENING: ClassVar = frozenset({"choice", "entry", "carrying"})

    # functions on memory; those that a run has none of have no code
    correcting: Evaluation
    predicting: Evaluation
    terms: Evaluation
    zeroed: Evaluation
    payload: Evaluation
    tick: Evaluation
    assemble: Evaluation
    accept: Evaluation
    look: Evaluation
    left: Evaluation
    choice: Evaluation
    entry: Evaluation
    leaving: Evaluation
    carrying: Evaluation
    measuring: Evaluation

    # which stage follows
    exits: ExitTable

    # params that may be set while it runs
    live: LiveTable

    # the gripper
    grip: GripTable

    # how far it is
    ticks: int  # of the run
    stage_ticks: int  # of the stage
    stage: int  # its number
    carries: int  # whether its torque goes on from that of the stage before

    alone: int  # whether there is nobody to whom a tick could be left
    velocities: int  # whether joints are commanded velocities
    positions: int  # whether they are commanded positions
    n: int  # joints
    n_reactions: int  # constraint equations
    n_outputs: int  # outputs of the tick
    n_memory: int  # numbers that the stage remembers
    n_requests: int  # force set points of the stage
    n_constraints: int  # that decide coordinates
    n_coordinates: int  # to choose from
    n_cubics: int  # of moves and of the path that follow from the entry
    n_known: int  # the path's timing and its tables, where they do not
    n_known_knots: int  # of these
    slowed: int  # whether signals slow the path
    has_last_torque: int  # whether the tick reads the torque before
    has_earlier_torque: int  # whether it reads the one before that
    has_program: int  # whether limits may need a program
    solves: int  # whether the programs are solved here
    asks: int  # whether forces are asked of contacts
    solved: int  # programs solved
    relaxed: int  # of them, with limits that collided
    relaxing: Relaxing  # what that works in
    holding: Holding  # what a tick without an answer works in
    limits: Workspace  # the program of the limits
    nearest: Workspace  # that of the forces that contacts return
    clear: int  # whether no limit was in the way
    paring: int  # whether requests are being cut
    tares: int  # whether the stage measures the sensor's zero
    adapts: int  # whether it changes the estimate of a payload
    n_zero: int  # numbers that a sensor's zero is made of
    n_inertia: int  # of H, packed
    n_payload: int  # that the estimate remembers
    n_theta: int  # of them, the estimate itself
    estimates: int  # whether the stage measures a frame
    estimate_ticks: int  # ticks of that
    estimate_room: int  # ticks that it looks back
    n_handed: int  # numbers that go from stage to stage
    n_rests: int  # limits that may lead to a stage

    # where the outputs have what the kernel reads
    i_conditioning: int
    i_health: int
    i_violation: int
    i_clamped: int
    i_unsettled: int
    i_limits: int
    i_limited: int
    i_residual: int

    # where the numbers that go from stage to stage have what the kernel writes
    i_handed_p: int
    i_handed_R: int
    i_handed_same: int

    period: float  # of control [s]
    next_knot: float  # stage time at which a path or move changes [s]
    least_conditioning: float  # below which coordinates are chosen again
    worst: float  # residual of an answer that was used
    decay: float  # time constant in which an arm is brought to rest [s]

    # the inputs
    q: Vector
    v: Vector
    wrench: Vector
    reactions: Vector
    now: Vector

    # of the estimate of velocities
    predicted: Vector

    # of the model's terms
    inertia: Vector
    bias: Vector
    gravity: Vector
    rest: Vector  # what is commanded of an arm at rest
    tip_position: Vector
    tip_rotation: Vector

    # the tick: what holds, and what a tick makes of it
    torque: Vector
    torque_before: Vector
    torque_earlier: Vector  # of the tick before the last one
    outputs: Vector
    memory: Vector
    new_torque: Vector
    new_outputs: Vector
    new_memory: Vector
    last_torque: Vector
    earlier_torque: Vector
    clamped_cut: Vector
    cut: Vector
    limited: Vector
    cut_before: Vector
    found_cut: Vector
    accepted: Vector
    residual: Vector
    binding: Vector
    unreachable: Vector
    left_over: Vector
    solver_last: Vector

    # a tick without an answer, and an arm that is brought to rest
    fade_from: Vector
    most: Vector
    stop_step: Vector
    rate: Vector  # of commanded positions, as the arm is brought to rest

    # a stage that is opened
    last: Vector
    handed: Vector
    rests: Vector
    entry_poses: Vector
    cubics: Vector
    known_knots: Vector
    known_cubics: Vector
    parameters: Vector
    path_time: Vector
    wanted: Vector
    kept: Vector
    held: Vector
    chosen_at: Vector
    gradient: Vector
    selection: Vector
    pivot_rows: Vector

    # a payload that laws adapt to
    loaded_inertia: Vector
    loaded_bias: Vector
    loaded_gravity: Vector
    payload_memory: Vector
    payload_kept: Vector

    # the sensor's zero, and forces that frames are estimated by
    turned: Vector
    zeroed_wrench: Vector
    taring_total: Vector
    taring_left: Vector
    taring_count: Vector
    recent: Vector
    recent_total: Vector
    taring_zero: Vector
    estimate_count: Vector
    estimate_tip: Vector
    estimated: Vector
    estimated_poses: Vector

    fading: Words  # ticks without an answer
    unheard: Words  # 1 for each joint that nobody measures
    alike: Words  # 1 for each stage that keeps track of the same mechanism
    resting: Words  # of each limit that may lead to a stage: where the memory has its rest, or -1
    reactions_of: Words  # of each event: the limit that leads to a stage by it, or -1
    carries_of: Words  # of each event: whether the torque goes on in the stage that follows
    needs: Words  # of all stages: where `needed` has their estimated frames
    needed: Words  # numbers of frames
    limit_events: Words  # 1 for each event of the stage that is a limit
    cubic_places: Words  # of each: its first knot, knots, whether it is the path's, parameter
    known_places: Words  # of each: its first knot, knots, parameter
    pivot_columns: Words
    pivots_left: Words


def controller_memories(machine: Machine) -> tuple[ControllerMemory, ...]:
    """The memory of each stage of a machine, which the kernel then shares with it."""
    if machine.memories is None:
        shared = _shared(machine)
        machine.memories = tuple(_of_stage(shared, machine, each) for each in machine.runners)
    return machine.memories


def _shared(machine: Machine) -> ControllerMemory:
    """What all stages have."""
    record = ControllerMemory()
    places = slices(fields(len(machine.reactions)))
    names = (
        *("conditioning", "health", "violation", "clamped", "unsettled"),
        *("limits", "limited", "residual"),
    )
    assert isinstance(machine.terms, CompiledTerms)
    record.terms = Evaluation(machine.terms.bound)
    inertia, bias, gravity, _, position, rotation, _ = machine.terms.arrays
    handed, stages = slices(HANDED), [runner.stage for runner in machine.runners]
    record.exits, record.live, record.grip = machine.counts, machine.live.table, machine.grip
    record.take(
        inertia=inertia,
        bias=bias,
        gravity=gravity,
        rest=machine.rest,
        tip_position=position,
        tip_rotation=rotation,
        handed=machine.handed,
        n_handed=len(machine.handed),
        **{f"i_handed_{name}": handed[name].start for name in ("p", "R", "same")},
        rests=np.zeros(len(REACTING)),
        n_rests=len(REACTING),
        fade_from=np.zeros(len(machine.q)),
        fading=np.zeros(1, dtype=np.int64),
        unheard=np.zeros(len(machine.q), dtype=np.int64),
        decay=decay_time(machine.period),
        velocities=machine.drives.commands == "velocity",
        positions=machine.drives.positions,
        rate=np.zeros(len(machine.q)),
        **_needs(machine, stages),
    )
    record.take(
        n=len(machine.q),
        n_reactions=len(machine.reactions),
        n_outputs=len(machine.outputs),
        period=machine.period,
        **{f"i_{name}": places[name].start for name in names},
    )
    record.take(
        q=machine.q,
        v=machine.v,
        wrench=machine.wrench,
        reactions=machine.reactions,
        now=machine.now,
        torque=machine.torque,
        outputs=machine.outputs,
        torque_before=machine.applied,
        torque_earlier=machine.earlier,
        last=machine.last,
    )
    estimator = machine.estimator
    if estimator is not None:
        record.correcting = Evaluation(estimator.correct)
        record.predicting = Evaluation(estimator.predict)
        record.take(predicted=estimator.predicted)
    zero, estimates = machine.sensor, machine.estimation.estimates
    if zero is not None:
        record.zeroed = Evaluation(zero.function)
        record.take(
            n_zero=len(zero.zero),
            turned=zero.turned,
            zeroed_wrench=zero.wrench,
            taring_total=zero.total,
            taring_left=zero.left,
            taring_count=zero.count,
            taring_zero=zero.zero,
        )
    if machine.payload is not None:
        _take_payload(record, machine.payload)
    if estimates is not None:
        record.take(
            estimate_room=len(estimates.recent),
            recent=estimates.recent.reshape(-1),
            recent_total=estimates.total,
            estimate_count=estimates.count,
            estimate_tip=estimates.tip,
            estimated=estimates.found,
            estimated_poses=estimates.poses,
        )
    return record


def _take_payload(record: ControllerMemory, payload: PayloadEstimate) -> None:
    """The estimate of a payload, which all stages share."""
    record.payload = Evaluation(payload.function)
    inertia, bias, gravity = payload.loaded
    record.take(
        n_inertia=len(inertia),
        n_payload=len(payload.memory),
        n_theta=KEPT,
        loaded_inertia=inertia,
        loaded_bias=bias,
        loaded_gravity=gravity,
        payload_memory=payload.memory,
        payload_kept=payload.kept,
    )


def _of_stage(shared: ControllerMemory, machine: Machine, runner: StageRunner) -> ControllerMemory:
    """What a stage has of its own, beside what all share."""
    record, solver = ControllerMemory(shared), runner.solver
    new_torque, new_outputs = np.zeros_like(machine.torque), np.zeros_like(machine.outputs)
    own_torque, new_memory, own_outputs, *_ = runner.tick.results
    scratch = [(own_torque, new_torque), (own_outputs, new_outputs)]
    record.tick = Evaluation(runner.tick, scratch)
    record.take(
        n_memory=runner.stage.memory.size,
        least_conditioning=runner.least_conditioning,
        memory=runner.memory,
        new_memory=new_memory,
        new_torque=new_torque,
        new_outputs=new_outputs,
    )
    tracks = runner.tracks
    for name in ("entry", "leaving", "carrying"):
        setattr(record, name, Evaluation(getattr(runner, name)))
    record.take(
        n_cubics=len(tracks.places),
        n_known_knots=len(tracks.known),
        slowed=tracks.path_time is not None,
        cubics=tracks.numbers,
        cubic_places=tracks.cubic_places,
        known_knots=tracks.known,
        n_known=len(tracks.known_places) // 3,
        known_cubics=tracks.known_cubics,
        known_places=tracks.known_places,
        parameters=runner.parameters,
    )
    if tracks.path_time is not None:
        record.take(path_time=tracks.path_time)
    record.take(
        stage=machine.runners.index(runner),
        carries=False,
        entry_poses=runner.poses,
        **_events(machine, runner),
    )
    estimates = machine.estimation.estimates
    if estimates is not None and runner.stage.name in estimates.ends:
        record.measuring = Evaluation(estimates.ends[runner.stage.name])
        record.estimates = True
    record.tares = runner.stage.plan.spec.tare and machine.sensor is not None
    record.adapts = runner.stage.plan.adapts
    limits = np.array([each.is_limit for each in runner.stage.events], dtype=np.int64)
    record.take(limit_events=limits)
    if runner.last_command is not None:
        record.take(has_last_torque=True, last_torque=runner.last_command)
    if runner.earlier_command is not None:
        record.take(has_earlier_torque=True, earlier_torque=runner.earlier_command)
    chooser = runner.chooser
    if chooser is not None:
        record.choice = Evaluation(chooser.look)
        m, c = chooser.sizes
        record.take(
            n_constraints=m,
            n_coordinates=c,
            wanted=chooser.wanted,
            kept=chooser.kept,
            held=chooser.held,
            chosen_at=chooser.chosen_at,
            gradient=chooser.gradient,
            selection=chooser.selection,
            pivot_rows=chooser.rows,
            pivot_columns=chooser.chosen,
            pivots_left=chooser.left,
        )
    if solver is not None:
        _take_programs(record, runner, scratch)
    return record


def _needs(machine: Machine, stages: Sequence[CompiledStage]) -> dict[str, NDArray[np.int64]]:
    """The estimated frames that each stage is placed in."""
    estimates = machine.estimation.estimates
    names = () if estimates is None else estimates.names
    of_stages = [[names.index(name) for name in stage.entry.poses] for stage in stages]
    ends = np.cumsum([0, *map(len, of_stages)], dtype=np.int64)
    flat = np.array([number for numbers in of_stages for number in numbers], dtype=np.int64)
    return {"needs": ends, "needed": flat}


def _events(machine: Machine, runner: StageRunner) -> dict[str, NDArray[Any]]:
    """What the events of a stage are followed by, and what an arm is brought to rest with."""
    stage, kinds = runner.stage, [event.kind for event in runner.stage.events]
    reactions = [
        REACTING.index(event.name) if event.kind == REACTION else -1 for event in stage.events
    ]
    slots = stage.memory.slots
    resting_at = [
        slots[resting(limit)].start if resting(limit) in slots else -1 for limit in REACTING
    ]
    alike = [stage.tracked == other.stage.tracked for other in machine.runners]
    words = {
        "alike": alike,
        "resting": resting_at,
        "reactions_of": reactions,
        "carries_of": [kind not in (FAIL_IF, REACTION) for kind in kinds],
    }
    found: dict[str, NDArray[Any]] = {n: np.array(v, dtype=np.int64) for n, v in words.items()}
    robot = stage.plan.context.robot
    found["most"] = np.array(robot.torque_limit, dtype=np.float64)
    found["stop_step"] = machine.period * stage.plan.torque_rates
    return found


def _take_programs(
    record: ControllerMemory,
    runner: StageRunner,
    scratch: Sequence[tuple[np.ndarray, np.ndarray]],
) -> None:
    """The programs of a stage that has some; `scratch` as in `Evaluation`."""
    solver = runner.solver
    assert solver is not None
    record.take(
        has_program=True,
        n_requests=len(solver.cut),
        clamped_cut=solver.clamped_cut,
        cut=solver.cut,
        cut_before=np.zeros_like(solver.cut),
        limited=solver.limited,
        unreachable=solver.unreachable,
        asks=solver.nearest is not None,
    )
    if solver.own is None:
        return
    record.assemble = Evaluation(solver.assemble)
    record.accept = Evaluation(solver.accept, scratch)
    record.take(
        relaxing=solver.relaxing,
        holding=solver.holding,
        limits=solver.own.workspace,
        solver_last=solver.applied,
        accepted=solver.accepted,
        residual=solver.residual,
        binding=solver.binding,
        found_cut=solver.found_cut,
    )
    if solver.nearest is not None and solver.nearest.own is not None:
        record.look = Evaluation(solver.nearest.look)
        record.left = Evaluation(solver.nearest.left)
        record.take(nearest=solver.nearest.own.workspace, left_over=solver.nearest.left_over)
