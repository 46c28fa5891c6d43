"""Random tasks for `make truth`: those of `random_tasks.py`, wider, and with slips of the pen.

A task is its seed and its number: `truth_task(1, 17)` is one text for ever. Beside what
`random_tasks.py` draws there are contacts of 1 to 300 kN/m whatever the sensor is like, every
mechanism on every arm, and, in some files, one thing that an engineer may get wrong: a gain, a
speed, a way, a limit, a time, a guard or a sensor. Nothing is left out because it fails.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from random_tasks import COMPANIONS, LAWS, Value, angles, flow, lengths, rotation
from workshop_scenes import HABITS, WorkshopDraft

#: How many files have one thing wrong, and in how many the gains are given.
SLIPS, GIVEN = 0.25, 0.5
#: The time of a stage in an expression.
_TIME = re.compile(r"(?<![\w.])t(?![\w.])")
#: The bound of an expectation.
_BOUND = re.compile(r"< ([\d.]+)")
#: The number that a quantity begins with.
_NUMBER = re.compile(r"-?\d+(\.\d+)?(e-?\d+)?")


def truth_task(seed: int, number: int) -> str:
    """Returns the text of file `number` of a seed."""
    return draft(seed, number).written()


def draft(seed: int, number: int) -> TruthDraft:
    """The draft of file `number` of a seed, with its scene drawn."""
    made = TruthDraft(number, seed)
    made.draw()
    return made


def write_companions(folder: Path) -> None:
    """Writes the files that tasks refer to into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in {**COMPANIONS, **HABITS}.items():
        (folder / name).write_text(text, "utf-8")


def scaled(text: str, factor: float, digits: int = 3) -> str:
    """A quantity with the number that it begins with times a factor; as it is where it has none."""
    found = _NUMBER.match(text)
    if found is None:
        return text
    return f"{factor * float(found[0]):.{digits}g}{text[found.end() :]}"


