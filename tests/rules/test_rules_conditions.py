"""Interval arithmetic of expressions holds every value, and conditions that exclude each other."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from taskspec.expression import FloatAlgebra, evaluate, parse
from taskspec.program.conditions import value_of
from taskspec.program.interval import ANY, MAYBE, NEVER, Interval, IntervalAlgebra

#: Outward by rounding: products and sums of numbers below 100 err by less than this.
_ROUNDING = 1e-9

numbers = st.floats(-10, 10, allow_nan=False)
atoms = st.sampled_from(["x", "y", "2", "0.5"])
terms = st.recursive(
    atoms,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/"]), inner).map(
            lambda p: f"({p[0]} {p[1]} {p[2]})"
        ),
        inner.map(lambda a: f"(-{a})"),
        inner.map(lambda a: f"({a})^2"),
        inner.map(lambda a: f"({a})^-3"),
        st.tuples(
            st.sampled_from(["sin", "atan", "sqrt", "exp", "log", "smooth", "abs", "sign", "acos"]),
            inner,
        ).map(lambda p: f"{p[0]}({p[1]})"),
        st.tuples(st.sampled_from(["min", "max", "norm", "atan2"]), inner, inner).map(
            lambda p: f"{p[0]}({p[1]}, {p[2]})"
        ),
        inner.map(lambda a: f"clamp({a}, -1, 2)"),
    ),
    max_leaves=6,
)


@given(terms, st.tuples(numbers, numbers), st.tuples(numbers, numbers), st.floats(0, 1))
@settings(max_examples=400, deadline=None)
def test_an_interval_holds_every_value(text, x, y, share):
    node = parse(text, "sum")
    ends = {"x": sorted(x), "y": sorted(y)}
    at = {name: low + share * (high - low) for name, (low, high) in ends.items()}
    value = evaluate(node, FloatAlgebra(), lambda name: at[str(name)])
    interval = evaluate(node, IntervalAlgebra(), lambda name: Interval(*ends[str(name)]))
    if math.isnan(value):
        return
    slack = _ROUNDING * max(1.0, abs(value))
    assert interval.low - slack <= value <= interval.high + slack


RANGES = {"x": Interval(0.0, 3.0), "y": ANY, "b": MAYBE}


@pytest.mark.parametrize(
    ("text", "never"),
    [
        ("x > 4", True),
        ("x > 2", False),
        ("x < 0", True),
        ("x <= 0", False),
        ("not x < 4", True),
        ("x within 4..5", True),
        ("y > 2 and y < 1", True),
        ("y > 1 and y < 2", False),
        ("abs(y) < 1 and abs(y) > 3", True),
        ("y within 1..2 and y within 3..4", True),
        ("y > 2 or x > 4", False),
        ("y^2 < 0", True),
        ("max(x) - min(x) > 4", True),
        ("std(x) > 2", True),
        ("rms(y) < 0", True),
        ("mean(x) > 2.9", False),
        ("b and x > 4", True),
        ("(b and y > 2) for 3 s", True),
        ("1 / x > 4", False),
        ("y > 2 and x / y > 2", True),
        ("max(y) > 2 and y < 0", False),
    ],
)
def test_conditions_that_never_hold(text, never):
    node = parse(text, "logic")
    value = value_of(node, IntervalAlgebra(longest=2.0), lambda name: RANGES[str(name)])
    assert (value == NEVER) is never
