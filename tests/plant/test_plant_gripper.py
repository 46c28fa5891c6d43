"""A gripper's pads: they press, stick and slip as friction lets them, and hand a mass over."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.program.bound import Wiring
from taskspec.program.execution.compiled_terms import CompiledTerms
from taskspec.program.program import Program
from taskspec.program.worlds import true_world
from taskspec.robot.model_terms import PinocchioTerms
from taskspec.spec import Shape, load_task, load_text
from taskspec.spec.gripper import Gripper
from taskspec_runner import run
from taskspec_runner.link.on_robot import LostPolicy, OnRobot, RobotPlant
from taskspec_runner.link.simulated import SimulatedRobot
from taskspec_runner.loop import fixed_step
from taskspec_runner.loop.assembly import Assembly, assemble
from taskspec_runner.plant import pads
from taskspec_runner.plant.names import PREFIX
from taskspec_runner.record.log import Log

TASKS = Path(__file__).resolve().parents[2] / "tasks"
G = 9.81

#: Picks a block that is 40 mm wide between the jaws, and holds it in the air with another force.
HOLD = """
taskspec: 1
robot:
  model: panda
  tool: {shape: sphere, radius: 4 mm, length: 120 mm, mass: 700 g}
  start: {xyz: [450 mm, 0, 330 mm]}
world:
  table: {shape: plane, xyz: [0, 0, 300 mm], friction: 0.4}
  block:
    {shape: box, size: [60 mm, 40 mm, 60 mm], xyz: [450 mm, 0, 330 mm], free: true, mass: 500 g,
     friction: 0.4}
stages:
  grasp: {grip: {object: block, force: 30 N}, until: grip.force > 29.9 N, within: 2 s}
  lift: {axes: {z: {move: 60 mm}}}
  hold: {grip: {object: block, force: FORCE}, time: 400 ms}
