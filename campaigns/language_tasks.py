"""The second generator of `make truth`: task files as different users would write them.

It is written from docs/language and the pages that it links, and reads nothing of the rules, so
that no constant of theirs is fitted to it. A file is a scene, the habits of who wrote it and, in a
third of them, one typical mistake. The same seed and number give the same file.

    python campaigns/language_tasks.py SEED NUMBER
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from language_draft import MULTIPLIERS, LanguageDraft, Section, Value, deg, mm, newton, scaled
from language_scenes import OUTLINE, SCENES

#: How many files have a mistake.
MISTAKEN = 0.33
#: Files that tasks name, beside them.
COMPANIONS = {
    OUTLINE: "x [mm], y [mm]\n0, 0\n15, 2\n30, 8\n38, 20\n30, 32\n15, 36\n",
    "cell.yaml": (
        "params: {lower: 25 mm/s}\n"
        "templates:\n"
        "  wait:\n"
        "    params: {lasts: 0.4 s}\n"
        "    axes: {}\n"
        "    time: lasts\n"
    ),
    "arm.yaml": (
        "about: bounds of our cell\n"
        "source: cell documentation\n"
        "tip: {speed: 1 m/s}\n"
        "reflex: {force: 120 N, torque: 30 N*m}\n"
    ),
}


def draft(seed: int, number: int) -> LanguageDraft:
    """The draft of file `number` of a seed."""
    d = LanguageDraft(seed, number)
    d.kind = d.one_of(list(SCENES), [share for _, share in SCENES.values()])
    SCENES[d.kind][0](d)
    for habit, share in HABITS.items():
        if d.chance(share):
            habit(d)
    if d.chance(MISTAKEN):
        _mistake(d)
    return d


def language_task(seed: int, number: int) -> str:
    """The text of file `number` of a seed."""
    return draft(seed, number).written()


def write_companions(folder: Path) -> None:
    """Writes the files that tasks name."""
    for name, text in COMPANIONS.items():
        (folder / name).write_text(text, "utf-8")


# --- habits ------------------------------------------------------------------------------------


def _gains(d: LanguageDraft) -> None:
    """Gains of the law's own kind, one or a few of them."""
    law: Section = {"kind": d.law}
    k = f"{d.nice(400, 3000):g} N/m"
    c = f"{d.nice(60, 250):g} N*s/m"
    linear: Value = {"linear": k, "angular": f"{d.nice(20, 120):g} N*m/rad"}
    if d.law.startswith("hybrid"):
        some: Section = {
            "bandwidth": f"{d.grid(3, 8, 1):g} Hz",
            "damping_ratio": d.pick(0.7, 0.8, 1, {"linear": 1, "angular": 0.8}),
            "force": {"damping": {"z": f"{d.nice(150, 500):g} N*s/m"}},
        }
        if d.law != "hybrid-reaction" and d.chance(0.5):
            some["force"]["integral"] = {"z": f"{d.grid(4, 15, 1):g} /s"}
        elif d.law == "hybrid-reaction":
            some["force"]["proportional"] = {"z": d.pick(0.3, 0.5)}
    elif d.law in ("impedance", "parallel"):
        some = {
            "stiffness": linear,
            "damping": {"linear": c},
            "mass": {"linear": f"{d.grid(2, 6, 1):g} kg"},
        }
        if d.law == "parallel":
            some["force"] = {
                "integral": {"z": f"{d.grid(2, 8, 1):g} /s"},
                "proportional": d.pick(0.5, 1),
            }
    elif d.law == "pd-joint":
        some = {"stiffness": k, "damping": f"{d.pick(3, 5, 8)} N*m*s/rad"}
    elif d.law == "stiffness":
        some = {"stiffness": linear}
    else:
        some = {"stiffness": linear, "damping": {"linear": c}}
        if d.law == "parallel-pid":
            some["force"] = {"integral": {"z": f"{d.grid(2, 8, 1):g} /s"}}
    for index in d.rng.permutation(len(some))[: d.pick(1, 1, 2)]:
        key = list(some)[int(index)]
        law[key] = some[key]
    if "stiffness" in law and d.chance(0.3):
        law["stiffness"] = _spring(d)
    d["law"] = law


