"""Scenes of task files as different users would write them, by docs/language alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from language_draft import (
    FORCE_LOOPS,
    LAWS,
    MULTIPLIERS,
    LanguageDraft,
    Section,
    Value,
    deg,
    mm,
    newton,
)

#: A table of points beside the file, from where a stage begins: see `language_tasks.COMPANIONS`.
OUTLINE = "outline.csv"
#: Joint positions from which an arm's tool points down over the bench.
_OVER_THE_BENCH = {
    "ur5e": [0, -100, 100, -90, -90, 0],
    "panda": [0, -20, 0, -130, 0, 110, 45],
}


@dataclass(frozen=True)
class Surface:
    """Something to touch from above.

    Attributes:
        name: of the object. shape: of it. point: of the surface under the tool [mm].
        rpy: of the surface there [deg]. own: whether z of the object's own frame is its normal.
    """

    name: str
    shape: str
    point: np.ndarray
    rpy: tuple[float, float, float]
    own: bool

    @property
    def level(self) -> bool:
        return not any(self.rpy)

    @property
    def normal(self) -> np.ndarray:
        a, b, _ = np.radians(self.rpy)
        return np.array([math.sin(b) * math.cos(a), -math.sin(a), math.cos(b) * math.cos(a)])


# --- robots and tools -------------------------------------------------------------------


def arm(d: LanguageDraft, *tools: str, models: tuple[str, ...] = ("ur5e", "panda")) -> None:
    """An arm with a tool of one of some shapes."""
    d.model = d.one_of(models)
    d["robot"]["model"] = d.model
    if made := tool(d, *(tools or ("ball", "ball", "flat", "box", ""))):
        d["robot"]["tool"] = made
    if d.law == "stiffness":
        d["robot"] |= {"balanced": True, "joint_damping": f"{d.pick(3, 5, 8)} N*m*s/rad"}


def tool(d: LanguageDraft, *shapes: str) -> Section:
    """A tool as a maker's sheet has it; nothing for the default one."""
    shape = d.one_of(shapes)
    made: Section = {}
    if shape == "ball":
        made = {"shape": "sphere", "radius": mm(d.grid(4, 20, 2))}
    elif shape == "flat":
        made = {"shape": "cylinder", "radius": mm(d.grid(8, 30, 2))}
        if d.chance(0.5):
            made["thickness"] = mm(d.grid(8, 30, 2))
    elif shape == "box":
        made = {"shape": "box", "size": mm(d.grid(20, 60, 5), d.grid(20, 60, 5), d.grid(10, 40, 5))}
    if made and d.model in _OVER_THE_BENCH:
        made["length"] = mm(d.grid(80, 180, 10))
    if made and d.chance(0.7):
        made["mass"] = f"{d.grid(100, 900, 50):g} g"
    return made


# --- what is touched --------------------------------------------------------------------


def material(d: LanguageDraft) -> Section:
    """Stiffness, damping and friction of a contact, or some of them."""
    made: Section = {}
    if d.chance(0.85):
        k = d.nice(2, 150)
        made["stiffness"] = "rigid" if d.chance(0.08) else f"{k:g} kN/m"
        if made["stiffness"] != "rigid" and d.chance(0.5):
            made["damping"] = f"{d.nice(0.5, 2) * 0.2 * math.sqrt(k * 1000):.0f} N*s/m"
    if d.chance(0.7):
        made["friction"] = d.grid(0.05, 0.5, 0.05)
    return made


def surface(d: LanguageDraft, *shapes: str, tilted: bool = True) -> Surface:
    """Puts something to touch under the tool, and the tool over it."""
    shape = d.one_of(shapes or ("plane", "plane", "box", "cylinder", "sphere"))
    point = np.array([d.grid(420, 540, 10), d.grid(-120, 120, 20), d.grid(160, 320, 10)])
    rpy = (0.0, 0.0, 0.0)
    made: Section = {"shape": shape}
    names = {
        "plane": ("table", "bench", "plate", "ramp"),
        "box": ("block", "workpiece", "crate"),
        "cylinder": ("pipe", "drum", "tube"),
        "sphere": ("dome", "bowl", "helmet"),
    }
    name = d.one_of(names[shape])
    if shape == "plane":
        if tilted and d.chance(0.35):
            rpy = (d.sign() * d.grid(0, 15, 5), d.sign() * d.grid(5, 20, 5), 0.0)
            made |= {"xyz": mm(*point), "rpy": deg(*rpy)}
        else:
            made["xyz"] = mm(*((0, 0, point[2]) if d.chance(0.6) else point))
    elif shape == "box":
        size = [d.grid(120, 300, 20), d.grid(120, 300, 20), d.grid(40, 120, 20)]
        made |= {"xyz": mm(point[0], point[1], point[2] - size[2] / 2), "size": mm(*size)}
    else:
        radius = d.grid(60, 200, 10) if shape == "cylinder" else d.grid(100, 250, 10)
        made |= {"xyz": mm(point[0], point[1], point[2] - radius), "radius": mm(radius)}
        if shape == "cylinder":
            lying = (0, 90, 0) if d.chance(0.5) else (90, 0, 0)
            made |= {"rpy": deg(*lying), "length": mm(d.grid(300, 600, 50))}
    d["world"][name] = made | material(d)
    return Surface(name, shape, point, rpy, shape in ("plane", "box"))


def over(d: LanguageDraft, s: Surface) -> float:
    """Puts the tool over a surface; so far away [mm]."""
    gap = d.grid(10, 40, 5)
    # The default tool is a ball, too, and its tip is what is placed.
    d["robot"]["start"] = {"xyz": [mm(round(x, 2)) for x in s.point + gap * s.normal]}
    if not s.level or d.chance(0.25):
        d["robot"]["start"]["rpy"] = deg(
            s.rpy[0] + 180, s.rpy[1], 0 if not s.level else d.pick(0, 0, 45, 90)
        )
    return gap


def choose_frame(d: LanguageDraft, s: Surface) -> np.ndarray | None:
    """Draws the frame; the tool's place in its xy plane, None where positions are relative."""
    kinds = ["surface"] * 3 + ["own"] * s.own * 2 + ["world"] * s.level + ["bench"] * s.level
    kind = d.one_of(kinds)
    place = d["world"][s.name]["xyz"]
    at_zero = all(x == 0 for x in place[:2])
    if kind == "surface":
        d["frames"]["task"] = {"surface": s.name}
        if d.chance(0.3):
            d["frames"]["task"]["heading"] = d.pick([1, 0, 0], [0, 1, 0], [1, 1, 0])
        d["frame"] = "task"
        return None
    if kind == "bench":
        d["frames"]["bench"] = {"xyz": mm(*s.point)}
        if d.chance(0.5):
            d["frames"]["bench"]["rpy"] = [0, 0, f"{d.grid(10, 90, 10):g} deg"]
        d["frame"] = "bench"
        return np.zeros(2)
    if kind == "own":
        d["frame"] = s.name
        return s.point[:2] if at_zero else np.zeros(2)
    return s.point[:2]


# --- stages -----------------------------------------------------------------------------


def touched(d: LanguageDraft, name: str, level: float) -> str:
    """A guard that waits for a touch."""
    return str(
        d.pick(
            f"force.z < -{level:g} N for {d.pick(5, 10, 20)} ms",
            f"force.z < -{level:g} N",
            f"norm(force) > {level:g} N for 5 ms",
            "touching for 10 ms",
            f"{name}.gap < 0 for 5 ms",
            f"abs(force.z) > {level:g} N and t > 100 ms",
            f"max(norm(force)) > {level:g} N",
            f"force.z in tool > {level:g} N for 5 ms",
        )
    )


