"""Other forms of a value, words for another notion, and keys at another level."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taskspec.geometry.rotation import from_rpy
from taskspec.spec import FILE, LoadedTask, load_text
from taskspec.spec.alias import turned_to
from taskspec.text.diagnostic import Diagnostic, SpecError
from taskspec.text.suggest import closest

STAGES = "stages: {press: {time: 1 s}, leave: {time: 1 s}}\n"
HEAD = f"taskspec: 1\nrobot: {{model: panda}}\n{STAGES}"


def found(text: str) -> tuple[Diagnostic, ...]:
    with pytest.raises(SpecError) as caught:
        load_text(text, "task.yaml")
    return caught.value.diagnostics


def world(text: str, **overrides: str) -> LoadedTask:
    paths = {path.replace("__", "."): value for path, value in overrides.items()}
    return load_text(f"{HEAD}params: {{d: 20 mm}}\nworld: {{{text}}}\n", "task.yaml", paths)


# Diameters


@pytest.mark.parametrize("text", ["20 mm", "d", "2*d - 2 cm"])
def test_diameter_is_twice_the_radius(text: str) -> None:
    task = world(f"rod: {{shape: cylinder, diameter: {text}, length: 50 mm}}").task
    assert task.shapes["rod"].radius == pytest.approx(0.01, rel=1e-15)


def test_diameter_of_a_tool_and_of_a_spiral() -> None:
    text = HEAD.replace("panda", "panda, tool: {diameter: 12 mm}").replace(
        "press: {time: 1 s}",
        "press: {path: {spiral: {pitch: 1 mm, diameter: 8 mm}, time: 1 s}}",
    )
    task = load_text(text, "task.yaml").task
    assert task.robot.tool.radius == 0.006
    assert task.stages["press"].path is not None
    assert task.stages["press"].path.spiral.radius == 0.004


def test_what_is_wrong_with_a_diameter_is_pointed_at() -> None:
    text = f"{HEAD}world: {{rod: {{shape: cylinder, diameter: 3 + 4 N, length: 50 mm}}}}\n"
    (only,) = found(text)
    assert (only.code, only.span and only.span.column) == (
        "TS110",
        text.split("\n")[3].index("3 +") + 1,
    )


def test_shape_without_a_radius_has_no_diameter_either() -> None:
    (only,) = found(f"{HEAD}world: {{rod: {{shape: plane, diameter: 4 mm}}}}\n")
    assert (only.code, only.message) == ("TS302", "a plane has no 'diameter'")


# Directions


@pytest.mark.parametrize(
    "direction",
    [(0, 0, 1), (0, 0, -1), (-1, 0, 0), (0, 2, 0), (1, -2, 3), (3e-9, 0, -1), (1, 1, -9)],
)
def test_direction_is_reached_by_the_smallest_rotation(
    direction: tuple[float, float, float],
) -> None:
    n = np.array(direction) / np.linalg.norm(direction)
    R = from_rpy(turned_to(direction))
    # Rounding of a few sines and cosines.
    np.testing.assert_allclose(R[:, 2], n, atol=1e-15)
    cosine = (np.trace(R) - 1) / 2
    assert cosine == pytest.approx(n[2], abs=2e-15)


@pytest.mark.parametrize("key", ["normal", "axis"])
@pytest.mark.parametrize("form", ["[-1, 0, 0]", "-x", "[-d/d, 0, 0]"])
def test_direction_stands_for_an_orientation(key: str, form: str) -> None:
    loaded = world(
        f"wall: {{shape: plane, {key}: {form}}}, hatch: {{mechanism: hinge, {key}: {form}}}"
    )
    written = world("wall: {shape: plane, rpy: [0, -90 deg, 0]}").task.shapes["wall"].rpy
    for each in loaded.task.world.values():
        assert each.rpy == pytest.approx(written, abs=0)  # type: ignore[union-attr]
    # What is found about the orientation is reported at the key that the file has.
    place = loaded.span(FILE.world["wall"].rpy)
    assert loaded.source.text.split("\n")[place.line - 1][place.column - 1] in "[-"
    assert loaded.has(FILE.world["wall"].rpy)


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("normal: [0, 0, 0]", "TS118", "a direction of length zero"),
        ("normal: up", "TS022", "a list of 3 is needed here, this is a text"),
        ("axis: [0, 1 m, 0]", "TS112", "a plain number is needed here, this is a length (m)"),
        ("axis: z, rpy: [0, 0, 0]", "TS026", "'rpy' and 'axis' of an object say the same thing"),
        ("axis: z, normal: z", "TS026", "'normal' and 'axis' of an object say the same thing"),
    ],
)
def test_wrong_directions(text: str, code: str, message: str) -> None:
    (only,) = found(f"{HEAD}world: {{wall: {{shape: plane, {text}}}}}\n")
    assert (only.code, only.message) == (code, message)


def test_both_of_two_forms_are_one_too_many() -> None:
    (only,) = found(HEAD.replace("panda", "panda, tool: {radius: 5 mm, diameter: 10 mm}"))
    assert (only.code, only.hint) == ("TS026", "keep one of the two")


def test_an_override_and_the_truth_replace_the_other_form() -> None:
    text = "wall: {shape: plane, normal: x}, rod: {shape: sphere, diameter: 20 mm}"
    changed = world(text, world__wall__rpy="[0, 0, 0]", world__rod__radius="3 mm").task
    assert changed.shapes["wall"].rpy == (0, 0, 0)
    assert changed.shapes["rod"].radius == 0.003
    again = world(text.replace("diameter: 20", "radius: 20"), world__rod__diameter="8 mm").task
    assert again.shapes["rod"].radius == 0.004
    true = {"truth__world__wall__rpy": "[0, 0, 2 deg]", "truth__world__rod__radius": "11 mm"}
    loaded = world(text, **true)
    assert loaded.true_task.shapes["wall"].rpy == (0, 0, math.radians(2))
    assert loaded.true_task.shapes["rod"].radius == 0.011
    assert loaded.task.shapes["rod"].radius == 0.01


def test_a_path_of_the_truth_says_that_the_quantity_is_another_one() -> None:
    text = f"{HEAD}world: {{rod: {{shape: sphere, diameter: 20 mm}}}}\n"
    (only,) = found(f"{text}truth: {{world.rod.diameter: 21 mm}}\n")
    assert only.hint == "did you mean 'radius'? It is half of the diameter"


def test_pitch_of_a_thread_is_that_of_a_turn() -> None:
    pitches = [
        world(f"bolt: {{mechanism: screw, pitch: {text}}}").task.mechanisms["bolt"].lead
        for text in ("2 mm", "2 mm/turn")
    ]
    assert pitches[0] == pytest.approx(pitches[1], rel=1e-15)


# Linear ramps


@pytest.mark.parametrize(
    ("axis", "ramp", "written"),
    [
        ("z", "force: {from: -2 N, to: -d*2 kN/m, time: 3 s}", "force"),
        ("z", "force: {from: 0, to: -40 N, over: 3 s}", "force"),
        ("rz", "torque: {from: 0, to: 2 N*m, duration: 2 s}", "torque"),
        ("x", "velocity: {from: 0, to: 20 mm/s, in: 1 s}", "velocity"),
    ],
)
def test_a_ramp_is_an_expression_of_time(axis: str, ramp: str, written: str) -> None:
    text = HEAD.replace("press: {time: 1 s}", f"press: {{axes: {{{axis}: {{{ramp}}}}}, time: 4 s}}")
    task = load_text(f"{text}params: {{d: 20 mm}}\n", "task.yaml").task
    entry = next(iter(task.stages["press"].axes.values()))
    expression = getattr(entry, written)
    assert expression.uses("t")
    assert "clamp(t/(" in expression.text


def test_a_ramp_of_a_constraint() -> None:
    stage = "press: {constraints: {rim: {force: {from: 0, to: 20 N, time: 1 s}}}, time: 2 s}"
    text = HEAD.replace("press: {time: 1 s}", stage)
    more = "law: hybrid-multipliers\nworld: {rim: {equation: z = 300 mm}}\n"
    task = load_text(text + more, "task.yaml").task
    assert task.stages["press"].constraints["rim"].wanted.uses("t")


@pytest.mark.parametrize(
    ("ramp", "codes"),
    [
        ("{from: -2 N, to: -40 N}", ["TS021"]),
        ("{from: -2 N, too: -40 N, time: 1 s}", ["TS020"]),
        ("{from: -2, to: -40, time: 0 s}", ["TS110", "TS110", "TS118"]),
        ("{from: -2 N, to: 3 mm, time: 3 N}", ["TS112", "TS112"]),
        ("{from: -2 N, to: [1 N], time: 3 s}", ["TS022"]),
    ],
)
def test_wrong_ramps(ramp: str, codes: list[str]) -> None:
    text = HEAD.replace(
        "press: {time: 1 s}", f"press: {{axes: {{z: {{force: {ramp}}}}}, time: 4 s}}"
    )
    assert [each.code for each in found(text)] == codes


# Keys at another level, and words for another notion


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        (f"{HEAD}sensor: {{noise: 1 N}}\n", "it belongs at robot.sensor"),
        (f"{HEAD}tool: {{mass: 1 kg}}\n", "it belongs at robot.tool"),
        (HEAD.replace("model: panda", "model: panda, noise: 1 N"),
         "it belongs at robot.sensor.noise"),
        (HEAD.replace("{time: 1 s}", "{axes: {z: hold, until: t > 1 s}, time: 1 s}", 1),
         "it belongs at stages.NAME.until"),
        (HEAD.replace("{time: 1 s}", "{limits: {expect: 3 N}, time: 1 s}", 1),
         "'expect' belongs to the top level of the file"),
        (HEAD.replace("{time: 1 s}", "{time: 1 s, bandwidth: 3 Hz}", 1),
         "it belongs at law.bandwidth"),
        (f"{HEAD}world: {{a: {{shape: plane, handle: [0, 0, 0]}}}}\n",
         "it is a key of a hinge, a slide or a screw"),
    ],
)  # fmt: skip
def test_a_key_at_another_level_says_where_it_belongs(text: str, hint: str) -> None:
    (only,) = found(text)
    assert (only.code, only.hint) == ("TS020", hint)


@pytest.mark.parametrize("key", ["lissajous", "spiral", "arc", "circle", "line", "raster"])
@pytest.mark.parametrize("form", ["{{{key}: {{}}}}", "{{x: {{{key}: {{}}}}}}"])
def test_a_curve_under_axes_says_where_it_belongs(key: str, form: str) -> None:
    axes = form.format(key=key)
    (only,) = found(HEAD.replace("press: {time: 1 s}", f"press: {{axes: {axes}, time: 1 s}}"))
    name = "arc" if key == "circle" else key
    assert only.hint.startswith(f"a curve stands beside 'axes': path: {{{name}: ..")


@pytest.mark.parametrize("kind", ["hinge", "slide", "screw"])
def test_a_mechanism_that_is_called_a_shape(kind: str) -> None:
    """What else is wrong with it is found as of the mechanism that is meant."""
    pitch = ", pitch: 2 mm" if kind == "screw" else ""
    text = f"{HEAD}world: {{a: {{shape: {kind}{pitch}, stop: 0 .. 3 N, held: true}}}}\n"
    shape, stop, held = found(text)
    assert (shape.code, shape.hint) == ("TS025", f"write mechanism: {kind}")
    assert stop.code == "TS112"
    assert held.hint == "what the robot holds stands at robot.grasp: NAME.handle"


@pytest.mark.parametrize(
    ("text", "code", "hint"),
    [
        ("type: hinge", "TS020", "write mechanism: hinge"),
        ("kind: ball, radius: 5 mm", "TS020", "write shape: sphere"),
        ("mechanism: box", "TS025", "write shape: box"),
        ("mechanism: prismatic", "TS025", "did you mean 'slide'?"),
        ("shape: cube", "TS025", "did you mean 'box'?"),
    ],
)
def test_other_words_for_what_an_object_is(text: str, code: str, hint: str) -> None:
    (only,) = found(f"{HEAD}world: {{a: {{{text}}}}}\n")
    assert (only.code, only.hint) == (code, hint)


def test_a_coordinate_has_no_ramp() -> None:
    ramp = "{from: 0, to: 50 mm, time: 2 s}"
    (only,) = found(
        HEAD.replace(
            "press: {time: 1 s}", f"press: {{axes: {{x: {{position: {ramp}}}}}, time: 4 s}}"
        )
    )
    assert "move: 50 mm" in only.hint


@pytest.mark.parametrize(
    ("word", "options", "meant"),
    [
        ("axis", ["radius", "size"], None),
        ("slide", ["cylinder", "slot"], None),
        ("pitch", ["width", "depth"], None),
        ("handle", ["angle"], None),
        ("stifness", ["stiffness"], "stiffness"),
        ("hybird", ["hybrid", "parallel"], "hybrid"),
        ("tabel", ["table"], "table"),
        ("damp", ["damping"], "damping"),
        ("max_force", ["force", "speed"], "force"),
        ("Limits", ["limits"], "limits"),
    ],
)
def test_only_a_slip_is_taken_for_a_word(word: str, options: list[str], meant: str | None) -> None:
    assert closest(word, options) == meant


# Expectations in everyday words


@pytest.mark.parametrize(
    ("said", "condition"),
    [
        ("peak force < 60 N", "max(norm(force)) < 60 N"),
        ("max force < 60 N", "max(norm(force)) < 60 N"),
        ("peak_force < 60 N", "max(norm(force)) < 60 N"),
        ("press peak force < 60 N", "max(norm(press.force)) < 60 N"),
        ("press.max_force < 60 N", "max(norm(press.force)) < 60 N"),
        ("maximum of force.z in press < 3 N", "max(press.force.z) < 3 N"),
        ("mean normal force in press < 3 N", "mean(press.force.z) < 3 N"),
        ("press.force.z at end > -2 N", "last(press.force.z) > -2 N"),
        ("press.force.z > -2 N at end", "last(press.force.z) > -2 N"),
        ("force.z at the end of press < 2 N", "last(press.force.z) < 2 N"),
        ("final position.z < 3 mm", "last(position.z) < 3 mm"),
        ("peak force.z > -30 N", "min(force.z) > -30 N"),
        ("average speed <= 50 mm/s", "mean(norm(velocity)) <= 50 mm/s"),
    ],
)  # fmt: skip
def test_a_phrase_gets_the_expression_to_write(said: str, condition: str) -> None:
    (only,) = found(f"{HEAD}expect: ['{said}']\n")
    assert (only.code, only.hint) == ("TS101", f"write {condition}")
    assert load_text(f"{HEAD}expect: ['{condition}']\n", "task.yaml").task.expect


@pytest.mark.parametrize("said", ["peak foo < 60 N", "max speed < 60 N", "force peak < 3 N"])
def test_nothing_is_proposed_that_would_be_wrong_too(said: str) -> None:
    for each in found(f"{HEAD}expect: ['{said}']\n"):
        assert "write max" not in each.hint


@pytest.mark.parametrize(
    ("expect", "hint"),
    [
        ("peak force < 30 N", "write expect: [max(norm(force)) < 30 N]"),
        ("{max force: 30 N}", "write max-force: max(norm(force)) < 30 N"),
        ("[force.z within 1 N of -10 N]", "write within -10 N +- 1 N"),
    ],
)
def test_phrases_of_other_forms(expect: str, hint: str) -> None:
    (only,) = found(f"{HEAD}expect: {expect}\n")
    assert only.hint == hint


def test_listed_stages_are_read_on() -> None:
    """That they have no names hides nothing that is wrong with them."""
    text = HEAD.replace(
        STAGES,
        "stages: [{name: press, axes: {z: {velocity: -20}}, time: 1 s}, {leave: {tme: 1 s}}]\n",
    )
    listed, unit, key = found(f"{text}expect: [max(press.force.z) < 3 N]\n")
    assert (listed.code, listed.hint) == (
        "TS022",
        "write each by its name: stages: {press: {..}}",
    )
    assert (unit.code, key.code) == ("TS110", "TS020")


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("shape: cylinder, radius: 5 mm, height: 9 mm", "along its axis a cylinder has a 'length'"),
        ("shape: plane, height: 9 mm",
         "did you mean 'xyz'? It is a list whose third entry is the height"),
        ("mechanism: hinge, radius: 9 mm",
         "how far the handle is from the axis stands in 'handle', such as [120 mm, 0, 0]"),
    ],
)  # fmt: skip
def test_a_word_depends_on_what_it_is_said_of(text: str, hint: str) -> None:
    assert hint in [each.hint for each in found(f"{HEAD}world: {{a: {{{text}}}}}\n")]


@pytest.mark.parametrize(("key", "meant"), [("start", "from"), ("end", "to"), ("frm", "from")])
def test_other_words_for_the_ends_of_a_ramp(key: str, meant: str) -> None:
    axes = f"{{z: {{force: {{{key}: 0, to: -2 N, time: 1 s}}}}}}"
    (first, *_) = found(HEAD.replace("press: {time: 1 s}", f"press: {{axes: {axes}, time: 4 s}}")
                        .replace("end: 0, to:", "from: 0, end:"))  # fmt: skip
    assert first.hint == f"did you mean '{meant}'?"


def test_sides_of_a_raster_stand_in_one_key() -> None:
    raster = "path: {raster: {width: 9 mm, height: 5 mm, spacing: 1 mm}, speed: 9 mm/s}"
    hints = [
        each.hint for each in found(HEAD.replace("press: {time: 1 s}", f"press: {{{raster}}}"))
    ]
    sides = "did you mean 'size'? It is a list of all sides"
    assert hints == [sides, sides, "did you mean 'pitch'?"]


def test_a_phrase_with_a_colon() -> None:
    (only,) = found(f"{HEAD}expect: [peak force: 60 N]\n")
    assert only.hint == "write max(norm(force)) < 60 N"
