"""Random plausible tasks, as an engineer would write them: every robot, law, shape and sensor.

A task is its number: `random_task(7)` is the same text however many tasks are made. It depends on
nothing but NumPy's generator, so that two versions of the compiler are given the same files.

    python campaigns/random_tasks.py --tasks 20 --out FOLDER
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from draws import Draws
from numpy.typing import NDArray

Vector = NDArray[np.float64]
#: A value of a task file: text as it stands there, or what `flow` writes.
Value = str | Sequence["Value"] | Mapping[str, "Value"]

LAWS = (
    "hybrid",
    "hybrid-multipliers",
    "hybrid-reaction",
    "parallel",
    "parallel-pid",
    "impedance",
    "impedance-natural",
    "pd",
    "pd-joint",
    "stiffness",
)
_LOOPED = LAWS[:5]
_MULTIPLIERS = ("hybrid-multipliers", "hybrid-reaction")
#: Laws that damp no axis, or the joints alone.
_BARE = ("pd-joint", "stiffness")

_TABLE = """\
# an outline: there, around a corner and back
x [mm], y [mm]
0, 0
12, 0
24, 4
24, 14
12, 20
0, 16
-6, 8
0, 0
"""
_TIMED = """\
t [s], x [mm], y [mm], rz [deg]
0, 0, 0, 0
0.4, 8, 0, 2
0.9, 16, 6, 6
1.4, 10, 12, 3
1.8, 0, 8, 0
"""
#: Files that tasks refer to, by their name beside the task.
COMPANIONS = {"outline.csv": _TABLE, "timed.csv": _TIMED}


def random_task(number: int) -> str:
    """Returns the text of random task `number`."""
    return Draft(number).text()


def write_tasks(folder: Path, numbers: Sequence[int]) -> list[Path]:
    """Writes random tasks, and the files that they refer to, into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in COMPANIONS.items():
        (folder / name).write_text(text, "utf-8")
    paths = [folder / f"random-{number:04}.yaml" for number in numbers]
    for path, number in zip(paths, numbers, strict=True):
        path.write_text(random_task(number), "utf-8")
    return paths


def flow(value: Value) -> str:
    """Returns a value in YAML's flow style."""
    if isinstance(value, str):
        return value
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_inside(each)}" for key, each in value.items()) + "}"
    return "[" + ", ".join(_inside(each) for each in value) + "]"


def _inside(value: Value) -> str:
    """Returns a value that stands within braces or brackets, where a comma would end it."""
    text = flow(value)
    return f'"{text}"' if "," in text and text[0] not in '[{"' else text