def _spring(d: LanguageDraft) -> Value:
    """A stiffness that couples two axes, or that varies."""
    k = [f"{d.nice(500, 2000):g} N/m" for _ in range(3)]
    springs: Section = dict(zip("xyz", k, strict=True))
    if d.chance(0.5):
        return springs | {d.pick("xy", "xz", "yz"): f"{d.nice(50, 300):g} N/m"}
    swing = f"{d.nice(50, 300):g} N/m * sin(2*pi*t/({d.pick(0.5, 1, 2)} s))"
    return springs | {d.pick("x", "y", "z"): f"{k[0]} + {swing}"}


def _in_law(d: LanguageDraft, **keys: Value) -> None:
    law = d["law"]
    d["law"] = (law if isinstance(law, dict) else {"kind": law}) | keys


def _solver(d: LanguageDraft) -> None:
    """Limits that are kept, with a bound on the torque's rate now and then."""
    _in_law(d, solve="qp")
    if d.chance(0.3):
        _in_law(d, solver="osqp")
    if d.chance(0.3):
        d["limits"]["torque_rate"] = f"{d.pick(2000, 4000, 8000)} N*m/s"
    if d.chance(0.3):
        d["expect"].append("max(force_inconsistent) < 20 N")


def _null_space(d: LanguageDraft) -> None:
    if d.model == "panda" and d.law not in ("pd-joint", "stiffness"):
        _in_law(d, null_space=d.pick("joint-limits", "manipulability", ["posture", "joint-limits"]))


def _angles(d: LanguageDraft) -> None:
    """Orientation by angles, for teaching: in frames that do not turn."""
    turning = any("surface" in each or "track" in each for each in d["frames"].values())
    torques = any(True for _ in d.places("torque", "path"))
    if not turning and not torques and d.model in ("panda", "ur5e") and "grasp" not in d["robot"]:
        _in_law(d, orientation=d.pick("rpy", "rpy", "zyz"))


def _sensor(d: LanguageDraft) -> None:
    """A sensor as its sheet has it."""
    made: Section = {}
    if d.chance(0.7):
        made["noise"] = d.pick(
            newton(d.pick(0.05, 0.1, 0.2)), {"force": "0.1 N", "torque": "0.005 N*m"}
        )
    if d.chance(0.5):
        made["filter"] = f"{d.pick(50, 80, 100, 200)} Hz"
    if d.chance(0.4):
        made["delay"] = f"{d.pick(1, 2, 4)} ms"
    if d.chance(0.25):
        made["rate"] = f"{d.pick(250, 500, 1000)} Hz"
    if d.chance(0.3):
        made |= {"at": "wrist", "bias": [0, 0, newton(d.pick(1, 2, 3)), 0, 0, 0]}
    d["robot"]["sensor"] = made or {"noise": "0.1 N"}
    if "bias" in made and d.chance(0.8) and "grasp" not in d["robot"]:
        d["stages"] = {"zero": {"tare": True, "time": "0.5 s"}} | d.stages


def _joints(d: LanguageDraft) -> None:
    """What the joints of a real arm are like, or where it stands."""
    robot = d["robot"]
    if "joint_damping" not in robot and d.chance(0.6):
        robot["joint_damping"] = f"{d.pick(0.5, 1, 2)} N*m*s/rad"
    if d.chance(0.4):
        robot["joint_friction"] = f"{d.pick(0.2, 0.5, 1)} N*m"


def _protection(d: LanguageDraft) -> None:
    d["robot"]["protection"] = "panda" if d.model == "panda" and d.chance(0.5) else "arm.yaml"


