"""What the loop in machine code reads and writes: one record of numbers and addresses."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.native.code import (
    CODE,
    Compiling,
    NotReadyError,
    expression_engine,
    interpreter_engine,
)
from taskspec.native.interpreter import INTERPRET, interpreted
from taskspec.native.kernel import Record, Vector, Words
from taskspec.native.quadratic import Workspace
from taskspec.program.bound import BoundFunction

Array = NDArray[np.float64]
#: What a function of CasADi's takes: arguments, results, and three that are not used.
_SIGNATURE = (ctypes.c_void_p,) * 4 + (ctypes.c_int,)

#: MuJoCo's functions by their addresses, and C's.
LIBRARY = (
    "mj_step",
    "mj_step1",
    "mj_step2",
    "mj_objectVelocity",
    "mj_applyFT",
    "mj_jacBody",
    "mj_jacDot",
    "mj_fullM",
    "mj_fwdActuation",
    "mj_fwdAcceleration",
    "mj_fwdConstraint",
    "mj_mulM",
    "memcpy",
)


class Evaluation(Record):
    """A function of CasADi on its memory, as machine code or by the interpreter.

    What is called takes the addresses of the addresses of arguments and results, and two that only
    the interpreter takes: of its instructions and of the work vector.
    """

    code: int  # the address of what is called, 0 for none
    arguments: int
    results: int
    instructions: int
    work: int

    def __init__(
        self, bound: BoundFunction | None = None, instead: Sequence[tuple[Array, Array]] = ()
    ) -> None:
        """Takes the function, None for none; `instead` has pairs of its arrays and ours."""
        super().__init__()
        self._bound = bound
        if bound is None:
            return
        ours = {id(theirs): array for theirs, array in instead}
        self._arrays = [
            [ours.get(id(array), array) for array in arrays]
            for arrays in (bound.arguments, bound.results)
        ]
        self._places = [
            np.array([array.ctypes.data for array in arrays], dtype=np.int64)
            for arrays in self._arrays
        ]
        self.arguments, self.results = (places.ctypes.data for places in self._places)

    def load(self, compiling: Compiling) -> bool:
        """Takes the function's own machine code; returns whether there is some."""
        bound = self._bound
        if bound is None:
            return True
        if bound.code is None:
            try:
                engine = expression_engine(bound.function, compiling)
            except NotReadyError:
                return False
            bound.code = engine
            # Ticks that are left to Python take the same code.
            bound.evaluate_by(engine.function(CODE, None, *_SIGNATURE, brief=True))
        # The code lives as long as the bound function.
        self.code = bound.code.address(CODE)
        return True

    @property
    def ready(self) -> bool:
        """Whether there is code for the function, if there is a function."""
        return bool(self.code) or self._bound is None

    def interpret(self) -> None:
        """Has the interpreter evaluate the function, where it has no code."""
        bound = self._bound
        if bound is None or self.code:
            return
        engine = interpreter_engine()
        prepared = interpreted(bound.function, engine)
        self._prepared, self._work = prepared, prepared.work.copy()
        self.instructions, self.work = prepared.runs.ctypes.data, self._work.ctypes.data
        self.code = engine.address(INTERPRET)
        called = engine.function(INTERPRET, None, *_SIGNATURE, brief=True)
        bound.evaluate_by(called, prepared.runs, self._work)