def approach(d: LanguageDraft, name: str, gap: float, stage: str = "approach") -> str:
    """A stage that goes down until something is touched; its name."""
    v = d.grid(10, 40, 5)
    level = d.pick(1, 2, 2, 3)
    time = math.ceil(gap / v + 1.5)
    within: Value = {"time": f"{time} s", "travel": mm(gap + d.pick(10, 20, 30))}
    if d.chance(0.3):
        within = d.pick(f"{time} s", {"travel": mm(gap + 20)})
    speed = d.param("down", f"{v:g} mm/s")
    d.stages[stage] = {
        "axes": {"z": {"velocity": f"-{speed}"}},
        "until": touched(d, name, level),
        "within": within,
    }
    return stage


def force_text(d: LanguageDraft, press: str, value: float) -> str:
    """A set point of force that presses."""
    if d.chance(0.75):
        return f"-{press}"
    return str(
        d.pick(
            f"-{press} - {value * 0.2:.3g} N * sin(2*pi*t/({d.pick(1, 2, 3)} s))",
            f"-{press} * smooth(t/({d.pick(0.5, 1)} s))",
            f"-{press} * (1 + 0.3 * smooth(t/(2 s)))",
            f"clamp(-{press} - 20 N*s/m * velocity.z, -{value * 1.3:.3g} N, -1 N)",
            f"-max({press}, 2 N)",
        )
    )


def strokes(d: LanguageDraft, at: np.ndarray | None) -> Section:
    """A motion along a surface, as a part of a stage."""
    here = np.zeros(2) if at is None else at
    x, y = mm(here[0]) or "0 mm", here[1]
    a, b, v, period = d.grid(10, 50, 5), d.grid(10, 40, 5), d.grid(20, 80, 10), d.pick(2, 3, 4)
    pace = f"{v:g} mm/s"
    offset = "" if at is None or not here[0] else f"{x} + "
    kinds = ["sine", "rate", "until", "move", "line", "to", "arc", "raster", "spiral"]
    kinds += ["waypoints", "lissajous", "feed"] + ["file"] * 2 * (at is None)
    kind = d.one_of(kinds)
    if kind == "sine":
        return {
            "axes": {"x": {"position": f"{offset}{a:g} mm * sin(2*pi*t/({period} s))"}},
            "time": f"{period * d.pick(1, 1, 2):g} s",
        }
    if kind == "rate":
        speed = d.pick(
            f"{v / 2:g} mm/s * smooth(t/(0.5 s))", f"{v / 2:g} mm/s * sin(2*pi*t/({period} s))"
        )
        return {"axes": {d.pick("x", "y"): {"velocity": speed}}, "time": f"{d.pick(1, 2)} s"}
    if kind == "until":
        end = f"travel > {a:g} mm" if at is not None else f"position.x > {a:g} mm"
        return {
            "axes": {"x": {"velocity": f"{v / 2:g} mm/s * smooth(t/(0.3 s))"}},
            "until": end,
            "within": {"time": f"{math.ceil(2 * a / v + 1.5)} s"},
        }
    if kind == "move":
        return {"axes": {d.pick("x", "y"): {"move": mm(d.sign() * a), "speed": pace}}}
    path: Section = {
        "line": {"line": {"by": mm(a, d.sign() * b)}, "speed": pace},
        "to": {"to": mm(here[0] + a, y + b), "time": f"{period} s"},
        "arc": {
            "arc": {"center": mm(here[0] + b, y), "turns": d.pick(1, -1, 0.5)},
            d.pick("speed", "time"): "",
        },
        "raster": {
            "raster": {"size": mm(a, d.sign() * b), "pitch": mm(d.pick(4, 5, 10))},
            "speed": pace,
        },
        "spiral": {
            "spiral": {"pitch": mm(d.pick(1, 2, 4)), "radius": mm(d.pick(4, 6, 8))},
            "speed": pace,
        },
        "waypoints": {
            "waypoints": {
                "points": [mm(here[0], y), mm(here[0] + a, y), mm(here[0] + a, y + b)],
                "radius": mm(d.pick(3, 5, 8)),
            },
            "speed": pace,
        },
        "lissajous": {
            "lissajous": {"amplitude": mm(a / 2, b / 2), "turns": d.pick([1, 2], [1, 1], [2, 1])},
            "time": f"{2 * period} s",
        },
        "file": {"file": OUTLINE, "speed": pace},
        "feed": {
            "line": {"by": [mm(a)]},
            "speed": f"{pace} * clamp(1.5 - norm(force)/({d.pick(20, 30, 40)} N), 0.1, 1)",
        },
    }[kind]
    path = {k: each or (pace if k == "speed" else f"{2 * period} s") for k, each in path.items()}
    if "raster" in path and d.chance(0.3):
        path["raster"]["along"] = d.pick("x", "y")
    made: Section = {"path": path, "axes": {}}
    if kind == "feed":
        made["within"] = {"time": "20 s"}
    return made


def judge_press(d: LanguageDraft, stage: str, press: str, value: float, name: str) -> None:
    """What is expected of a stage that presses."""
    loop = d.law in FORCE_LOOPS
    share, near = d.pick(70, 80, 90), (0.15 if loop else 0.3) * value
    every = [
        f"{stage}.force.z within -{press} +- {max(near, 1):.2g} N for {share} %",
        f"mean({stage}.force.z) within -{press} +- {15 if loop else 30} %",
        f"rms({stage}.force.z - {stage}.force.z.ref) < {max(0.3 * value, 1.5):.2g} N",
        f"max(norm(force)) < {3 * value + 20:.0f} N",
        f"std({stage}.force.z) < 30 % * {press}",
        f"last({stage}.force.z) within -{press} +- {max(near, 1):.2g} N",
        f"max({stage}.tilt) < 5 deg",
        f"min({name}.gap) > -{d.pick(3, 5, 10)} mm",
        f"max({name}.force) < {4 * value + 20:.0f} N",
        f"max(speed) < {d.pick(300, 400)} mm/s",
        f"max({stage}.travel) < {d.pick(150, 200)} mm",
        f"not {stage}.limited for 90 %",
        f"{stage}.touching for 80 %",
        f"max(abs({stage}.power)) < 20 W",
        f"{stage}.visits >= 1",
        f"max(clock) < {d.pick(20, 30)} s",
    ]
    for text in d.rng.permutation(len(every))[: d.pick(0, 1, 2, 2, 3)]:
        expect(d, every[int(text)])


def expect(d: LanguageDraft, text: str) -> None:
    d["expect"].append(text)


def leave(d: LanguageDraft, stage: str = "retreat") -> None:
    """A stage that goes away from what is pressed."""
    axis: Section = {"move": mm(d.grid(20, 60, 10))}
    if d.chance(0.5):
        axis["speed"] = f"{d.grid(50, 150, 25):g} mm/s"
    d.stages[stage] = {"axes": {"z": axis}}
    if d.chance(0.2):
        expect(d, f"last({stage}.gap) > {d.pick(5, 10)} mm")


def bound(d: LanguageDraft, value: float) -> None:
    """Limits as one sets them who presses with a force [N]."""
    limits = d["limits"]
    if d.chance(0.7):
        limits["force"] = newton(max(math.ceil(d.pick(2, 3, 4) * value / 10) * 10, 40))
    if d.chance(0.5):
        limits["speed"] = f"{d.pick(200, 250, 300, 400)} mm/s"
    if d.chance(0.15):
        limits["torque"] = f"{d.pick(5, 10, 15)} N*m"
    if d.chance(0.15):
        limits["deviation"] = mm(d.pick(10, 20, 30))


