"""Scenes of a workshop for random tasks: insertion, what is pushed, frames that track, reuse.

What `random_tasks.py` draws has none of these: plates with a cut and tools that are put into them,
shapes on a mechanism, frames that track a force or a motion, paths that signals slow, and the ways
of writing a stage again.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from random_tasks import Draft, Value, angles, deg, flow, lengths, mm

#: Laws that give way along an axis as they are told.
_YIELDING = ("hybrid", "hybrid", "parallel")
#: A file that tasks include, by its name beside the task.
HABITS = {
    "habits.yaml": """\
params: {moment: 0.3 s}
templates:
  pause: {params: {lasts: moment}, time: lasts}
"""
}
#: Joints in which an arm is far from its limits [deg].
_HOMES = {
    "planar2": (45, -90),
    "planar3": (60, -120, 60),
    "ur5e": (0, -90, 90, -90, -90, -90),
    "panda": (0, -45, 0, -135, 0, 90, 45),
}
#: How many files have their scene replaced by one with a feed that the force slows.
_FEEDS = 0.02


def _plain(speed: Value) -> bool:
    """Whether a speed is a number alone."""
    return isinstance(speed, str) and speed.endswith(" mm/s")


class WorkshopDraft(Draft):
    """A task that may be one of a workshop.

    Attributes:
        template: the stage that is written as a template; empty for none.
        included: whether the file includes `HABITS`.
    """

    def __init__(self, number: int, *campaign: int) -> None:
        super().__init__(number, *campaign)
        self.template, self.included = "", False
        self.campaign = (*campaign, number)

    def scenes(self) -> dict[str, tuple[float, Callable[[], None]]]:
        return {
            **super().scenes(),
            "insert": (0.05, self._insert),
            "button": (0.03, self._button),
            "track": (0.04, self._track),
            "outline": (0.03, self._outline),
            "feed": (0.0, self._feed),  # see `scene`
        }

    def scene(self) -> str:
        # What came later replaces a few scenes, so that all other files stay as they are.
        drawn = super().scene()
        return "feed" if np.random.default_rng((*self.campaign, 2)).random() < _FEEDS else drawn

    # --- scenes ------------------------------------------------------------------------------

    def _insert(self) -> None:
        """A peg, a blade or a ball into a hole, a slot or a groove."""
        self.model = self.one_of(("panda", "ur5e"))
        self.robot["model"] = self.model
        self.sense()
        self.choose_law(_YIELDING)
        self.given = False
        shape = self.one_of(("hole", "slot", "groove"), (3, 2, 1))
        place, depth = self.place(), round(self.between(8, 25))
        room, wide = round(self.between(0.1, 0.5), 2), round(self.between(8, 24))
        keys: dict[str, Value] = {"shape": shape, "depth": mm(depth)}
        tool: dict[str, Value] = {"shape": "cylinder", "radius": mm(wide / 2)}
        if shape == "hole":
            keys["radius"] = mm(wide / 2 + room / 2)
            if self.chance(0.3):
                keys["size"] = lengths((wide + 30, wide + 40, depth + 20))
        elif shape == "slot":
            keys["width"] = mm(wide + room)
            if self.chance(0.5):
                tool = {"shape": "box", "size": lengths((20, wide, 30))}
            if self.chance(0.3):
                keys["length"] = mm(60)
        else:
            keys["angle"] = deg(round(self.between(50, 120)))
            tool = {"shape": "sphere", "radius": mm(round(self.between(4, 10)))}
        if tool["shape"] == "cylinder":
            tool["thickness"] = "40 mm"
        tool |= {"length": mm(round(self.between(100, 150))), "mass": "300 g"}
        chamfer = round(self.between(0.5, 2), 1)
        if shape != "groove":
            keys["chamfer"] = mm(chamfer)
        aside = self.between(-0.6, 0.6) * (chamfer if shape != "groove" else 3)
        # Blades lie along the slot, and slots along x.
        off = np.array([0, aside, 0]) if shape != "hole" else np.array([aside, 0.2 * aside, 0])
        keys["xyz"] = lengths(place)
        self.world["socket"] = {**keys, **self.contact(40, 300)}
        self.robot["tool"] = tool
        self.robot["start"] = {"xyz": lengths(np.round(place + off + np.array([0, 0, 4]), 2))}
        self.frame = self.one_of(("world", "socket"))
        force = self.force()
        self.approach(4 + chamfer)
        free = {a: {"force": "0"} for a in ("x", "y")[shape != "hole" :]}
        turns = {a: {"torque": "0"} for a in (("rx", "ry") if shape == "hole" else ("rx",))}
        down: Value = {"force": f"-{force:g} N"}
        stage: dict[str, Value] = {"axes": {**free, **turns, "z": down}}
        if self.chance(0.5):
            stage |= {"until": "abs(velocity.z) < 0.5 mm/s for 300 ms", "within": {"time": "8 s"}}
        else:
            stage["time"] = f"{self.between(1.5, 4):.2g} s"
        self.stages["insert"] = stage
        if self.chance(0.5):
            self.stages["leave"] = {
                "axes": {**free, "z": {"move": mm(depth + 10), "speed": "60 mm/s"}}
            }
        self.limits = {"force": f"{round(4 * force + 60)} N", "speed": "300 mm/s"}
        self.expect.append(f"max(norm(insert.force)) < {round(4 * force + 40)} N")
        self.about = f"Put a {tool['shape']} into a {shape}."

    def _button(self) -> None:
        """A cap on a slide, which is pushed by what rides on it."""
        self.mount(("panda", "ur5e"))
        self.sense()
        self.choose_law(("hybrid", "parallel", "impedance", "impedance-natural"))
        self.given = self.given and self.chance(0.3)
        place = self.place()
        way = round(self.between(4, 30))
        keys: dict[str, Value] = {
            "mechanism": "slide",
            "xyz": lengths(place),
            "rpy": ["180 deg", "0", "0"],
            "mass": self.nice(0.02, 0.5, "kg"),
            "damping": self.nice(5, 60, "N*s/m"),
            "friction": self.nice(0.5, 5, "N"),
            "stop": f"0..{way} mm",
        }
        if self.chance(0.5):
            keys["detent"] = {
                "at": mm(round(0.5 * way, 1)),
                "force": self.nice(2, 8, "N"),
                "width": mm(round(0.25 * way, 1)),
            }
        cap: dict[str, Value] = {"shape": "cylinder", "on": "button", "radius": "20 mm"}
        cap |= {"length": "20 mm", "xyz": lengths((0, 0, 10))}
        if self.chance(0.4):
            cap = {"shape": "box", "on": "button", "size": lengths((60, 60, 20))}
            cap["xyz"] = lengths((0, 0, 10))
        self.world |= {"button": keys, "cap": {**cap, **self.contact(5, 100)}}
        gap = round(self.between(3, 12), 1)
        self.robot["start"] = {"xyz": lengths(np.round(place + np.array([0, 0, gap]), 2))}
        self.press_force = 8.0
        self.approach(gap)
        speed = round(self.between(5, 20))
        push: dict[str, Value] = {"axes": {"z": {"velocity": f"-{speed} mm/s"}}}
        if self.chance(0.6):
            most = round(self.between(10, 20))
            push |= {"until": f"force.z < -{most} N for 3 ms"}
            push["within"] = {"time": f"{2 * way / speed + 2:.2g} s", "travel": mm(way + 20)}
        else:
            push["time"] = f"{(0.9 * way + gap) / speed:.2g} s"
        self.stages["push"] = push
        self.stages["leave"] = {"axes": {"z": {"move": "30 mm", "speed": "80 mm/s"}}}
        self.limits = {"force": f"{round(self.between(60, 120))} N", "speed": "300 mm/s"}
        self.expect.append(f"max(button.travel) > {0.6 * way:.3g} mm")
        self.about = "Push a button."

    def _track(self) -> None:
        """Over a hill that nobody told, in a frame that goes with the force."""
        self.mount(("panda", "ur5e"))
        self.lag = 2 * self.period
        self.choose_law(_YIELDING)
        self.given = False
        contact = self.contact(5, 60)
        if self.chance(0.7):
            contact["friction"] = f"{self.between(0, 0.15):.2g}"
        place, radius = self.place(), round(self.between(80, 250), -1)
        hill: dict[str, Value] = {"shape": "sphere", "radius": mm(radius)}
        if self.chance(0.6):
            hill = {"shape": "cylinder", "radius": mm(radius), "length": "300 mm"}
            hill["rpy"] = ["90 deg", "0", "0"]
        self.world["hill"] = {**hill, "xyz": lengths(place - np.array([0, 0, radius])), **contact}
        gap, aside = round(self.between(2, 6), 1), round(self.between(-0.2, 0) * radius)
        rise = np.hypot(radius, aside) - radius + gap
        top = place + np.array([aside, 0, rise])
        self.robot["start"] = {"xyz": lengths(np.round(top, 2))}
        cutoff = self.nice(1, 6, "Hz")
        self.frames["skin"] = {"track": "force", "filter": cutoff}
        if self.chance(0.3):
            self.frames["skin"] |= {"turn": f"{round(self.between(40, 90))} deg/s"}
        force = self.force()
        self.approach(gap + 10)
        speed, time = round(self.between(10, 40)), round(self.between(1, 2.5), 1)
        along = f"{speed} mm/s * smooth(t/(0.5 s))"
        self.stages["trace"] = {
            "frame": "skin",
            "axes": {"x": {"velocity": along}, "z": {"force": f"-{force:g} N"}},
            "time": f"{time:g} s",
        }
        self.stages["leave"] = {"axes": {"z": {"move": "20 mm"}}}
        self.turns = True
        self.bound()
        self.expect.append(
            f"trace.force.z within -{force:g} N +- {max(2, 0.3 * force):.2g} N for 80 %"
        )
        self.about = "Feel along a hill."

    def _outline(self) -> None:
        """Along the outline of a disc or a block, in a frame that goes with the motion."""
        self.mount(("panda", "ur5e"))
        self.lag = 2 * self.period
        self.choose_law(_YIELDING)
        self.given = False
        place, half = self.place(), round(self.between(40, 90))
        part: dict[str, Value] = {"shape": "cylinder", "radius": mm(half), "length": "80 mm"}
        if self.chance(0.4):
            part = {"shape": "box", "size": lengths((2 * half, 2 * half, 80))}
        self.world["part"] = {**part, "xyz": lengths(place), **self.contact(8, 60)}
        gap = round(self.between(2, 8), 1)
        start = place - np.array([0, half + self.radius + gap, self.radius])
        self.robot["start"] = {"xyz": lengths(np.round(start, 2))}
        self.frames["rim"] = {
            "track": "velocity",
            "filter": self.nice(3, 8, "Hz"),
            "floor": "5 mm/s",
            "turn": "240 deg/s",
        }
        force = self.force()
        self.normal, self.sign, self.across = "y", 1, ["x", "z"]
        self.approach(gap)
        push: Value = {"force": f"{force:g} N"}
        self.stages["press"] = {"axes": {"y": push}, "time": "0.5 s"}
        speed = round(self.between(10, 25))
        held: dict[str, Value] = {a: {"hold": "world"} for a in ("rx", "ry", "rz")}
        along: Value = {"velocity": f"{speed} mm/s * smooth(t/(0.5 s))"}
        self.stages["around"] = {
            "frame": "rim",
            "axes": {"x": along, "y": push, **held},
            "time": f"{self.between(2, 6):.2g} s",
        }
        self.turns = True
        self.bound()
        self.expect.append(
            f"around.force.y within {force:g} N +- {max(2, 0.3 * force):.2g} N for 80 %"
        )
        self.about = "Follow an outline."

    def _feed(self) -> None:
        """Along a surface against something that gives way as a damper does, as a cut would."""
        self.mount(("panda", "ur5e"))
        self.sense()
        self.choose_law(_YIELDING)
        self.given = False
        place, force = self.place(), self.force()
        contact, gap = self.contact(10, 100), round(self.between(3, 10), 1)
        self.world["edge"] = {"shape": "plane", "xyz": lengths(place), **contact}
        ahead = self.radius + 8 + round(self.between(3, 30))
        chip: dict[str, Value] = {"mechanism": "slide", "rpy": ["0", "90 deg", "0"]}
        chip |= {
            "xyz": lengths(place + np.array([ahead, 0, 4])),
            "mass": self.nice(0.05, 0.5, "kg"),
        }
        chip |= {"damping": self.nice(50, 1500, "N*s/m"), "friction": self.nice(0.5, 5, "N")}
        burr: dict[str, Value] = {"shape": "box", "on": "chip", "size": lengths((16, 30, 20))}
        self.world |= {"chip": chip, "burr": {**burr, **self.contact(5, 60)}}
        self.robot["start"] = {"xyz": lengths(np.round(place + np.array([0, 0, gap]), 2))}
        self.approach(gap)
        self.stages["press"] = {"axes": {"z": {"force": f"-{force:g} N"}}, "time": "0.4 s"}
        most, least = round(self.between(8, 30)), self.one_of(("0", "0.02", "0.1"), (1, 3, 1))
        pace, way = round(self.between(20, 80)), round(self.between(40, 90))
        load = self.one_of(("force.x", "abs(force.x)", "norm(force)"), (3, 1, 1))
        spare = f"{load}/({most} N)" if load != "norm(force)" else f"{load}/({most + force:g} N)"
        line: Value = {"line": {"by": lengths((way, 0))}}
        assert isinstance(line, dict)
        self.stages["feed"] = {
            "axes": {"z": {"force": f"-{force:g} N"}},
            "path": {**line, "speed": f"{pace} mm/s * clamp(1 - {spare}, {least}, 1)"},
            "within": {"time": f"{round(self.between(10, 40))} s"},
        }
        self.stages["leave"] = {"axes": {"z": {"move": "20 mm", "speed": "80 mm/s"}}}
        self.bound()
        self.expect.append(f"max(feed.force.x) < {round(1.3 * most + 0.6 * force + 3)} N")
        self.about = "Feed against a burr."

    # --- ways of writing ------------------------------------------------------------------------

    def reuse(self) -> None:
        """Writes some of what has been drawn as people do who have written it before."""
        press, slide = self.stages.get("press", {}), self.stages.get("slide", {})
        keep = flow(press.get("axes", {}).get(self.normal, "")) if press else ""
        if "time" in press and self.chance(0.15):
            self.template = "press"
        if slide and "force" in keep and "sin" not in keep and self.chance(0.1):
            axes = slide["axes"]
            if isinstance(axes, dict) and "force" in flow(axes.get(self.normal, "")):
                axes[self.normal] = {"hold": "force"}
        path = slide.get("path", {})
        if isinstance(path, dict) and "speed" in path and self.chance(0.2):
            path["speed"] = (
                f"{path['speed']} * clamp(2 - norm(force)/({3 * self.press_force:g} N), 0.1, 1)"
            )
        if slide and self.chance(0.05):
            slide["repeat"] = "2"
        if slide and "leave" in self.stages and "fail_if" not in slide and self.chance(0.05):
            slide["next"] = [{"when": "slide.visits < 2", "to": "slide"}, {"to": "leave"}]
        if "leave" in self.stages and "force" in self.limits and self.chance(0.05):
            self.limits["force"] = {"max": self.limits["force"], "then": "leave"}
            self.stages["leave"]["attempts"] = "2"
        # What came later is drawn on its own, so that all else of a file stays as it is.
        first, self.rng = self.rng, np.random.default_rng((*self.campaign, 1))
        self._later()
        self.rng = first

    def _later(self) -> None:
        """An included file, a way home by the joints, and points with orientations."""
        last = "grasp" not in self.robot and self.kind != "probe"  # what is held moves on
        if last and self.chance(0.05):
            self.included = True
            self.stages["pause"] = {"use": "pause"}
            if self.chance(0.5):
                self.stages["pause"]["with"] = {"lasts": f"{self.between(0.1, 0.6):.1f} s"}
        if last and "torque_rate" not in self.limits and self.chance(0.06):
            home = _HOMES[self.model] + self.rng.uniform(-12, 12, len(_HOMES[self.model]))
            joints: Value = angles(np.round(home))
            if self.chance(0.3):
                joints = [joints, angles(np.round(home + self.rng.uniform(-8, 8, len(home))))]
            self.stages["home"] = {
                "path": {"joints": joints, "speed": f"{round(self.between(10, 60))} deg/s"}
            }
        path = self.stages.get("slide", {}).get("path", {})
        if isinstance(path, dict) and "waypoints" in path and self.across == ["x", "y"]:
            bends = path["waypoints"]
            assert isinstance(bends, dict)
            if self.spatial and self.chance(0.4):
                turned = [deg(round(self.between(-20, 20))) for _ in bends["points"]]
                bends["points"] = [
                    [*point, "0", "0", "0", turn]
                    for point, turn in zip(bends["points"], turned, strict=True)
                ]
        for name, share in (("slide", 0.6), ("go", 0.3)):
            path = self.stages.get(name, {}).get("path", {})
            if isinstance(path, dict) and _plain(path.get("speed", "")) and self.chance(share):
                self._slowed(self.stages[name], path)

    def _slowed(self, stage: dict[str, Value], path: dict[str, Value]) -> None:
        """Makes a signal slow a path."""
        most = f"{self.between(1, 4) * self.press_force:.2g} N"
        least = self.one_of(("0", "0.05", "0.2"))
        ways = [f"clamp(1 - norm(force)/({most}), {least}, 1)"]
        ways += [f"clamp(1 - abs(force.{self.across[0]})/({most}), {least}, 1)"]
        ways += [f"smooth(t/({self.between(0.2, 1.5):.2g} s))"]
        if self.stages.get("press"):
            kept = f"abs(abs({self.felt}) - {self.press_force:g} N)"
            ways += [f"clamp(2 - {kept}/({0.3 * self.press_force:.2g} N), {least}, 1)"]
        path["speed"] = f"{path['speed']} * {self.one_of(ways)}"
        if "within" not in stage:
            stage["within"] = {"time": f"{round(self.between(8, 25))} s"}

    def written(self) -> str:
        text = self._templated()
        return (
            text.replace("\nrobot:", "include: [habits.yaml]\n\nrobot:", 1)
            if self.included
            else text
        )

    def _templated(self) -> str:
        stage = self.stages.get(self.template)
        if stage is None:
            return super().written()
        self.stages[self.template] = {"use": "usual", "with": {"long": stage["time"]}}
        text = super().written()
        self.stages[self.template] = stage
        lines = "".join(f"    {k}: {flow(v)}\n" for k, v in {**stage, "time": "long"}.items())
        written = f"\ntemplates:\n  usual:\n    params: {{long: 1 s}}\n{lines}"
        return text.replace("\nstages:\n", f"{written}\nstages:\n", 1)
