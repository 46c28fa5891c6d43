"""The pages of docs/laws: equations, gains, tasks and numbers are those of code and runs."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from documents import (
    BLOCK,
    ROOT,
    TASKS,
    completed,
    load,
    table,
    text_of,
    units_written,
    value,
    words,
)
from test_docs_keys import units_needed

from taskspec.control.state import ARM_LENGTH
from taskspec.expression import Expression, parse
from taskspec.geometry.axis import AXES, Axis
from taskspec.laws import LAWS
from taskspec.laws.gains import AxisPlant
from taskspec.laws.servo_loop import Contact, ServoTiming
from taskspec.motion.blend import BLEND_TIME
from taskspec.program.reference.constraints import FORCED, NAMED, UNNAMED, weigh
from taskspec.program.stages import candidates
from taskspec.spec import AxisEntry, Law
from taskspec.spec.law import ForceGains
from taskspec.text.units import FORCE, split_quantity

PAGES = ROOT / "docs" / "laws"
INDEX = PAGES / "README.md"
CONSTRAINTS = PAGES / "constraints.md"
THEORY = ROOT / "docs" / "theory.md"

law_pages = pytest.mark.parametrize("law", LAWS)


def page(law: str) -> Path:
    return PAGES / f"{law}.md"


def shown(path: Path) -> list[str]:
    """Every task that a page shows, completed."""
    found = []
    for match in BLOCK.finditer(text_of(path)):
        if match["kind"] == "yaml":
            name = match["name"]
            found.append(completed(match["text"], path, name) if name else match["text"])
    return found


def tables(path: Path, name: str) -> list[list[str]]:
    """Rows of all tables with one name."""
    marked = re.findall(rf"^<!-- {name} -->\n((?:\|.*\n)+)", text_of(path), re.M)
    lines = [line for rows in marked for line in rows.splitlines()[2:]]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


@law_pages
def test_page_names_its_equations(law):
    text = text_of(page(law))
    assert text.startswith(f"# `{law}`: {LAWS[law].title}\n")
    for equation in LAWS[law].equations.split(", "):
        written = equation if "=" in equation else equation.replace("-", "–")
        assert written.lower() in text.lower(), equation
    equation = text.partition("## Equation")[2].partition("\n## ")[0]
    assert "$$" in equation
    # Each stands there once, as a formula.
    assert "```" not in equation


@law_pages
def test_tasks_of_a_page_are_under_its_law(law):
    first, *others = shown(page(law))
    assert others
    assert {load(task).task.law.kind for task in (first, *others)} == {law}
    given = load(others[-1]).task.law
    for gain in LAWS[law].gain_names:
        owner, _, key = gain.rpartition(".")
        if LAWS[law].damps_joints and gain == "damping":
            key = "joint_damping"
        assert getattr(given.force if owner else given, key) is not None, gain


@pytest.mark.parametrize("path", sorted(PAGES.glob("*.md")), ids=lambda path: path.stem)
def test_tasks_that_are_shown_are_the_shipped_ones(path):
    said = re.findall(r"^This is \[`tasks/(\S+)`\]\(../../tasks/\1\):\n\n```yaml\n(.*?)^```$",
                      text_of(path), re.M | re.S)  # fmt: skip
    if path.stem in LAWS:
        assert [name for name, _ in said] == [f"press-{path.stem}.yaml"]
        assert f"(../images/press-{path.stem}.svg)" in text_of(path)
    for name, text in said:
        _, _, shipped = text_of(TASKS / name).partition("\n")
        assert text == shipped


# Gains

KINDS = {
    "motion": AxisEntry(hold="start"),
    "force": AxisEntry(force=Expression("", parse("1 N", "sum"), FORCE)),
}
SERVO = ServoTiming(w=2 * np.pi * 20.0, ratio=1.0, delay=4e-3, period=1e-3, tick=1e-3, step=1e-3)
PLANTS = (
    AxisPlant(h=3.0, held=8.0, k=20e3, period=1e-3, servo=SERVO.along(3.0, Contact(20e3))),
    AxisPlant(h=0.4, held=0.7, k=1e3, period=1e-3, servo=SERVO.along(0.4, Contact(1e3))),
    AxisPlant(h=1.5, held=2.0, k=2e5, period=4e-3, servo=SERVO.along(1.5, Contact(2e5))),
)


@law_pages
def test_gains_and_their_units(law):
    rows = table(page(law), "table: gains")
    assert {words(row[0])[0] for row in rows} == set(LAWS[law].gain_names)
    for gain, kind, unit, *_ in rows:
        (name,) = words(gain)
        owner, _, key = name.rpartition(".")
        if kind == "joint":
            key = "joint_damping"
        model = ForceGains if owner else Law
        assert units_written(unit) == units_needed(model, key), name


@pytest.mark.parametrize("plant", PLANTS)
@law_pages
def test_designed_gains(law, plant):
    for gain, kind, _, _, rule in table(page(law), "table: gains"):
        (name,), (formula,) = words(gain), words(rule)
        if kind == "joint":
            known = {"H": plant.held, "h": plant.h, "S": plant.k, "T": plant.period}
            found = Law(kind=law).design_joints([plant])["joint.1"].value
        else:
            designed = Law(kind=law).design({Axis.X: KINDS[kind]}, {Axis.X: plant})
            gains = {name: by_axis[Axis.X].value for name, by_axis in designed.items()}
            if formula == "none":
                assert name not in gains
                continue
            known = {"h": plant.h, "L": plant.held, "k": plant.k, "T": plant.period}
            known |= {"M": gains.get("mass", 0.0), "K": gains.get("stiffness", 0.0)}
            known["d"] = gains.get("force.damping", gains.get("damping", 0.0))
            assert plant.servo is not None
            known["D_0"] = plant.servo.least_damping(lag=5e-3)[0]
            if "force.damping" in gains:  # Beside the integral that the least without one has.
                alone = plant.servo.least_damping()[0]
                integral = plant.k / (8 * 3 * alone)
                known["D_0"] = plant.servo.least_damping(integral=integral)[0]
            found = gains[name]
        assert found == pytest.approx(value(formula, known), rel=1e-12), (name, kind)


@law_pages
def test_gains_that_differ_with_a_force_have_a_row_for_it(law):
    rows = {(words(row[0])[0], row[1]) for row in table(page(law), "table: gains")}
    motion, force = (
        Law(kind=law).design({Axis.X: KINDS[kind]}, {Axis.X: PLANTS[0]})
        for kind in ("motion", "force")
    )
    for gain in LAWS[law].gain_names:
        if gain in motion and gain in force and motion[gain]["x"].value != force[gain]["x"].value:
            assert {(gain, "motion"), (gain, "force")} <= rows, gain


# Numbers


def test_measured_numbers_are_those_of_the_predictions():
    lines = [line.strip("|").split(" | ") for line in text_of(THEORY).splitlines()]
    known = {
        tuple(cell.strip() for cell in cells[:3]): cells[3:5] for cells in lines if len(cells) == 7
    }
    found = 0
    for path in PAGES.glob("*.md"):
        for what, equation, case, predicted, measured in tables(path, "table: measured"):
            row = known[what, equation, case]
            assert predicted == row[0].strip(), (path.stem, what)
            # The last digits of a run may differ from one machine to the next.
            assert float(measured) == pytest.approx(float(row[1]), rel=1e-2, abs=1e-3), what
            found += 1
    assert found >= len(LAWS)


LARGEST = [
    pytest.param(law, *words(row[0]), *words(row[1]), id=f"{law}, {words(row[0])[0]}")
    for law in LAWS
    for row in tables(PAGES / f"{law}.md", "table: largest")
]


@pytest.mark.parametrize(("law", "gain", "largest"), LARGEST)
def test_a_press_settles_up_to_the_largest_gain(simulate, law, gain, largest):
    parts = split_quantity(largest)
    assert parts is not None
    number, unit = parts

    def swing(factor):
        changed = {gain: f"{factor * float(number):.6g} {unit}", "limits.force": "100 kN"}
        run = simulate(f"press-{law}", changed)
        if run.outcome.status != "done":
            return np.inf
        pressing = "slide" if "slide" in run.program.context.loaded.task.stages else "press"
        return np.ptp(run.during(pressing, "force.z")[-500:])

    # The factors and what settling means are those of the index's section on sampling.
    assert swing(0.8) < 0.5
    assert swing(1.25) > 0.5


def test_what_settling_means_stands_in_the_index():
    text = " ".join(text_of(INDEX).split())
    assert "within 0.5 N for the last half second" in text
    assert "0.8 times the value settles and one at 1.25 times the value does not" in text
    assert {law for law, *_ in (param.values for param in LARGEST)} == LAWS.keys()


# The index and the page on constraints


def test_index_lists_the_laws_with_what_they_can_do():
    rows = table(INDEX, "table: choose")
    assert [words(row[0])[0] for row in rows] == list(LAWS)
    for row in rows:
        law = words(row[0])[0]
        facts = LAWS[law]
        assert f"({law}.md)" in row[0]
        # (4.16) is the one law that measures the force without a loop for it.
        assert row[1] == ("yes" if facts.force_loop or law == "impedance" else "no"), law
        assert row[3].startswith("yes") == facts.force_loop, law
        assert row[7].startswith("yes") == facts.shares, law
    assert "docs/laws/README.md" in text_of(ROOT / "README.md")


def test_order_in_which_coordinates_give_way():
    weights = [float(row[1]) for row in table(CONSTRAINTS, "table: weights")]
    assert weights == [FORCED, UNNAMED, NAMED]
    assert all(a > b for a, b in pairwise(weights))
    found = weigh(AXES, named=["x", "rx"], forced=["z"])
    assert found[:3] == [NAMED, UNNAMED, FORCED]
    text = " ".join(text_of(CONSTRAINTS).split())
    assert f"a radian counts as {ARM_LENGTH:g} m" in text
    assert f"fades over {BLEND_TIME:g} s along a quintic" in text
    assert f"be more than {candidates.WORN:g} times as large, the choice is made again" in text