# --- scenes -----------------------------------------------------------------------------


def press(d: LanguageDraft) -> None:
    """Touches a surface, presses, works along it and leaves."""
    d.use_law()
    arm(d)
    s = surface(d)
    gap = over(d, s)
    at = choose_frame(d, s)
    value = d.grid(5, 30, 1) if d.chance(0.8) else d.grid(30, 80, 5)
    name = d.param("press", newton(value))
    bound(d, value)
    approach(d, s.name, gap)
    flat = d["robot"].get("tool", {}).get("shape") in ("cylinder", "box")
    count = d.pick(1, 1, 2, 3)
    for number in range(count):
        stage = ("settle", "work", "finish")[number]
        along = (
            strokes(d, at)
            if (d.chance(0.65) or number) and not (at is not None and number > 1)
            else {}
        )
        made: Section = along or {"time": f"{d.pick(1, 1.5, 2, 3)} s"}
        z: Section = {"force": force_text(d, name, value)}
        if d.chance(0.25):
            z["ramp"] = f"{d.pick(0.3, 0.5, 1)} s"
        if number and d.chance(0.2) and "t" not in z["force"].split("(")[0]:
            z = {"hold": "force"}
        made.setdefault("axes", {})["z"] = z
        _extras(d, made, flat)
        d.stages[stage] = made
        judge_press(d, stage, name, value, s.name)
        at = None if d["frame"] == "task" else at
        if at is not None and along:
            break
    if d.chance(0.8):
        leave(d)


def _extras(d: LanguageDraft, stage: Section, flat: bool) -> None:
    """What some users add to a stage that presses."""
    axes = stage["axes"]
    if flat and d.law not in ("stiffness",) and d.chance(0.35):
        axes |= {"rx": {"torque": 0}, "ry": {"torque": 0}}
    if d.law not in MULTIPLIERS and "y" not in axes and "path" not in stage and d.chance(0.1):
        axes["y"] = {"stiffness": f"{d.nice(300, 1500):g} N/m"}
        if d.law not in ("pd-joint", "stiffness"):
            axes["y"]["damping"] = f"{d.nice(40, 120):g} N*s/m"
    if d.law in FORCE_LOOPS and d.chance(0.08):
        axes["rz"] = d.pick("free", {"hold": "start"})
    if "until" not in stage and d.chance(0.12):
        stage["fail_if"] = d.pick("not touching for 200 ms", "norm(force) > 150 N", "gap < -15 mm")


def planar(d: LanguageDraft) -> None:
    """A planar arm against a wall."""
    d.use_law()
    arm(d, "ball", "", models=("planar2", "planar3"))
    x, y = d.grid(330, 420, 10), d.grid(60, 200, 10)
    tip = float(d["robot"].get("tool", {}).get("radius", "10 mm").split()[0])
    gap, value = tip + d.grid(5, 20, 5), d.grid(3, 15, 1)
    side = d.pick("x", "y")
    place = mm(x + gap, 0, 0) if side == "x" else mm(0, y + gap, 0)
    rpy = [0, "-90 deg", 0] if side == "x" else ["90 deg", 0, 0]
    d["world"]["wall"] = {"shape": "plane", "xyz": place, "rpy": rpy} | material(d)
    d["robot"]["start"] = {"xyz": mm(x, y, 0)}
    bound(d, value)
    across = "y" if side == "x" else "x"
    d.stages["reach"] = {
        "axes": {side: {"velocity": f"{d.grid(10, 40, 5):g} mm/s"}},
        "until": f"force.{side} > {d.pick(1, 2)} N for {d.pick(5, 10)} ms",
        "within": {"time": f"{d.pick(4, 5)} s"},
    }
    name = d.param("push", newton(value))
    start = y if side == "x" else x
    wander: Value = d.pick(
        {"position": f"{start:g} mm + {d.grid(10, 40, 5):g} mm * sin(2*pi*t/({d.pick(2, 4)} s))"},
        {"velocity": f"{d.grid(10, 30, 5):g} mm/s"},
        {"hold": "start"},
    )
    d.stages["press"] = {
        "axes": {side: {"force": name}, across: wander},
        "time": f"{d.pick(2, 3, 4)} s",
    }
    expect(d, f"mean(press.force.{side}) within {name} +- {20 if d.law in FORCE_LOOPS else 40} %")
    if d.chance(0.5):
        expect(d, "max(norm(force)) < 60 N")
    d.stages["away"] = {"axes": {side: {"move": mm(-d.grid(20, 50, 10))}}}


def air(d: LanguageDraft) -> None:
    """Moves in the air: moves, turns, paths of the tool and of the joints."""
    d.use_law()
    arm(d)
    x, y, z = d.grid(420, 520, 10), d.grid(-120, 120, 20), d.grid(300, 450, 10)
    d["robot"]["start"] = {"xyz": mm(x, y, z)}
    a, b, v = d.grid(20, 80, 10), d.grid(20, 60, 10), d.grid(40, 150, 10)
    joints = list(_OVER_THE_BENCH[d.model])
    joints[0] = d.sign() * d.grid(10, 40, 5)
    stages: list[tuple[str, Section]] = [
        ("aside", {"axes": {"y": {"move": mm(d.sign() * a), "speed": f"{v:g} mm/s"}}}),
        ("roll", {"axes": {d.pick("rx", "ry", "rz"): {"move": deg(d.sign() * d.grid(5, 30, 5))}}}),
        (
            "swing",
            {"axes": {"x": {"velocity": f"{v / 2:g} mm/s * sin(2*pi*t/(2 s))"}}, "time": "2 s"},
        ),
        ("spin", {"axes": {"rz": {"velocity": f"{d.grid(5, 25, 5):g} deg/s"}}, "time": "1.5 s"}),
        (
            "sway",
            {
                "axes": {"rx": {"position": f"{d.pick(3, 5, 10)} deg * sin(2*pi*t/(3 s))"}},
                "time": "3 s",
            },
        ),
        ("carry", {"path": {"line": {"by": mm(a, b, d.sign() * 20)}, "speed": f"{v:g} mm/s"}}),
        (
            "lean",
            {
                "path": {
                    "line": {"by": [0, 0, 0, *deg(d.grid(5, 20, 5), d.grid(5, 15, 5))]},
                    "time": "2 s",
                }
            },
        ),
        (
            "eight",
            {
                "path": {
                    "lissajous": {"amplitude": mm(a / 2, b / 2), "turns": [1, 2]},
                    "time": f"{d.pick(4, 6)} s",
                }
            },
        ),
        ("fetch", {"path": {"joints": deg(*joints), "speed": f"{d.grid(20, 60, 10):g} deg/s"}}),
        (
            "parts",
            {
                "path": {
                    "joints": [deg(*joints), deg(*_OVER_THE_BENCH[d.model])],
                    "time": f"{d.pick(5, 6)} s",
                }
            },
        ),
        ("pause", {"time": f"{d.pick(0.3, 0.5, 1)} s"}),
        ("loosen", {"axes": {"y": "free"}, "time": "1 s"}),
    ]
    if d.law in MULTIPLIERS:
        stages.pop()
    jointed = False
    for index in d.rng.permutation(len(stages))[: d.pick(1, 2, 3, 4)]:
        name, made = stages[int(index)]
        d.stages[name] = made
        jointed |= "joints" in made.get("path", {})
        if d.chance(0.4) and not jointed and name != "loosen":
            expect(
                d,
                d.pick(
                    f"max(abs({name}.error.z)) < 10 mm",
                    f"max({name}.speed) < 500 mm/s",
                    f"rms({name}.error.y) < 8 mm",
                    f"max(norm({name}.error)) < 25 mm",
                ),
            )
        elif name in ("fetch", "parts"):
            expect(d, f"max({name}.joint_error) < {d.pick(0.5, 1, 2)} deg")
    if d.chance(0.4):
        d["limits"]["speed"] = f"{d.pick(300, 400, 500)} mm/s"
    moved = d.stages.get("aside", {}).get("axes", {})
    if moved and d.chance(0.5):
        # Beside y, which begins where the file says or where the stage before ends.
        moved[d.pick("rx", "rz")] = {"follows": f"{d.pick(1, 2, 3)} rad/m * (y - {y:g} mm)"}
        moved["z"] = {
            "follows": d.pick(
                f"{z:g} mm + {d.pick(0.1, 0.3, -0.2)} * (y - {y:g} mm)",
                f"{z:g} mm + 10 mm * sin((y - {y:g} mm)/({d.pick(10, 20)} mm))",
            )
        }
    if d.chance(0.2):
        expect(
            d,
            d.pick(
                "max(abs(joint.4.velocity)) < 120 deg/s",
                "max(abs(joint.2.torque)) < 140 N*m",
                "max(norm(force)) < 5 N",
            ),
        )