control: {plant_rate: 4 kHz}
"""


def program(text: str) -> Program:
    return compile_unchecked(load_text(text, "hold.yaml"))


def held(force: float, text: str = HOLD) -> tuple[Assembly, np.ndarray, np.ndarray]:
    """A run of a block that is held with a force: times [s] and heights [m] in the last stage."""
    made = program(text.replace("FORCE", f"{force} N"))
    parts = assemble(made)
    joint = parts.plant.model.joint(f"{PREFIX}block")
    height = parts.plant.data.qpos[joint.qposadr[0] + 2 :]
    last, times, heights = len(made.stages) - 1, [], []
    with closing(parts.recorder(None)) as recorder:
        steps = fixed_step.Steps(
            parts.machine, parts.plant, parts.bus, recorder, made.context.period, loop="python"
        )
        while steps.outcome is None:
            steps.advance(1)
            if parts.machine.index == last:
                times.append(steps.clock)
                heights.append(float(height[0]))
    return parts, np.array(times), np.array(heights)


def test_a_body_that_is_held_firmly_enough_stays_and_its_mass_is_the_models() -> None:
    # 500 g on two pads of 0.4: 6.13 N each.
    parts, _, heights = held(6.4)
    assert np.ptp(heights[100:]) < 20e-6  # what pads give by their springs as the force falls
    assert parts.machine.reactions[-1] < 1e-6
    assert parts.machine.grip.load[0] == 0.5
    # Without the body's weight, nothing is measured.
    weighs = parts.machine.wrench[2] + 0.5 * G
    assert abs(weighs) < 0.02


def test_a_body_that_is_held_too_weakly_slides_by_what_friction_leaves_of_its_weight() -> None:
    force = 4.0
    parts, times, heights = held(force)
    # From when the jaws press with that up to when its edge comes to the pads.
    part = slice(60, 140)
    fall = 2 * np.polyfit(times[part], heights[part], 2)[0]
    expected = -(G - 2 * 0.4 * force / 0.5)
    # Within 1 %: the arm, on which less weight hangs, rises as it falls.
    assert fall == pytest.approx(expected, rel=0.01)
    slid = parts.machine.reactions[-1]
    assert slid > 0.02


def test_jaws_close_at_their_speed_and_press_as_fast_as_they_are_stiff() -> None:
    made = program(HOLD.replace("FORCE", "30 N"))
    parts = assemble(made)
    with closing(parts.recorder(None)) as recorder:
        steps = fixed_step.Steps(
            parts.machine, parts.plant, parts.bus, recorder, made.context.period, loop="python"
        )
        forces = []
        while parts.machine.index == 0:
            steps.advance(1)
            forces.append(float(parts.machine.reactions[-2]))
    # 80 mm to 40 mm at 100 mm/s. The tick that measures is one later.
    first = int(np.argmax(np.array(forces) > 0))
    assert first * 1e-3 == pytest.approx(0.4, abs=2e-3)
    task = made.context.loaded.task
    k, _, _ = pads.pad_numbers(
        task.shapes["block"], made.context.robot.tool_body.mobility, 1 / 4000
    )
    rise = k * 0.5 * 0.1
    assert forces[first + 10] - forces[first] == pytest.approx(10e-3 * rise, rel=1e-9)


def test_what_slips_out_is_lost_and_its_mass_goes_from_the_model() -> None:
    text = HOLD.replace("time: 400 ms", "time: 900 ms")
    parts, _, heights = held(2.0, text)
    assert parts.machine.reactions[-2] == 0.0
    assert parts.machine.grip.load[0] == 0.0
    assert heights[-1] == pytest.approx(0.33, abs=1e-3)  # on the table


# --- the limit surface of the pads ---------------------------------------------------------------

GRIPPER = Gripper()
CYLINDER = Shape(shape="cylinder", free=True, mass=0.1, radius=0.015, length=0.04, friction=0.3)
PERIOD = 1 / 4000


class Pads:
    """The pads' function on a body at rest between them, which is moved by hand."""

    def __init__(self, force: float) -> None:
        state, memory = ca.SX.sym("state", 12), ca.SX.sym("memory", pads.MEMORY)
        command, wiring = ca.SX.sym("command"), Wiring()
        tip = pads.Body(ca.SX.zeros(3), ca.SX.eye(3), ca.SX.zeros(3), ca.SX.zeros(3))
        turn = ca.SX.eye(3) + ca.skew(state[3:6])
        body = pads.Body(state[:3], turn, state[6:9], state[9:])
        found = pads.hold(
            GRIPPER, CYLINDER, tip, body, memory, command, wiring, "body", 0.3, PERIOD
        )
        symbols, given = zip(*wiring._arguments, strict=True)
        self._function = ca.Function(
            "pads",
            [state, memory, command, *symbols],
            [found.force, found.moment, found.memory, found.presses, found.slipped],
        )
        self._given, self._force = given, force
        self.memory = pads.start(GRIPPER)
        self.place, self.rate = np.zeros(6), np.zeros(6)
        for _ in range(4000):
            self.step()

    def step(self) -> tuple[np.ndarray, np.ndarray]:
        state = np.concatenate([self.place, self.rate])
        f, m, memory, self.presses, self.slipped = (
            np.asarray(x).ravel()
            for x in self._function(state, self.memory, self._force, *self._given)
        )
        self.memory = memory
        self.place = self.place + PERIOD * self.rate
        return f, m

    def moved(self, rate: np.ndarray, ticks: int) -> tuple[np.ndarray, np.ndarray]:
        """Force and moment on the body after it has been moved at a rate (6,), slowly."""
        self.rate = np.asarray(rate, dtype=float)
        for _ in range(ticks):
            found = self.step()
        return found


SLOW = 1e-3


def test_pads_hold_mu_n_each_against_a_shift_across_them() -> None:
    hand = Pads(20.0)
    f, m = hand.moved([0, 0, -SLOW, 0, 0, 0], 8000)
    assert hand.presses[0] == 20.0
    assert f == pytest.approx([0, 0, 2 * 0.3 * 20.0], abs=1e-6)
    assert np.linalg.norm(m) < 1e-6
    # All of 2 mm but what the springs take up, k z + b v = mu N.
    k, b, _ = pads.pad_numbers(CYLINDER, 0.3, PERIOD)
    assert hand.slipped[0] == pytest.approx(2e-3 - (0.3 * 20.0 - b * SLOW) / k, rel=1e-3)


