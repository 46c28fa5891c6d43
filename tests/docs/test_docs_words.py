"""Units, functions, signals, laws and all other words: exactly those of the code."""

from __future__ import annotations

import re

import pytest
from documents import (
    LANGUAGE,
    codes_of,
    completed,
    example,
    first_words,
    load,
    models_of,
    table,
    text_of,
    words,
)
from signal_tables import with_tables

from taskspec import signals
from taskspec.expression.functions import FUNCTIONS, REDUCERS
from taskspec.laws import LAWS
from taskspec.robot import builtin_robots
from taskspec.spec import Robot, Task
from taskspec.spec.mechanism import Detent
from taskspec.spec.model import Model
from taskspec.spec.robot import JointEncoder, Noise, Payload, Pose, Sensor, Start, Tool
from taskspec.spec.servo import Servo
from taskspec.text.confines import VARIABLE
from taskspec.text.diagnostic import SpecError
from taskspec.text.units import UNITS


def test_units():
    assert set(first_words(LANGUAGE, "table: units")) == UNITS.keys()
    for unit, _, cell in table(LANGUAGE, "table: units"):
        (name,), (same,) = words(unit), words(cell)
        task = completed(f'params: {{press: 12 N, a: "1 {name}", b: "{same}"}}\n')
        params = load(task).task.params
        assert params["a"].dimension == params["b"].dimension, name
        assert params["a"].value == pytest.approx(params["b"].value, rel=1e-12), name


def _called(cells: list[str]) -> set[str]:
    return {word.partition("(")[0] for word in cells}


def test_functions():
    assert _called(first_words(LANGUAGE, "table: functions")) == FUNCTIONS.keys()


def test_reducers():
    assert _called(first_words(LANGUAGE, "table: reducers")) == set(REDUCERS)


def test_laws_and_their_gains():
    rows = {words(row[0])[0]: tuple(words(row[2])) for row in table(LANGUAGE, "table: laws")}
    assert rows == {law: facts.gain_names for law, facts in LAWS.items()}


def test_laws_name_their_equations():
    for row in table(LANGUAGE, "table: laws"):
        equations = LAWS[words(row[0])[0]].equations
        if "=" in equations:  # It is in no book's count: the formula itself stands there.
            assert "ẋ = " in row[1], row[0]
        else:
            assert row[1].endswith(equations.replace("-", "–")), row[0]


@pytest.mark.parametrize("law", LAWS)
def test_a_motion_and_a_force_on_one_axis(law):
    text = (
        f"law: {law}\nstages: {{slide: {{axes: {{z: {{hold: start, force: -5 N}}}}, time: 1 s}}}}\n"
    )
    whole = completed(f"{text}expect: []\n")
    assert "model: panda" in whole
    robot = f"command: {LAWS[law].commands}\n  model: panda"
    found = codes_of(whole.replace("model: panda", robot))
    assert found == ([] if law in ("parallel", "parallel-pid") else ["TS203"])


def test_laws_at_the_arms_own_inertia():
    text = " ".join(text_of(LANGUAGE).split())
    match = re.search(r"laws at the arm's own inertia \(([^)]*)\)", text)
    assert match is not None
    assert set(words(match[1])) == {law for law, facts in LAWS.items() if facts.natural}


def test_robots():
    rows = {words(row[0])[0]: (int(row[1]), row[2]) for row in table(LANGUAGE, "table: robots")}
    assert rows == {r.name: (r.joints, " ".join(r.axes)) for r in builtin_robots()}


def test_signals_are_those_of_the_table():
    """`python tests/docs/signal_tables.py` writes them again."""
    text = text_of(LANGUAGE)
    assert with_tables(text) == text


def test_signals_that_other_frames_show_differently():
    entries = (*signals.VECTORS.values(), *signals.SCALARS.values())
    text = " ".join(text_of(LANGUAGE).split())
    match = re.search(
        r"In expectations that works for ([^;]*); in references and guards for (.*?), and for the",
        text,
    )
    assert match is not None
    assert set(words(match[1])) == {s.name for s in entries if s.framed}
    assert set(words(match[2])) == {s.name for s in entries if s.anywhere}


#: The log has a gain where it varies.
VARYING = """law:
  kind: parallel
  mass: {z: 4 kg + 1 kg * sin(2*pi*t/(1 s))}
  stiffness: {z: 400 N/m + 100 N/m * sin(2*pi*t/(1 s))}
  damping: {z: 200 N*s/m + 10 N*s/m * sin(2*pi*t/(1 s))}
  force:
    proportional: {z: 1 + 0.1 * sin(2*pi*t/(1 s))}
    integral: {z: 2 /s + 0.1 /s * sin(2*pi*t/(1 s))}
"""