def held(d: LanguageDraft) -> None:
    """Turns, pulls or screws a mechanism that it holds."""
    kind = d.pick("hinge", "slide", "screw")
    d.use_law(*[law for law in LAWS if law != "stiffness"])
    d.model = d.one_of(("panda", "ur5e"))
    x, y, z = d.grid(430, 500, 10), d.grid(-60, 60, 20), d.grid(300, 400, 10)
    made: Section = {"mechanism": kind, "xyz": mm(x, y, z)}
    name = {
        "hinge": d.pick("crank", "door", "lever"),
        "slide": d.pick("drawer", "bolt"),
        "screw": "valve",
    }[kind]
    d["robot"] |= {"model": d.model, "grasp": f"{name}.handle"}
    if d.chance(0.3):
        d["robot"]["tool"] = tool(d, "ball", "flat")
    if kind == "slide":
        _held_slide(d, name, made)
    elif kind == "hinge":
        _held_hinge(d, name, made)
    else:
        _held_screw(d, name, made)
    if d.chance(0.4):
        d["limits"]["force"] = newton(d.pick(60, 80, 120))


def _held_slide(d: LanguageDraft, name: str, made: Section) -> None:
    way, v = d.grid(40, 120, 10), d.grid(30, 100, 10)
    made |= {
        "rpy": d.pick([0, "90 deg", 0], ["90 deg", 0, 0], [0, 0, 0]),
        "mass": f"{d.nice(0.5, 4):g} kg",
    }
    made["damping"] = f"{d.nice(2, 30):g} N*s/m"
    if d.chance(0.6):
        made["friction"] = newton(d.nice(1, 8))
    if d.chance(0.4):
        made["stop"] = f"0 .. {way + d.pick(20, 50)} mm"
    if d.chance(0.3):
        made["detent"] = {"at": mm(15), "force": newton(d.pick(4, 8, 12)), "width": mm(8)}
    d["world"][name] = made
    d["frame"] = f"{name}.handle"
    axes: Section = {
        "x": {"force": 0},
        "y": {"force": 0},
        "z": {"velocity": f"{v:g} mm/s * smooth(t/(0.3 s))"},
    }
    if d.chance(0.4):
        axes["z"] = {"move": mm(way), "speed": f"{v:g} mm/s"}
        d.stages["pull"] = {"axes": axes}
    else:
        d.stages["pull"] = {
            "axes": axes,
            "until": f"{name}.travel > {way:g} mm",
            "within": {"time": f"{math.ceil(way / v + 2)} s"},
        }
    if d.chance(0.4):
        d.stages["back"] = {"axes": {**axes, "z": {"move": mm(-way / 2), "speed": f"{v:g} mm/s"}}}
    expect(d, d.pick(f"max({name}.travel) > {way * 0.9:.0f} mm", f"max(abs({name}.force)) < 80 N"))


def _held_hinge(d: LanguageDraft, name: str, made: Section) -> None:
    radius, angle, v = d.grid(80, 200, 10), d.grid(30, 90, 10), d.grid(30, 90, 10)
    made |= {
        "handle": d.pick(mm(radius, 0, 0), mm(0, -radius, 0)),
        "inertia": f"{d.nice(0.01, 0.2):g} kg*m^2",
    }
    if d.chance(0.6):
        made["knob"] = "free"
    if d.chance(0.8):
        made["damping"] = f"{d.nice(0.05, 0.6):g} N*m*s/rad"
    if d.chance(0.4):
        made["friction"] = f"{d.nice(0.1, 1):g} N*m"
    if d.chance(0.4):
        made["stop"] = d.pick(f"0 .. {angle + 30:g} deg", "+- 120 deg")
    if d.chance(0.2):
        made["detent"] = {"at": deg(10), "force": f"{d.pick(0.5, 1, 2)} N*m", "width": deg(5)}
    d["world"][name] = made
    d["frame"] = f"{name}.handle"
    turning: Value = {"hold": "world"} if made.get("knob") == "free" else {"follows": name}
    axes: Section = {
        "x": {"force": 0},
        "y": {"velocity": f"{v:g} mm/s * smooth(t/(0.3 s))"},
        "z": {"force": 0},
    }
    if made.get("knob") == "free" or d.chance(0.7):
        axes["rz"] = turning
    if d.chance(0.5):
        axes |= {"rx": {"torque": 0}, "ry": {"torque": 0}}
    time = math.ceil(math.radians(angle) * radius / v + 2)
    d.stages["rotate"] = {
        "axes": axes,
        "until": f"{name}.angle > {angle:g} deg",
        "within": {"time": f"{time} s"},
    }
    if d.chance(0.3):
        d.stages["hold"] = {"time": "0.5 s"}
    expect(
        d,
        d.pick(
            f"last({name}.angle) > {angle - 5:g} deg",
            f"max(abs(rotate.{name}.torque)) < 15 N*m",
            "max(norm(rotate.force)) < 80 N",
        ),
    )


def _held_screw(d: LanguageDraft, name: str, made: Section) -> None:
    radius, angle, v = d.pick(0, 60, 80, 100), d.grid(30, 90, 10), d.grid(20, 60, 10)
    made |= {
        "pitch": f"{d.pick(2, 4, 8, 10)} mm/turn",
        "damping": f"{d.nice(0.02, 0.2):g} N*m*s/rad",
    }
    if radius:
        made["handle"] = mm(radius, 0, 0)
    if d.chance(0.4):
        made["friction"] = f"{d.nice(0.05, 0.4):g} N*m"
    d["world"][name] = made
    d["frame"] = f"{name}.handle"
    if radius:
        axes: Section = {
            "x": {"force": 0},
            "y": {"velocity": f"{v:g} mm/s"},
            "z": {"force": 0},
            "rz": {"follows": name},
        }
        if d.chance(0.4):
            axes["z"] = {"follows": name}
        time = math.ceil(math.radians(angle) * radius / v + 2)
    else:
        rate = d.grid(10, 40, 5)
        axes = {
            "x": {"force": 0},
            "y": {"force": 0},
            "z": {"follows": name},
            "rz": {"velocity": f"{rate:g} deg/s"},
        }
        time = math.ceil(angle / rate + 2)
    d.stages["open"] = {
        "axes": axes,
        "until": f"{name}.angle > {angle:g} deg",
        "within": {"time": f"{time} s"},
    }
    expect(d, d.pick(f"max({name}.travel) > 0", f"max(abs({name}.torque)) < 10 N*m"))


