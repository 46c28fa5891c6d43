"""What the conventions say of contacts, mechanisms and the grip: the numbers of the plant."""

from __future__ import annotations

import pytest
from documents import CONVENTIONS, table, words

from taskspec.program.world import stiffness
from taskspec.program.world.stiffness import GRIP
from taskspec.robot import load_robot
from taskspec.shapes import Box, Cylinder, Sphere
from taskspec.spec import Robot, Tool
from taskspec.text.units import split_quantity, to_si
from taskspec_runner.plant import contact, dry_friction, mechanisms

TEXT = " ".join(CONVENTIONS.read_text(encoding="utf-8").split())


def quantity(text: str) -> float:
    parts = split_quantity(text)
    assert parts is not None
    return to_si(*parts).value


def test_creep():
    for row in table(CONVENTIONS, "table: friction"):
        (model,), (mass,), (most,), (slip,) = (words(cell) for cell in row)
        tool = Tool(radius=0.01, length=0.1, mass=quantity(mass))
        found = contact.most_creep(load_robot(Robot(model=model, tool=tool)), 1e-3)
        assert quantity(most) == pytest.approx(found, rel=5e-3)
        assert quantity(slip) == pytest.approx(0.2 * 20 / found, rel=0.05)
    assert f"c is {stiffness.IMPRATIO:.0f} times the contact's damping" in TEXT
    assert stiffness.SETTLING == 0.5
    assert "no more than takes away half of a slip" in TEXT


def test_grip():
    rows = {row[0]: [quantity(words(cell)[0]) for cell in row[1:]] for row in table(
        CONVENTIONS, "table: grip"
    )}  # fmt: skip
    assert rows == {
        "stiffness": [GRIP.stiffness, GRIP.angular_stiffness],
        "damping": [GRIP.damping, GRIP.angular_damping],
    }
    assert f"{GRIP.damping * 1e-3:g} kg at 1 kHz" in TEXT
    assert f"50 N along the circle of a handle are {50e3 / GRIP.stiffness:g} mm of tool" in TEXT


def test_mechanisms():
    assert mechanisms._STOP_STEPS == 3
    assert "a time constant of three plant steps" in TEXT
    assert f"a damping ratio of {mechanisms._STOP_DAMPING:g}" in TEXT
    assert quantity("1e-6 kg*m^2") == mechanisms.KNOB_INERTIA
    assert "its inertia is 1e-6 kg·m²" in TEXT
    assert dry_friction.SETTLING == 0.5


def test_loose_bodies():
    on = [kind.resting_points for kind in (Box, Cylinder, Sphere)]
    assert on == [4, 8, 1]
    assert "a flat face rests on four points at its corners, a cylinder's end on eight" in TEXT
