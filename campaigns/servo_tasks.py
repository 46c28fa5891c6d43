"""Presses by arms that take velocities or positions, whose gains are all designed.

A task is its number, as in `random_tasks.py`; arm, servo, sensor, rates, tool, pose, contact, law
and force are drawn. `make servo-designs` holds the designed damping of each against the boundary of
the sampled loop, and some against runs:

    python campaigns/servo_tasks.py --tasks 500 --every 8

Numbers below `JUDGING` are to try rules with; those from there on judge them.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import statistics
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from boundaries import DAMPING, keep, pressed
from draws import Draws

from taskspec.compiler import compile_unchecked
from taskspec.laws.design import GAIN_MARGIN
from taskspec.laws.gains import Gain
from taskspec.program.program import Program
from taskspec.program.sensor import SensorModel
from taskspec.robot import RobotError
from taskspec.rules.servo import fitting_servos
from taskspec.spec import load_text
from taskspec.stability.margin import STABLE, grows
from taskspec.stability.sampled_stage import SampledStage, analyse
from taskspec.text.diagnostic import SpecError
from taskspec_runner.loop.assembly import assemble

LAWS = ("admittance", "force-velocity")
ARMS = ("ur5e", "panda")
#: Number of the first task that judges.
JUDGING = 20_000
#: How far from their boundary designed gains are to be: times the damping at it.
PROMISED = 1.2
#: As far as boundaries are looked for, as a share of what is designed.
_LEAST = 0.02
#: Part of the force that a run begins without.
PUSH = 0.05
#: What is left of that at the end of a run, and how many time constants of the law that lasts.
SETTLED, CONSTANTS = 0.2, 8.0
#: Shortest and longest run [s].
SHORTEST, LONGEST = 0.4, 6.0


@dataclass(frozen=True)
class Press:
    """What is drawn.

    Attributes:
        number: of the task. draws: its keys, by what they are.
    """

    number: int
    draws: Mapping[str, str]

    @staticmethod
    def of(number: int) -> Press:
        """The press of a number."""
        draw = Draws(46, number)
        between, spread = draw.between, draw.spread
        control = int(draw.rng.choice((125, 250, 500, 1000)))
        plant = draw.one_of(("1 kHz", "2 kHz", "4 kHz"), (2, 1, 1))
        servo = {
            "bandwidth": f"{spread(4, 60):.3g} Hz",
            "damping": f"{between(0.6, 1.5):.2f}",
            "delay": f"{between(0, 20):.1f} ms",
        }
        arm = draw.one_of(ARMS)
        if draw.chance(0.25):
            stiffest = spread(1500, 8000)
            joints = [stiffest * (0.3 if i > 2 else 1) for i in range(7 if arm == "panda" else 6)]
            servo["stiffness"] = f"[{', '.join(f'{k:.0f} N*m/rad' for k in joints)}]"
            plant, servo["rate"] = "4 kHz", "4 kHz"
        sensor = {}
        if draw.chance(0.5):
            sensor["filter"] = f"{spread(10, 200):.3g} Hz"
        if draw.chance(0.3):
            sensor["delay"] = f"{between(0.5, 8):.1f} ms"
        if draw.chance(0.15):
            sensor["at"] = "wrist"
        law = draw.one_of(LAWS)
        if law == "admittance" and draw.chance(0.3):
            law = f"{{kind: admittance, mass: {spread(0.5, 20):.2g} kg}}"
        stiffness = spread(1, 200)
        damping = f", damping: {spread(0.02, 1) * 10 * math.sqrt(stiffness):.3g} N*s/m"
        size = f"radius: {between(5, 30):.0f} mm, length: {between(60, 200):.0f} mm"
        tilts = [draw.one_of(("0", f"{between(-35, 35):.0f}")) for _ in range(2)]
        return Press(
            number,
            {
                "arm": arm,
                "command": draw.one_of(("velocity", "position")),
                "servo": _listed(servo),
                "sensor": _listed(sensor),
                "control": f"rate: {control} Hz, plant_rate: {plant}",
                "tool": f"shape: sphere, {size}, mass: {spread(0.1, 2):.2g} kg",
                "xyz": f"{between(380, 560):.0f} mm, {between(-200, 200):.0f} mm",
                "z": f"{between(200, 420):.0f}",
                "rpy": f"{180 + float(tilts[0]):.0f} deg, {tilts[1]} deg, "
                f"{between(-90, 90):.0f} deg",
                "stiffness": f"{stiffness:.3g}",
                "damping": damping if draw.chance(0.5) else "",
                "law": law,
                "force": f"{spread(5, 60):.0f}",
                "motion": draw.one_of(("", "x: {velocity: 20 mm/s}, ")),
            },
        )

    def text(self, depth: float = 0.0) -> str:
        """The task, the plane so far above the tip at the start [mm]."""
        at = self.draws
        sensor = f", sensor: {{{at['sensor']}}}" if at["sensor"] else ""
        return (
            f"taskspec: 1\nname: press-{self.number}\nrobot: {{model: {at['arm']}, "
            f"command: {at['command']}, servo: {{{at['servo']}}}, tool: {{{at['tool']}}}, "
            f"start: {{xyz: [{at['xyz']}, {at['z']} mm], rpy: [{at['rpy']}]}}{sensor}}}\n"
            f"control: {{{at['control']}}}\n"
            f"world: {{bench: {{shape: plane, xyz: [0, 0, {float(at['z']) + depth:.6f} mm], "
            f"stiffness: {at['stiffness']} kN/m{at['damping']}}}}}\nlaw: {at['law']}\n"
            f"stages: {{press: {{axes: {{{at['motion']}z: {{force: -{at['force']} N}}}}, "
            "time: 60 s}}\n"
        )

    def program(self) -> Program | None:
        """Compiled; None where the arm cannot be there, or its servo is not stable itself."""
        try:
            return _sound(compile_unchecked(load_text(self.text(), "press.yaml")))
        except (SpecError, RobotError):
            return None


def _listed(keys: Mapping[str, str]) -> str:
    return ", ".join(f"{key}: {value}" for key, value in keys.items())


def _sound(program: Program) -> Program | None:
    return None if any(fitting_servos(program.plan)) else program


@dataclass(frozen=True)
class Looked:
    """A press whose loop was analysed.

    Attributes:
        press: which. growth: of what grows most in its loop, or 0 [1/s]. least: damping at which
            the sampled loop is on its boundary, as a share of the designed one; `_LEAST` for less.
        most: whether `PROMISED` times the designed damping is stable too. settles: whether a run
            does; None where there was none.
    """

    press: Press
    growth: float
    least: float
    most: bool
    settles: bool | None = None

    @property
    def row(self) -> dict[str, float | None]:
        """All but the press."""
        return {key: value for key, value in vars(self).items() if key != "press"}

    @property
    def holds(self) -> bool:
        """Whether all is as it is promised."""
        far = self.least * PROMISED <= 1 and self.most
        return self.growth == 0 and far and self.settles is not False


def looked(press: Press, program: Program, *, run: bool) -> Looked:
    """The sampled loop of a press, and its run."""
    sampled = analyse(program.stages[0])
    assert sampled is not None
    growth = max((mode.s.real for mode in sampled.modes() if grows(mode)), default=0.0)
    # Most are where the closed form has put them.
    marks = [_LEAST, 0.9 / GAIN_MARGIN, 1.1 / GAIN_MARGIN, 1.0]
    sound = [stable(sampled, mark) for mark in marks[1:3]]
    i = sound.index(True) if True in sound else 2
    low, high = marks[i], marks[i + 1]
    if i == 0 and stable(sampled, low):
        high = low
    while high > 1.04 * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if stable(sampled, middle) else (middle, high)
    settles = settled(press, program) if run else None
    return Looked(press, growth, high, stable(sampled, PROMISED), settles)


def stable(sampled: SampledStage, factor: float) -> bool:
    """Whether the loop is with so many times its designed damping, and the mass that goes with it.

    An integral stays what it is.
    """
    context, gains = sampled.context, sampled.stage.plan.gains
    moved = {}
    for name in (*DAMPING.values(), "mass"):
        gain = gains.get(name, {}).get("z")
        if gain is not None and gain.origin != "file":
            moved[name] = gains[name] | {"z": Gain(gain.value * factor, gain.origin)}
    assert moved
    sensor = SensorModel.of(context.loaded.task.robot.sensor, context.period)
    controller = sampled.at.under(gains | moved).linear()
    return STABLE.holds(controller, sampled.nominal, sensor, context.period)


def settled(press: Press, program: Program) -> bool:
    """Whether a run settles that begins with nearly all of its force.

    It stays where it is: an arm that slides on comes to other poses, and may align its joints.
    """
    press = replace(press, draws={**press.draws, "motion": ""})
    plan = program.stages[0].plan
    load, k = float(press.draws["force"]), plan.design_rules.plants["z"].k
    [gap] = program.context.start_gaps.values()
    depth = 1e3 * (gap + (1 - PUSH) * load / k)
    there = compile_unchecked(load_text(press.text(depth), "press.yaml"))
    gains, period = there.stages[0].plan.gains, there.context.period
    [damping] = [gains[name]["z"].value for name in DAMPING.values() if name in gains]
    axis = plan.design_rules.plants["z"].servo
    assert axis is not None
    seconds = min(max(CONSTANTS * damping / axis.stiffness, SHORTEST), LONGEST)
    force = pressed(assemble(there), period, round(seconds / period), load, PUSH)
    if len(force) < round(seconds / period):
        return False
    last = force[-len(force) // 10 :]
    return bool(np.ptp(last) < SETTLED * PUSH * load and abs(last.mean() - load) < PUSH * load)


def campaign(tasks: int, every: int, first: int, rows: Path) -> Iterator[Looked]:
    """So many presses that an arm can do; those whose number `every` divides are run as well.

    What a line of `rows` already has is not analysed again.
    """
    rows.parent.mkdir(parents=True, exist_ok=True)
    rows.touch()
    known = {row.pop("number"): row for row in map(json.loads, rows.read_text().splitlines())}
    done = 0
    for number in itertools.count(first):
        press = Press.of(number)
        if number not in known:
            program = press.program()
            each = None
            if program is not None:
                each = looked(press, program, run=number % every == 0)
            known[number] = {} if each is None else each.row
            with rows.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"number": number, **known[number]}) + "\n")
        if known[number]:
            yield Looked(press, **known[number])
            done += 1
        if done == tasks:
            return


def lines(found: Sequence[Looked]) -> Iterator[str]:
    """What came of a campaign."""
    ran = [each for each in found if each.settles is not None]
    unstable = sum(each.growth > 0 for each in found)
    near = sum(each.least * PROMISED > 1 or not each.most for each in found)
    yield (
        f"{len(found)} presses: {unstable} unstable, {near} nearer to a boundary than by "
        f"{100 * (PROMISED - 1):.0f} %. {len(ran)} of them were run: "
        f"{sum(not each.settles for each in ran)} did not settle."
    )
    yield ""
    yield "| law | arm | presses | designed over least stable damping | runs that settle |"
    yield "| --- | --- | --- | --- | --- |"
    for (law, arm), count in sorted(Counter(map(_kind, found)).items()):
        own = [each for each in found if _kind(each) == (law, arm)]
        margins = sorted(1 / each.least for each in own)
        settles = [each.settles for each in own if each.settles is not None]
        yield (
            f"| {law} | {arm} | {count} | {margins[0]:.2f} at least, "
            f"{statistics.median(margins):.2f} in the middle | {sum(settles)} of {len(settles)} |"
        )


def _kind(each: Looked) -> tuple[str, str]:
    draws = each.press.draws
    given = "admittance, its mass in the file"
    return draws["law"] if draws["law"] in LAWS else given, draws["arm"]


def main(arguments: Sequence[str]) -> int:
    """Looks at presses; 1 if one does not hold what is promised."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tasks", type=int, default=500)
    parser.add_argument(
        "--every", type=int, default=8, help="how many there are to one that is run"
    )
    parser.add_argument("--rows", type=Path, default=Path("runs/servo-designs.jsonl"))
    parser.add_argument("--first", type=int, default=JUDGING)
    parser.add_argument("--page", type=Path, help="in which the table is kept")
    options = parser.parse_args(arguments)
    found: list[Looked] = []
    for each in campaign(options.tasks, options.every, options.first, options.rows):
        found.append(each)
        if not each.holds:
            sys.stdout.write(f"{each.press.number}: {each}\n")
    if options.page is None:
        sys.stdout.write("\n".join([*lines(found), ""]))
    else:
        keep(options.page, "designs", lines(found))
    return int(not all(each.holds for each in found))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