def pushed(d: LanguageDraft) -> None:
    """Pushes a button, or a door by its leaf."""
    d.use_law()
    arm(d, "ball", "flat")
    x, y, z = d.grid(440, 520, 10), d.grid(-80, 80, 20), d.grid(220, 320, 10)
    bound(d, 10)
    if d.chance(0.6):
        way = d.pick(4, 6, 8)
        button: Section = {
            "mechanism": "slide",
            "xyz": mm(x, y, z),
            "rpy": ["180 deg", 0, 0],
            "mass": f"{d.pick(30, 50, 100)} g",
            "damping": f"{d.pick(5, 10, 20)} N*s/m",
            "stop": f"0 .. {way} mm",
        }
        if d.chance(0.6):
            button["friction"] = newton(d.pick(0.5, 1, 2))
        if d.chance(0.6):
            button["detent"] = {
                "at": mm(way / 2),
                "force": newton(d.pick(3, 5, 8)),
                "width": mm(way / 4),
            }
        cap: Section = {"shape": d.pick("cylinder", "box"), "on": "button", "xyz": [0, 0, mm(10)]}
        cap |= (
            {"radius": mm(15), "length": mm(20)}
            if cap["shape"] == "cylinder"
            else {"size": mm(30, 30, 20)}
        )
        d["world"] |= {"button": button, "cap": cap | material(d)}
        gap = d.grid(10, 25, 5)
        d["robot"]["start"] = {"xyz": mm(x, y, z + gap)}
        approach(d, "cap", gap)
        level = d.pick(8, 10, 15)
        d.stages["push"] = d.pick(
            {
                "axes": {"z": {"velocity": "-5 mm/s"}},
                "until": f"force.z < -{level} N",
                "within": {"time": "5 s", "travel": mm(20)},
            },
            {"axes": {"z": {"force": newton(-level), "ramp": "0.5 s"}}, "time": "1.5 s"},
            {"axes": {"z": {"move": mm(-way - 1), "speed": "10 mm/s"}}},
        )
        expect(d, f"max(button.travel) > {way * 0.8:g} mm")
        leave(d)
        return
    radius = d.grid(200, 300, 20)
    d["world"] |= {
        "door": {
            "mechanism": "hinge",
            "xyz": mm(x, y - radius, z),
            "handle": mm(0, radius, 0),
            "inertia": f"{d.nice(0.05, 0.4):g} kg*m^2",
            "damping": f"{d.nice(0.2, 2):g} N*m*s/rad",
            "stop": "-90 .. 90 deg",
        },
        "leaf": {
            "shape": "box",
            "on": "door",
            "size": mm(20, 2 * radius, 200),
            "xyz": mm(0, radius, 0),
        }
        | material(d),
    }
    gap = d.grid(10, 20, 5)
    tip = d["robot"].get("tool", {}).get("radius", "10 mm").split()[0]
    d["robot"]["start"] = {"xyz": mm(x - 10 - gap - float(tip), y, z)}
    v = d.grid(20, 60, 10)
    d.stages["reach"] = {
        "axes": {"x": {"velocity": f"{v:g} mm/s"}},
        "until": "force.x > 1 N for 5 ms",
        "within": {"time": "3 s"},
    }
    d.stages["push"] = {"axes": {"x": {"move": mm(d.grid(30, 80, 10)), "speed": f"{v:g} mm/s"}}}
    expect(d, d.pick("max(abs(door.angle)) > 3 deg", "max(norm(force)) < 80 N"))


def rail(d: LanguageDraft) -> None:
    """Keeps to equations: a rail, a floor, a ceiling, coupled joints."""
    kind = d.pick("ring", "ring", "floor", "ceiling", "joints")
    d.use_law(*(MULTIPLIERS if d.chance(0.8) or kind == "joints" else LAWS[:9]))
    if kind == "joints":
        d.model = "planar3"
        d["robot"] |= {"model": "planar3", "start": {"joints": deg(30, 40, -70)}}
        spring = {"stiffness": "2 kN*m/rad", "damping": "5 N*m*s/rad"}
        spring = {"stiffness": "exact"} if d.chance(0.3) else spring
        d["world"]["bars"] = {"equation": "q1 + q2 + q3 = 0", **spring}
        d.stages["go"] = {
            "axes": {
                "x": {"velocity": f"{d.sign() * d.grid(10, 40, 10):g} mm/s * sin(2*pi*t/(2 s))"}
            },
            "time": "2 s",
        }
        if d.law in MULTIPLIERS and d.chance(0.6):
            d.stages["go"]["constraints"] = {"bars": {"torque": f"{d.pick(0.5, 1, 2)} N*m"}}
        if d.chance(0.5):
            swing, load = f"{d.grid(5, 15, 5):g} deg*sin(2*pi*t/(2 s))", f"{d.pick(0.5, 1)} N*m"
            d.stages["swing"] = {
                "path": {
                    "joints": [f"30 deg + {swing}", f"40 deg - {swing}", "-70 deg"],
                    "time": "2 s",
                }
            }
            if d.law in MULTIPLIERS:
                d.stages["swing"]["constraints"] = {"bars": {"generalised": [load] * 3}}
                expect(d, "max(swing.bars.residual) < 1 mN*m")
        expect(d, "max(abs(bars.gap)) < 1 deg")
        return
    arm(d, "ball", "", models=("panda", "ur5e"))
    x, y, z, r = (
        d.grid(430, 500, 10),
        d.grid(-60, 60, 20),
        d.grid(320, 400, 10),
        d.grid(50, 100, 10),
    )
    k = f"{d.nice(10, 80):g} kN/m"
    d["frames"]["rail"] = {"xyz": mm(x, y, z)}
    d["frame"] = "rail"
    multipliers = d.law in MULTIPLIERS
    force = d.grid(4, 15, 1)
    if kind == "ring":
        d["robot"]["start"] = {"xyz": mm(x + r, y, z)}
        spring = {"stiffness": k, "damping": "100 N*s/m"}
        spring = {"stiffness": "exact"} if d.chance(0.3) else spring
        rim = f"x^2 + y^2 = ({r:g} mm)^2"
        d["world"]["rim"] = {"equation": rim, "frame": "rail", **spring}
        if d.chance(0.5):
            k = spring["stiffness"]
            d["world"]["level"] = {"equation": "z = 0 mm", "frame": "rail", "stiffness": k}
        d.stages["round"] = {
            "path": {
                "arc": {"center": [0, 0], "turns": d.pick(0.5, 1, -1)},
                "time": f"{d.pick(5, 6, 8)} s",
            }
        }
        if multipliers:
            push = newton(d.sign() * force)
            d.stages["round"]["constraints"] = {"rim": {"force": push}}
            expect(d, f"mean(round.rim.force) within {push} +- 20 %")
        return
    up = kind == "ceiling"
    d["robot"]["start"] = {"xyz": mm(x, y, z)}
    edge = f"z {'<=' if up else '>='} {z:g} mm"
    d["world"][kind] = {
        "equation": edge + (" + 2 mm * sin(2*pi*clock*0.5 Hz)" if d.chance(0.25) else ""),
        "stiffness": k,
    }
    d["world"][kind]["damping"] = "60 N*s/m"
    push = newton(force if up else -force)
    stage: Section = {
        "axes": {"x": {"velocity": f"{d.grid(10, 40, 10):g} mm/s * smooth(t/(0.5 s))"}},
        "time": f"{d.pick(1, 2)} s",
    }
    if multipliers:
        stage["constraints"] = {kind: {"force": push, "ramp": "0.5 s"}}
    else:
        stage["axes"]["z"] = {"force": push}
    d.stages["along"] = stage
    expect(d, f"mean(along.{kind}.force) within {push} +- 25 %")


