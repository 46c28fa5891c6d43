"""What the loop in machine code reads and writes: one record of numbers and addresses."""

from __future__ import annotations

from taskspec.native.code import Compiling
from taskspec.native.kernel import Vector, Words
from taskspec.program.evaluation import Evaluation, Evaluations
from taskspec.program.execution.controller_memory import ControllerMemory

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


class TickMemory(Evaluations):
    """The memory of one stage of a run. A number that tells whether is 1 or 0."""

    control: ControllerMemory

    # functions on memory; those that a run has none of have no code
    encoder: Evaluation
    sensor: Evaluation
    observed_terms: Evaluation
    observed_entry: Evaluation
    observed: Evaluation
    forces: Evaluation
    moving: Evaluation
    equations: Evaluation
    handling: Evaluation
    rigid: Evaluation
    detents: Evaluation
    servo: Evaluation

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
    opens: int  # whether it has been entered and has had no tick

    # the bus
    n_bus: int  # numbers of a tick
    i_clock: int
    i_t: int
    i_stage: int

    # who observes the truth where joints are not exact
    n_observed: int  # numbers that the observed stage remembers
    n_observed_parameters: int
    n_observed_places: int  # of them, that say where the stage began

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
    n_handled: int  # degrees of freedom of bodies that are gripped, and of what takes them
    n_handling: int  # numbers that the grip remembers
    n_warnings: int
    look_every: int  # ticks from look to look at the simulator
    cartesian: int  # whether an equation acts on the tip
    n_rigid: int  # equations that hold exactly
    rigid_cartesian: int  # whether one of them is on the tip
    servo_positions: int  # whether its joints are commanded positions
    servo_every: int  # steps from tick to tick of the servo
    servo_ticks: int  # of the servo in a control period
    servo_rows: int  # of the queue of its commands
    servo_unknown: int  # whether the tool has a weight that it does not know
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

    moving_inertia: float  # of a driven coordinate
    last_time: float  # of the simulator at the last look [s]
    force_bound: float  # [N]
    torque_step: float  # of the joint where it is most, as the stage was opened [N m]
    energy_bound: float  # [J]

    # what the controller's inputs are measured from
    true_q: Vector
    true_v: Vector
    true_wrench: Vector
    true_reactions: Vector

    # who observes the truth
    observed_q: Vector
    observed_v: Vector
    observed_visit: Vector
    observed_memory: Vector
    observed_next_memory: Vector
    observed_own: Vector
    observed_parameters: Vector
    observed_entered: Vector

    # the sensor
    noise_rows: Vector
    noise: Vector
    samples: Vector
    sensor_memory: Vector
    sensor_kept: Vector

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
    handling_twist: Vector
    handling_on_tip: Vector
    handling_about_tip: Vector
    handling_forces: Vector
    handling_memory: Vector
    handling_kept: Vector
    grip_source: Vector
    grip_command: Vector
    servo_before: Vector
    servo_queue: Vector
    servo_delayed: Vector
    servo_H: Vector
    servo_J: Vector
    servo_turning_J: Vector
    servo_state: Vector
    servo_next_state: Vector
    servo_wanted: Vector
    servo_exerted: Vector
    servo_shown: Vector
    joint_rates: Vector
    velocity: Vector
    momentum: Vector
    arm_velocity: Vector

    # the record
    bus: Vector
    rows: Vector

    observed_places: Words
    mechanism_at: Words
    mechanism_dof: Words
    loose_at: Words
    moving_at: Words
    moving_dof: Words
    detent_dof: Words
    handled_dof: Words
    servo_place: Words
    warnings: Words
    data_words: Words
    bus_words: Words
    weights: Words
    sums: Words

    def load(self, compiling: Compiling) -> bool:
        """As `Evaluations.load`, of the controller as well."""
        return self.control.load(compiling) & super().load(compiling)

    def interpret(self, *, programs: bool) -> None:
        """As `Evaluations.interpret`, of the controller as well."""
        self.control.interpret(programs=programs)
        super().interpret(programs=programs)
