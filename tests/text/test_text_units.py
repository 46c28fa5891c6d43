from __future__ import annotations

import math

import pytest

from taskspec.text import units
from taskspec.text.units import (
    Dimension,
    describe,
    fitting,
    number,
    parse_unit,
    scaled,
    sensible,
    show,
    split_quantity,
    to_si,
)


@pytest.mark.parametrize(
    ("text", "value", "dimension"),
    [
        ("15 N", 15.0, units.FORCE),
        ("15N", 15.0, units.FORCE),
        ("20 kN/m", 20e3, units.STIFFNESS),
        ("1 N/mm", 1e3, units.STIFFNESS),
        ("30 N*s/m", 30.0, units.DAMPING),
        ("12 /s", 12.0, units.FREQUENCY),
        ("12 1/s", 12.0, units.FREQUENCY),
        ("5 Hz", 5.0, units.FREQUENCY),
        ("60 rpm", 2 * math.pi, units.ANGULAR_VELOCITY),
        ("300 mJ", 0.3, units.MOMENT),
        ("900 mW", 0.9, units.POWER),
        ("0.5 turn", math.pi, units.ANGLE),
        ("180 deg", math.pi, units.ANGLE),
        ("93 %", 0.93, units.NUMBER),
        ("2 N*m/rad", 2.0, units.ANGULAR_STIFFNESS),
        ("3 Nm*s/rad", 3.0, units.ANGULAR_DAMPING),
        ("1 mm^2", 1e-6, units.LENGTH**2),
        ("2 m/s^2", 2.0, units.LENGTH / units.TIME**2),
        ("1 J", 1.0, units.MOMENT),
        ("5 mm/rad", 5e-3, units.LENGTH / units.ANGLE),
        ("1e3 mN", 1.0, units.FORCE),
        ("7", 7.0, units.NUMBER),
    ],
)
def test_quantity_in_si(text: str, value: float, dimension: Dimension) -> None:
    parts = split_quantity(text)
    assert parts is not None
    quantity = to_si(*parts)
    assert quantity.value == pytest.approx(value, rel=1e-15)
    assert quantity.dimension == dimension


@pytest.mark.parametrize("number", [0.1, 0.3, 1.5, 30, 250, 999, 0.007])
@pytest.mark.parametrize(("unit", "exponent"), [("mm", -3), ("um", -6), ("ms", -3), ("kN", 3)])
def test_decimal_prefix_is_exact(number: float, unit: str, exponent: int) -> None:
    assert to_si(number, unit).value == pytest.approx(float(f"{number}e{exponent}"), rel=3e-16)


def test_only_a_zero_without_a_unit_fits_everything() -> None:
    assert to_si(0.0, "").bare
    assert not to_si(0.0, "mm").bare
    assert not to_si(1.0, "").bare


@pytest.mark.parametrize("text", ["lbs", "m*", "N//m", "m^", "m^12", "mm ", "N·m", "°", "", "1"])
def test_what_is_no_unit(text: str) -> None:
    with pytest.raises(ValueError, match="is not a unit"):
        parse_unit(text)


@pytest.mark.parametrize("text", ["15 newton", "N", ".5 N", "5. N", "1 2", "", "-3 N", "3 mmm"])
def test_what_is_no_quantity(text: str) -> None:
    assert split_quantity(text) is None


@pytest.mark.parametrize("dimension", sorted({m.dimension for m in units.MEASURES}, key=str))
def test_named_dimensions_fit_the_units_that_are_offered_for_them(dimension: Dimension) -> None:
    for unit in fitting(dimension):
        assert parse_unit(unit).dimension == dimension


def test_dimensions_are_told_in_words() -> None:
    assert describe(units.FORCE) == "a force (N)"
    assert describe(units.NUMBER) == "a plain number"
    assert describe(units.FORCE * units.TIME**2 / units.ANGLE) == "a quantity (kg*m/rad)"
    assert describe(units.NUMBER / units.LENGTH) == "a quantity (1/m)"


def test_moment_and_stiffness_against_rotation_differ() -> None:
    assert parse_unit("N*m").dimension != parse_unit("N*m/rad").dimension
    assert parse_unit("rad/s").dimension != parse_unit("Hz").dimension


@pytest.mark.parametrize("measure", units.MEASURES, ids=lambda m: m.noun)
def test_what_is_shown_in_a_unit_is_what_it_was(measure: units.Measure) -> None:
    """Steps go from coarse to fine and cover every size; their units are those of the measure."""
    for steps in (measure.sized, measure.page):
        assert [s.least for s in steps] == sorted((s.least for s in steps), reverse=True)
        assert not steps or steps[-1].least == 0
    for step in measure.sized:
        assert parse_unit(step.unit).dimension == measure.dimension
    for step in measure.page:
        letters = step.unit.replace("·", "*").replace("µ", "u")
        known = letters.split("*")[0] in units.UNITS
        assert not known or 1 / parse_unit(letters).scale == pytest.approx(step.factor)
    assert units.measure_in(measure.si) is measure


def test_quantities_in_the_unit_that_suits_them() -> None:
    assert show(0.015, units.LENGTH) == "15 mm"
    assert show(-12.0, units.FORCE.on(rotation=True)) == "-12 N*m"
    assert show(0.5, units.NUMBER) == "0.5"
    assert [scaled(x, units.LENGTH) for x in (2.0, 1e-4, 9e-5, 0.0)] == [
        "2000 mm", "0.1 mm", "90 um", "0 mm",
    ]  # fmt: skip
    assert [scaled(x, units.STIFFNESS) for x in (-2e4, 999.0)] == ["-20 kN/m", "999 N/m"]
    assert scaled(0.2, units.DAMPING) == "0.2 N*s/m"
    assert number(123456.0, 3) == "123000"


@pytest.mark.parametrize(
    ("value", "dimension", "text"),
    [
        (1.71e13, units.LENGTH, "more than 1000000 m"),
        (-1.71e13, units.LENGTH, "less than -1000000 m"),
        (4.4e11, units.TIME, "more than 1000000 s"),
        (1.5e52, units.MASS, "more than 1000000 kg"),
        (0.5, units.LENGTH, "500 mm"),
    ],
)
def test_what_makes_no_sense_is_more_than_what_does(value, dimension, text) -> None:
    assert show(value, dimension) == text
    assert sensible(value, dimension) == (value == 0.5)