def insertion(d: LanguageDraft) -> None:
    """Puts a peg into a hole, a blade into a slot, or follows a groove."""
    kind = d.pick("hole", "hole", "slot", "groove")
    d.use_law(*FORCE_LOOPS, "impedance")
    x, y, z = d.grid(440, 520, 10), d.grid(-60, 60, 20), d.grid(220, 300, 10)
    made: Section = {"shape": kind, "xyz": mm(x, y, z)}
    clear = d.pick(0.2, 0.3, 0.5, 1)
    depth = d.grid(15, 30, 5)
    length = d.grid(120, 160, 10)
    if kind == "hole":
        arm(d, "")
        r = d.grid(6, 15, 1)
        made |= {"radius": mm(r), "depth": mm(depth)}
        if d.chance(0.3):
            made["size"] = mm(120, 120, depth + 20)
        d["robot"]["tool"] = {
            "shape": "cylinder",
            "radius": mm(r - clear / 2),
            "thickness": mm(depth + 10),
            "length": mm(length),
        }
    elif kind == "slot":
        arm(d, "")
        w = d.grid(10, 20, 2)
        made |= {"width": mm(w), "depth": mm(depth)}
        if d.chance(0.4):
            made["length"] = mm(80)
        d["robot"]["tool"] = {
            "shape": "box",
            "size": mm(30, w - clear, depth + 10),
            "length": mm(length),
        }
    else:
        arm(d, "ball")
        made |= {"angle": deg(d.pick(60, 90, 120)), "depth": mm(d.pick(10, 15))}
    if kind != "groove" and d.chance(0.6):
        made["chamfer"] = mm(d.pick(0.5, 1, 2))
    d["robot"].setdefault("tool", {})["mass"] = f"{d.grid(100, 500, 50):g} g"
    made |= {"stiffness": f"{d.nice(30, 120):g} kN/m", "friction": d.grid(0.05, 0.3, 0.05)}
    name = {"hole": "socket", "slot": "slot1", "groove": "guide"}[kind]
    d["world"][name] = made
    aside = d.pick(0, 0, 0, 0.5, 1.5)
    gap = d.grid(5, 15, 5)
    yaw = d.pick(0, 90) if kind == "slot" else 0
    if yaw:
        made["rpy"] = deg(0, 0, yaw)
    d["robot"]["start"] = {
        "xyz": mm(x + (0 if kind == "slot" else aside), y, z + gap),
        "rpy": deg(180, 0, -yaw),
    }
    d["limits"]["force"] = newton(d.pick(40, 60, 80))
    value = d.grid(5, 12, 1)
    if kind == "groove":
        approach(d, name, gap)
        d.stages["follow"] = {
            "axes": {
                "x": {"move": mm(d.grid(30, 80, 10)), "speed": f"{d.grid(20, 50, 10):g} mm/s"},
                "y": {"force": 0},
                "z": {"force": newton(-value)},
            }
        }
        expect(d, f"mean(follow.force.z) within {-value:g} N +- 20 %")
        return
    soft: Section = {
        "x": {"force": 0},
        "y": {"force": 0},
        "z": {"force": newton(-value)},
        "rx": {"torque": 0},
        "ry": {"torque": 0},
    }
    if kind == "hole" and aside:
        approach(d, name, gap)
        d.stages["search"] = {
            "axes": {"z": {"force": newton(-value)}},
            "path": {
                "spiral": {"pitch": mm(d.pick(0.5, 1)), "radius": mm(3)},
                "speed": f"{d.pick(6, 8, 10)} mm/s",
            },
            "until": "max(position.z) - position.z > 0.7 mm or abs(force.x) > 6 N",
            "within": {"time": "10 s"},
        }
    else:
        d.stages["lower"] = {
            "axes": {"z": {"move": mm(-gap - d.pick(1, 3)), "speed": f"{d.pick(10, 20)} mm/s"}}
        }
    d.stages["insert"] = {
        "axes": soft if d.chance(0.8) else {"z": {"force": newton(-value)}},
        "until": f"position.z < {z - depth + 5:g} mm",
        "within": {"time": "8 s"},
    }
    if d.chance(0.4):
        d.stages["insert"] |= {"on_fail": "lift", "next": "end"}
        d.stages["lift"] = {"axes": {"z": {"move": mm(30)}}, "next": "fail"}
    expect(d, d.pick("max(norm(force)) < 60 N", f"last(insert.position.z) < {z - depth + 6:g} mm"))


def compliant(d: LanguageDraft) -> None:
    """Gives way: to a hand, to an obstacle, on soft axes."""
    kind = d.pick("hand", "soft", "obstacle")
    x, y, z = d.grid(430, 500, 10), d.grid(-60, 60, 20), d.grid(300, 400, 10)
    d.use_law(
        *(FORCE_LOOPS if kind == "hand" else [law for law in LAWS[:9] if law not in MULTIPLIERS])
    )
    arm(d, "ball", "flat", "")
    d["robot"]["start"] = {"xyz": mm(x, y, z)}
    if kind == "hand":
        far, time = d.grid(40, 120, 10), d.pick(2, 3)
        d["world"]["palm"] = {
            "shape": "box",
            "size": mm(60, 400, 200),
            "xyz": mm(x - 30 - d.pick(25, 35), y, z),
            "stiffness": f"{d.nice(0.5, 3):g} kN/m",
            "damping": "10 N*s/m",
            "motion": {"x": f"{far:g} mm * smooth(clock/({time} s))"},
        }
        d.stages["led"] = {
            "axes": {"x": {"force": 0}, "y": {"force": 0}, "z": "hold"},
            "time": f"{time} s",
        }
        expect(
            d,
            d.pick(
                f"max(norm(force)) < {d.pick(15, 20, 30)} N", f"last(led.travel) > {far / 4:.0f} mm"
            ),
        )
        return
    axis = d.pick("x", "y")
    d["world"]["block"] = {
        "shape": "box",
        "size": mm(60, 60, 200),
        "stiffness": f"{d.nice(5, 60):g} kN/m",
        "xyz": mm(x + 30 + 60 * (axis == "x"), y + 90 * (axis == "y"), z),
    } | ({"friction": 0.2} if d.chance(0.5) else {})
    soft: Section = {"stiffness": f"{d.nice(200, 2000):g} N/m"}
    if d.law != "pd-joint":
        soft["damping"] = f"{d.nice(40, 150):g} N*s/m"
    v = d.grid(20, 50, 10)
    goal = soft | {"move": mm(d.grid(30, 90, 10)), "speed": f"{v:g} mm/s"}
    d.stages["go"] = {"axes": {axis: goal}}
    if kind == "soft":
        d.stages["go"]["axes"] |= {
            ("y" if axis == "x" else "x"): dict(soft),
            "rz": d.pick("hold", "free"),
        }
        d.stages["rest"] = {"axes": {axis: dict(soft)}, "time": "1 s"}
    expect(d, f"max(norm(force)) < {d.pick(60, 100, 150)} N")
    if d.chance(0.5):
        d["limits"]["force"] = newton(d.pick(80, 120))