#: And where it follows an estimate.
ESTIMATED = "law: {kind: hybrid, estimate: 1..10000 kN/m}\n"


#: What a file needs for a signal, by the beginning of its name.
NEEDED = {
    r"estimate\.|gain\.force\.damping": ESTIMATED,
    r"gain\.": VARYING,
    # A law with a storage function, and one that falls.
    r"energy\.|power\.": "law: pd\n",
    r"tank\.": "law: {kind: pd, tank: 2 J}\n",
    r"payload\.": "law: {kind: pd, adapt: payload}\n",
    r"joint\.\d\.disturbance": "law: {kind: pd, disturbance_observer: 20 Hz}\n",
    r"grip\.": "world: {table: {shape: plane}, cap: {shape: sphere, radius: 20 mm,"
    " free: true, mass: 100 g, friction: 0.5, xyz: [450 mm, 0, 330 mm]}}\n",
}


@pytest.mark.parametrize("row", table(LANGUAGE, "table: signals"), ids=lambda row: words(row[0])[0])
def test_signals_are_available_where_the_table_says(row):
    signal = words(row[0])[0].replace("joint.N", "joint.1")
    signal = signal.replace("STAGE", "slide").replace("ENTRY", "z").replace("AXIS", "z")
    number = row[1] != "condition"
    unit = words(row[1])[0] if words(row[1]) else ""
    condition = f"{signal} > 0.5 {unit}" if number else signal
    motion = f"{signal}*(1 N/(1 {unit}))" if unit else f"{signal}*(1 N)"
    stage = 'stages: {slide: {axes: {z: {force: "%s"}, x: hold}, %stime: 1 s}}\nexpect: [%s]\n'
    stage = next((text for names, text in NEEDED.items() if re.match(names, signal)), "") + stage
    if signal.startswith("grip."):
        stage = stage.replace("slide: {", "slide: {grip: {object: cap, force: 20 N}, ")
    path = "path: {line: {by: [0, 5 mm]}, time: 1 s}, "
    places = {
        "references": stage % (motion, path, ""),
        "guards": stage % ("-5 N", f'fail_if: "{condition}", {path}', ""),
        "expect": stage % ("-5 N", path, f'"{condition}"'),
    }
    for (place, text), says in zip(places.items(), row[3:], strict=True):
        assert (codes_of(completed(text)) == []) == says.startswith("yes"), place
    found = codes_of(completed(stage % ("-5 N", path, f'"{signal}.ref > 1 {unit}"')))
    assert ("TS120" not in found) == row[-1].endswith(", `.ref`")


OBJECTS = {
    "shape": "ball: {shape: sphere, radius: 20 mm}",
    "equation": "ball: {equation: x = 520 mm}",
    "joint equation": "ball: {equation: q1 = 0}",
    "exact equation": "ball: {equation: y = 0, stiffness: exact}",
    "exact rotation equation": "ball: {equation: 'angle(tool.z, world.x) = 90 deg', "
    "stiffness: exact}",
    "exact joint equation": "ball: {equation: q1 = 0, stiffness: exact}",
    "rotation equation": "ball: {equation: 'angle(tool.z, world.x) >= 10 deg'}",
    "bushing": "ball: {bushing: tool, xyz: [520 mm, 0, 0], stiffness: [1 N/m, 0, 0, 0, 0, 0]}",
    "hinge": "ball: {mechanism: hinge, xyz: [400 mm, 0, 300 mm], handle: [100 mm, 0, 0]}",
    "slide": "ball: {mechanism: slide, xyz: [500 mm, 0, 300 mm]}",
    "screw": "ball: {mechanism: screw, xyz: [500 mm, 0, 300 mm], pitch: 2 mm/turn}",
}
OF_OBJECTS = table(LANGUAGE, "table: object signals")