def test_pads_hold_a_moment_at_the_lever_of_the_body() -> None:
    hand = Pads(20.0)
    # Small angles: the turn of the body is linear here.
    _, m = hand.moved([0, 0, 0, 0, 0, -0.02], 8000)
    assert m[2] == pytest.approx(2 * 0.3 * 20.0 * 0.015, rel=1e-3)


def test_pads_turn_about_their_axis_at_two_thirds_of_their_radius() -> None:
    hand = Pads(20.0)
    _, m = hand.moved([0, 0, 0, 0, -0.04, 0], 8000)
    rocks = 2 / 3 * GRIPPER.pad
    # The side of a cylinder is flat along its axis, across that axis round: it does not rock here.
    assert m[1] == pytest.approx(2 * 0.3 * 20.0 * rocks, rel=1e-3)


def test_shift_and_turn_share_one_limit() -> None:
    """Sliding by v and w, a pad has f and tau with (f / mu N)^2 + (tau / mu N r)^2 = 1."""
    rng = np.random.default_rng(3)
    shares = []
    for _ in range(5):
        hand = Pads(20.0)
        # The turn is of first order here: it stays below 1 deg.
        v, w = rng.uniform(0.5, 1.0) * SLOW, rng.uniform(5e-3, 2e-2)
        f, m = hand.moved([0, 0, v, 0, w, 0], 3200)
        most = 2 * 0.3 * 20.0
        shares.append((np.linalg.norm(f) / most) ** 2 + (m[1] / (most * 2 / 3 * GRIPPER.pad)) ** 2)
    assert shares == pytest.approx([1.0] * 5, rel=1e-3)


def test_a_body_off_the_middle_is_pushed_there_by_two_n_at_most() -> None:
    hand = Pads(20.0)
    f, _ = hand.moved([0, SLOW, 0, 0, 0, 0], 8000)
    assert f == pytest.approx([0, -40.0, 0], abs=1e-6)


# --- the arm's model -----------------------------------------------------------------------------


def test_the_load_is_a_point_at_the_tip() -> None:
    robot, mass = program(HOLD.replace("FORCE", "30 N")).context.robot, 1.3
    rng, load = np.random.default_rng(5), np.array([1.3])
    q, v = rng.uniform(-1, 1, robot.n), rng.uniform(-1, 1, robot.n)
    model = robot.pin.copy()
    point = pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
    model.inertias[robot.tip_joint] += robot.tip.act(point)
    data = model.createData()
    pin.computeAllTerms(model, data, q, v)
    H = np.triu(data.M) + np.triu(data.M, 1).T
    for terms in (CompiledTerms, PinocchioTerms):
        found = terms(robot, q.copy(), v.copy(), load)
        found.update()
        np.testing.assert_allclose(found.inertia, H, atol=1e-10)
        np.testing.assert_allclose(found.bias, data.nle, atol=1e-10)
        np.testing.assert_allclose(found.gravity, data.g, atol=1e-10)


SENSORS = ("", "  sensor: {at: wrist, bias: [1 N, 0 N, 2 N, 0 N*m, 0 N*m, 0 N*m]}\n")