def probing(d: LanguageDraft) -> None:
    """Probes again and again: loops, attempts, ways by condition, limits that lead somewhere."""
    d.use_law(*[law for law in LAWS if law != "stiffness"])
    arm(d, "ball", "flat")
    s = surface(d, "plane", "box", tilted=False)
    gap = over(d, s)
    count = d.pick(2, 3)
    value = d.grid(4, 12, 1)
    back = {"axes": {"z": {"move": mm(d.pick(8, 10, 15))}}}
    approach(d, s.name, gap, "touch")
    kind = d.pick("visits", "attempts", "limit", "repeat")
    if kind == "visits":
        d.stages["lift"] = back | {
            "next": [{"when": f"touch.visits < {count}", "to": "touch"}, {"to": "end"}]
        }
        expect(d, f"touch.visits >= {count}")
    elif kind == "attempts":
        settled = f"abs(force.z + {value:g} N) < {d.pick(1, 2)} N"
        d.stages["touch"] |= {"attempts": count, "on_fail": "lift"}
        d.stages["settle"] = {
            "axes": {"z": {"force": newton(-value)}},
            "until": f"({settled} and speed < 5 mm/s) for {d.pick(50, 100)} ms",
            "fail_if": "not touching for 100 ms",
            "within": {"time": f"{d.pick(2, 3)} s", "travel": mm(8)},
            "on_fail": "lift",
            "next": "end",
        }
        d.stages["lift"] = back | {"next": "touch"}
        expect(d, f"last(settle.force.z) within {-value:g} N +- 2 N")
    elif kind == "limit":
        d["limits"]["force"] = {"max": newton(d.pick(30, 40, 60)), "then": "lift"}
        d.stages["touch"]["attempts"] = count
        d.stages["press"] = {
            "axes": {"z": {"force": newton(-value)}},
            "time": "1.5 s",
            "next": "end",
        }
        d.stages["lift"] = back | {"next": "touch"}
        expect(d, "press.visits >= 1")
    else:
        d.stages["lift"] = back
        d.stages["shake"] = {
            "axes": {"x": {"move": mm(d.pick(4, 6)), "speed": "40 mm/s"}},
            "repeat": count,
        }
        expect(d, f"shake.visits >= {count}")


def contour(d: LanguageDraft) -> None:
    """Follows what it feels: frames that track the force or the motion, or are estimated."""
    kind = d.pick("force", "velocity", "estimate", "estimate")
    d.use_law("hybrid", "parallel", "hybrid-multipliers", "impedance")
    arm(d, "ball", "")
    s = surface(d, *(("cylinder", "sphere", "plane") if kind == "force" else ("plane", "box")))
    d["world"][s.name]["friction"] = d.pick(0, 0.1, 0.2)
    gap = over(d, s)
    value = d.grid(5, 15, 1)
    bound(d, value)
    approach(d, s.name, gap)
    if kind == "estimate":
        d.stages["feel"] = {"axes": {"z": {"force": newton(-value)}}, "time": f"{d.pick(0.5, 1)} s"}
        d["frames"]["felt"] = {"estimate": "feel"}
        d.stages["work"] = {
            "frame": "felt",
            "axes": {
                "z": {"force": newton(-value)},
                "x": {"move": mm(d.grid(20, 50, 10)), "speed": "40 mm/s"},
            },
        }
        expect(d, f"mean(work.force.z) within {-value:g} N +- 25 %")
        if d.chance(0.4):
            expect(
                d,
                f"max(abs(work.force.x in {s.name})) < 10 N"
                if s.own
                else "max(norm(force)) < 60 N",
            )
    elif kind == "force":
        d["frames"]["skin"] = {
            "track": "force",
            "filter": f"{d.pick(2, 3, 5)} Hz",
            "floor": newton(d.pick(1, 2)),
        }
        d.stages["press"] = {"axes": {"z": {"force": newton(-value)}}, "time": "0.5 s"}
        d.stages["trace"] = {
            "frame": "skin",
            "axes": {
                "z": {"force": newton(-value)},
                "x": {"velocity": f"{d.grid(10, 30, 5):g} mm/s * smooth(t/(0.5 s))"},
            },
            "until": f"travel > {d.pick(20, 30, 40)} mm",
            "within": {"time": "6 s"},
        }
        expect(d, f"trace.force.z within {-value:g} N +- 3 N for 80 %")
    else:
        d["frames"]["rim"] = {
            "track": "velocity",
            "filter": f"{d.pick(4, 6)} Hz",
            "floor": f"{d.pick(4, 8)} mm/s",
            "turn": "90 deg/s",
        }
        d.stages["press"] = {"axes": {"z": {"force": newton(-value)}}, "time": "0.5 s"}
        d.stages["trace"] = {
            "frame": "rim",
            "axes": {
                "z": {"force": newton(-value)},
                "x": {"velocity": f"{d.grid(20, 40, 5):g} mm/s * smooth(t/(0.3 s))"},
            },
            "time": f"{d.pick(1, 2)} s",
        }
        expect(d, "max(norm(trace.force)) < 50 N")
    if d.chance(0.7):
        d.stages["off"] = {"frame": "world", "axes": {"z": {"move": mm(30)}}}


def loose(d: LanguageDraft) -> None:
    """Holds a loose body and sets it down, or pushes one along."""
    x, y, z = d.grid(440, 510, 10), d.grid(-60, 60, 20), d.grid(200, 300, 10)
    size = [d.grid(40, 80, 10), d.grid(40, 80, 10), d.grid(40, 80, 10)]
    d["world"]["table"] = {"shape": "plane", "xyz": mm(0, 0, z)} | material(d)
    d["world"]["table"]["friction"] = d.pick(0.2, 0.3, 0.4)
    part: Section = {
        "shape": "box",
        "size": mm(*size),
        "mass": f"{d.grid(200, 1200, 100):g} g",
        "free": True,
        "stiffness": f"{d.nice(10, 60):g} kN/m",
    }
    d["world"]["part"] = part
    if d.chance(0.5):
        d.use_law("hybrid", "impedance", "parallel", "impedance-natural", "pd")
        arm(d, "ball", "flat")
        gap = d.grid(10, 30, 5)
        part["xyz"] = mm(x, y, z + size[2] / 2 + gap)
        d["robot"]["grasp"] = "part"
        v = d.grid(10, 30, 5)
        d.stages["down"] = {
            "axes": {"z": {"velocity": f"-{v:g} mm/s"}},
            "until": f"t > 300 ms and gap < {d.pick(0, 0)}"
            if d.chance(0.1)
            else f"t > {gap / v + 1:.1f} s",
            "within": {"time": f"{math.ceil(gap / v + 3)} s"},
        }
        if d.chance(0.6):
            d.stages["up"] = {"axes": {"z": {"move": mm(30)}}}
        expect(d, d.pick("max(norm(force)) < 120 N", "max(abs(torque.rx)) < 5 N*m"))
        d["limits"]["force"] = newton(150)
        return
    d.use_law()
    arm(d, "ball", "flat")
    part |= {"xyz": mm(x, y, z + size[2] / 2), "friction": d.pick(0.1, 0.2)}
    tip = float(d["robot"]["tool"]["radius"].split()[0])
    gap = d.grid(5, 20, 5)
    d["robot"]["start"] = {"xyz": mm(x - size[0] / 2 - tip - gap, y, z + size[2] / 2)}
    way = d.grid(20, 60, 10)
    d.stages["push"] = {
        "axes": {"x": {"move": mm(gap + way), "speed": f"{d.grid(20, 60, 10):g} mm/s"}}
    }
    expect(d, d.pick("max(part.force) < 60 N", "max(norm(force)) < 80 N"))