class TruthDraft(WorkshopDraft):
    """A task of the campaign.

    Attributes:
        slip: what is wrong with it; empty for nothing. gain_factor: of all gains that it gives.
    """

    def __init__(self, number: int, seed: int) -> None:
        super().__init__(number, 13, seed)
        self.name = f"truth-{seed}-{number}"
        self.slip, self.gain_factor = "", 1.0

    # --- what is drawn -----------------------------------------------------------------------

    def scenes(self) -> dict[str, tuple[float, Callable[[], None]]]:
        return {**super().scenes(), "held": (0.12, self._held)}

    def draw(self) -> None:
        super().draw()
        if self.kind == "mechanism":
            # As wide as one writes it before the first run.
            self.expect = [_BOUND.sub(lambda m: f"< {3 * float(m[1]):g}", e) for e in self.expect]
        if "mass" not in flow(self.robot.get("tool", {})):
            self.vary.pop("robot.tool.mass", None)
        if self.kind == "probe":
            deepest = max(10.0, 3 * self.press_force / self.stiffness)
            self.expect[0] = f"min(work.gap) > -{deepest:.2g} mm"
        if self.chance(SLIPS):
            self._slip()
        self.reuse()

    def written(self) -> str:
        # Gains are drawn while the file is written: each writing begins with the same draws.
        state = self.rng.bit_generator.state
        try:
            return super().written()
        finally:
            self.rng.bit_generator.state = state

    def choose_law(self, laws: Sequence[str] = LAWS) -> None:
        super().choose_law(laws)
        self.given = self.chance(GIVEN)

    def contact(self, low: float = 1, high: float = 300) -> dict[str, Value]:
        # Whatever the sensor is like; the scene's own range is what an arm with a good one bears.
        del low, high
        lag, self.lag = self.lag, 0.0
        made = super().contact(1, 300)
        self.lag = lag
        return made

    def stiff(self, low: float, high: float, *, exact: float = 0.0) -> dict[str, Value]:
        return super().stiff(min(low, 1), max(high, 300), exact=exact)

    def press(self, force: float) -> None:
        super().press(force)
        stage = self.stages["press"]
        pressing = flow(stage["axes"])
        if "time" in stage and "position" not in pressing and "sin" not in pressing:
            # What an open loop presses with is known roughly.
            about = f"within {self.sign * force:g} +- {max(2.0, 0.6 * force):.2g} N"
            if not any(each.startswith("last(press.") for each in self.expect):
                self.expect.append(f"last(press.{self.felt}) {about}")

    def slide(self, force: float, reach: float = 25) -> None:
        before = len(self.expect)
        super().slide(force, reach)
        wanted = self.expect[before:]
        if not wanted:
            return
        # Friction that turns round disturbs every loop, and is all that one without an integral
        # has against it; what is not constant is held against its own reference.
        friction = 0.3 if any("friction" in flow(each) for each in self.world.values()) else 0.0
        loose = 0.4 if self.law == "hybrid-reaction" else 0.2
        band = f"{max(2.0, (loose + friction) * force):.2g} N"
        ramped = "press" not in self.stages or "ramp" in flow(self.stages["slide"]["axes"])
        share = round(self.between(30, 50) if ramped else self.between(50, 80))
        signal = f"slide.{self.felt}"
        what = f"{signal} within {signal}.ref +- {band}"
        self.expect[before:] = [f"{what} for {share} %"]

    # --- mechanisms of every kind --------------------------------------------------------------

    def _held(self) -> None:
        """A handle of any kind at any place, moved as far as its mechanism leaves it free."""
        self.model = self.one_of(("panda", "ur5e"))
        self.robot["model"] = self.model
        self.sense()
        self.choose_law(tuple(law for law in LAWS if law != "stiffness"))
        self.given = self.given and self.chance(0.3)
        self.stiffness, self.press_force, self.turns = 50.0, 15.0, True
        leaning = ("180 deg, 0, 0", "180 deg, -30 deg, 0", "180 deg, 0, 90 deg", "150 deg, 0, 0")
        self.robot["grasp"] = "part.handle"
        self.robot["start"] = {"rpy": self.one_of(leaning).split(", ")}
        handle = np.round([self.between(420, 560), self.between(-120, 120), self.between(280, 420)])
        kind = self.one_of(("hinge", "slide", "screw"), (4, 3, 3))
        {"hinge": self._hinge, "slide": self._slide, "screw": self._thread}[kind](handle)
        self.limits = {"force": f"{round(self.between(60, 150)):g} N", "speed": "400 mm/s"}
        self.expect.append(f"max(norm(go.force)) < {round(self.between(40, 60))} N")
        self.about = f"Move a {kind} by its handle."

    def _go(self, driven: dict[str, Value], until: str, time: float) -> None:
        stage: dict[str, Value] = {"axes": self._yielding(driven)}
        if self.chance(0.7):
            self.stages["go"] = {**stage, "until": until, "within": {"time": f"{time:.2g} s"}}
            # What is measured last is of the tick before the guard holds.
            signal, bound, unit = until.replace("> ", "").split()
            self.expect.append(f"last(go.{signal}) > {0.9 * float(bound):g} {unit}")
        else:
            self.stages["go"] = {**stage, "time": f"{0.5 * time:.2g} s"}
        if self.chance(0.5):
            self.stages["ease"] = {"axes": self._yielding({}), "time": "0.3 s"}

    def _hinge(self, handle: np.ndarray) -> None:
        radius, about = round(self.between(40, 400), -1), round(self.between(-180, 180), -1)
        upright = self.chance(0.75)
        arm = radius * np.array([np.cos(np.radians(about)), np.sin(np.radians(about)), 0.0])
        rpy = (0.0, 0.0, 0.0) if upright else (90.0, 0.0, 0.0)
        keys: dict[str, Value] = {
            "mechanism": "hinge",
            "xyz": lengths(np.round(handle - rotation(rpy) @ arm)),
            "handle": lengths(np.round(arm)),
            "inertia": self.nice(0.01, 2, "kg*m^2"),
            "damping": self.nice(0.05, 3, "N*m*s/rad"),
        }
        if not upright:
            keys["rpy"] = angles(rpy)
        if self.chance(0.6):
            keys["friction"] = self.nice(0.05, 0.8, "N*m")
        if self.chance(0.3):
            keys["stop"] = f"-10..{round(self.between(45, 120), -1):g} deg"
        knob = self.one_of(("fixed", "free"), (2, 1))
        keys["knob"] = knob
        self.world["part"] = keys
        # A turn at which the handle goes some 20 to 120 mm/s.
        rate = round(np.degrees(self.between(20, 120) / radius), 1)
        angle = round(self.between(10, 60))
        time = angle / rate * 1.5 + 1
        if self.chance(0.6):
            speed = np.radians(rate) * radius
            # x of the handle's frame is along its lever.
            self.frame = "part.handle"
            rz: Value = {"hold": "world"} if knob == "free" else {"follows": "part"}
            driven: dict[str, Value] = {"y": {"velocity": f"{speed:.3g} mm/s"}, "rz": rz}
        else:
            self.frames["axis"] = {"parent": "part", "point": "origin"}
            self.frame = "axis"
            driven = {"rz": {"velocity": f"{rate:g} deg/s"}}
        self._go(driven, f"part.angle > {angle} deg", time)

    def _slide(self, handle: np.ndarray) -> None:
        turned = self.one_of(("0, -90 deg, 0", "0, 0, 0", "90 deg, 0, 0", "0, 40 deg, 20 deg"))
        way = round(self.between(30, 150), -1)
        keys: dict[str, Value] = {
            "mechanism": "slide",
            "xyz": lengths(handle),
            "rpy": turned.split(", "),
            "mass": self.nice(0.3, 8, "kg"),
            "damping": self.nice(2, 40, "N*s/m"),
        }
        if turned != "0, -90 deg, 0" and self.chance(0.8):
            keys["friction"] = self.nice(10, 40, "N")
        if self.chance(0.4):
            keys["stop"] = f"-20..{round(way * self.between(0.8, 2)):g} mm"
        self.world["part"] = keys
        self.frame = self.one_of(("part.handle", "part"))
        speed = round(self.between(15, 80))
        driven: dict[str, Value] = {"z": {"velocity": f"{speed} mm/s"}}
        self._go(driven, f"part.travel > {way:g} mm", way / speed * 1.5 + 1)

    def _thread(self, handle: np.ndarray) -> None:
        lever = self.chance(0.4)
        arm = np.array([round(self.between(40, 100)), 0, 0]) if lever else np.zeros(3)
        down = self.chance(0.5)
        rpy = (180.0, 0.0, 0.0) if down else (0.0, 0.0, 0.0)
        keys: dict[str, Value] = {
            "mechanism": "screw",
            "xyz": lengths(np.round(handle - rotation(rpy) @ arm)),
            "pitch": f"{self.between(1, 8):.2g} mm/turn",
            "inertia": self.nice(0.0005, 0.02, "kg*m^2"),
            "mass": self.nice(0.1, 0.6, "kg"),
            "damping": self.nice(0.02, 0.2, "N*m*s/rad"),
            "friction": self.nice(0.05, 0.3, "N*m"),
        }
        if down:
            keys["rpy"] = angles(rpy)
        if lever:
            keys["handle"] = lengths(arm)
            # About a free knob the hand would turn, and the screw would not.
            keys["knob"] = "fixed"
        if self.chance(0.4):
            keys["stop"] = f"-5..{round(self.between(40, 120), -1):g} deg"
        self.world["part"] = keys
        self.frame = "part"
        rate = round(self.between(15, 60))
        angle = round(self.between(20, 100), -1)
        driven: dict[str, Value] = {"rz": {"velocity": f"{rate} deg/s"}}
        if self.chance(0.6):
            driven["z"] = {"follows": "part"}
        until = f"part.angle > {angle:g} deg" if self.chance(0.7) else "part.torque > 1 N*m"
        if "torque" in until and "stop" not in keys:
            keys["stop"] = f"-5..{angle:g} deg"
        self._go(driven, until, angle / rate * 1.5 + 1)

    # --- the same again ------------------------------------------------------------------------

    def lengthen(self, name: str, factor: float) -> None:
        """Makes a stage go the same way more slowly, and press for longer."""
        stage = self.stages[name]
        path, within = stage.get("path", {}), stage.get("within", {})
        for keys in (stage, path, within):
            if isinstance(keys, dict) and "time" in keys:
                keys["time"] = scaled(str(keys["time"]), factor)
        _slow(path, factor)
        axes = stage.get("axes", {})
        for axis in axes.values() if isinstance(axes, dict) else ():
            _slow(axis, factor)

    def soften(self, factor: float) -> None:
        """Multiplies the stiffness of all contacts, to which gains of force loops are relative."""
        for keys in self.world.values():
            if isinstance(keys, dict) and "stiffness" in keys:
                keys["stiffness"] = scaled(str(keys["stiffness"]), factor, digits=9)

    # --- slips ---------------------------------------------------------------------------------

    def _slip(self) -> None:
        """One thing that is not as it should be; which one is drawn until one fits."""
        slips = {
            "gain": self._gain,
            "fast": self._fast,
            "far": self._far,
            "limit": self._limit,
            "time": self._time,
            "guard": self._guard,
            "late": self._late,
        }
        for name in self.rng.permutation(list(slips), axis=0):
            if slips[str(name)]():
                self.slip = str(name)
                return

    def _gain(self) -> bool:
        """A gain that was given is too high; see `gains`."""
        self.given = True
        return True

    def gains(self) -> dict[str, Value]:
        made = super().gains()
        leaves = list(_leaves(made))
        if self.slip == "gain" and leaves:
            holder, key = leaves[int(self.rng.integers(len(leaves)))]
            holder[key] = scaled(str(holder[key]), self.spread(1.3, 8))
        if self.gain_factor != 1.0:
            for holder, key in leaves:
                holder[key] = scaled(str(holder[key]), self.gain_factor, digits=9)
        return made

    def _axes(self, *keys: str) -> list[tuple[dict[str, Value], str]]:
        """Entries of axes and paths of one of these keys, with what holds them."""
        return [(h, k) for s in self.stages.values() for h, k in _leaves(s) if k in keys]

    def _pick(
        self, entries: Sequence[tuple[dict[str, Value], str]]
    ) -> tuple[dict[str, Value], str] | None:
        return entries[int(self.rng.integers(len(entries)))] if entries else None

    def _fast(self) -> bool:
        """A motion several times as fast."""
        picked = self._pick(self._axes("velocity", "speed"))
        if picked is None:
            return False
        holder, key = picked
        holder[key] = scaled(str(holder[key]), self.spread(2, 15))
        return True

    def _far(self) -> bool:
        """A way several times as long."""
        picked = self._pick(self._axes("move"))
        if picked is None:
            return False
        holder, key = picked
        holder[key] = scaled(str(holder[key]), self.spread(3, 20))
        return True

    def _limit(self) -> bool:
        """A limit that is close to what is wanted, or below."""
        kind = self.one_of(("force", "speed"))
        most = {"force": f"{self.press_force * self.between(0.7, 1.6):.3g} N"}
        self.limits[kind] = most.get(kind) or f"{round(self.spread(15, 120))} mm/s"
        return True

    def _time(self) -> bool:
        """A stage that has too little time, or way."""
        within = [s["within"] for s in self.stages.values() if isinstance(s.get("within"), dict)]
        leaves = [leaf for each in within for leaf in _leaves(each)]
        picked = self._pick(leaves)
        if picked is None:
            return False
        holder, key = picked
        holder[key] = scaled(str(holder[key]), self.spread(0.1, 0.8))
        return True

    def _guard(self) -> bool:
        """A guard on a force that the stage hardly comes to, or a failure where it is well."""
        for name in ("press", "slide"):
            stage = self.stages.get(name, {})
            if "time" in stage:
                bound = self.press_force * self.between(0.6, 1.8)
                if self.chance(0.5):
                    stage["fail_if"] = f"abs({self.felt}) > {bound:.2g} N for 20 ms"
                else:
                    stage["within"] = {"time": str(stage.pop("time"))}
                    stage["until"] = f"abs({self.felt}) > {bound:.2g} N"
                return True
        return False

    def _late(self) -> bool:
        """A sensor that is later than the gains were thought for."""
        sensor = self.robot.get("sensor", {})
        assert isinstance(sensor, dict)
        self.robot["sensor"] = {**sensor, "delay": f"{self.between(3, 15):.2g} ms"}
        return True


def _leaves(value: Value) -> Iterator[tuple[dict[str, Value], str]]:
    """Mappings and keys of all quantities under a value."""
    if isinstance(value, dict):
        for key, each in value.items():
            if isinstance(each, str) and _NUMBER.match(each):
                yield value, key
            else:
                yield from _leaves(each)


def _slow(reference: Value, factor: float) -> None:
    """Makes a reference go the same way more slowly."""
    if not isinstance(reference, dict):
        return
    for key in ("position", "velocity", "force", "torque"):
        if key in reference:
            text = _TIME.sub(f"(t/{factor:g})", str(reference[key]))
            reference[key] = f"({text})/{factor:g}" if key == "velocity" else text
    if "speed" in reference:
        reference["speed"] = scaled(str(reference["speed"]), 1 / factor)


def main() -> int:
    """Writes one file, or several, to the screen."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seed", type=int)
    parser.add_argument("numbers", type=int, nargs="+")
    arguments = parser.parse_args()
    texts = (truth_task(arguments.seed, number) for number in arguments.numbers)
    sys.stdout.write("---\n".join(texts))
    return 0


if __name__ == "__main__":
    sys.exit(main())