@pytest.mark.parametrize("row", OF_OBJECTS, ids=lambda row: "-".join(words(row[0] + row[1])))
def test_signals_of_objects_are_available_where_the_table_says(row):
    kind, signal, unit = (words(cell)[0] for cell in row[:3])
    robot = "robot: {model: panda%s}\nframe: world\nframes: {}\n"
    world = f"world: {{{OBJECTS[kind]}, far: {{shape: plane}}}}\n"
    stage = "stages: {go: {axes: {z: {force: %s}}, fail_if: %s, time: 1 s}}\nexpect: [%s]\n"
    if signal == "residual":
        torques = "constraints: {ball: {generalised: [0, 0, 0, 0, 0, 0, 0]}}"
        stage = stage.replace("{go: {", f"{{go: {{law: hybrid-multipliers, {torques}, ")
    value, never = f"ball.{signal}*(1 N/(1 {unit}))", f"ball.{signal} > 1e6 {unit}"
    places = {
        "references": stage % (value, "t > 9 s", "go.t < 2 s"),
        "guards": stage % ("-5 N", never, "go.t < 2 s"),
        "expect": stage % ("-5 N", "t > 9 s", never),
    }
    for (place, text), says in zip(places.items(), row[4:], strict=True):
        for grasp in ("", ", grasp: ball.handle") if "held" in row else ("",):
            found = codes_of(completed(robot % grasp + world + text))
            there = says.startswith("yes") or (says == "held" and grasp != "")
            assert (found == []) == there, (place, grasp, found)
    reference = stage % ("-5 N", "t > 9 s", f"ball.{signal}.ref > 1 {unit}")
    unknown = "TS120" in codes_of(completed(robot % "" + world + reference))
    assert unknown != row[-1].endswith(", `.ref`")


def test_conditions_can_be_written_and_mistakes_are_found():
    stage = (
        "stages: {slide: {axes: {z: {force: -press}}, %stime: 8 s}, other: {time: 1 s}}\n"
        "expect: [%s]\n"
    )

    def guarded(condition: str) -> str:
        return completed(stage % (f'fail_if: "{condition}", ', ""))

    for cell, place in table(LANGUAGE, "table: conditions"):
        (condition,) = words(cell)
        assert place in ("guard", "expect")
        text = guarded(condition) if place == "guard" else completed(stage % ("", condition))
        assert codes_of(text) == [], condition
    for written, code, instead in table(LANGUAGE, "table: mistakes"):
        assert codes_of(guarded(words(written)[0])) == [code], written
        assert codes_of(guarded(words(instead)[0])) == [], instead


@pytest.mark.parametrize("override", first_words(LANGUAGE, "table: overrides"))
def test_overrides(override):
    key, _, text = override.partition("=")
    loaded = load(example(), {key: text})
    assert loaded.task != load(example()).task


_RIM = "world: {rim: {equation: x = 500 mm}, table: {shape: plane}}\n"
_SLIDE = "stages: {slide: {%s, time: 1 s}}\nexpect: []\n"
_TURN = "path: {line: {by: [0, 0, 0, 0, 0, 20 deg]}, %s}"


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("TS204", _SLIDE % "axes: {z: {hold: world}}"),
        ("TS209", "frames: {task: {surface: table, point: origin}}\n"),
        ("TS224", _SLIDE % "fail_if: tilt in world > 3 deg"),
        ("TS226", "frames: {task: {surface: table}, other: {parent: task}}\n"),
        ("TS227", "stages: {slide: {%s}}\nexpect: []\n" % (_TURN % "speed: 20 mm/s")),
        ("", "stages: {slide: {%s}}\nexpect: []\n" % (_TURN % "time: 2 s")),
        ("TS306", "law: {kind: pd, stiffness: 0 N/m}\n" + _SLIDE % "axes: {z: {force: -5 N}}"),
        ("TS020", "law: {kind: pd-joint, joint_damping: 3 N*m*s/rad}\n"),
        ("TS210", "law: pd-joint\n" + _SLIDE % "axes: {x: {hold: start, damping: 3 N*s/m}}"),
        ("TS210", "law: stiffness\n" + _SLIDE % "axes: {x: {hold: start, damping: 3 N*s/m}}"),
        ("", "law: pd\n" + _SLIDE % "axes: {x: {hold: start, damping: 3 N*s/m}}"),
        ("TS211", _RIM + _SLIDE % "constraints: {rim: {force: 3 N}}"),
        ("", "law: hybrid-reaction\n" + _RIM + _SLIDE % "constraints: {rim: {force: 3 N}}"),
        ("TS212", "law: hybrid-reaction\n" + _SLIDE % "axes: {x: {hold: start, damping: 3 N*s/m}}"),
        ("TS213", "law: {kind: stiffness, null_space: posture}\n" + _SLIDE % "axes: {}"),
        ("TS104", _RIM.replace("x = 500 mm", "0 <= x <= 30 mm") + _SLIDE % "axes: {}"),
        ("TS228", "law: {kind: hybrid, orientation: rpy}\n" + _SLIDE % "axes: {rx: {torque: 0}}"),
        ("TS229", "law: {kind: hybrid, orientation: zyz}\n" + _SLIDE % "axes: {}"),
        ("", "law: {kind: hybrid, orientation: rpy}\n" + _SLIDE % "axes: {}"),
        ("TS214", "limits: {torque_rate: 100 N*m/s}\n" + _SLIDE % "axes: {}"),
        ("", "law: {kind: pd, solve: qp}\nlimits: {torque_rate: 9 W}\n" + _SLIDE % "axes: {}"),
    ],
)
def test_errors_that_the_reference_names(code, text):
    assert codes_of(completed(text)) == ([code] if code else [])