def _rates(d: LanguageDraft) -> None:
    made: Section = {"rate": d.pick("500 Hz", "250 Hz", "2 kHz", "1 kHz")}
    if d.chance(0.3):
        made["plant_rate"] = "2 kHz"
    if d.chance(0.2):
        made["timeout"] = "50 ms"
    d["control"] = made


def _vary(d: LanguageDraft) -> None:
    """What is uncertain, and how often that is to succeed."""
    entries: Section = {}
    for name, each in d["world"].items():
        if "shape" in each and each.get("stiffness", "") not in ("", "rigid"):
            entries[f"world.{name}.stiffness"] = d.pick("+- 20 %", "normal(10 %)", "5..50 kN/m")
        if "shape" in each and "on" not in each and d.chance(0.5):
            entries[f"world.{name}.xyz"] = d.pick(
                [0, 0, "+- 2 mm"], ["+- 1 mm", "+- 1 mm", "normal(0.5 mm)"]
            )
        if "friction" in each and d.chance(0.4):
            entries[f"world.{name}.friction"] = "0..0.4" if "shape" in each else "+- 20 %"
        if "inertia" in each:
            entries[f"world.{name}.inertia"] = "+- 20 %"
    if not entries:
        entries["robot.joint_damping"] = "0..1 N*m*s/rad"
    d["vary"] = entries
    if d.chance(0.4):
        d["sweep"] = {"worlds": d.pick(50, 100), "expect": "success >= 90 %"}


def _truth(d: LanguageDraft) -> None:
    """What is a little otherwise than the file tells the controller."""
    made: Section = {}
    for name, each in d["world"].items():
        if "shape" in each and each.get("stiffness", "") not in ("", "rigid") and d.chance(0.5):
            made[f"world.{name}.stiffness"] = scaled(each["stiffness"], d.pick(0.7, 1.3))
        if "shape" in each and "friction" in each and d.chance(0.3):
            made[f"world.{name}.friction"] = round(each["friction"] + 0.1, 2)
    if d.chance(0.4) or not made:
        made["robot.joint_friction"] = f"{d.pick(0.1, 0.3, 0.5)} N*m"
    if d.chance(0.2):
        made["robot.payload"] = d.pick("100 g", {"mass": "200 g", "xyz": mm(0, 0, 20)})
    d["truth"] |= made


def _faults(d: LanguageDraft) -> None:
    """Something breaks while the run goes on; mostly something that it survives."""
    at = f"{d.pick(0.5, 1, 1.5)} s"
    joint = d.pick(1, 2) if d.model.startswith("planar") else d.pick(2, 4, 6)
    d["truth"]["faults"] = [
        d.pick(
            {"sensor": "drops", "at": at, "for": "10 ms"},
            {"sensor": f"bias {d.pick(0.5, 1)} N", "axis": "z", "at": at},
            {"sensor": "noise 0.3 N", "at": at, "for": "1 s"},
            {"sensor": "spikes 1 N", "at": at, "for": "1 s", "every": "200 ms"},
            {"sensor": "late 3 ms", "at": at},
            {"sensor": "sticks", "at": at, "for": "20 ms"},
            {"sensor": "clips 50 N"},
            {"sensor": "drifts 0.2 N/s", "axis": "z", "at": at},
            {"torque": "gain 0.95", "joint": joint, "at": at},
            {"torque": "noise 0.2 N*m", "joint": joint, "at": at},
            {"encoder": "bias 0.05 deg", "joint": joint, "at": at},
            {"encoder": "drops", "at": at, "for": "5 ms"},
            {"sensor": "lost", "at": at, "for": "200 ms"},
            {"sensor": "flips", "axis": "z", "at": at, "for": "50 ms"},
        )
    ]