def moving(d: LanguageDraft) -> None:
    """Presses on something that moves by itself."""
    d.use_law(*FORCE_LOOPS, "impedance", "impedance-natural")
    arm(d, "ball", "flat", "")
    s = surface(d, "plane", "box", "box", tilted=False)
    gap = over(d, s)
    a = d.pick(1, 2, 3)
    d["world"][s.name]["motion"] = d.pick(
        {"z": f"{a} mm * sin(2*pi*clock*{d.pick(0.5, 1)} Hz)"},
        {"x": f"{d.grid(10, 40, 10):g} mm/s * clock"},
        {"x": f"{d.grid(10, 30, 5):g} mm * sin(2*pi*clock/(4 s))"},
        {"ry": f"{d.pick(1, 2)} deg * sin(2*pi*clock/(4 s))"},
    )
    value = d.grid(6, 20, 1)
    d["frame"] = s.name if d.chance(0.6) else ""
    bound(d, value)
    approach(d, s.name, gap)
    d.stages["approach"]["within"] = {"time": "6 s"}
    stage: Section = {"axes": {"z": {"force": newton(-value)}}, "time": f"{d.pick(2, 3)} s"}
    if not d["frame"] and d.chance(0.5):
        stage["contact"] = s.name
    d.stages["ride"] = stage
    expect(d, f"mean(ride.force.z) within {-value:g} N +- {d.pick(25, 40)} %")
    if d.chance(0.5):
        expect(d, "max(norm(force)) < 100 N")
    leave(d)


def corner(d: LanguageDraft) -> None:
    """Presses on a floor and a wall at once."""
    d.use_law(*FORCE_LOOPS)
    arm(d, "ball", "")
    x, y, z = d.grid(440, 500, 10), d.grid(-60, 60, 20), d.grid(220, 300, 10)
    d["world"]["floor"] = {"shape": "plane", "xyz": mm(0, 0, z)} | material(d)
    tip = float(d["robot"].get("tool", {}).get("radius", "10 mm").split()[0])
    gap, side = d.grid(10, 25, 5), d.grid(10, 25, 5)
    d["world"]["wall"] = {
        "shape": "plane",
        "xyz": mm(x + tip + side, 0, 0),
        "rpy": [0, "-90 deg", 0],
    } | material(d)
    d["robot"]["start"] = {"xyz": mm(x, y, z + gap)}
    down, push = d.grid(5, 15, 1), d.grid(4, 12, 1)
    bound(d, down + push)
    approach(d, "floor", gap)
    d.stages["find"] = {
        "axes": {"x": {"velocity": f"{d.grid(10, 25, 5):g} mm/s"}, "z": {"force": newton(-down)}},
        "until": f"force.x > {d.pick(3, 4)} N for 20 ms"
        if d.chance(0.3)
        else "wall.gap < 0 for 10 ms",
        "within": {"time": "6 s"},
    }
    d.stages["seat"] = {
        "axes": {"x": {"force": newton(push)}, "z": {"force": newton(-down)}},
        "time": f"{d.pick(1, 2)} s",
    }
    if d.chance(0.5):
        d.stages["seat"]["axes"]["y"] = {
            "velocity": f"{d.grid(5, 20, 5):g} mm/s * smooth(t/(0.5 s))"
        }
    expect(d, f"mean(seat.force.x) within {push:g} N +- 30 %")
    if d.chance(0.5):
        expect(d, f"mean(seat.wall.force) < {3 * push:g} N")


def mount(d: LanguageDraft) -> None:
    """Holds or presses a rubber mount, or goes along a guide that turns the tool."""
    kind = d.pick("hold", "press", "press", "thread", "cone")
    x, y, z = d.grid(430, 520, 10), d.grid(-60, 60, 20), d.grid(320, 400, 10)
    down: Section = {"xyz": mm(x, y, z), "rpy": deg(180, 0, 0)}
    if kind in ("hold", "press"):
        d.use_law(*(FORCE_LOOPS if kind == "press" else LAWS[:9]))
        arm(d, "ball", "", models=("panda", "ur5e"))
        k, turn = d.nice(1, 8), d.nice(10, 60)
        made: Section = {"bushing": "tool", "xyz": mm(x, y, z)}
        entries: list[Value] = [f"{k:g} kN/m"] * 3 + [f"{turn:g} N*m/rad"] * 3
        if d.chance(0.5):
            coupled = f"{0.4 * math.sqrt(1e3 * k * turn):.3g}"
            made["stiffness"] = [[entries[i] if i == j else 0 for j in range(6)] for i in range(6)]
            made["stiffness"][0][4] = f"{coupled} N/rad"
            made["stiffness"][4][0] = f"{coupled} N"
        else:
            made["stiffness"] = entries
        if d.chance(0.7):
            made["damping"] = [*["40 N*s/m"] * 3, *["1 N*m*s/rad"] * 3]
        d["world"]["mount"] = made
        d["robot"]["start"] = {"xyz": mm(x + (d.grid(-4, 4, 1) if kind == "hold" else 0), y, z)}
        d["frame"] = "mount"
        if kind == "hold":
            d.stages["hold"] = {"time": "2 s"}
            expect(d, "max(norm(hold.mount.force.x, hold.mount.force.z)) < 60 N")
            return
        push = newton(d.sign() * d.grid(3, 12, 1))
        d.stages["push"] = {"axes": {"z": {"force": push}}, "time": "3 s"}
        expect(d, f"last(push.mount.force.z) within {push} +- 10 %")
        return
    d.use_law(*MULTIPLIERS)
    arm(d, "ball", "", models=("panda", "ur5e"))
    d["frames"]["guide"] = down
    d["frame"] = "guide"
    lean = d.grid(8, 20, 2) if kind == "cone" else 0
    d["robot"]["start"] = {"xyz": mm(x, y, z), "rpy": deg(180 - lean, 0, 0)}
    if kind == "thread":
        lead = d.pick(2, 3, 5)
        d["world"]["guide_way"] = {
            "equation": f"rz + {lead} rad/m * z = 0 rad",
            "frame": "guide",
            "stiffness": "10 kN/m",
            "damping": "30 N*s/m",
        }
        push = newton(d.grid(2, 6, 1))
        d.stages["along"] = {
            "constraints": {"guide_way": {"force": push}},
            "axes": {"z": {"move": mm(d.grid(10, 40, 10)), "speed": "20 mm/s"}},
        }
        expect(d, f"mean(along.guide_way.force) within {push} +- 20 %")
        return
    d["world"]["lean"] = {
        "equation": f"angle(tool.z, -world.z) = {lean:g} deg",
        "stiffness": "500 N*m/rad",
        "damping": "1 N*m*s/rad",
    }
    load = f"{d.pick(0.3, 0.5, 1)} N*m"
    d.stages["round"] = {
        "constraints": {"lean": {"torque": load}},
        "axes": {"rz": {"move": deg(d.sign() * d.grid(10, 30, 10)), "speed": "20 deg/s"}},
    }
    expect(d, f"mean(round.lean.torque) within {load} +- 20 %")


#: Scenes, and how often each is written.
SCENES: dict[str, tuple[Callable[[LanguageDraft], None], float]] = {
    "press": (press, 7),
    "planar": (planar, 2),
    "air": (air, 2),
    "held": (held, 2.5),
    "pushed": (pushed, 1),
    "rail": (rail, 1.5),
    "insertion": (insertion, 1.5),
    "compliant": (compliant, 1.5),
    "probing": (probing, 1.5),
    "contour": (contour, 1.5),
    "loose": (loose, 1),
    "moving": (moving, 1),
    "corner": (corner, 1),
    "mount": (mount, 1),
}