class TickMemory(Record):
    """The memory of one stage of a run. A number that tells whether is 1 or 0."""

    # functions on memory; those that a run has none of have no code
    terms: Evaluation
    zeroed: Evaluation
    tick: Evaluation
    sensor: Evaluation
    forces: Evaluation
    moving: Evaluation
    equations: Evaluation
    rigid: Evaluation
    assemble: Evaluation
    accept: Evaluation
    look: Evaluation
    left: Evaluation
    detents: Evaluation
    choice: Evaluation
    entry: Evaluation
    leaving: Evaluation
    carrying: Evaluation

    # functions of libraries, by their addresses
    mj_step: int
    mj_step1: int
    mj_step2: int
    mj_objectVelocity: int
    mj_applyFT: int
    mj_jacBody: int
    mj_jacDot: int
    mj_fullM: int
    mj_fwdActuation: int
    mj_fwdAcceleration: int
    mj_fwdConstraint: int
    mj_mulM: int
    memcpy: int

    # how far it is
    ticks: int  # of the run
    stage_ticks: int  # of the stage
    stage: int  # its number
    opens: int  # whether it has been entered and has had no tick
    carries: int  # whether its torque goes on from that of the stage before

    # the controller
    n: int  # joints
    n_reactions: int  # constraint equations
    n_outputs: int  # outputs of the tick
    n_memory: int  # numbers that the stage remembers
    n_requests: int  # force set points of the stage
    n_constraints: int  # that decide coordinates
    n_coordinates: int  # to choose from
    n_cubics: int  # of moves and of the path that follow from the entry
    n_known_knots: int  # of the path that do not
    slowed: int  # whether signals slow the path
    has_last_torque: int  # whether the tick reads the torque before
    has_program: int  # whether limits may need a program
    solves: int  # whether the programs are solved here
    asks: int  # whether forces are asked of contacts
    solved: int  # programs solved
    limits: Workspace  # the program of the limits
    nearest: Workspace  # that of the forces that contacts return
    clear: int  # whether no limit was in the way
    paring: int  # whether requests are being cut
    tares: int  # whether the stage measures the sensor's zero
    estimates: int  # whether the stage measures a frame
    estimate_ticks: int  # ticks of that
    estimate_room: int  # ticks that it looks back

    # where the outputs have what the loop reads
    i_conditioning: int
    i_health: int
    i_violation: int
    i_clamped: int
    i_unsettled: int
    i_limits: int
    i_limited: int
    i_residual: int

    # the bus
    n_bus: int  # numbers of a tick
    i_clock: int
    i_t: int
    i_stage: int

    # the sensor
    noisy: int  # whether it has noise
    noise_used: int  # rows of the noise
    noise_drawn: int  # rows there are
    sensor_ticks: int  # so far
    hold_ticks: int  # from sample to sample
    n_sensor: int  # numbers that it remembers

    # the plant
    model: int  # MuJoCo's
    data: int  # MuJoCo's
    substeps: int  # of a period
    simple: int  # whether MuJoCo's step is all there is to a step
    n_applied: int  # degrees of freedom
    n_joints: int  # of the arm, those that follow others among them
    n_mechanisms: int
    n_loose: int  # numbers of their poses
    n_moving: int  # driven coordinates
    n_detents: int
    n_warnings: int
    look_every: int  # ticks from look to look at the simulator
    cartesian: int  # whether an equation acts on the tip
    n_rigid: int  # equations that hold exactly
    rigid_cartesian: int  # whether one of them is on the tip
    body_kind: int  # MuJoCo's number for a body's frame
    tip_body: int
    applied_at: int  # address of the applied forces
    grip_rows: int  # address of the rows of a grip, 0 without one
    grip_first: int  # bytes before them among all rows
    grip_bytes: int  # of them
    at_efc_force: int  # which word of MuJoCo's data has the address of all rows

    # the record
    keeps: int  # whether ticks are kept
    checks: int  # whether with a checksum, for others to read
    row: int  # of the block
    room: int  # rows of it
    recorded: int  # ticks so far

    period: float  # of control [s]
    next_knot: float  # stage time at which a path or move changes [s]
    least_conditioning: float  # below which coordinates are chosen again
    moving_inertia: float  # of a driven coordinate
    last_time: float  # of the simulator at the last look [s]
    force_bound: float  # [N]
    worst: float  # residual of an answer that was used
    torque_step: float  # of the joint where it is most, as the stage was opened [N m]
    energy_bound: float  # [J]

    # the controller's inputs, and what they are measured from
    q: Vector
    v: Vector
    wrench: Vector
    reactions: Vector
    now: Vector
    true_q: Vector
    true_v: Vector
    true_wrench: Vector
    true_reactions: Vector

    # the tick: what holds, and what a tick makes of it
    torque: Vector
    torque_before: Vector
    outputs: Vector
    memory: Vector
    new_torque: Vector
    new_outputs: Vector
    new_memory: Vector
    last_torque: Vector
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

    # a stage that is opened
    last: Vector
    cubics: Vector
    known_knots: Vector
    path_time: Vector
    gradient: Vector
    selection: Vector
    pivot_rows: Vector

    # the sensor and its zero
    noise_rows: Vector
    noise: Vector
    samples: Vector
    sensor_memory: Vector
    sensor_kept: Vector
    tip_rotation: Vector
    turned: Vector
    zeroed_wrench: Vector
    taring_total: Vector
    taring_left: Vector
    taring_count: Vector
    recent: Vector
    recent_total: Vector

    # the plant
    qpos: Vector
    qvel: Vector
    motors: Vector
    applied: Vector
    time: Vector
    mechanism_positions: Vector
    mechanism_rates: Vector
    loose: Vector
    moving_clock: Vector
    moving_place: Vector
    moving_rate: Vector
    moving_bend: Vector
    equations_clock: Vector
    tip: Vector
    tip_twist: Vector
    on_tip: Vector
    about_tip: Vector
    on_joints: Vector
    applied_joints: Vector
    rigid_clock: Vector
    rigid_J: Vector
    rigid_J_rate: Vector
    rigid_turning_J: Vector
    rigid_turning_J_rate: Vector
    rigid_H: Vector
    rigid_others: Vector
    rigid_on_joints: Vector
    rigid_exerted: Vector
    rigid_round: Vector
    rigid_settled: Vector
    rigid_multipliers: Vector
    rigid_before: Vector
    rigid_step: Vector
    rigid_broyden: Vector
    rigid_next_multipliers: Vector
    rigid_next_step: Vector
    rigid_next_broyden: Vector
    constraint_forces: Vector
    detent_forces: Vector
    joint_rates: Vector
    velocity: Vector
    momentum: Vector
    arm_velocity: Vector

    # the record
    bus: Vector
    rows: Vector

    limit_events: Words  # 1 for each event of the stage that is a limit
    cubic_places: Words  # of each: where its knots are, how many, whether it is the path's
    pivot_columns: Words
    pivots_left: Words
    mechanism_at: Words
    mechanism_dof: Words
    loose_at: Words
    moving_at: Words
    moving_dof: Words
    detent_dof: Words
    warnings: Words
    data_words: Words
    bus_words: Words
    weights: Words
    sums: Words

    def __init__(self, base: TickMemory | None = None) -> None:
        """An empty one, or one that begins as `base` is now."""
        super().__init__()
        if base is not None:
            self._memory = type(base._memory).from_buffer_copy(base._memory)
            self._held = dict(base._held)
            return
        for name in _EVALUATIONS:
            setattr(self, name, Evaluation())

    def take(self, **values: Any) -> None:
        """Sets fields: numbers, and vectors to contiguous arrays, which it keeps."""
        for name, value in values.items():
            setattr(self, name, value)

    def load(self, compiling: Compiling) -> bool:
        """Has functions take their machine code; returns whether all have some.

        Args:
            compiling: what becomes of code that there is not. Where that is compiled, none is left
                unasked for; else it is asked for what each tick evaluates.

        Raises:
            EngineError: there is no machine code here.
            UnsupportedOperationError: a function has an operation that machine code lacks.
        """
        compiled = compiling in (Compiling.WAIT, Compiling.BESIDE)
        asked = self._evaluations(_EVALUATIONS if compiled else _OF_TICKS)
        return all([evaluation.load(compiling) for evaluation in asked]) and compiled

    def interpret(self, *, programs: bool) -> None:
        """Has the interpreter evaluate what each tick evaluates and has no code.

        Args:
            programs: whether also that of programs, which many runs never solve.

        Raises:
            EngineError, UnsupportedOperationError: as `load`.
        """
        for evaluation in self._evaluations(_OF_PROGRAMS if programs else _OF_TICKS):
            evaluation.interpret()

    @property
    def solves_programs(self) -> bool:
        """Whether there is code for all that programs need."""
        return all(evaluation.ready for evaluation in self._evaluations(_OF_PROGRAMS))

    @property
    def opens_stage(self) -> bool:
        """Whether there is code for all that the stage's begin needs."""
        return all(evaluation.ready for evaluation in self._evaluations(_OF_OPENING))

    def _evaluations(self, names: Iterable[str]) -> Iterator[Evaluation]:
        return (getattr(self, name) for name in names)


_EVALUATIONS = [name for name, kind in TickMemory.records.items() if kind is Evaluation]
_OF_PROGRAMS = ("assemble", "accept", "look", "left")
#: Each is evaluated once in a stage, so that to prepare it for the interpreter never pays.
_OF_OPENING = ("choice", "entry", "carrying")
_OF_TICKS = sorted(set(_EVALUATIONS) - {*_OF_PROGRAMS, *_OF_OPENING, "leaving"})
