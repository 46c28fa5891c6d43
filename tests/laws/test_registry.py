"""The table of laws: what a law has to state, and what follows where it states nothing."""

from __future__ import annotations

import pytest

from taskspec.laws import DEFAULTS, LAWS, register
from taskspec.laws.design import springs
from taskspec.laws.gains import DAMPING, STIFFNESS, AxisDesign, AxisPlant
from taskspec.laws.law import ControlLaw, gain_named

PLANT = AxisPlant(h=2.0, held=3.0, k=1e4, period=1e-3)


@pytest.fixture
def _unlisted(monkeypatch):
    """Laws that a test registers are forgotten after it."""
    monkeypatch.setattr("taskspec.laws.law.LAWS", dict(LAWS))


class Push(ControlLaw):
    """A spring and a damper, and nothing else stated than what has to be."""

    kind = "push"
    title = "a push"
    equations = "(9.1), (9.2)"
    gains = (STIFFNESS, DAMPING)

    def command(self, case):
        return case


def test_laws_are_listed_by_their_names():
    assert {LAWS[kind].commands: kind for kind in DEFAULTS.values()} == DEFAULTS
    assert all(law.kind == name for name, law in LAWS.items())


def test_a_law_has_a_dual_for_arms_that_take_what_it_does_not_command():
    assert len(LAWS) > 10
    assert {name for name, law in LAWS.items() if LAWS[law.dual].commands == law.commands} == set()


@pytest.mark.usefixtures("_unlisted")
def test_a_name_is_given_once():
    register(Push)
    with pytest.raises(ValueError, match="there is a law 'push' already"):
        register(Push)


@pytest.mark.usefixtures("_unlisted")
def test_a_law_states_its_name_equations_and_gains():
    class Nameless(ControlLaw):
        title, gains = "nameless", ()

    with pytest.raises(TypeError, match="Nameless does not state its kind, equations"):
        register(Nameless)


@pytest.mark.usefixtures("_unlisted")
def test_a_law_has_an_equation():
    class Silent(ControlLaw):
        kind, title, equations, gains = "silent", "silent", "(9.3)", ()

    with pytest.raises(TypeError, match="command"):
        register(Silent)


def test_what_a_law_does_not_state_has_an_answer():
    law, gains = Push(), {"stiffness": 500.0, "damping": 20.0}
    axis = AxisDesign(PLANT, given={"stiffness": 500.0})
    assert law.design(axis) == springs(law, axis)
    assert law.rest
    assert law.drag(gains) == 0.0
    assert law.spring(gains, mass=2.0) == 500.0
    assert law.spring({}, mass=2.0) == 0.0
    assert law.loop_damping(gains) == 20.0
    assert law.gives_way({}, ["z"]) == [1.0]
    assert law.settles_at(moves=False, reached=True) == "set point"
    assert law.enforces(force=False, motion=True, open_loop=False, soft=False) == "impedance"


def test_gains_that_no_law_declares_are_plain_numbers():
    assert gain_named("stiffness").text(2000.0, angular=False) == "2 kN/m"
    assert gain_named("odd").text(2.5, angular=True) == "2.5"