def _template(d: LanguageDraft) -> None:
    """A first wait by a template, of the file or of one that it includes."""
    if d.chance(0.5):
        d.sections = {"taskspec": 1, "include": ["cell.yaml"]} | d.sections
        pause: Section = {"use": "wait", "with": {"lasts": f"{d.pick(0.2, 0.3)} s"}}
    else:
        d["templates"] = {"rest": {"params": {"lasts": "0.3 s"}, "axes": {}, "time": "lasts"}}
        pause = {"use": "rest"}
    d["stages"] = {"ready": pause} | d.stages


def _base(d: LanguageDraft) -> None:
    """An arm that does not stand at the world's origin."""
    if not d.model.startswith("planar"):
        d["robot"]["base"] = {
            "xyz": mm(d.grid(-60, 60, 20), d.grid(-60, 60, 20), 0),
            "rpy": [0, 0, deg(d.pick(10, -10, 20))],
        }


def _names(d: LanguageDraft) -> None:
    """Expectations by name."""
    if d["expect"]:
        d["expect"] = {f"check-{n}": text for n, text in enumerate(d["expect"], 1)}


def _allow(d: LanguageDraft) -> None:
    stage = list(d.stages)[-1]
    d.stages[stage]["allow"] = [d.pick("oscillation", "saturation")]


def _stage_law(d: LanguageDraft) -> None:
    """A law of its own for a stage, mostly a stiffer one to go away with."""
    stage = list(d.stages)[-1]
    others = [law for law in ("hybrid", "impedance", "parallel") if law != d.law]
    if (
        d.law not in MULTIPLIERS
        and d.law != "stiffness"
        and "joints" not in d.stages[stage].get("path", {})
    ):
        d.stages[stage]["law"] = d.pick(*others)


def _stage_limits(d: LanguageDraft) -> None:
    stage = next(iter(d.stages))
    d.stages[stage]["limits"] = {"speed": f"{d.pick(150, 200, 250)} mm/s"}


def _posture(d: LanguageDraft) -> None:
    """Elbow to the side, or the joints that a redundant arm keeps near."""
    if d.model == "panda":
        d["robot"]["posture"] = deg(0, -20, 0, -130, 0, 110, 45)


#: What users write beside the scene itself, and how often.
HABITS: Mapping[Callable[[LanguageDraft], None], float] = {
    _gains: 0.3,
    _solver: 0.15,
    _null_space: 0.2,
    _angles: 0.08,
    _sensor: 0.3,
    _joints: 0.15,
    _protection: 0.08,
    _rates: 0.2,
    _vary: 0.25,
    _truth: 0.25,
    _faults: 0.08,
    _template: 0.1,
    _base: 0.06,
    _stage_law: 0.1,
    _stage_limits: 0.12,
    _posture: 0.06,
    _names: 0.2,
    _allow: 0.05,
}


# --- mistakes ----------------------------------------------------------------------------------


def _mistake(d: LanguageDraft) -> None:
    """One typical mistake of those that fit the file."""
    for index in d.rng.permutation(len(MISTAKES)):
        name = list(MISTAKES)[int(index)]
        if MISTAKES[name](d):
            d.slip = name
            return


def _some(d: LanguageDraft, *keys: str, of: Value = None) -> tuple[Section, str] | None:
    """A place in the stages with one of some keys, if there is any with a number to alter."""
    found = [(m, k) for m, k in d.places(*keys, of=of) if isinstance(m[k], str)]
    return found[int(d.rng.integers(len(found)))] if found else None


def _times_somewhere(*keys: str, factors: tuple[float, ...]) -> Callable[[LanguageDraft], bool]:
    """A mistake that makes one value of some keys so many times as much."""

    def mistake(d: LanguageDraft) -> bool:
        place = _some(d, *keys)
        if place is not None:
            d.scale(*place, float(d.pick(*factors)))
        return place is not None

    return mistake


def _wrong_sign(d: LanguageDraft) -> bool:
    place = _some(d, "force", "velocity", "move")
    if place is None:
        return False
    mapping, key = place
    text = str(mapping[key])
    mapping[key] = text[1:] if text.startswith("-") else f"-{text}"
    return True