def zeroed(sensor: str) -> str:
    """A task that tares with a leant block in the hand, turns it upright, and lets it go."""
    lean = "{move: 20 deg, speed: 90 deg/s}"
    text = HOLD.replace("world:\n", f"{sensor}world:\n").replace(
        "60 mm}}}", f"60 mm}}, rx: {lean}}}}}"
    )
    hold = text.index("  hold:")
    return (
        text[:hold]
        + "  zero: {tare: true, time: 200 ms}\n"
        + f"  upright: {{axes: {{rx: {lean.replace('20', '-20')}}}}}\n"
        + "  hold: {time: 100 ms}\n  let_go: {release: true, time: 100 ms}\n"
        + text[text.index("control:") :]
    )


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_tare_while_holding_takes_the_bias_and_not_the_load(sensor: str, tmp_path: Path) -> None:
    """Without that, the 4.9 N of the block were taken off twice, and missing once it was let go."""
    made = run(load_text(zeroed(sensor), "zero.yaml"), tmp_path / "run", report=False, force=True)
    assert made.summary["status"] == "done"
    rows = made.history.window("zero")
    assert np.abs(made.column("force.z")[rows][-1] - 0.5 * G) < 0.01
    for stage in ("hold", "let_go"):
        for axis in "xyz":
            measured = made.column(f"force.{axis}.measured")[made.history.window(stage)]
            # The mean has what was left of the move, 12 mN; of the bias of 2 N nothing is left.
            assert np.abs(measured[-1]) < 0.02


# --- loops and links -----------------------------------------------------------------------------


LOOPS = ("python", "interpreted", "native")


def logged(made: Program, folder: Path, loop: str) -> bytes:
    parts, path = assemble(made), folder / loop / "log.arrow"
    path.parent.mkdir()
    with closing(parts.recorder(Log(path))) as recorder:
        fixed_step.run(
            parts.machine, parts.plant, parts.bus, recorder, made.context.period, loop=loop
        )
    return path.read_bytes() + repr(parts.machine.transitions).encode()


def test_the_loops_lose_a_body_alike(tmp_path: Path) -> None:
    text = HOLD.replace("FORCE", "2 N").replace(
        "time: 400 ms}", "time: 600 ms}\n  again: {release: true, time: 200 ms}"
    )
    made = program(text)
    assert len({logged(made, tmp_path, loop) for loop in LOOPS}) == 1


def test_the_loops_tare_alike_with_a_body_in_the_hand(tmp_path: Path) -> None:
    made = program(zeroed(SENSORS[1]))
    assert len({logged(made, tmp_path, loop) for loop in LOOPS}) == 1


def test_a_robot_elsewhere_is_told_what_to_press_with() -> None:
    made = program(HOLD.replace("FORCE", "2 N"))
    here = assemble(made)
    robot = SimulatedRobot(made)
    assert robot.facts.grips
    assert robot.facts.reactions == ("grip.force", "grip.slip")
    linked = OnRobot(robot, LostPolicy(), "here")
    linked.check(made)
    there = linked.assemble(made, true_world(made.context))
    torques: list[list[bytes]] = [[], []]
    for parts, commanded in zip((here, there), torques, strict=True):
        with closing(parts.recorder(None)) as recorder:
            steps = fixed_step.Steps(
                parts.machine, parts.plant, parts.bus, recorder, made.context.period,
                loop="python", sensing=parts.sensing,
            )  # fmt: skip
            while steps.outcome is None:
                steps.advance(1)
                commanded.append(parts.machine.torque.tobytes())
    assert len(torques[0]) > 1000
    assert torques[0] == torques[1]
    assert isinstance(there.plant, RobotPlant)


# --- the shipped task ----------------------------------------------------------------------------


def test_the_cap_slips_without_a_harder_grip_and_is_screwed_on_with_one(tmp_path: Path) -> None:
    path = TASKS / "pick-and-screw.yaml"
    good = run(load_task(path), tmp_path / "good", report=False)
    assert good.passed
    assert [v.stage for v in good.visits].count("grip_harder") == 1
    lines = [
        line
        for line in path.read_text(encoding="utf-8").splitlines()
        if not any(key in line for key in ("fail_if:", "attempts:", "on_fail:"))
    ]
    plain = run(load_text("\n".join(lines), str(path)), tmp_path / "plain", report=False)
    assert not plain.passed
    assert plain.visits[-1].stage == "screw_down"
    torque = np.abs(np.asarray(plain.signals["torque.rz"]))
    # Both pads slide at the lever of the radius, and carry what presses on the thread beside.
    most = 2 * 30.0 * 0.25 * 0.015
    assert torque.max() == pytest.approx(most, rel=0.05)
