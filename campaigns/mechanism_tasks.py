"""Tasks with every mechanism, arm, frame, law and rate, whose gains are all designed.

A task is its number, as in `random_tasks.py`. What is moved is what the mechanism leaves free; all
else gives way. `make designs` holds their sampled loops to be stable:

    python campaigns/mechanism_tasks.py --tasks 400

Numbers from `PLANAR` on are of arms that move in a plane; a campaign has one of them for every
three others. With `--page` the counts are kept, by mechanism, arm and rate, and by law.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from draws import Draws
from random_tasks import LAWS as ALL_LAWS

from taskspec.planning import plan_task
from taskspec.robot import RobotError
from taskspec.spec import load_text
from taskspec.stability.margin import grows
from taskspec.stability.sampled_stage import loop_of
from taskspec.text.diagnostic import SpecError

#: `stiffness` damps nothing, so that nothing of it is designed to come to rest.
LAWS = tuple(law for law in ALL_LAWS if law != "stiffness")
MECHANISMS = ("hinge", "knob", "pivot", "slide", "screw", "thread")
RATES = (250, 500, 1000, 2000)
ARMS = ("panda", "ur5e")
PLANE_ARMS = ("planar3", "planar2")
#: What arms in a plane hold; the two links have no third axis that a fixed knob would need.
PLANE_MECHANISMS = {"planar3": ("hinge", "pivot", "slide"), "planar2": ("pivot", "slide")}
#: Number of the first task in a plane.
PLANAR = 100_000
#: Starts of the arm, leaning and turned.
_RPY = ((180, 0, 0), (180, -30, 0), (180, 0, 90), (180, 20, 120), (150, 0, -45))


def mechanism_task(number: int, law: str = "") -> str:
    """Returns the text of task `number`; `law` replaces its own."""
    if number >= PLANAR:
        return _in_plane(number, law)
    draw = Draws(12, number)
    between, spread = draw.between, draw.spread

    law = law or LAWS[number % len(LAWS)]
    kind = kind_of(number)
    rate = int(draw.rng.choice(RATES))
    arm = draw.one_of(ARMS)
    rpy = _RPY[int(draw.rng.integers(len(_RPY)))]
    x, y, z = between(420, 600), between(-120, 120), between(280, 430)
    frame, lines = "obj", ""
    if kind in ("hinge", "pivot"):
        radius, about = between(80, 400), between(0, 360)
        hx, hy = radius * np.cos(np.radians(about)), radius * np.sin(np.radians(about))
        turned = "rpy: [90 deg, 0, 0], " if draw.chance(0.25) else ""
        # The handle stays within reach: the axis is where the handle is not.
        ox, oy, oz = (x - hx, y, z - hy) if turned else (x - hx, y - hy, z)
        knob = "free" if kind == "pivot" else "fixed"
        lines = (
            f"mechanism: hinge, xyz: [{ox:.0f} mm, {oy:.0f} mm, {oz:.0f} mm], {turned}"
            f"handle: [{hx:.0f} mm, {hy:.0f} mm, 0], knob: {knob}, "
            f"inertia: {spread(0.01, 2):.3g} kg*m^2, damping: {spread(0.05, 3):.2g} N*m*s/rad, "
            f"friction: {spread(0.05, 0.8):.2g} N*m"
        )
        frame = draw.one_of(("obj.handle", "hinge", "obj.handle", "obj"))
    elif kind == "knob":
        lines = (
            f"mechanism: hinge, xyz: [{x:.0f} mm, {y:.0f} mm, {z:.0f} mm], "
            f"inertia: {spread(0.001, 0.05):.3g} kg*m^2, damping: {spread(0.05, 0.5):.2g} N*m*s/rad"
        )
    elif kind == "slide":
        turned = draw.one_of(("0, -90 deg, 0", "0, 0, 0", "90 deg, 0, 0", "0, 40 deg, 20 deg"))
        knob = draw.one_of(("fixed", "free"))
        lines = (
            f"mechanism: slide, xyz: [{x:.0f} mm, {y:.0f} mm, {z:.0f} mm], rpy: [{turned}], "
            f"knob: {knob}, mass: {spread(0.3, 8):.2g} kg, damping: {spread(2, 40):.2g} N*s/m"
        )
        frame = draw.one_of(("obj.handle", "obj"))
    else:
        lever = f"handle: [{between(40, 120):.0f} mm, 0, 0], " if kind == "thread" else ""
        knob = draw.one_of(("fixed", "free")) if kind == "thread" else "fixed"
        down = "rpy: [180 deg, 0, 0], " if draw.chance(0.5) else ""
        lines = (
            f"mechanism: screw, xyz: [{x:.0f} mm, {y:.0f} mm, {z:.0f} mm], {down}{lever}"
            f"knob: {knob}, pitch: {spread(1, 8):.2g} mm/turn, "
            f"inertia: {spread(0.0005, 0.02):.2g} kg*m^2, "
            f"mass: {spread(0.1, 0.6):.2g} kg, damping: {spread(0.02, 0.2):.2g} N*m*s/rad"
        )
    driven = {"z": "{velocity: 30 mm/s}"} if kind == "slide" else {"rz": "{velocity: 15 deg/s}"}
    if kind in ("hinge", "pivot") and frame == "obj.handle":
        driven = {"y": "{velocity: 40 mm/s}"}
        driven["rz"] = "{hold: start}" if kind == "pivot" else "{follows: obj}"
    if kind == "screw" and draw.chance(0.6):
        driven["z"] = "{follows: obj}"
    sensor = ""
    if draw.chance(0.35):
        parts = [
            f"at: {draw.one_of(('wrist', 'contact'))}",
            f"delay: {between(0.5, 4):.1f} ms" if draw.chance(0.5) else "",
            f"filter: {spread(40, 200):.0f} Hz" if draw.chance(0.5) else "",
            f"rate: {min(rate, 500)} Hz" if draw.chance(0.3) else "",
        ]
        sensor = f", sensor: {{{', '.join(p for p in parts if p)}}}"
    axes = {a: "{force: 0}" for a in "xyz"} | {a: "{torque: 0}" for a in ("rx", "ry", "rz")}
    axes |= driven
    start = f"start: {{rpy: [{rpy[0]} deg, {rpy[1]} deg, {rpy[2]} deg]}}{sensor}"
    return _text(number, f"{arm}, grasp: obj.handle, {start}", lines, frame, law, rate, axes)


def _text(
    number: int, robot: str, held: str, frame: str, law: str, rate: int, axes: dict[str, str]
) -> str:
    """The text of a task; the robot and what it holds are lists as YAML has them."""
    hinge = "frames: {hinge: {parent: obj, point: origin}}\n" if frame == "hinge" else ""
    return (
        f"taskspec: 1\nname: mechanism-{number}\nrobot: {{model: {robot}}}\n"
        f"world: {{obj: {{{held}}}}}\n{hinge}frame: {frame}\nlaw: {law}\n"
        f"control: {{rate: {rate} Hz}}\n"
        f"stages:\n  go:\n    axes: {{{', '.join(f'{a}: {v}' for a, v in axes.items())}}}\n"
        "    time: 1 s\n"
    )


def _in_plane(number: int, law: str) -> str:
    """A task of an arm that moves in the world's xy plane, and holds something there."""
    draw = Draws(13, number)
    between, spread = draw.between, draw.spread

    law, (arm, kind) = law or LAWS[number % len(LAWS)], _plane_case(number)
    rate, frame = int(draw.rng.choice(RATES)), draw.one_of(("obj.handle", "obj"))
    x, y, fixed = between(300, 480), between(-150, 250), arm == "planar3"
    if kind == "slide":
        knob = draw.one_of(("fixed", "free")) if fixed else "free"
        lines = (
            f"mechanism: slide, xyz: [{x:.0f} mm, {y:.0f} mm, 0], "
            f"rpy: [0, 90 deg, {between(0, 360):.0f} deg], knob: {knob}, "
            f"mass: {spread(0.3, 4):.2g} kg, damping: {spread(2, 40):.2g} N*s/m"
        )
        # The slide goes along its z, which lies in the plane as its y does.
        axes = {"z": "{velocity: 30 mm/s}", "y": "{force: 0}"}
        axes |= {"rx": "{torque: 0}"} if fixed else {}
    else:
        radius, about = between(60, 250), np.radians(between(0, 360))
        knob = "free" if kind == "pivot" else "fixed"
        hx, hy = radius * np.cos(about), radius * np.sin(about)
        lines = (
            f"mechanism: hinge, xyz: [{x - hx:.0f} mm, {y - hy:.0f} mm, 0], "
            f"handle: [{hx:.0f} mm, {hy:.0f} mm, 0], knob: {knob}, "
            f"inertia: {spread(0.01, 1):.3g} kg*m^2, damping: {spread(0.05, 1):.2g} N*m*s/rad, "
            f"friction: {spread(0.02, 0.3):.2g} N*m"
        )
        turns = {"hinge": "{follows: obj}", "pivot": "{hold: start}"}[kind]
        if frame == "obj" and kind == "hinge":
            axes = {"x": "{force: 0}", "y": "{force: 0}", "rz": "{velocity: 15 deg/s}"}
        else:
            frame = "obj.handle"
            axes = {"x": "{force: 0}", "y": "{velocity: 40 mm/s}"}
            axes |= {"rz": turns} if fixed else {}
    sensor = f", sensor: {{delay: {between(0.5, 4):.1f} ms}}" if draw.chance(0.3) else ""
    return _text(number, f"{arm}, grasp: obj.handle{sensor}", lines, frame, law, rate, axes)


