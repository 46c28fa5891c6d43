"""Random tasks with random limits, and how far a run of one goes beyond them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.compiler import compile_unchecked
from taskspec.laws import LAWS
from taskspec.program.execution.stage_solver import SolverCounts
from taskspec.program.prepare import prepare
from taskspec.program.program import Program
from taskspec.robot import RobotModel
from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError
from taskspec_runner.loop import fixed_step as loop
from taskspec_runner.loop.assembly import assemble

Vector = NDArray[np.float64]

#: Torques are limited under laws that command them.
_LAWS = tuple(kind for kind, facts in LAWS.items() if facts.commands == "torque")
_SPATIAL, _PLANAR = ("panda", "ur5e"), ("planar3", "planar2")
_HOME = {
    "panda": (0.0, -0.1, 0.0, -2.28, 0.0, 2.17, 0.785),
    "ur5e": (-0.27, -1.57, 1.8, -1.8, -1.57, -1.84),
    "planar3": (1.35, -2.2, 1.16),
    "planar2": (1.06, -1.63),
}
_RANGE = {
    "panda": (
        (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
        (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    ),
    "ur5e": ((-6.2832, -6.2832, -3.1416, *[-6.2832] * 3), (6.2832, 6.2832, 3.1416, *[6.2832] * 3)),
    "planar3": ((-2.967, -2.7925, -2.7925), (2.967, 2.7925, 2.7925)),
    "planar2": ((-2.967, -2.7925), (2.967, 2.7925)),
}


class RefusedError(Exception):
    """A task that is not one of those that the limits are promised for; says why."""


class Writer:
    """Writes one random task."""

    def __init__(self, number: int) -> None:
        self.rng = np.random.default_rng((4, number))
        self.number = number
        #: Of the first stage, along the contact's normal [N], [m/s].
        self.force = self.speed = 0.0

    def between(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def spread(self, low: float, high: float) -> float:
        """Uniform in the logarithm."""
        return float(math.exp(self.rng.uniform(math.log(low), math.log(high))))

    def chance(self, p: float) -> bool:
        return bool(self.rng.random() < p)

    def one_of(self, values: tuple[str, ...]) -> str:
        return values[int(self.rng.integers(len(values)))]

    def text(self) -> str:
        family = self.rng.choice(["press", "approach", "drop", "corner", "reach"], p=_SHARES)
        return {"reach": self._reach}.get(str(family), lambda: self._contact(str(family)))()

    def _contact(self, family: str) -> str:
        planar = family != "corner" and self.chance(0.3)
        self.robot = self.one_of(_PLANAR if planar else _SPATIAL)
        law = self.one_of(_LAWS)
        normal, sign = ("x", 1) if planar else ("z", -1)
        k, friction = self.spread(1, 100), self.between(0, 0.5) if self.chance(0.7) else 0.0
        cap = self.spread(10, 80)
        damping = self.between(0.02, 0.2) * 2 * math.sqrt(k * 1e3)
        self.material = (
            f"stiffness: {k:.4g} kN/m, damping: {damping:.3g} N*s/m, friction: {friction:.3g}"
        )
        if planar:
            self.at = (self.between(350, 450), self.between(-50, 150), 0.0)
        else:
            self.at = (self.between(400, 550), self.between(-150, 150), 300.0)
        self.slope = 0.0 if planar or family == "corner" else self.between(-10, 10)
        # Gaps [mm] from the objects at the start.
        gap = -self.between(0, 0.4) * cap / k if family == "press" else self.between(0.3, 3.0)
        wanted = (0.0, 0.0) if family == "corner" else (gap,)
        force, ramp = sign * cap * self.spread(0.1, 2.0), self.between(0.02, 0.2)
        self.force = abs(force)
        stages = []
        if family == "approach":
            speed = sign * self.spread(3, 100)
            self.speed = abs(speed) / 1e3
            stages.append(
                f"  near: {{axes: {{{normal}: {{velocity: {speed:.2f} mm/s}}}}, "
                f"until: abs(force.{normal}) > {0.1 * cap:.2f} N, within: {{time: 0.8 s}}}}"
            )
        ways = [f"{normal}: {{force: {force:.3f} N, ramp: {ramp:.3f} s}}"]
        if family == "corner":
            ways.append(f"x: {{force: {cap * self.spread(0.1, 1.0):.3f} N, ramp: {ramp:.3f} s}}")
            ways.append(self._way("y"))
        else:
            along = ("y",) if planar else ("x", "y")
            ways += [self._way(a, cap) for a in along if self.chance(0.6)]
        time = self.between(0.25, 0.5)
        stages.append(f"  press: {{axes: {{{', '.join(ways)}}}, time: {time:.3f} s}}")
        if self.chance(0.3):
            stages.append(
                f"  off: {{axes: {{{normal}: {{move: {-sign * 10:.1f} mm, "
                f"speed: {self.between(50, 300):.0f} mm/s}}}}}}"
            )
        limits = [f"force: {cap:.3f} N" if self.chance(0.9) else "force: 1 kN", *self._limits()]
        start = "xyz: [" + ", ".join(f"{x:.2f} mm" for x in self.at) + "]"
        # How far each object has to be moved away to have its gap depends on the tool's pose.
        self.objects = self._walls() if planar else self._table(family == "corner")
        frame = "world" if planar else "table"
        tool, unmoved = self._tool(), self._world((0.0,) * len(wanted))
        text = self._task(tool, start, unmoved, frame, law, limits, stages)
        gaps = prepare(load_text(text, "task.yaml")).start_gaps
        moved = tuple(w - 1e3 * gaps[o] for w, o in zip(wanted, self.objects, strict=True))
        return self._task(tool, start, self._world(moved), frame, law, limits, stages)

    def _walls(self) -> dict[str, tuple[str, Vector]]:
        """Pose of each object through the tip, and where it is moved to be further away [mm]."""
        return {"wall": ("rpy: [0, -90 deg, 0]", np.array([1.0, 0.0, 0.0]))}

    def _table(self, corner: bool) -> dict[str, tuple[str, Vector]]:
        angle = math.radians(self.slope)
        down = -np.array([math.sin(angle), 0.0, math.cos(angle)])
        found = {"table": (f"rpy: [0, {self.slope:.4f} deg, 0]", down)}
        return {**found, **(self._walls() if corner else {})}

    def _world(self, moved: tuple[float, ...]) -> list[str]:
        shapes = []
        for (name, (turned, away)), far in zip(self.objects.items(), moved, strict=True):
            xyz = ", ".join(f"{x:.5f} mm" for x in np.array(self.at) + far * away)
            shapes.append(f"{name}: {{shape: plane, xyz: [{xyz}], {turned}, {self.material}}}")
        return shapes

    def _way(self, axis: str, cap: float = 0.0) -> str:
        kind = self.one_of(("sine", "velocity", "move", "drag") if cap else ("sine", "move"))
        if kind == "sine":
            size, period = self.between(2, 30), self.between(0.3, 1.5)
            return f"{axis}: {{position: {size:.2f} mm * sin(2*pi*t/({period:.3f} s))}}"
        if kind == "velocity":
            return f"{axis}: {{velocity: {self.between(-300, 300):.1f} mm/s}}"
        if kind == "move":
            way, speed = self.between(-50, 50), self.between(50, 400)
            return f"{axis}: {{move: {way:.2f} mm, speed: {speed:.1f} mm/s}}"
        return f"{axis}: {{force: {cap * self.between(-0.4, 0.4):.3f} N}}"

    def _limits(self) -> list[str]:
        found = []
        if self.chance(0.6):
            found.append(f"speed: {self.spread(30, 400):.2f} mm/s")
        if self.chance(0.4):
            found.append(f"torque_rate: {self.spread(200, 5000):.1f} N*m/s")
        return found

    def _reach(self) -> str:
        """Moves in free space from a start with a joint near its limit."""
        self.robot = self.one_of((*_SPATIAL, *_PLANAR))
        low, high = (np.array(x) for x in _RANGE[self.robot])
        q = np.array(_HOME[self.robot]) + self.rng.uniform(-0.3, 0.3, len(low))
        q = np.clip(q, low + 0.05, high - 0.05)
        if self.robot != "ur5e":
            joint = int(self.rng.integers(len(q)))
            away = self.spread(0.005, 0.2)
            q[joint] = low[joint] + away if self.chance(0.5) else high[joint] - away
        start = "joints: [" + ", ".join(f"{math.degrees(x):.4f} deg" for x in q) + "]"
        law = self.one_of(tuple(kind for kind in _LAWS if not LAWS[kind].bare))
        axes = ("x", "y", "z") if self.robot in _SPATIAL else ("x", "y")
        ways = [self._free(axis) for axis in axes if self.chance(0.7)]
        time = self.between(0.3, 0.6)
        stages = [f"  go: {{axes: {{{', '.join(ways)}}}, time: {time:.3f} s}}"]
        return self._task(self._tool(), start, [], "world", law, self._limits(), stages)

    def _free(self, axis: str) -> str:
        if self.chance(0.4):
            return f"{axis}: {{velocity: {self.between(-800, 800):.1f} mm/s}}"
        if self.chance(0.5):
            size, period = self.between(5, 100), self.between(0.2, 1.5)
            return f"{axis}: {{position: {size:.2f} mm * sin(2*pi*t/({period:.3f} s))}}"
        return f"{axis}: {{move: {self.between(-150, 150):.1f} mm, speed: 600 mm/s}}"

    def _tool(self) -> str:
        return f"tool: {{radius: 10 mm, length: 100 mm, mass: {self.between(0, 600):.0f} g}}"

    def _task(
        self,
        tool: str,
        start: str,
        shapes: list[str],
        frame: str,
        law: str,
        limits: list[str],
        stages: list[str],
    ) -> str:
        world = "".join(f"  {shape}\n" for shape in shapes)
        return (
            f"taskspec: 1\nname: random-{self.number}\n"
            f"robot: {{model: {self.robot}, {tool}, start: {{{start}}}}}\n"
            + (f"world:\n{world}" if world else "")
            + f"frame: {frame}\nlaw: {{kind: {law}, solve: qp}}\n"
            + (f"limits: {{{', '.join(limits)}}}\n" if limits else "")
            + "stages:\n"
            + "".join(f"{stage}\n" for stage in stages)
        )


_SHARES = (0.3, 0.25, 0.15, 0.1, 0.2)


def program_of(number: int) -> Program:
    """Random task `number`, compiled.

    Raises:
        RefusedError: it cannot be compiled, or its impact alone may exceed the cap.
    """
    writer = Writer(number)
    try:
        program = compile_unchecked(load_text(writer.text(), f"random-{number}.yaml"))
    except SpecError as error:
        raise RefusedError(",".join(sorted({d.code for d in error.diagnostics}))) from error
    if writer.force:
        _check_impact(program, writer)
    return program


def _check_impact(program: Program, writer: Writer) -> None:
    """Holds v sqrt(h k) against the cap for every object of the task.

    v is the speed that the first stage asks for, or the one that its force reaches over the gap
    with nothing to brake it.

    Raises:
        RefusedError: it is not below.
    """
    context, cap = program.context, program.stages[0].plan.limits.force
    J, H = context.start_jacobian[:3], context.start_inertia
    assert cap is not None
    for name, normal in context.start_normals.items():
        h = 1 / float(normal @ J @ np.linalg.solve(H, J.T @ normal))
        k, gap = context.compliances[name].stiffness, max(context.start_gaps[name], 0.0)
        v = writer.speed if writer.speed else math.sqrt(2 * writer.force * gap / h)
        if v * math.sqrt(h * k) >= cap:
            raise RefusedError("impact")


@dataclass(frozen=True)
class Traces:
    """What a run left behind, tick by tick.

    Attributes:
        program: that was run. outcome: how it ended. fields: name to (ticks, size).
        relaxed: (ticks,) how often limits had collided until then. counts: what the solver did.
    """

    program: Program
    outcome: loop.Outcome
    fields: Mapping[str, Vector]
    relaxed: Vector
    counts: Mapping[str, float]


class Keeper:
    """A recorder that keeps the bus."""

    def __init__(self, array: Vector, solver_counts: list[SolverCounts]) -> None:
        self._array, self._counts = array, solver_counts
        self.rows: list[Vector] = []
        self.relaxed: list[int] = []

    def add(self) -> None:
        self.rows.append(self._array.copy())
        self.relaxed.append(sum(counts.relaxed for counts in self._counts))


def run_program(program: Program) -> Traces:
    """Runs a task and keeps every number of its bus."""
    parts = assemble(program)
    runners = parts.machine.runners
    solver_counts = [r.solver.counts for r in runners if r.solver is not None]
    keeper = Keeper(parts.bus.array, solver_counts)
    outcome = loop.run(parts.machine, parts.plant, parts.bus, keeper, program.context.period)
    rows = np.array(keeper.rows)
    fields = {name: rows[:, where] for name, where in parts.bus.slices.items()}
    names = ("solved", "relaxed", "held")
    counts = {name: float(sum(getattr(a, name) for a in solver_counts)) for name in names}
    counts["limited"] = float(np.sum(fields["limited"]))
    return Traces(program, outcome, fields, np.array(keeper.relaxed), counts)


def joint_excess(traces: Traces) -> dict[str, float]:
    """The most that torques, their rate, joint positions and velocities were beyond, relative."""
    robot, limits = traces.program.context.robot, traces.program.stages[0].plan.limits
    q, v, torque = (traces.fields[name] for name in ("q", "v", "torque"))
    span = robot.upper - robot.lower
    found = {
        "torque": np.max(np.abs(torque) / robot.torque_limit) - 1,
        "joint position": np.max(np.maximum(q - robot.upper, robot.lower - q) / span),
        "joint velocity": np.max(np.abs(v) / robot.velocity_limit) - 1,
    }
    if limits.torque_rate is not None:
        # The run begins with what carries the arm.
        torque = np.vstack([traces.program.context.start_gravity, torque])
        rate = np.max(np.abs(np.diff(torque, axis=0))) / traces.program.context.period
        found["torque rate"] = rate / limits.torque_rate - 1
    return {name: float(value) for name, value in found.items()}


@dataclass(frozen=True)
class Excess:
    """What of a limit was exceeded on one tick, and what of it is accounted for.

    Attributes:
        tick: which. beyond: relative. explained: relative, by what the control could not know.
        collided: whether stronger limits had been in the way shortly before.
    """

    tick: int
    beyond: float
    explained: float
    collided: bool


#: A collision is felt for as long as limits need to be met again: some of the contact's periods.
_SHORTLY = 100


def force_excess(traces: Traces) -> list[Excess]:
    """Ticks on which the true contact force is above the cap.

    The control sees a force one tick late, and its torque acts a tick later: f_i - f_(i-2) are one
    tick of contact dynamics. And on a surface with damping d that the tool slides on at v, MuJoCo's
    friction cone adds mu d v to the normal force (measured: 0.219 N at 27.3 mm/s, mu 0.441 and
    17.8 N s/m, where mu d v is 0.214 N), which no nominal spring has.
    """
    cap = traces.program.stages[0].plan.limits.force
    if cap is None:
        return []
    force = np.linalg.norm(traces.fields["wrench"][:, :3], axis=1)
    found = []
    for i in np.flatnonzero(force > cap * (1 + 1e-6)):
        rising = force[i] - force[max(i - 2, 0)]
        sliding = 0.0
        for shape in traces.program.context.loaded.task.shapes.values():
            mu = shape.friction
            damping = traces.program.context.compliances[_name(traces, shape)].damping
            sliding += mu * damping * traces.fields["speed"][i, 0] * math.hypot(1, mu)
        explained = (max(rising, 0.0) + sliding) / cap
        found.append(Excess(int(i), force[i] / cap - 1, explained, _collided(traces, i)))
    return found


def speed_excess(traces: Traces) -> list[Excess]:
    """Ticks on which the tip is faster than its limit.

    The velocity at tick i is what the torque at i - 1 was made for, but for the contact force,
    which that torque took to be the one before: an error of T J H^-1 J' (f_(i-1) - f_(i-2)).
    """
    limit = traces.program.stages[0].plan.limits.speed
    if limit is None:
        return []
    context = traces.program.context
    speed, wrench = traces.fields["speed"][:, 0], traces.fields["wrench"][:, :3]
    found = []
    for i in np.flatnonzero(speed > limit * (1 + 1e-6)):
        change = np.linalg.norm(wrench[i - 1] - wrench[max(i - 2, 0)])
        wrong = context.period * mobility(context.robot, traces.fields["q"][i - 1]) * change
        found.append(Excess(int(i), speed[i] / limit - 1, wrong / limit, _collided(traces, i)))
    return found


def _collided(traces: Traces, tick: int) -> bool:
    return bool(traces.relaxed[tick] > traces.relaxed[max(tick - _SHORTLY, 0)])


def _name(traces: Traces, shape: object) -> str:
    shapes = traces.program.context.loaded.task.shapes
    return next(name for name, other in shapes.items() if other is shape)


def mobility(robot: RobotModel, q: Vector) -> float:
    """Largest eigenvalue of J H^-1 J' of the tip's translations [1/kg]."""
    data = robot.pin.createData()
    H = np.triu(pin.crba(robot.pin, data, q))
    H = H + np.triu(H, 1).T
    frame = robot.pin.getFrameId("tip")
    J = pin.computeFrameJacobian(robot.pin, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
    return float(np.linalg.eigvalsh(J @ np.linalg.solve(H, J.T))[-1])