def _wrong_unit(d: LanguageDraft) -> bool:
    """A unit of another size: cm for mm, N/m for kN/m."""
    swaps = (("mm", "cm"), ("kN/m", "N/m"), ("deg", "rad"))
    found = [
        (m, k, a, b)
        for m, k in (
            *d.places("move", "velocity", "speed", "position"),
            *d.places("stiffness", of=d["world"]),
        )
        for a, b in swaps
        if isinstance(m[k], str) and f" {a}" in m[k]
    ]
    if not found:
        return False
    mapping, key, a, b = found[int(d.rng.integers(len(found)))]
    mapping[key] = mapping[key].replace(f" {a}", f" {b}", 1)
    return True


def _guard_that_never_holds(d: LanguageDraft) -> bool:
    place = _some(d, "until")
    if place is None:
        return False
    mapping, key = place
    text = str(mapping[key])
    if " < -" in text and d.chance(0.5):
        mapping[key] = (
            text.replace(" < -", " > ", 1) if d.chance(0.3) else text.replace(" < -", " < -10", 1)
        )
    else:
        head, mark, tail = text.partition(" > ") if " > " in text else text.partition(" < ")
        mapping[key] = head + mark + scaled(tail, 20)
    return bool(mapping[key] != text)


def _out_of_reach(d: LanguageDraft) -> bool:
    d["robot"]["base"] = {"xyz": mm(-float(d.pick(200, 350, 500)), 0, 0)}
    return True


def _limit_too_low(d: LanguageDraft) -> bool:
    limits = d["limits"]
    kind = d.pick("force", "speed", "deviation")
    limits[kind] = {
        "force": newton(d.pick(2, 5, 8)),
        "speed": f"{d.pick(10, 20, 40)} mm/s",
        "deviation": mm(d.pick(0.2, 0.5, 1)),
    }[kind]
    return True


def _late_sensor(d: LanguageDraft) -> bool:
    d["robot"].setdefault("sensor", {})["delay"] = f"{d.pick(10, 20, 40)} ms"
    return True


def _noisy_sensor(d: LanguageDraft) -> bool:
    d["robot"].setdefault("sensor", {})["noise"] = newton(d.pick(0.5, 1, 2))
    return True


def _gain_too_high(d: LanguageDraft) -> bool:
    keys: dict[str, Section] = {
        "hybrid": d.pick(
            {"force": {"integral": f"{d.pick(60, 120)} /s"}},
            {"bandwidth": f"{d.pick(30, 60)} Hz"},
            {"force": {"damping": "20 N*s/m"}},
        ),
        "parallel": {"force": {"integral": f"{d.pick(40, 100)} /s"}},
        "impedance": d.pick({"mass": {"linear": "0.2 kg"}}, {"damping": {"linear": "5 N*s/m"}}),
        "pd-joint": {"stiffness": "40 kN/m"},
        "stiffness": {"stiffness": "60 kN/m"},
        "parallel-pid": {"force": {"integral": f"{d.pick(40, 100)} /s"}},
    }
    some = (
        keys.get(d.law) or keys["hybrid"]
        if d.law.startswith("hybrid")
        else keys.get(d.law, {"stiffness": {"linear": "60 kN/m"}})
    )
    if d.law == "hybrid-reaction":
        some = {"force": {"proportional": d.pick(3, 8)}}
    _in_law(d, **some)
    return True