def _plane_case(number: int) -> tuple[str, str]:
    """Arm and mechanism of a task in a plane."""
    cases = [(arm, kind) for arm in PLANE_ARMS for kind in PLANE_MECHANISMS[arm]]
    return cases[(number // len(LAWS)) % len(cases)]


def worst(number: int, law: str = "") -> float | None:
    """Growth of what grows most in a task's loop, or 0 [1/s]; None where the arm cannot hold it."""
    try:
        task = plan_task(load_text(mechanism_task(number, law), f"mechanism-{number}.yaml"))
        loop = loop_of(task, "go")
    except (SpecError, RobotError):
        return None
    if loop is None:
        return None
    return max((mode.s.real for mode in loop.modes() if grows(mode)), default=0.0)


@dataclass(frozen=True)
class Looked:
    """A task whose loop was looked at.

    Attributes:
        number: of it. law, kind, arm, rate: what it has; rate in Hz. growth: see `worst`.
    """

    number: int
    law: str
    kind: str
    arm: str
    rate: int
    growth: float


def campaign(numbers: Iterable[int], law: str) -> Iterator[Looked]:
    """All tasks that the arm can hold."""
    for number in numbers:
        growth = worst(number, law)
        if growth is not None:
            found = yaml.safe_load(mechanism_task(number, law))
            rate = int(found["control"]["rate"].removesuffix(" Hz"))
            yield Looked(
                number, found["law"], kind_of(number), found["robot"]["model"], rate, growth
            )


def kind_of(number: int) -> str:
    """The mechanism of a task."""
    if number >= PLANAR:
        return _plane_case(number)[1]
    return MECHANISMS[(number // len(LAWS)) % len(MECHANISMS)]


PAGE = """\
# Designed gains of held mechanisms

Where an arm holds a mechanism, and the file states no gains, they are designed
([laws](laws/README.md)). `make designs` closes the sampled loop of random tasks with every
mechanism, arm, law and rate, and looks for a mode that grows. A *knob* is a hinge that is turned
about itself, a *pivot* a hinge with a free knob, a *thread* a screw with a lever; arms that move
in a plane hold what moves there. Handles, axes,
masses, friction, the arm's start, late and filtered sensors are drawn anew for each; a task that
the arm cannot hold where it begins is left out. A cell is how many are unstable, of how many.
"""


def page(looked: Sequence[Looked]) -> str:
    """The text of docs/designed-gains.md."""
    unstable = sum(each.growth > 0 for each in looked)
    lines = [PAGE, f"{len(looked)} tasks, {unstable} of them unstable.", ""]
    head = ["mechanism", "arm", *(f"{rate} Hz" for rate in RATES)]
    lines += ["| " + " | ".join(head) + " |", "| " + " | ".join(["---"] * len(head)) + " |"]
    for kind in MECHANISMS:
        for arm in (*ARMS, *PLANE_ARMS):
            here = [each for each in looked if (each.kind, each.arm) == (kind, arm)]
            if not here:
                continue
            cells = [_count([each for each in here if each.rate == rate]) for rate in RATES]
            lines.append(f"| {kind} | {arm} | " + " | ".join(cells) + " |")
    lines += ["", "| law | tasks |", "| --- | --- |"]
    lines += [f"| {law} | {_count([e for e in looked if e.law == law])} |" for law in LAWS]
    return "\n".join(lines) + "\n"


def _count(looked: Sequence[Looked]) -> str:
    return f"{sum(each.growth > 0 for each in looked)} of {len(looked)}" if looked else ""


def main() -> int:
    """Says of how many tasks the designed gains are unstable; 1 where there is one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", type=int, default=400)
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--law", default="", help="in place of each task's own")
    parser.add_argument("--page", type=Path, help="where the table is written")
    arguments = parser.parse_args()
    first = PLANAR + arguments.first // 3
    numbers = [*range(arguments.first, arguments.first + arguments.tasks)]
    numbers += range(first, first + arguments.tasks // 3)
    looked: list[Looked] = []
    for each in campaign(numbers, arguments.law):
        looked.append(each)
        if each.growth > 0:
            sys.stdout.write(
                f"mechanism-{each.number} under {each.law} grows by {each.growth:.3g} /s\n"
            )
            sys.stdout.flush()
    for law in LAWS:
        sys.stdout.write(f"{law}: {_count([e for e in looked if e.law == law])} unstable\n")
    if arguments.page is not None:
        arguments.page.write_text(page(looked), "utf-8")
    return int(any(each.growth > 0 for each in looked))


if __name__ == "__main__":
    sys.exit(main())
