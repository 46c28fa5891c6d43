"""Boundaries of force loops over joint servos: closed form, sampled loop, and bisected runs.

An arm that takes velocities or positions presses on a surface, from the first tick on with the
force that it is to press with, but for a part of it. Whether what that leaves grows or dies away
tells on which side of its boundary the loop is. `make boundaries` finds the boundary for servos,
delays, stiffnesses, commands and laws; table in docs/admittance-boundary.md.

    python campaigns/boundaries.py --servos 0 3
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from taskspec.compiler import compile_unchecked
from taskspec.control.servo import drive_gains
from taskspec.laws.gains import Gain, Gains
from taskspec.laws.servo_loop import Contact, DrivenAxis, ServoLoop
from taskspec.program.program import Program
from taskspec.program.sensor import SensorModel
from taskspec.spec import load_text
from taskspec.stability.margin import STABLE
from taskspec.stability.sampled_stage import SampledStage, analyse
from taskspec_runner.loop.assembly import Assembly, assemble
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.plant.plant import Plant

#: Bandwidth [Hz] and damping ratio of the servos.
SERVOS = ((5, 1.0), (10, 0.7), (15, 1.0), (20, 0.7), (30, 1.0), (50, 0.7))
#: Of commands [ms], and stiffness of the surface [kN/m].
DELAYS, STIFFNESSES = (2, 4, 10), (5, 20, 80)
COMMANDS = ("velocity", "position")
#: The gain whose boundary is found, by law.
DAMPING = {"force-velocity": "force.damping", "admittance": "damping"}
#: M / D that an admittance is designed with [s].
LAG = 0.005

#: What the arm presses with [N], and the part of it that it begins without. Over a damping of
#: 1 N s/m a tenth of a newton is 0.1 m/s, at 100 Hz as much as drives can follow.
LOAD, PUSH = 20.0, 0.005
#: From this part of the load on a growing force is not evaluated any more.
LARGE = 0.05
#: Periods of the predicted oscillation that a run lasts.
SWINGS = 40
#: By which part runs may be off what is predicted.
PROMISED = 0.03
#: By which factor the boundary is bracketed first, and how close it is found.
BRACKET, CLOSE = 1.06, 1.005


@dataclass(frozen=True)
class Case:
    """An arm, its servo and a surface.

    Attributes:
        bandwidth: of the servo [Hz]. ratio: damping ratio. delay: of commands [ms]. stiffness: of
            the surface [kN/m]. command: velocity or position. law: of the press. rest: of the file,
            as keys of `robot` and whole lines.
    """

    bandwidth: float
    ratio: float
    delay: float
    stiffness: float
    command: str = "velocity"
    law: str = "force-velocity"
    robot: str = ""
    rest: str = ""

    @property
    def text(self) -> str:
        """The task."""
        law = self.law
        if law == "force-velocity":
            law = "{kind: force-velocity, force: {integral: 0 1/s}}"
        depth = (1 - PUSH) * LOAD / self.stiffness
        return (
            f"taskspec: 1\nname: press\nrobot: {{model: ur5e, command: {self.command}, "
            f"servo: {{bandwidth: {self.bandwidth} Hz, damping: {self.ratio}, "
            f"delay: {self.delay} ms}}, "
            "tool: {shape: sphere, radius: 15 mm, length: 120 mm, mass: 0.3 kg}, "
            f"start: {{xyz: [450 mm, 100 mm, {300 - depth:.6f} mm]}}{self.robot}}}\n"
            f"{self.rest}"
            f"world: {{bench: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: {self.stiffness} "
            f"kN/m}}}}\nlaw: {law}\n"
            f"stages: {{press: {{axes: {{z: {{force: {-LOAD} N}}}}, time: 60 s}}}}\n"
        )

    @cached_property
    def loop(self) -> PressLoop:
        """Its loop."""
        program = compile_unchecked(load_text(self.text, "press.yaml"))
        sampled = analyse(program.stages[0])
        assert sampled is not None
        return PressLoop(program, sampled, DAMPING[self.law])


@dataclass(frozen=True)
class PressLoop:
    """A press whose damping is moved.

    Attributes:
        program: compiled. sampled: its loop. gain: its damping, by name.
    """

    program: Program
    sampled: SampledStage
    gain: str

    @cached_property
    def axis(self) -> ServoLoop:
        """The closed form."""
        axis = self.program.stages[0].plan.design_rules.plants["z"].servo
        assert axis is not None
        return axis

    @cached_property
    def formed(self) -> tuple[float, float]:
        """Least damping [N s/m] of the closed form, and where a loop with it rings [Hz]."""
        return self.axis.least_damping(lag=LAG if "mass" in self.gains(1.0) else 0.0)

    @cached_property
    def predicted(self) -> float:
        """Least damping of the sampled loop [N s/m]."""
        period = self.program.context.period
        sensor = SensorModel.of(self.program.context.loaded.task.robot.sensor, period)

        def stable(damping: float) -> bool:
            controller = self.sampled.at.under(self.gains(damping)).linear()
            return STABLE.holds(controller, self.sampled.nominal, sensor, period)

        low, high = 0.5 * self.formed[0], 2 * self.formed[0]
        assert stable(high)
        assert not stable(low)
        while high > 1.0005 * low:
            middle = math.sqrt(low * high)
            low, high = (low, middle) if stable(middle) else (middle, high)
        return math.sqrt(low * high)

    def gains(self, damping: float) -> Gains:
        """Those of the stage with a damping [N s/m], and the mass that goes with it."""
        gains = dict(self.program.stages[0].plan.gains)
        moved = {self.gain: damping} | ({"mass": LAG * damping} if "mass" in gains else {})
        return gains | {name: gains[name] | {"z": Gain(v, "file")} for name, v in moved.items()}

    def growth(self, damping: float) -> float:
        """How fast the force of a run comes to leave its set point [1/s]; negative if it settles.

        Its change from tick to tick is taken through Hann windows, one over the last third of
        the run and one over the third before; a run that becomes large ends there.
        """
        [stage] = self.program.stages
        stage = replace(stage, plan=stage.plan.but(gains=self.gains(damping)))
        period = self.program.context.period
        ticks = round(SWINGS / self.formed[1] / period)
        force = pressed(assemble(replace(self.program, stages=(stage,))), period, ticks)
        large = np.abs(force - LOAD) > LARGE * LOAD
        changes = np.diff(force[: int(np.argmax(large))] if large.any() else force)
        third = len(changes) // 3
        window = np.hanning(third + 2)[1:-1]
        before, last = (
            float(np.sqrt(np.mean(window * part**2)))
            for part in (changes[-2 * third : -third], changes[-third:])
        )
        return math.log(last / before) / (third * period)

    @cached_property
    def found(self) -> tuple[float, float]:
        """Two dampings next to each other [N s/m]: with the first runs grow, with the second not.

        The next to be tried is where the growths of the two lead to nothing.
        """
        low, high = self.predicted / BRACKET, self.predicted * BRACKET
        grows, settles = self.growth(low), self.growth(high)
        while grows <= 0:
            high, settles, low = low, grows, low / BRACKET
            grows = self.growth(low)
        while settles > 0:
            low, grows, high = high, settles, high * BRACKET
            settles = self.growth(high)
        while high > CLOSE * low:
            share = min(max(grows / (grows - settles), 0.05), 0.95)
            for side in (share - 0.04, share + 0.04):
                middle = low * (high / low) ** side
                growth = self.growth(middle)
                if growth > 0:
                    low, grows = middle, growth
                else:
                    high, settles = middle, growth
                    break
        return low, high


def pressed(
    parts: Assembly[Plant], period: float, ticks: int, load: float = LOAD, push: float = PUSH
) -> np.ndarray:
    """(ticks,) what the arm presses down with [N], from when it already nearly does.

    Its drives begin as far ahead of the joints as that takes. A run in which the force comes to
    nothing, or to twice the load, is over.

    Args:
        parts: of the run. period: of control [s]. ticks: of it. load: set point [N]. push: part of
            it that is missing as the run begins.
    """
    plant, machine, context = parts.plant, parts.machine, parts.program.context
    servo, n = plant.arm.servo, context.robot.n
    assert servo is not None
    robot, timing = context.loaded.task.robot, context.drives.timing
    assert timing is not None
    H, stiffness = context.start_inertia, robot.servo.stiffness
    own = None if stiffness is None else np.broadcast_to(stiffness, n)
    K, _ = drive_gains(H, timing.w, timing.ratio, own)
    ahead = -np.linalg.solve(K, context.start_jacobian[2] * (1 - push) * load)
    servo.state[:n] += ahead
    servo.state[n : 2 * n] += ahead
    sensing = Sensing(plant.arm, plant.views.equations, machine)
    sensing.read()
    machine.start()
    if servo.positions:
        for command in (machine.torque, machine.applied, servo.command, servo.before):
            command[:] = servo.state[:n]
        servo.queue[:] = np.tile(servo.state[:n], servo.rows)
    force = np.zeros(ticks)
    for k in range(ticks):
        if k:
            sensing.read()
        machine.tick(k * period)
        plant.step(machine.torque)
        force[k] = plant.arm.wrench[2]
        if machine.ended or abs(force[k] - load) > load:
            return force[: k + 1]
    return force


def cases(servos: Iterable[int]) -> Iterator[Case]:
    """All of some servos, by their numbers; laws and commands last."""
    chosen = [SERVOS[number] for number in servos]
    for (bandwidth, ratio), *others in itertools.product(
        chosen, DELAYS, STIFFNESSES, DAMPING, COMMANDS
    ):
        delay, stiffness, law, command = others
        yield Case(bandwidth, ratio, delay, stiffness, command, law)


@dataclass(frozen=True)
class Row:
    """What came of a case.

    Attributes:
        case: which. formed, rings: least damping of the closed form [N s/m], and its frequency
            [Hz]. predicted: that of the sampled loop. found: that of runs.
    """

    case: Case
    formed: float
    rings: float
    predicted: float
    found: float

    @staticmethod
    def of(case: Case) -> Row:
        """Predicts and runs."""
        loop = case.loop
        return Row(case, *loop.formed, loop.predicted, math.sqrt(math.prod(loop.found)))

    @property
    def numbers(self) -> list[float]:
        """All but the case."""
        return [self.formed, self.rings, self.predicted, self.found]

    @property
    def off(self) -> float:
        """By which part runs are off what the sampled loop predicts."""
        return self.found / self.predicted - 1


def table(rows: Sequence[Row]) -> Iterator[str]:
    """Lines of a table, the commands of a case side by side."""
    yield "| law | servo | delay | contact | rings at | closed form | sampled loop | runs |"
    yield "| --- | --- | --- | --- | --- | --- | --- | --- |"
    keys = dict.fromkeys(replace(row.case, command="") for row in rows)
    for case in keys:
        own = [row for row in rows if replace(row.case, command="") == case]
        runs = ", ".join(f"{row.found:.4g} ({100 * row.off:+.1f} %)" for row in own)
        yield (
            f"| {case.law} | {case.bandwidth} Hz, {case.ratio} | {case.delay} ms "
            f"| {case.stiffness} kN/m | {own[0].rings:.3g} Hz | {own[0].formed:.4g} "
            f"| {own[0].predicted:.4g} | {runs} |"
        )


def terms() -> Iterator[str]:
    """Lines of a table: the boundary of one press in closed form, with and without each part."""
    loop = Case(20, 1.0, 4, 20, law="admittance").loop
    axis, plant = loop.axis, loop.program.stages[0].plan.design_rules.plants["z"]
    timing, contact = axis.timing, axis.contact
    w, ratio, fine = timing.w, timing.ratio, timing.period / 8
    parts = {
        "all of it": axis,
        "contact without its damping": replace(axis, contact=replace(contact, d=0.0)),
        "without the mass that the simulator adds": replace(axis, contact=replace(contact, m=0.0)),
        "contact as a spring alone": replace(axis, contact=Contact(contact.k)),
        "arm that gives way not at all": replace(axis, arm=DrivenAxis.alone(1e9, w, ratio)),
        "effective mass with the other axes held": replace(
            axis, arm=DrivenAxis.alone(plant.held, w, ratio)
        ),
        "commands without delay": replace(axis, timing=replace(timing, delay=0.0)),
        "plant in steps of an eighth": replace(axis, timing=replace(timing, step=fine)),
        "plant, servo and control eight times as fast": replace(
            axis, timing=replace(timing, step=fine, tick=fine, period=fine)
        ),
        "sensor with a low-pass of 30 Hz": replace(
            axis, timing=replace(timing, pole=math.exp(-2 * math.pi * 30 * timing.period))
        ),
    }
    yield "| closed form | without a mass | M = 5 ms D |"
    yield "| --- | --- | --- |"
    for name, part in parts.items():
        cells = (part.least_damping(lag=lag) for lag in (0.0, LAG))
        yield f"| {name} | " + " | ".join(f"{d:.4g} N s/m at {f:.3g} Hz" for d, f in cells) + " |"


def main(arguments: Sequence[str]) -> int:
    """Finds all boundaries; 1 if one is off by more than is promised."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--servos", type=int, nargs="+", default=range(len(SERVOS)))
    parser.add_argument("--rows", type=Path, default=Path("runs/boundaries.jsonl"))
    parser.add_argument("--page", type=Path, help="in which the table is kept")
    options = parser.parse_args(arguments)
    options.rows.parent.mkdir(parents=True, exist_ok=True)
    options.rows.touch()
    known = dict(map(json.loads, options.rows.read_text("utf-8").splitlines()))
    rows: list[Row] = []
    for case in cases(options.servos):
        if str(case) not in known:
            known[str(case)] = Row.of(case).numbers
            with options.rows.open("a", encoding="utf-8") as file:
                file.write(json.dumps([str(case), known[str(case)]]) + "\n")
        rows.append(Row(case, *known[str(case)]))
    lines = [
        f"{len(rows)} boundaries; runs are off the sampled loop by "
        f"{100 * max(abs(row.off) for row in rows):.1f} % at most, the closed form by "
        f"{100 * max(abs(row.formed / row.predicted - 1) for row in rows):.2f} %.",
        "",
        *table(rows),
    ]
    if options.page is None:
        sys.stdout.write("\n".join([*lines, ""]))
    else:
        keep(options.page, "terms", terms())
        keep(options.page, "boundaries", lines)
    return int(any(abs(row.off) > PROMISED for row in rows))


def keep(page: Path, name: str, lines: Iterable[str]) -> None:
    """Writes lines between the marks of a table on a page."""
    text, begin, end = page.read_text("utf-8"), f"<!-- {name} -->\n", f"<!-- end {name} -->"
    before, rest = text.split(begin)
    page.write_text(before + begin + "\n".join(lines) + "\n" + end + rest.split(end)[1], "utf-8")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