def rotation(rpy: Sequence[float]) -> Vector:
    """(3, 3) of angles about the fixed axes x, y, z in this order [deg]."""
    (sa, sb, sc), (ca, cb, cc) = (f(np.radians(rpy)) for f in (np.sin, np.cos))
    about_x = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    about_z = np.array([[cc, -sc, 0], [sc, cc, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


def mm(value: float) -> str:
    """A length [mm]."""
    return "0" if abs(value) < 5e-4 else f"{round(value, 3):g} mm"


def deg(value: float) -> str:
    """An angle [deg]."""
    return "0" if abs(value) < 5e-4 else f"{round(value, 3):g} deg"


def lengths(values: Sequence[float] | Vector) -> list[str]:
    """Several lengths [mm]."""
    return [mm(float(v)) for v in values]


def angles(values: Sequence[float] | Vector) -> list[str]:
    """Several angles [deg]."""
    return [deg(float(v)) for v in values]


_PANDA_HOME = (0.0, -6.0, 0.0, -130.0, 0.0, 124.0, 45.0)


class Draft(Draws):
    """One random task as it is being written.

    Attributes:
        kind: of scene, drawn by `text`. name: of the task.
        normal: the axis of the frame along which the tool presses. sign: of a press on it.
        across: the other translations. at: of the tip at the start in the frame, where positions
            count from the frame's origin, else 0 [mm]. touch: the same along `normal` on contact.
    """

    def __init__(self, number: int, *campaign: int) -> None:
        """The draft of a number; in another campaign the same number has other draws."""
        self.name = "-".join(map(str, ("random", *campaign, number)))
        super().__init__(*(campaign or (11,)), number)
        self.kind = self.about = ""
        self.robot: dict[str, Value] = {}
        self.world: dict[str, Value] = {}
        self.frames: dict[str, Value] = {}
        self.stages: dict[str, dict[str, Value]] = {}
        self.limits: dict[str, str] = {}
        self.vary: dict[str, Value] = {}
        self.expect: list[str] = []
        self.frame, self.normal, self.sign, self.across = "world", "z", -1, ["x", "y"]
        self.at, self.touch = {"x": 0.0, "y": 0.0}, 0.0
        self.stiffness, self.radius, self.spatial, self.flat = 20.0, 10.0, True, False
        self.law = "hybrid"
        self.turns, self.moves, self.given, self.press_force = False, False, False, 10.0

    # --- draws -------------------------------------------------------------------------------

    def nice(self, low: float, high: float, unit: str, digits: int = 2) -> str:
        """A quantity as one writes it, spread over a range."""
        return f"{float(f'{self.spread(low, high):.{digits}g}'):g} {unit}".strip()

    # --- the file ----------------------------------------------------------------------------

    def text(self) -> str:
        """Returns the text of the task."""
        self.draw()
        return self.written()

    def scenes(self) -> dict[str, tuple[float, Callable[[], None]]]:
        """Kinds of scenes: how often each is drawn, and what draws it."""
        return {
            "surface": (0.44, self._surface),
            "planar": (0.12, self._planar),
            "mechanism": (0.12, self._mechanism),
            "equation": (0.08, self._equation),
            "air": (0.08, self._air),
            "loose": (0.05, self._loose),
            "probe": (0.05, self._probe),
            "felt": (0.03, self._felt),
            "corner": (0.03, self._corner),
        }

    def draw(self) -> None:
        """Draws everything but the gains."""
        scenes = self.scenes()
        self.rates()
        self.qp = self.chance(0.12)
        self.kind = self.scene()
        scenes[self.kind][1]()
        self.about = self.about or self.kind

    def scene(self) -> str:
        """Draws the kind of the scene."""
        scenes = self.scenes()
        return self.one_of(list(scenes), [share for share, _ in scenes.values()])

    def written(self) -> str:
        """Returns what was drawn as a file; gains are drawn here."""
        lines = ["taskspec: 1", f"name: {self.name}", f"about: {self.about}", "", "robot:"]
        lines += [f"  {key}: {flow(value)}" for key, value in self.robot.items()]
        for name, entries in (("world", self.world), ("frames", self.frames)):
            if entries:
                lines += ["", f"{name}:"]
                lines += [f"  {key}: {flow(value)}" for key, value in entries.items()]
        lines += ["", f"frame: {self.frame}", f"law: {flow(self._law())}"]
        if self.limits:
            lines.append(f"limits: {flow(self.limits)}")
        if self.control:
            lines.append(f"control: {flow(self.control)}")
        lines += ["", "stages:"]
        for name, stage in self.stages.items():
            lines.append(f"  {name}:")
            lines += [f"    {key}: {flow(value)}" for key, value in stage.items()]
        lines += ["", "expect:" if self.expect else "expect: []"]
        lines += [f"  - {each}" for each in self.expect]
        if self.vary:
            lines += ["", "vary:"]
            lines += [f"  {key}: {flow(value)}" for key, value in self.vary.items()]
        return "\n".join(lines) + "\n"

    # --- robot, sensor, rates ----------------------------------------------------------------

    def rates(self) -> None:
        rate = int(self.one_of(("1000", "500", "2000", "250", "800"), (50, 16, 18, 9, 7)))
        self.period = 1 / rate
        self.control: dict[str, Value] = {}
        if rate != 1000 or self.chance(0.1):
            self.control["rate"] = f"{rate / 1000:g} kHz" if rate >= 1000 else f"{rate} Hz"
        if self.chance(0.15):
            self.control["plant_rate"] = f"{rate * int(self.one_of('248')) / 1000:g} kHz"

    def mount(self, models: Sequence[str] = ("panda", "ur5e"), *, flat: bool = False) -> None:
        """The arm and its tool; `flat`: whether the tool may have a flat face."""
        self.model = self.one_of(models)
        self.spatial = not self.model.startswith("planar")
        self.robot["model"] = self.model
        if self.spatial and self.chance(0.06):
            self.robot["base"] = {"rpy": ["0", "0", deg(round(self.between(-25, 25)))]}
        shape = "sphere"
        if self.spatial and flat:
            shape = self.one_of(("sphere", "cylinder", "box"), (5, 1, 1))
        self.flat = shape != "sphere"
        self.radius = round(self.between(5, 15))
        tool: dict[str, Value] = {"shape": shape}
        if shape == "box":
            tool["size"] = [mm(round(self.between(16, 40))) for _ in range(3)]
        else:
            tool["radius"] = mm(self.radius)
        if self.spatial:
            tool["length"] = mm(round(self.between(80, 150)))
        if self.chance(0.85):
            tool["mass"] = f"{round(self.between(50, 600), -1):g} g"
        self.robot["tool"] = tool
        if self.chance(0.05):
            self.robot["balanced"] = "true"
        if self.chance(0.1):
            self.robot["joint_damping"] = self.nice(0.1, 1, "N*m*s/rad")
        if self.model == "panda" and self.chance(0.06):
            posture = np.array(_PANDA_HOME) + self.rng.uniform(-8, 8, 7)
            self.robot["posture"] = angles(np.round(posture, 1))

    def sense(self) -> None:
        """Some arms have a real sensor; what is late in it bounds the gains that are given."""
        self.lag = 2 * self.period
        if not self.chance(0.35):
            return
        sensor: dict[str, Value] = {}
        if self.chance(0.5):
            sensor["at"] = "wrist" if self.chance(0.8) else "contact"
        if self.chance(0.45):
            force = self.nice(0.01, 0.2, "N")
            pair: Value = {"force": force, "torque": self.nice(0.5, 5, "mN*m")}
            sensor["noise"] = force if self.chance(0.5) else pair
        if self.spatial and self.chance(0.35):
            forces = [f"{round(self.between(-3, 3), 1):g} N" for _ in range(3)]
            moments = [f"{round(self.between(-30, 30)):g} mN*m" for _ in range(3)]
            sensor["bias"] = [*forces, *moments]
            self.stages["zero"] = {"tare": "true", "time": f"{self.between(0.15, 0.4):.2f} s"}
        if self.chance(0.35):
            corner = round(self.between(40, 200), -1)
            sensor["filter"] = f"{corner:g} Hz"
            self.lag += 1 / (2 * math.pi * corner)
        if self.chance(0.35):
            rate = min(float(self.one_of(("250", "500", "1000"))), 1 / self.period)
            sensor["rate"] = f"{rate:g} Hz"
            self.lag += 0.5 / rate
        if self.chance(0.35):
            delay = round(self.between(0.5, 4), 1)
            sensor["delay"] = f"{delay:g} ms"
            self.lag += delay / 1e3
        if sensor:
            self.robot["sensor"] = sensor

    def contact(self, low: float = 1, high: float = 300) -> dict[str, Value]:
        """What a surface is made of."""
        slow = self.lag > 2.5 * self.period + 1e-3
        self.stiffness = float(f"{self.spread(low, min(high, 60) if slow else high):.2g}")
        if self.chance(0.03):
            self.stiffness = 200.0
            return {"stiffness": "rigid", **self._friction()}
        made: dict[str, Value] = {"stiffness": f"{self.stiffness:g} kN/m"}
        if self.chance(0.75):
            damping = self.between(0.05, 0.25) * 2 * math.sqrt(self.stiffness * 1e3)
            made["damping"] = f"{float(f'{damping:.2g}'):g} N*s/m"
        return {**made, **self._friction()}

    def _friction(self) -> dict[str, Value]:
        return {"friction": f"{self.between(0, 0.6):.2f}"} if self.chance(0.65) else {}

    def force(self) -> float:
        """How strongly to press [N]."""
        self.press_force = float(f"{self.spread(3, 30):.2g}")
        return self.press_force

    # --- laws and limits ---------------------------------------------------------------------

    def choose_law(self, laws: Sequence[str] = LAWS) -> None:
        shares = [3 if law == "hybrid" else 1.5 if law in _LOOPED else 1 for law in laws]
        self.law = self.one_of(laws, shares)
        self.given = self.chance(0.45)
        if self.law == "stiffness":
            # It carries no weight and damps nothing: for arms that do both themselves.
            self.robot["balanced"] = "true"
            high = (20, 30) if self.spatial else (4, 8)
            self.robot["joint_damping"] = self.nice(*high, "N*m*s/rad")

    def _law(self) -> Value:
        keys: dict[str, Value] = {"kind": self.law}
        if self.qp:
            keys["solve"] = "qp"
            if self.chance(0.15):
                keys["solver"] = "osqp"
        if self.given:
            keys.update(self.gains())
        if self.model == "panda" and self.law not in _BARE and self.chance(0.15):
            goals = ("posture", "joint-limits", "manipulability")
            keys["null_space"] = (
                ["posture", self.one_of(goals[1:])] if self.chance(0.4) else self.one_of(goals)
            )
        if self._fixed_frame() and self.law not in _MULTIPLIERS and self.chance(0.06):
            keys["orientation"] = "rpy"
        return self.law if list(keys) == ["kind"] else keys

    def _fixed_frame(self) -> bool:
        stages = self.stages.values()
        other = any("torque" in flow(s.get("axes", "")) or "frame" in s for s in stages)
        return self.spatial and not self.turns and not other

    def gains(self) -> dict[str, Value]:
        """Gains near those that the textbook's rules give, some left to be designed."""
        return self._hybrid_gains() if self.law.startswith("hybrid") else self._spring_gains()

    def _most_damping(self) -> float:
        """What a damper may take that is held over a period, and that is late."""
        return 2 * self._mass() / (3 * max(self.lag, 2 * self.period))

    def _mass(self) -> float:
        return 2.0 if self.spatial else 1.2

    def _hybrid_gains(self) -> dict[str, Value]:
        most = min(2 * math.sqrt(self._mass() * self.stiffness * 1e3), self._most_damping())
        damping = self.between(0.4, 0.9) * most
        made: dict[str, Value] = {}
        if self.chance(0.6):
            made["bandwidth"] = self.nice(2, 8, "Hz")
        if self.chance(0.4):
            ratio = f"{self.between(0.7, 1.2):.2f}"
            pair = {"linear": ratio, "angular": "1"}
            made["damping_ratio"] = pair if self.spatial and self.chance(0.4) else ratio
        loop: dict[str, Value] = {}
        if self.chance(0.7):
            loop["damping"] = {self.normal: f"{damping:.3g} N*s/m"}
        if self.law == "hybrid-reaction":
            if self.chance(0.6):
                loop["proportional"] = f"{self.between(0.1, 0.6):.2f}"
        elif loop or self.chance(0.5):
            loop["integral"] = f"{self._integral(damping):.3g} /s"
        return {**made, "force": loop} if loop else made

    def _spring_gains(self) -> dict[str, Value]:
        apparent = self.law in ("impedance", "parallel")
        M = self.between(1.5, 5) if apparent else 1.5 * self._mass()
        K = float(f"{self.spread(300, 2000):.2g}")
        made: dict[str, Value] = {}
        if apparent and self.chance(0.7 if self.law == "impedance" else 0.4):
            made["mass"] = {"linear": f"{M:.2g} kg"}
        stiffness = {"linear": f"{K:g} N/m"}
        if self.spatial and self.chance(0.25):
            stiffness["angular"] = self.nice(30, 120, "N*m/rad")
        made["stiffness"] = stiffness
        if self.law in _BARE:
            if self.law == "pd-joint" and self.chance(0.3):
                made["damping"] = self.nice(4, 9, "N*m*s/rad")
            return made
        against = K + (1 if apparent else 0.3) * self.stiffness * 1e3
        most = M / (3 * self.period) if apparent else self._most_damping()
        damping = min(self.between(1.2, 2) * math.sqrt(M * against), 0.9 * most)
        if "mass" in made or self.chance(0.6):
            made["damping"] = {self.normal: f"{damping:.3g} N*s/m"}
        if self.law in _LOOPED and self.chance(0.7):
            loop = {"integral": f"{self._integral(damping):.3g} /s"}
            if self.law == "parallel" and self.chance(0.4):
                loop["proportional"] = f"{self.between(0.6, 1):.2f}"
            made["force"] = loop
        return made

    def _integral(self, damping: float) -> float:
        """A force integral [1/s] that a contact of this stiffness bears."""
        return self.between(0.3, 0.9) * min(15.0, self.stiffness * 1e3 / (6 * damping))

    def bound(self) -> None:
        """Limits with room above what is commanded."""
        if self.chance(0.88) or self.qp:
            self.limits["force"] = f"{round(2.5 * self.press_force + self.between(25, 60)):g} N"
            self.limits["speed"] = f"{round(self.between(220, 400), -1):g} mm/s"
            if self.chance(0.2) and self.spatial:
                self.limits["torque"] = f"{round(self.between(8, 20)):g} N*m"
            if self.chance(0.1) and self.law in ("hybrid", *_MULTIPLIERS):
                self.limits["deviation"] = "25 mm"
        if self.qp and self.chance(0.5):
            self.limits["torque_rate"] = f"{round(self.spread(500, 4000), -2):g} N*m/s"

    # --- stages on a surface -----------------------------------------------------------------

    @property
    def felt(self) -> str:
        return f"force.{self.normal}"

    def pressing(self, force: float) -> Value:
        """The axis that presses with a force [N], or nearly, on the surface."""
        kinds = ("constant", "swell", "ramp") if self.law in _LOOPED else ("constant", "depth")
        known = any("shape" in flow(each) for each in self.world.values())
        open_loop = (3 if known else 0, 2)
        kind = self.one_of(kinds, (6, 1, 2) if self.law in _LOOPED else open_loop)
        if kind == "depth":
            depth = force / (self.stiffness * 1e3) + force / 1200
            return {"position": mm(self.touch + self.sign * 1e3 * depth)}
        if kind == "swell":
            swell = f"{0.3 * force:.2g} N * sin(2*pi*t/({self.between(0.8, 2):.2g} s))"
            return {"force": f"{'-' if self.sign < 0 else ''}({force:g} N + {swell})"}
        axis: dict[str, Value] = {"force": f"{self.sign * force:g} N"}
        if kind == "ramp" or (self.law not in _LOOPED and self.chance(0.5)):
            axis["ramp"] = f"{self.between(0.1, 0.6):.1f} s"
        return axis

    def approach(self, gap: float, *, slow: float = 1.0) -> None:
        """Towards the surface until it is felt; `gap` [mm] to go."""
        impact = 12 / math.sqrt(3 * self.stiffness * 1e3) * 1e3
        speed = round(min(self.between(12, 40), max(impact, 5)) * slow)
        speed = max(speed, 4)
        s, f = self.sign, self.felt
        sense = "<" if s < 0 else ">"
        most = max(1.0, min(2.5, 0.3 * self.press_force))
        untils = (
            f"{f} {sense} {s * most:.2g} N for {round(self.between(4, 20)):g} ms",
            f"{f} {sense} {s * most:.2g} N",
            "touching for 10 ms",
            f"norm(force) > {most:.2g} N for 5 ms",
            f"abs({f}) > {most:.2g} N and t > 20 ms",
            f"max(abs({f})) > {most:.2g} N",
        )
        until = self.one_of(untils, (6, 3, 2, 2, 1, 1))
        velocity = f"{s * speed} mm/s"
        if self.chance(0.15):
            velocity = f"{s * speed} mm/s * smooth(t/(0.2 s))"
        axes: dict[str, Value] = {self.normal: {"velocity": velocity}}
        if self.law in ("parallel", "parallel-pid") and self.chance(0.2):
            axes = {self.normal: {"velocity": f"{s * speed} mm/s", "force": "0"}}
        within: dict[str, Value] = {"time": f"{math.ceil(2 * gap / speed + 1.5):g} s"}
        if self.chance(0.6):
            within["travel"] = mm(round(gap + 20))
        self.stages["approach"] = {"axes": axes, "until": until, "within": within}

    def press(self, force: float) -> None:
        """Press and let the force settle."""
        pressing = self.pressing(force)
        stage: dict[str, Value] = {"axes": {self.normal: pressing, **self.turning()}}
        if self.law in _LOOPED and self.chance(0.2):
            off = f"{self.felt} {'+' if self.sign < 0 else '-'} {force:g} N"
            calm = f"abs({off}) < {max(0.5, 0.1 * force):.2g} N"
            pick = self.one_of(("calm", "look", "still"))
            if pick == "calm":
                stage["until"] = f"{calm} for {round(self.between(50, 200)):g} ms"
            elif pick == "look":
                stage["until"] = f"max(abs({self.felt})) > {0.8 * force:.2g} N and t > 0.3 s"
            else:
                stage["until"] = f"({calm} and speed < 5 mm/s) for 50 ms"
            stage["within"] = {"time": f"{self.between(1.5, 3):.1f} s"}
            if self.chance(0.5):
                stage["fail_if"] = "not touching for 0.3 s"
            stage["on_fail"] = "leave"
        else:
            stage["time"] = f"{self.between(0.5, 1.5):.1f} s"
            if self.law in _LOOPED and "sin" not in flow(pressing):
                self.expect.append(f"last(press.{self.felt}) within {self.sign * force:g} +- 2 N")
        self.stages["press"] = stage

    def turning(self) -> dict[str, Value]:
        """What some rotations do while the tool presses."""
        if not self.spatial:
            return {}
        if self.flat and self.law in _LOOPED and self.chance(0.5):
            return {"rx": {"torque": "0"}, "ry": {"torque": "0"}}
        if self.flat or not self.chance(0.15):
            return {}
        kind = self.one_of(("rock", "spin", "turn"))
        if kind == "rock":
            size = f"{round(self.between(2, 8))} deg"
            return {self.one_of(("rx", "ry")): {"position": f"{size} * sin(2*pi*t/(1.5 s))"}}
        if kind == "spin":
            return {"rz": {"velocity": f"{round(self.between(-20, 20))} deg/s"}}
        return {"rz": {"move": deg(round(self.between(-20, 20))), "speed": "20 deg/s"}}

    def slide(self, force: float, reach: float = 25) -> None:
        """Along the surface, pressing; at most `reach` [mm] from where it touched."""
        axes: dict[str, Value] = {self.normal: self.pressing(force)}
        stage: dict[str, Value] = {"axes": axes}
        kind = self.one_of(("axes", "path"), (3, 2))
        if kind == "path" and len(self.across) == 2:
            stage["path"] = self.path(reach)
        else:
            ways = [axis for axis in self.across if self.chance(0.65)] or self.across[:1]
            for axis in ways:
                axes[axis] = self.way(axis, reach, force)
            axes.update(self.turning())
            stage["time"] = f"{self.between(0.8, 2):.1f} s"
        if self.chance(0.1):
            stage["fail_if"] = f"norm(force) > {3 * force + 20:.3g} N for 20 ms"
            stage["on_fail"] = "leave"
        self.stages["slide"] = stage
        if "depth" not in axes and self.law in _LOOPED and force > 4:
            band = f"within {self.sign * force:g} +- {max(1.0, 0.2 * force):.2g} N"
            self.expect.append(f"slide.{self.felt} {band} for {round(self.between(60, 95))} %")

    def way(self, axis: str, reach: float, force: float) -> Value:
        """How one axis goes along a surface."""
        kinds = ["sine", "velocity", "move", "soft", "drag", "felt", "hold"]
        shares = [4.0, 3, 3, 1, 0.7, 0.7, 0.7]
        if self.law in _MULTIPLIERS:
            shares[3] = 0
        if self.law not in ("hybrid", "parallel"):
            shares[4] = 0
        kind = self.one_of(kinds, shares)
        size, start = self.between(0.3, 1) * reach, self.at.get(axis, 0.0)
        if kind == "sine":
            period = self.between(1, 2.5)
            centre = f"{mm(start)} + " if abs(start) > 1e-3 else ""
            return {"position": f"{centre}{size:.2g} mm * sin(2*pi*t/({period:.2g} s))"}
        if kind == "velocity":
            return {"velocity": f"{self.rng.choice((-1, 1)) * size / 2:.2g} mm/s"}
        if kind == "move":
            speed = round(self.between(20, 80))
            return {"move": f"{self.rng.choice((-1, 1)) * size:.2g} mm", "speed": f"{speed} mm/s"}
        if kind == "soft":
            soft: dict[str, Value] = {"hold": "start", "stiffness": self.nice(300, 900, "N/m")}
            if self.law not in _BARE and self.chance(0.5):
                soft["damping"] = self.nice(40, 80, "N*s/m")
            return soft
        if kind == "drag":
            return {"force": f"{0.1 * force:.2g} N"} if self.qp else {"force": "0"}
        if kind == "felt":
            return {"velocity": f"{size / 3:.2g} mm/s * smooth(norm(force)/(2 N))"}
        return "hold"

    def path(self, reach: float) -> Value:
        """A curve over the surface."""
        kind = self.one_of(
            ("line", "arc", "lissajous", "raster", "spiral", "waypoints", "file", "timed"),
            (3, 2, 3, 1, 1, 1, 1, 0.5),
        )
        x, y = (self.at[axis] for axis in self.across)
        way = self.rng.uniform(0.4, 1, 2) * reach * self.rng.choice((-1, 1), 2)
        clock: dict[str, Value] = {"time": f"{self.between(1, 2.5):.1f} s"}
        pace: dict[str, Value] = {"speed": f"{round(self.between(20, 80))} mm/s"}
        if kind == "line":
            return {"line": {"by": lengths(np.round(way, 1))}, **(clock if way[0] > 0 else pace)}
        if kind == "arc":
            turns = f"{self.between(0.2, 1) * float(self.rng.choice((-1, 1))):.2g}"
            centre = [mm(round(x + 0.4 * way[0], 1)), mm(round(y, 1))]
            return {"arc": {"center": centre, "turns": turns}, **pace}
        if kind == "lissajous":
            ways = [str(int(n)) for n in self.rng.integers(1, 3, 2)]
            clock = {"time": f"{self.between(1.5, 2.5):.1f} s"}
            return {
                "lissajous": {"amplitude": lengths(np.round(abs(way), 1)), "turns": ways},
                **clock,
            }
        if kind == "raster":
            pitch = mm(round(float(abs(way).min()) / self.between(1, 4), 1))
            along = str(self.one_of(("x", "y"), (1, 1)))
            return {"raster": {"size": lengths(np.round(way, 1)), "pitch": pitch, "along": along},
                    **pace}  # fmt: skip
        if kind == "spiral":
            size = float(abs(way).min())
            pitch = mm(round(size / self.between(1, 4), 2))
            return {"spiral": {"pitch": pitch, "radius": mm(round(size, 1))}, **pace}
        if kind == "waypoints":
            corners = [(x, y), (x + way[0], y), (x + way[0], y + way[1])]
            radius = mm(round(float(abs(way).min()) * self.between(0, 0.9), 2))
            points: list[Value] = [lengths(np.round(corner, 1)) for corner in corners]
            return {"waypoints": {"points": points, "radius": radius}, **pace}
        if abs(x) + abs(y) > 1e-3:  # a table counts from the origin of a frame that is fixed
            return {"to": lengths(np.round((x + way[0], y + way[1]), 1)), **pace}
        return {"file": "outline.csv", **pace} if kind == "file" else {"file": "timed.csv"}

    def leave(self) -> None:
        """Off the surface."""
        axis: dict[str, Value] = {"move": mm(-self.sign * round(self.between(10, 40)))}
        if self.chance(0.6):
            axis["speed"] = f"{round(self.between(50, 150), -1):g} mm/s"
        self.stages["leave"] = {"axes": {self.normal: axis}}

    # --- scenes ------------------------------------------------------------------------------

    def place(self) -> Vector:
        """A point where a spatial arm works well [mm]."""
        low, high = ((420, -140, 200), (560, 140, 400))
        if self.model == "ur5e":
            low, high = ((380, 0, 120), (500, 180, 300))
        return np.round([self.between(a, b) for a, b in zip(low, high, strict=True)])

    def _tilted(self, most: float) -> tuple[float, float, float]:
        if self.chance(0.5) or most == 0:
            return (0.0, 0.0, 0.0)
        angle = round(self.between(-most, most), 1)
        return (angle, 0.0, 0.0) if self.chance(0.5) else (0.0, angle, 0.0)

    def _surface(self) -> None:
        """Onto a shape, press, along it, and off again."""
        shape = self.one_of(("plane", "box", "cylinder", "sphere"), (45, 25, 15, 15))
        curved = shape in ("cylinder", "sphere")
        self.mount(flat=not curved)
        self.sense()
        self.choose_law()
        contact = self.contact()
        touch, tilt = self.place(), self._tilted(20 if curved else 15)
        gap = round(self.between(2, 12), 1)
        tip = self._start(touch, tilt, gap, curved)
        origin = self._put("work", shape, touch, tilt, contact)
        if not curved and self.chance(0.2):
            self._moving("work")
        self._look_from(curved, tilt, touch, tip, origin, gap)
        if self.chance(0.22):
            self._beside(touch)
        force = self.force()
        self.approach(gap, slow=1.0)
        if self.chance(0.7):
            self.press(force)
        if "press" not in self.stages or self.chance(0.7):
            self.slide(force, 25 if not curved else 15)
        self.leave()
        self.bound()
        self._uncertain()
        self.expect.append(f"max(norm(force)) < {round(3 * force + 40)} N")
        self.about = f"Press on a {shape} and leave it."

    def _start(
        self, touch: Vector, tilt: tuple[float, float, float], gap: float, curved: bool
    ) -> Vector:
        """Where the tip begins: `gap` above the surface, pointing down or against the normal."""
        normal = rotation(tilt)[:, 2]
        leaning = self.flat or (any(tilt) and self.chance(0.3))
        rpy = (180 + tilt[0], tilt[1], 0.0)
        if not leaning and not curved and self.chance(0.1):
            rpy, leaning = (180.0, round(self.between(-12, 12)), 0.0), True
        pointing = rotation(rpy)[:, 2] if leaning else np.array([0.0, 0.0, -1.0])
        if self.flat:
            tip = touch + gap * normal
        else:
            tip = touch + (self.radius + gap) * normal + self.radius * pointing
        start: dict[str, Value] = {"xyz": lengths(np.round(tip, 2))}
        if leaning:
            start["rpy"] = angles(rpy)
        elif self.chance(0.2):
            start["rpy"] = ["180 deg", "0", "0"]
        self.robot["start"] = start
        return np.asarray(tip)

    def _put(
        self,
        name: str,
        shape: str,
        touch: Vector,
        tilt: tuple[float, float, float],
        contact: Mapping[str, Value],
    ) -> Vector:
        """Adds a shape that has its surface at a point; returns its origin [mm]."""
        normal = rotation(tilt)[:, 2]
        keys: dict[str, Value] = {"shape": shape}
        rpy: tuple[float, ...] = tilt
        if shape == "plane":
            origin = touch if any(tilt) or self.chance(0.3) else np.array([0.0, 0.0, touch[2]])
        elif shape == "box":
            size = np.round(self.rng.uniform((160, 160, 20), (300, 300, 100)), -1)
            keys["size"] = lengths(size)
            origin = touch - size[2] / 2 * normal
            if not any(tilt) and self.chance(0.2):
                rpy = (0.0, 0.0, float(round(self.between(-30, 30))))
        else:
            radius = round(self.between(90, 250), -1)
            keys["radius"] = mm(radius)
            origin = touch - radius * normal
            if shape == "cylinder":
                keys["length"] = mm(round(self.between(200, 400), -1))
                rpy = (0.0, 90.0, 0.0) if tilt[1] == 0 else (90.0, 0.0, 0.0)
            else:
                rpy = (0.0, 0.0, 0.0)
        keys["xyz"] = lengths(np.round(origin, 2))
        if any(rpy):
            keys["rpy"] = angles(rpy)
        self.world[name] = {**keys, **contact}
        self.turned = rpy
        return np.asarray(origin)

    def _moving(self, name: str) -> None:
        """Gives an object a motion that the controller knows."""
        wave = f"sin(2*pi*clock*{self.between(0.3, 1.5):.2g} Hz)"
        kind = self.one_of(("shake", "belt", "rock"), (3, 3, 1))
        motion: dict[str, Value] = {"z": f"{self.between(0.5, 3):.2g} mm * {wave}"}
        if kind == "belt":
            motion = {self.one_of("xy"): f"{round(self.between(-50, 50))} mm/s * clock"}
        if kind == "rock":
            motion = {self.one_of(("rx", "ry")): f"{self.between(0.3, 2):.2g} deg * {wave}"}
        objects = self.world[name]
        assert isinstance(objects, Mapping)
        self.world[name] = {**objects, "motion": motion}
        self.moves = True

    def _look_from(
        self,
        curved: bool,
        tilt: tuple[float, float, float],
        touch: Vector,
        tip: Vector,
        origin: Vector,
        gap: float,
    ) -> None:
        """The frame: over the surface, on the object, in the room, or in the tool."""
        kinds = ("surface", "object", "room", "placed", "tool")
        shares = [6.0, 2, 1.5, 1.5, 0.5]
        if curved or self.moves:
            shares[1:] = [0.0] * 4
        if any(tilt):
            shares[2] = shares[4] = 0
        kind = self.one_of(kinds, shares)
        if kind == "surface":
            keys: dict[str, Value] = {"surface": "work"}
            flat_world = flow(self.world["work"])
            if "sphere" in flat_world:
                keys["heading"] = self.one_of(("[1, 0, 0]", "[0, 1, 0]"))
            elif self.chance(0.2) and "cylinder" not in flat_world:
                keys["heading"] = self.one_of(("[1, 0, 0]", "[0, 1, 0]", "[1, 1, 0]"))
            self.frames["task"], self.frame = keys, "task"
            self.turns = curved or self.moves
            return
        if kind == "tool":
            self.frame, self.sign, self.turns = "tool", 1, True
            self.touch = gap
            return
        if kind == "object":
            self.frame, axes, where = "work", rotation(self.turned), origin
        elif kind == "room":
            axes, where = np.eye(3), np.zeros(3)
        else:
            wrong = np.round(self.rng.uniform(-2, 2, 3), 1) * (self.law != "parallel")
            rpy = np.array(tilt) + (wrong if self.chance(0.4) else 0)
            axes, where = rotation(rpy), np.round(touch + self.rng.uniform(-50, 50, 3))
            self.frames["bench"] = {"xyz": lengths(where), "rpy": angles(rpy)}
            self.frame = "bench"
        x, y, z = axes.T @ (tip - where)
        self.at, self.touch = {"x": float(x), "y": float(y)}, float(z - gap)

    def _beside(self, touch: Vector) -> None:
        """A second object beside the tool, which it does not touch."""
        keys = {"stiffness": self.nice(1, 100, "kN/m")}
        kind = self.one_of(("fence", "post", "block"), (2, 1, 2))
        side = float(self.rng.choice((-1, 1)))
        away = side * self.between(60, 140)
        if kind == "fence":
            self.world["fence"] = {
                "shape": "plane",
                "xyz": lengths((0, touch[1] + away, 0)),
                "rpy": [deg(90 * side), "0", "0"],
                **keys,
            }
        elif kind == "post":
            xyz = lengths((touch[0] + 20, touch[1] + away + 30 * side, touch[2]))
            sizes = {"radius": "20 mm", "length": "200 mm"}
            self.world["post"] = {"shape": "cylinder", "xyz": xyz, **sizes, **keys}
        else:
            xyz = lengths((touch[0], touch[1] + away + 30 * side, touch[2] + 20))
            sizes_of = {"size": ["120 mm", "40 mm", "80 mm"]}
            self.world["block"] = {"shape": "box", "xyz": xyz, **sizes_of, **keys}

    def _uncertain(self) -> None:
        if self.chance(0.12) and "work" in self.world and "rigid" not in flow(self.world["work"]):
            k = self.stiffness
            self.vary["world.work.stiffness"] = f"{0.7 * k:.2g}..{1.3 * k:.2g} kN/m"
            if self.chance(0.4):
                self.vary["world.work.friction"] = "0..0.4"
            if self.chance(0.4):
                self.vary["robot.tool.mass"] = "+- 50 g"

    def _planar(self) -> None:
        """A planar arm on a wall, a post or the side of a block."""
        self.mount(("planar2", "planar3"))
        self.sense()
        self.choose_law()
        contact = self.contact()
        x, y = round(self.between(330, 430)), round(self.between(-40, 140))
        start: dict[str, Value] = {"xyz": lengths((x, y, 0))}
        pointing = 0.0
        if self.model == "planar3":
            pointing = round(self.between(-15, 15))
            start["rpy"] = ["0", "0", deg(pointing)]
            self.across = ["y"]
        # The ball's side that faces the wall is ahead of the tip where the last link leans.
        ahead = self.radius * (1 - math.cos(math.radians(pointing)))
        gap = round(self.between(2, 8), 1) + (ahead if self.model == "planar3" else self.radius)
        self.robot["start"] = start
        self.normal, self.sign, self.across = "x", 1, ["y"]
        self.at, self.touch = {"y": float(y)}, x + gap
        shape = self.one_of(("plane", "cylinder", "box"), (3, 1, 1))
        if shape == "plane":
            rpy = ["0", "-90 deg", "0"]
            keys: dict[str, Value] = {"xyz": lengths((x + gap, 0, 0)), "rpy": rpy}
        elif shape == "cylinder":
            radius = round(self.between(150, 300), -1)
            keys = {"xyz": lengths((x + gap + radius, y, 0)), "radius": mm(radius)}
            keys["length"] = "100 mm"
        else:
            keys = {"xyz": lengths((x + gap + 50, y, 0)), "size": ["100 mm", "300 mm", "100 mm"]}
        self.world["wall"] = {"shape": shape, **keys, **contact}
        force = self.force()
        self.approach(gap)
        self.press(force)
        if self.chance(0.7):
            self.slide(force, 10 if shape == "cylinder" else 25)
        if self.model == "planar3" and self.chance(0.3):
            self.stages["press"]["axes"] = {
                "x": self.pressing(force),
                "rz": {"move": deg(round(self.between(-10, 10)))},
            }
        self.leave()
        self.bound()
        if self.chance(0.15) and "rigid" not in flow(contact):
            self.vary["world.wall.stiffness"] = (
                f"{0.8 * self.stiffness:.2g}..{self.stiffness:g} kN/m"
            )
        self.expect.append(f"max(norm(force)) < {round(3 * force + 40)} N")
        self.about = f"Press on a {shape} in the plane."

    def _air(self) -> None:
        """Ways through free space, and nothing to touch, or not near."""
        self.mount(("panda", "ur5e", "planar3", "planar2"), flat=True)
        self.sense()
        self.choose_law()
        if self.spatial:
            start = self.place()
            if self.chance(0.4):
                below = np.array([0, 0, start[2] - round(self.between(60, 120))])
                self.world["floor"] = {"shape": "plane", "xyz": lengths(below)}
        else:
            start = np.round([self.between(330, 430), self.between(-40, 140), 0])
        self.robot["start"] = {"xyz": lengths(start)}
        if self.model == "planar3":
            self.robot["start"] = {"xyz": lengths(start), "rpy": ["0", "0", "0"]}
        self.at = {"x": float(start[0]), "y": float(start[1])}
        if self.chance(0.5):
            self.stages["go"] = {"path": self.path(40)}
        else:
            axes = {axis: self.way(axis, 40, 0) for axis in ("x", "y")}
            self.stages["go"] = {"axes": axes, "time": f"{self.between(0.8, 1.8):.1f} s"}
        if self.spatial and self.chance(0.5):
            frame = {"parent": "tool", "xyz": ["0", "0", "20 mm"]}
            if self.chance(0.5):
                frame["point"] = "origin"
            self.frames["grip"] = frame
            turn = {self.one_of(("rx", "ry", "rz")): {"move": deg(round(self.between(-20, 20)))}}
            self.stages["swing"] = {"frame": "grip", "axes": turn}
        if self.chance(0.5):
            self.stages["wait"] = {"time": f"{self.between(0.2, 0.6):.1f} s"}
        if self.chance(0.4):
            self.stages["back"] = {
                "path": {"to": lengths(start[:2]), "speed": f"{round(self.between(30, 90))} mm/s"}
            }
        self.press_force = 5
        self.bound()
        self.expect.append("max(norm(force)) < 1 N")
        self.about = "Go through the air."

    def _probe(self) -> None:
        """Touch, settle, back off, and again."""
        self.mount()
        self.sense()
        self.choose_law(("hybrid", "hybrid-multipliers", "parallel", "hybrid-reaction"))
        contact = self.contact(5, 100)
        touch = self.place()
        gap = round(self.between(2, 8), 1)
        self._start(touch, (0.0, 0.0, 0.0), gap, True)
        self._put("work", self.one_of(("box", "plane")), touch, (0.0, 0.0, 0.0), contact)
        force = self.force()
        self.approach(gap)
        touching = self.stages.pop("approach")
        within = touching["within"]
        assert isinstance(within, dict)
        within.setdefault("travel", mm(gap + 30))
        times = int(self.rng.integers(2, 4))
        self.stages["touch"] = {**touching, "attempts": str(times)}
        self.stages["settle"] = {
            "axes": {"z": {"force": f"-{force:g} N"}},
            "until": f"abs(force.z + {force:g} N) < {max(0.4, 0.1 * force):.2g} N for 80 ms",
            "fail_if": "not touching for 0.2 s",
            "within": {"time": "2 s", "travel": "15 mm"},
            "on_fail": "back_off",
        }
        self.stages["back_off"] = {
            "axes": {"x": {"move": "5 mm"}, "z": {"move": "10 mm", "speed": "60 mm/s"}},
            "until": f"touch.visits >= {times} and t > 500 ms",
            "within": {"time": "600 ms"},
            "next": "end",
            "on_fail": "touch",
        }
        self.bound()
        self.expect += ["min(work.gap) > -10 mm", f"touch.visits within {times} +- 0.5"]
        self.about = "Probe a block several times."

    def _felt(self) -> None:
        """A board of unknown slope, pressed on in a frame that was felt."""
        self.mount(("panda", "ur5e"))
        self.lag = 2 * self.period
        self.choose_law(("parallel", "hybrid", "parallel"))
        contact = self.contact(3, 30)
        slope = round(self.between(-14, 14), 1)
        touch = self.place()
        gap = round(self.between(2, 6), 1)
        self._put("board", "plane", touch, (0.0, slope, 0.0), contact)
        normal = rotation((0, slope, 0))[:, 2]
        tip = touch + (self.radius + gap) * normal - self.radius * np.array([0, 0, 1.0])
        self.robot["start"] = {"xyz": lengths(np.round(tip, 2))}
        if self.chance(0.5):
            self.robot["sensor"] = {"noise": self.nice(5, 40, "mN")}
        self.frames["felt_plane"] = {"estimate": "touch"}
        force = self.force()
        down: dict[str, Value] = {"velocity": "-20 mm/s"}
        free: dict[str, Value] = {"x": {"force": "0"}, "y": {"force": "0"}}
        if self.law == "parallel":
            down["force"] = "0"
        self.stages["touch"] = {
            "axes": {**free, "z": down},
            "until": f"norm(force) > 1 N for {round(self.between(0.2, 0.4), 2):g} s",
            "within": {"time": "3 s", "travel": "60 mm"},
        }
        self.stages["press"] = {
            "frame": "felt_plane",
            "axes": {"z": {"force": f"-{force:g} N"}},
            "time": "0.6 s",
        }
        self.stages["slide"] = {
            "frame": "felt_plane",
            "axes": {"x": {"velocity": "20 mm/s"}, "z": {"force": f"-{force:g} N"}},
            "time": "1 s",
        }
        self.stages["leave"] = {"frame": "felt_plane", "axes": {"z": {"move": "20 mm"}}}
        self.turns = True
        self.bound()
        self.expect.append(f"slide.force.z within -{force:g} N +- 2 N for 70 %")
        self.about = "Feel the slope of a board."

    def _corner(self) -> None:
        """Floor and wall at once, then along the edge between them."""
        self.mount()
        self.sense()
        self.choose_law(("hybrid", "hybrid", "parallel", "impedance"))
        self.qp = self.qp or self.chance(0.6)
        contact = self.contact(3, 40)
        touch = self.place()
        gap = round(self.between(2, 6), 1)
        self._start(touch, (0.0, 0.0, 0.0), gap, True)
        contact.pop("friction", None)
        self.world["floor"] = {"shape": "plane", "xyz": lengths((0, 0, touch[2])), **contact}
        self.world["wall"] = {
            "shape": "plane",
            "xyz": lengths((touch[0] + self.radius + 8, 0, 0)),
            "rpy": ["0", "-90 deg", "0"],
            **contact,
        }
        self.frame = self.one_of(("floor", "world"))
        force = self.force()
        self.approach(gap)
        push = f"-{force:g} N"
        self.stages["across"] = {
            "axes": {"z": {"force": push}, "x": {"velocity": "20 mm/s"}},
            "until": "wall.gap < 0 mm and force.x > 1 N",
            "within": {"time": "3 s"},
        }
        both: dict[str, Value] = {"z": {"force": push}, "x": {"force": f"{0.7 * force:.2g} N"}}
        self.stages["press"] = {"axes": both, "time": "0.8 s"}
        self.stages["slide"] = {"axes": {**both, "y": {"move": "30 mm"}}}
        self.bound()
        self.expect.append(f"last(press.wall.force) within {0.7 * force:.2g} +- 3 N")
        self.about = "Press into a corner."

    def _equation(self) -> None:
        """Constraints that are written as equations."""
        scenes = {"ring": 2, "shelf": 3, "linkage": 2, "guide": 2}
        getattr(self, f"_{self.one_of(list(scenes), list(scenes.values()))}")()

    def _mechanism(self) -> None:
        """Something to turn or to pull."""
        scenes = {"door": 2, "crank": 2, "valve": 2, "drawer": 3, "screw": 2}
        kind = self.one_of(list(scenes), list(scenes.values()))
        self.model, self.robot["model"] = "panda", "panda"
        self.sense()
        laws = ("hybrid", "parallel", "hybrid-multipliers", "hybrid", "parallel", "impedance")
        self.choose_law(laws if self.chance(0.8) else ("pd", "impedance-natural", "parallel-pid"))
        self.given = self.given and self.chance(0.3)
        self.stiffness, self.press_force, self.turns = 50.0, 15.0, True
        getattr(self, f"_{kind}")()
        self.bound()
        self.limits.pop("torque", None)
        self.limits["force"] = f"{round(self.between(80, 150)):g} N"

    # --- equations ---------------------------------------------------------------------------

    def stiff(self, low: float, high: float, *, exact: float = 0.0) -> dict[str, Value]:
        """How stiff an equation is; `exact` is how often it gives way not at all."""
        if exact and self.chance(exact):
            self.stiffness = 200.0
            return {"stiffness": "exact"}
        self.stiffness = float(f"{self.spread(low, high):.2g}")
        made: dict[str, Value] = {"stiffness": f"{self.stiffness:g} kN/m"}
        if self.chance(0.7):
            damping = 0.15 * 2 * math.sqrt(self.stiffness * 1e3)
            made["damping"] = f"{damping:.2g} N*s/m"
        return made

    def _ring(self) -> None:
        """Along a circular rail that holds the tool both ways."""
        self.mount(("panda", "ur5e"))
        self.sense()
        self.choose_law(_MULTIPLIERS)
        made, centre = self.stiff(10, 80, exact=0.3), self.place()
        radius = round(self.between(50, 100))
        self.robot["start"] = {"xyz": lengths(centre + np.array([radius, 0, 0]))}
        self.frames["rail"], self.frame = {"xyz": lengths(centre)}, "rail"
        rim = f'"x^2 + y^2 = ({radius} mm)^2"'
        self.world["rim"] = {"equation": rim, "frame": "rail", **made}
        self.world["level"] = {"equation": '"z = 0"', "frame": "rail", **made}
        force = self.force()
        push: dict[str, Value] = {"rim": {"force": f"{force:g} N"}}
        if self.chance(0.3):
            push["rim"] = {"force": f"{force:g} N", "ramp": "0.4 s"}
        self.stages["press"] = {"constraints": push, "time": "0.4 s"}
        turns = f"{self.between(0.2, 0.6) * float(self.rng.choice((-1, 1))):.2g}"
        arc = {"center": ["0", "0"], "turns": turns}
        self.stages["round"] = {
            "constraints": push,
            "path": {"arc": arc, "time": f"{self.between(1.5, 2.5):.1f} s"},
        }
        self.bound()
        self.limits.pop("deviation", None)
        self.expect.append(f"round.rim.force within {force:g} N +- {0.2 * force:.2g} N for 80 %")
        self.about = "Go round on a rail."

    def _shelf(self) -> None:
        """On a floor or under a ceiling that is written as an inequality."""
        self.mount(("panda", "ur5e", "planar2"))
        self.sense()
        self.choose_law((*_MULTIPLIERS, *_MULTIPLIERS, "hybrid", "parallel", "impedance", "pd"))
        made, gap = self.stiff(2, 80), round(self.between(2, 6), 1)
        force = self.force()
        if self.spatial:
            touch = self.place()
            up = self.chance(0.3)
            self.sign = 1 if up else -1
            self.robot["start"] = {"xyz": lengths(touch - (0, 0, self.sign * gap))}
            shaken = f" + 1 mm * sin(2*pi*clock*{self.between(0.3, 1):.2g} Hz)"
            level = mm(touch[2]) + (shaken if self.chance(0.3) else "")
            self.world["shelf"] = {"equation": f"z {'<=' if up else '>='} {level}", **made}
            self.at = {"x": float(touch[0]), "y": float(touch[1])}
            self.touch = float(touch[2])
        else:
            x, y = round(self.between(340, 420)), round(self.between(0, 100))
            self.robot["start"] = {"xyz": lengths((x, y, 0))}
            self.world["shelf"] = {"equation": f"x <= {mm(x + gap)}", **made}
            self.normal, self.sign, self.across = "x", 1, ["y"]
            self.at, self.touch = {"y": float(y)}, x + gap
        self.approach(gap)
        if self.law in _MULTIPLIERS and self.chance(0.6):
            # Left minus right grows towards the side that is not allowed under `<=`.
            push: Value = {"shelf": {"force": f"{self.sign * force:g} N"}}
            self.stages["press"] = {"constraints": push, "time": "0.8 s"}
            free = {a: self.way(a, 20, force) for a in self.across if self.chance(0.8)}
            self.stages["slide"] = {"constraints": push, "axes": free or "{}", "time": "1 s"}
        else:
            self.press(force)
            self.slide(force, 20)
        self.leave()
        self.bound()
        self.limits.pop("deviation", None)
        self.about = "Press on an equation."

    def _linkage(self) -> None:
        """A linkage between the joints of a planar arm."""
        self.model, self.robot["model"], self.spatial = "planar3", "planar3", False
        self.sense()
        self.choose_law(_MULTIPLIERS)
        self.given = False
        x, y = round(self.between(360, 440)), round(self.between(120, 220))
        turn = round(self.between(-20, 20))
        start = {"xyz": lengths((x, y, 0)), "rpy": ["0", "0", deg(turn)]}
        self.robot["start"] = start
        stiff = {
            "stiffness": self.nice(0.5, 4, "kN*m/rad"),
            "damping": self.nice(2, 8, "N*m*s/rad"),
        }
        if self.chance(0.3):
            stiff = {"stiffness": "exact"}
        self.world["bars"] = {"equation": f'"q1 + q2 + q3 = {deg(turn)}"', **stiff}
        load = f"{self.between(-3, 3):.2g} N*m"
        bars: dict[str, Value] = {"bars": {"torque": load}}
        self.stages["load"] = {"constraints": bars, "time": "0.4 s"}
        for name, axis in (("right", "x"), ("up", "y")):
            other = "y" if axis == "x" else "x"
            way = f"{round(self.between(20, 60) * float(self.rng.choice((-1, 1))))} mm"
            axes: dict[str, Value] = {axis: {"move": way, "speed": "80 mm/s"}, other: "hold"}
            self.stages[name] = {"constraints": bars, "axes": axes}
        if self.rng.random() < 0.4:
            sway = f"{round(self.between(4, 12))} deg*sin(2*pi*t/(2 s))"
            joints = [f'"40 deg + {sway}"', f'"20 deg - {sway}"', deg(turn - 60)]
            shares = f"[{', '.join([f'{self.between(-1, 1):.2g} N*m'] * 3)}]"
            self.stages["sway"] = {
                "constraints": {"bars": {"generalised": shares}},
                "path": {"joints": f"[{', '.join(joints)}]", "time": "2 s"},
                "limits": {"speed": "800 mm/s"},
            }
            self.expect.append("max(sway.bars.residual) < 1 mN*m")
        self.limits["speed"] = "300 mm/s"
        self.press_force = 20.0
        self.expect.append(f"right.bars.torque within {load} +- 0.5 N*m for 80 %")
        self.about = "Move an arm whose joints are linked."

    def _guide(self) -> None:
        """A straight guide: two equations, motion along what they leave."""
        self.mount(("panda", "ur5e"))
        self.sense()
        self.choose_law((*_MULTIPLIERS, *_MULTIPLIERS, "hybrid", "impedance-natural", "pd"))
        made, start = self.stiff(5, 60, exact=0.3), self.place()
        self.robot["start"] = {"xyz": lengths(start)}
        yaw = round(self.between(-40, 40))
        self.frames["rail"] = {"xyz": lengths(start), "rpy": ["0", "0", deg(yaw)]}
        self.frame = "rail"
        self.world["side"] = {"equation": '"y = 0"', "frame": "rail", **made}
        self.world["level"] = {"equation": '"z = 0"', "frame": "rail", **made}
        axes: dict[str, Value] = {"x": {"position": "20 mm * sin(2*pi*t/(1.5 s))"}}
        stage: dict[str, Value] = {"axes": axes, "time": "1.5 s"}
        if self.law in _MULTIPLIERS and self.chance(0.6):
            stage["constraints"] = {"side": {"force": f"{self.between(-12, 12):.2g} N"}}
        elif self.law == "hybrid":
            axes.update({"y": {"force": "0"}, "z": {"force": "0"}})
        self.stages["go"] = stage
        self.stages["back"] = {"path": {"to": ["-15 mm"], "speed": "40 mm/s"}}
        self.bound()
        self.limits.pop("deviation", None)
        self.about = "Go along a straight guide."

    # --- mechanisms --------------------------------------------------------------------------

    @staticmethod
    def _yielding(driven: Mapping[str, Value], *, turning: bool = True) -> dict[str, Value]:
        """Every axis gives way but those that are driven."""
        free: dict[str, Value] = {axis: {"force": "0"} for axis in "xyz"}
        if turning:
            free.update({axis: {"torque": "0"} for axis in ("rx", "ry", "rz")})
        return {**free, **driven}

    def _door(self) -> None:
        self.robot["grasp"] = "door.handle"
        self.robot["start"] = {"rpy": ["180 deg", "-30 deg", "0"]}
        width = round(self.between(300, 420), -1)
        self.world["door"] = {
            "mechanism": "hinge",
            "xyz": lengths((600, 50 - width, round(self.between(360, 420)))),
            "handle": lengths((0, width, 0)),
            "inertia": self.nice(0.2, 1, "kg*m^2"),
            "damping": self.nice(0.5, 3, "N*m*s/rad"),
            "friction": self.nice(0.1, 0.8, "N*m"),
            "stop": "0..90 deg",
        }
        self.frame = "door.handle"
        speed = round(self.between(60, 140), -1)
        driven: dict[str, Value] = {"y": {"velocity": f"{speed:g} mm/s"}, "rz": {"follows": "door"}}
        if self.chance(0.3):
            self.frames["hinge"] = {"parent": "door", "point": "origin"}
            self.frame, self.law = "hinge", "parallel"
            driven = {"rz": {"velocity": f"{round(self.between(8, 18))} deg/s"}}
        angle = round(self.between(10, 22))
        self.stages["open"] = {
            "axes": self._yielding(driven),
            "until": f"door.angle > {angle} deg",
            "within": {"time": "5 s"},
        }
        self.limits["torque"] = "40 N*m"
        self.expect.append(f"last(door.angle) within {angle} deg +- 1 deg")
        self.about = "Open a door."

    def _crank(self) -> None:
        self.robot["grasp"] = "crank.handle"
        self.world["crank"] = {
            "mechanism": "hinge",
            "xyz": lengths(np.round((self.between(460, 520), self.between(-60, 60), 350))),
            "handle": lengths((round(self.between(80, 130)), 0, 0)),
            "knob": "free",
            "inertia": self.nice(0.01, 0.08, "kg*m^2"),
            "damping": self.nice(0.05, 0.4, "N*m*s/rad"),
        }
        self.frame = "crank.handle"
        speed = round(self.between(50, 120), -1)
        self.stages["rotate"] = {
            "axes": self._yielding({"y": {"velocity": f"{speed:g} mm/s"}, "rz": {"hold": "world"}}),
            "until": f"crank.angle > {round(self.between(60, 160))} deg",
            "within": {"time": "6 s"},
        }
        self.stages["ease"] = {
            "axes": self._yielding({"rz": {"hold": "world"}}),
            "time": "0.3 s",
        }
        self.expect.append("max(abs(rotate.force.x)) < 3 N")
        self.about = "Turn a crank by its knob."

    def _valve(self) -> None:
        self.robot["grasp"] = "valve.handle"
        self.robot["start"] = {"rpy": ["180 deg", "0", "90 deg"]}
        self.world["valve"] = {
            "mechanism": "hinge",
            "xyz": lengths(np.round((self.between(460, 540), self.between(-60, 60), 350))),
            "inertia": self.nice(0.001, 0.01, "kg*m^2"),
            "damping": self.nice(0.1, 0.5, "N*m*s/rad"),
            "friction": self.nice(0.1, 1, "N*m"),
        }
        wrong = round(self.between(-5, 5), 1)
        self.frames["believed"] = {"parent": "valve", "rpy": [deg(wrong), "0", "0"]}
        self.frame, self.turns = "believed", False
        self.stages["close"] = {
            "axes": self._yielding({"rz": {"velocity": f"-{round(self.between(25, 50))} deg/s"}}),
            "until": f"position.rz < -{round(self.between(30, 80))} deg",
            "within": {"time": "5 s"},
        }
        self.expect.append("rms(close.torque.ry) < 0.5 N*m")
        self.about = "Turn a valve whose axis is known roughly."

    def _drawer(self) -> None:
        self.robot["grasp"] = "drawer.handle"
        keys: dict[str, Value] = {
            "mechanism": "slide",
            "xyz": lengths((600, round(self.between(-80, 80)), round(self.between(350, 420)))),
            "rpy": ["0", "-90 deg", "0"],
            "mass": self.nice(0.8, 4, "kg"),
            "damping": self.nice(5, 30, "N*s/m"),
            "friction": self.nice(0.5, 4, "N"),
            "stop": f"0..{round(self.between(60, 120), -1):g} mm",
        }
        if self.chance(0.6):
            force = self.nice(5, 15, "N")
            keys["detent"] = {"at": "10 mm", "force": force, "width": "10 mm"}
        self.world["drawer"] = keys
        self.frame, self.turns = "drawer.handle", False
        speed = round(self.between(30, 80))
        self.stages["pull"] = {
            "axes": self._yielding({"z": {"velocity": f"{speed} mm/s"}}),
            "until": "drawer.force > 25 N" if self.chance(0.5) else "drawer.travel > 40 mm",
            "within": {"time": "4 s", "travel": "200 mm"},
        }
        self.stages["ease"] = {"axes": self._yielding({}), "time": "0.3 s"}
        self.expect.append("max(abs(pull.force.x)) < 5 N")
        self.about = "Pull a drawer."

    def _screw(self) -> None:
        self.robot["grasp"] = "cap.handle"
        self.robot["start"] = {"rpy": ["180 deg", "0", "120 deg"]}
        self.world["cap"] = {
            "mechanism": "screw",
            "xyz": lengths(np.round((self.between(460, 530), self.between(-50, 50), 300))),
            "rpy": ["180 deg", "0", "0"],
            "pitch": f"{self.between(1, 6):.2g} mm/turn",
            "inertia": self.nice(0.0005, 0.002, "kg*m^2"),
            "mass": self.nice(0.1, 0.3, "kg"),
            "damping": self.nice(0.02, 0.1, "N*m*s/rad"),
            "friction": self.nice(0.05, 0.2, "N*m"),
            "stop": f"-5..{round(self.between(40, 100)):g} deg",
        }
        self.frame, self.turns = "cap", False
        speed = f"{round(self.between(40, 70))} deg/s"
        driven: dict[str, Value] = {"z": {"follows": "cap"}, "rz": {"velocity": speed}}
        self.stages["screw_down"] = {
            "axes": self._yielding(driven),
            "until": "cap.torque > 1.5 N*m",
            "within": {"time": "5 s"},
        }
        self.stages["ease"] = {"axes": self._yielding({}), "time": "0.3 s"}
        self.expect.append("max(cap.torque) < 4 N*m")
        self.about = "Screw a cap down."

    # --- loose bodies ------------------------------------------------------------------------

    def _loose(self) -> None:
        """A part that lies on a table: pressed on, pushed along, or held and set down."""
        self.mount(("panda", "ur5e"))
        self.sense()
        self.choose_law()
        contact, touch = self.contact(5, 60), self.place()
        contact["friction"] = f"{self.between(0.3, 0.6):.2f}"
        edge = round(self.between(40, 80))
        shape = self.one_of(("box", "cylinder", "sphere"), (3, 1, 1))
        kind = self.one_of(("press", "push", "held"), (3, 2, 3))
        if kind == "press":
            shape = "box"
        sizes: dict[str, Value] = {"size": lengths((edge, edge, edge))}
        if shape != "box":
            sizes = {"radius": mm(edge / 2)}
            if shape == "cylinder":
                sizes["length"] = mm(edge)
        part = {
            "shape": shape,
            **sizes,
            "free": "true",
            "mass": self.nice(0.1, 0.8, "kg"),
            **contact,
        }
        force = self.force()
        if kind == "held":
            height = round(self.between(8, 25))
            table = touch - (0, 0, edge / 2 + height)
            self.world["part"] = {**part, "xyz": lengths(touch)}
            self.world["table"] = {"shape": "plane", "xyz": lengths((0, 0, table[2])), **contact}
            self.robot["grasp"] = "part"
            self.approach(height)
            self.press(force)
            self.at = {"x": float(touch[0]), "y": float(touch[1])}
            self.touch = float(touch[2]) - height
            self.stages["press"]["axes"] = {"z": {"force": f"-{force:g} N"}}
            self.leave()
        else:
            self.world["table"] = {
                "shape": "plane",
                "xyz": lengths((0, 0, touch[2] - edge)),
                **contact,
            }
            self.world["part"] = {**part, "xyz": lengths(touch - (0, 0, edge / 2))}
            if kind == "press":
                gap = round(self.between(2, 8), 1)
                self._start(touch, (0.0, 0.0, 0.0), gap, True)
                self.approach(gap)
                self.at = {"x": float(touch[0]), "y": float(touch[1])}
                self.touch = float(touch[2])
                self.press(force)
                self.leave()
            else:
                beside = touch - (edge / 2 + self.radius + 6, 0, edge / 2 + 5)
                self.robot["start"] = {"xyz": lengths(beside)}
                speed = f"{round(self.between(20, 50))} mm/s"
                self.stages["push"] = {
                    "axes": {"x": {"velocity": f"{speed} * smooth(t/(0.3 s))"}},
                    "time": f"{self.between(1, 1.6):.1f} s",
                }
                self.stages["leave"] = {"axes": {"x": {"move": "-20 mm"}}}
        self.bound()
        self.limits.pop("torque", None)
        self.limits["force"] = f"{round(force * 2.5 + 80)} N"
        self.expect.append("max(norm(force)) < 80 N")
        self.about = "A part that nothing holds."


def main() -> int:
    """Writes tasks into a folder, or one to the screen."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tasks", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--out", type=Path, help="folder; without it they are printed")
    arguments = parser.parse_args()
    numbers = range(arguments.first, arguments.first + arguments.tasks)
    if arguments.out is None:
        sys.stdout.write("---\n".join(random_task(number) for number in numbers))
    else:
        write_tasks(arguments.out, numbers)
    return 0


if __name__ == "__main__":
    sys.exit(main())