def test_a_time_beside_a_column_of_times(tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    (tmp_path / "timed.csv").write_text("t [s], x [mm]\n0, 0\n1, 10\n2, 20\n", encoding="utf-8")
    for pace, codes in (("", []), (", time: 2 s", ["TS223"]), (", speed: 9 mm/s", ["TS223"])):
        path = f"{tmp_path.as_posix()}/timed.csv"
        text = f"stages: {{slide: {{path: {{file: {path}{pace}}}}}}}\nexpect: []\n"
        assert codes_of(completed(text)) == codes, pace


def test_what_can_vary():
    """Every path that the reader takes, for one object of every kind and shape."""
    objects = (
        "{block: {shape: box, size: [10 mm, 10 mm, 10 mm]}, ball: {shape: sphere, radius: 10 mm},"
        " drum: {shape: cylinder, radius: 10 mm, length: 10 mm}, table: {shape: plane},"
        " bore: {shape: hole, radius: 10 mm, depth: 9 mm, chamfer: 1 mm},"
        " cut: {shape: slot, width: 10 mm, depth: 9 mm, chamfer: 1 mm},"
        " vee: {shape: groove, angle: 90 deg, depth: 9 mm},"
        " loose: {shape: sphere, radius: 10 mm, free: true, mass: 1 kg},"
        " rim: {equation: x = 500 mm}, bars: {equation: q1 = 0}, door: {mechanism: hinge},"
        " catch: {mechanism: hinge, detent: {at: 3 deg, force: 1 N*m, width: 1 deg}},"
        " drawer: {mechanism: slide}, bolt: {mechanism: screw, pitch: 2 mm/turn}}"
    )
    keys = {key for m in models_of(Model) for key in m.model_fields}
    names = [word.partition(":")[0].strip() for word in re.findall(r"\w+: {", objects)]
    inner = {
        "tool": Tool,
        "sensor": Sensor,
        "sensor.noise": Noise,
        "base": Pose,
        "start": Start,
        "payload": Payload,
        "encoder": JointEncoder,
        "servo": Servo,
    }
    detents = [f"world.catch.detent.{key}" for key in Detent.model_fields]
    paths = [
        *(f"world.{name}.{key}" for name in names for key in sorted(keys)),
        *detents,
        *(f"robot.{key}" for key in Robot.model_fields),
        *(f"robot.{k}.{key}" for k, m in inner.items() for key in m.model_fields),
    ]
    found = set()
    for interval in ("+- 0", "[0, 0, 0]", "[0, 0, 0, 0, 0, 0]"):
        # All at once would be more than a file may hold.
        for some in (paths[i::4] for i in range(4)):
            found |= _read(f"world: {objects}\n", {path: interval for path in some})
    objects_alike = {re.sub(r"^world\.\w+", "world.OBJECT", path) for path in found}
    assert set(first_words(LANGUAGE, "table: vary")) == objects_alike


def _read(head: str, varied: dict[str, str]) -> set[str]:
    """The paths that may vary so: one line each, those with a finding left out until none has."""
    text = "taskspec: 1\nrobot: {model: panda, command: velocity}\nstages: {wait: {time: 1 s}}\n"
    text += f"{head}vary:\n"
    first = text.count("\n") + 1
    left = list(varied)
    while left:
        lines = "".join(f"  {path}: {varied[path]}\n" for path in left)
        try:
            load(text + lines)
        except SpecError as error:
            bad = {d.span.line - first for d in error.diagnostics if d.span is not None}
        else:
            return set(left)
        fewer = [path for i, path in enumerate(left) if i not in bad]
        assert len(fewer) < len(left), "something else than a line is wrong"
        left = fewer
    return set()


def test_what_is_not_supported_yet():
    rows = {row[0]: set(words(row[1])) for row in table(LANGUAGE, "table: later")}
    assert rows == {
        "task": Task.reserved,
    }
    named = {m.__name__ for m in models_of(Model) if vars(m).get("reserved")}
    assert named == {"Task"}