def _another_world(d: LanguageDraft) -> bool:
    """Things are elsewhere, or of another kind, than the file says."""
    shapes = [
        name
        for name, each in d["world"].items()
        if "shape" in each and "on" not in each and not each.get("free")
    ]
    if not shapes:
        return False
    name = d.one_of(shapes)
    each = d["world"][name]
    truth = d["truth"]
    stiff = str(each.get("stiffness", "20 kN/m"))
    if stiff != "rigid" and d.chance(0.5):
        truth[f"world.{name}.stiffness"] = scaled(stiff, d.pick(0.1, 0.3, 6))
        return True
    place = [float(str(x).split()[0]) for x in each.get("xyz", [0, 0, 0])]
    place[2] += d.pick(-40, -25, -10, 8)
    truth[f"world.{name}.xyz"] = mm(*place)
    return True


def _too_picky(d: LanguageDraft) -> bool:
    stage = d.one_of(list(d.stages))
    text = str(
        d.pick(
            f"max(norm(force)) < {d.pick(1, 3, 5)} N",
            f"{stage}.speed < {d.pick(5, 10)} mm/s for 95 %",
            f"{stage}.t < {d.pick(0.1, 0.3)} s",
            f"max(norm({stage}.error)) < 0.005 mm",
            f"last({stage}.force.z) within -30 N +- 0.1 N",
        )
    )
    found = d["expect"]
    if isinstance(found, dict):
        found["picky"] = text
    else:
        found.append(text)
    return True


def _heavy(d: LanguageDraft) -> bool:
    d["truth"]["robot.payload"] = {"mass": f"{d.pick(1, 2, 4)} kg", "xyz": mm(0, 0, 50)}
    return True


def _broken(d: LanguageDraft) -> bool:
    """What breaks for good while the run goes on."""
    at = f"{d.pick(0.3, 0.8)} s"
    d["truth"]["faults"] = [
        d.pick(
            {"sensor": "drops", "at": at},
            {"sensor": "lost", "at": at},
            {"torque": "gain 0.4", "joint": 2, "at": at},
            {"encoder": "sticks", "joint": 2, "at": at},
            {"torque": "lost", "joint": 2, "at": at},
            {"sensor": "swaps", "axis": ["x", "z"], "at": at},
            {"sensor": "flips", "at": at},
            {"encoder": "drifts 2 deg/s", "joint": 1, "at": at},
            {"sensor": "gain 0.3", "at": at},
            {"torque": "late 20 ms", "at": at},
        ),
    ]
    return True


def _slip_of_the_pen(d: LanguageDraft) -> bool:
    """What is refused at reading: a unit forgotten, a key misspelled, a name that nothing has."""
    stage = d.stages[d.one_of(list(d.stages))]
    kind = d.pick("unit", "key", "frame", "within")
    place = _some(d, "force", "velocity", "move", "time")
    if kind == "unit" and place is not None:
        place[0][place[1]] = 12
    elif kind == "key":
        stage["untill"] = "force.z < -2 N"
    elif kind == "within" and "until" in stage:
        stage.pop("within", None)
    else:
        stage["frame"] = "workpiece_frame"
    return True


#: Mistakes by name; each says whether it fits the file, and makes it.
MISTAKES: Mapping[str, Callable[[LanguageDraft], bool]] = {
    "sign": _wrong_sign,
    "unit": _wrong_unit,
    "fast": _times_somewhere("velocity", "speed", factors=(4, 6, 10)),
    "strong": _times_somewhere("force", factors=(5, 8, 12)),
    "far": _times_somewhere("move", "position", factors=(4, 8)),
    "hurry": _times_somewhere("time", factors=(0.1, 0.2)),
    "guard": _guard_that_never_holds,
    "reach": _out_of_reach,
    "limit": _limit_too_low,
    "late": _late_sensor,
    "noise": _noisy_sensor,
    "gain": _gain_too_high,
    "world": _another_world,
    "picky": _too_picky,
    "heavy": _heavy,
    "broken": _broken,
    "pen": _slip_of_the_pen,
}


def main() -> None:
    """Prints a file."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seed", type=int)
    parser.add_argument("number", type=int)
    given = parser.parse_args()
    sys.stdout.write(language_task(given.seed, given.number))


if __name__ == "__main__":
    main()
