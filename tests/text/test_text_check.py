from __future__ import annotations

import pytest

from taskspec.expression import (
    FloatAlgebra,
    Scope,
    ScopeKind,
    check,
    evaluate,
    infer,
    parse,
    resolve,
    tree,
)
from taskspec.signals import SCALARS, VECTORS
from taskspec.text.units import (
    ANGLE,
    FORCE,
    LENGTH,
    MOMENT,
    NUMBER,
    TIME,
    VELOCITY,
    Dimension,
    Quantity,
)


def scope(kind: ScopeKind) -> Scope:
    return Scope(
        kind,
        {
            "press": Quantity(15.0, FORCE),
            "n": Quantity(3.0, NUMBER),
            "nil": Quantity(0, NUMBER, True),
        },
        stages=frozenset({"wipe", "touch"}),
        objects={"table": "shape", "touch": "shape", "crank": "hinge", "rim": "equation"},
        frames=frozenset({"world", "tool"}),
        broken=frozenset({"bad"}),
    )


def codes(text: str, expected: Dimension | None, kind: ScopeKind) -> list[str]:
    node = parse(text, "logic" if expected is None else "sum")
    return [p.code for p in check(node, scope(kind), expected).problems]


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("force.z within 12 N +- 5 %", 11.4, 12.6),
        ("force.z within -12 N +- 5 %", -12.6, -11.4),
        ("force.z within -press ± 20 %", -18.0, -12.0),
        ("force.z within 12 N +- 5 % * press", 11.25, 12.75),
        ("force.z within -(press - 5 N) * 2 +- (50 %)", -30.0, -10.0),
        # About a plain number a percentage is a width.
        ("force.x/force.z within n +- 5 %", 2.95, 3.05),
        ("force.x/force.z within 90 +- 5 %", 89.95, 90.05),
        ("force.x/force.z within 90 % +- 5 %", 0.85, 0.95),
        ("force.x/force.z within 80..90 %", 0.8, 0.9),
    ],
)
def test_a_percentage_after_plus_minus(text: str, low: float, high: float) -> None:
    checked = check(parse(text, "logic"), scope(ScopeKind.EXPECT), None)
    assert checked.problems == ()
    assert isinstance(checked.tree, tree.WithinNode)
    params = {"press": 15.0, "n": 3.0}
    ends = [
        evaluate(end, FloatAlgebra(), lambda name: params[str(name)])
        for end in (checked.tree.low, checked.tree.high)
    ]
    assert ends == pytest.approx([low, high], rel=1e-14)


@pytest.mark.parametrize(
    ("name", "kind", "dimension"),
    [
        ("force.z.ref", "signal", FORCE),
        ("wipe.position.rx.ref", "signal", ANGLE),
        ("wipe.velocity.x.ref", "signal", VELOCITY),
        ("rim.force.ref", "object", FORCE),
        ("wipe.rim.force.ref", "object", FORCE),
        ("force.ref", "vector", FORCE),
        ("wipe.torque.ref", "vector", MOMENT),
    ],
)
def test_references_are_signals_of_expectations_alone(
    name: str, kind: str, dimension: Dimension
) -> None:
    path = tuple(name.split("."))
    meaning = resolve(path, scope(ScopeKind.EXPECT))
    assert meaning is not None
    assert (meaning.kind, meaning.dimension, meaning.beside) == (kind, dimension, "ref")
    for elsewhere in (ScopeKind.GUARD, ScopeKind.REFERENCE, ScopeKind.PLANNED):
        assert resolve(path, scope(elsewhere)) is None


@pytest.mark.parametrize(
    "name", ["error.z.ref", "gap.ref", "crank.torque.ref", "error.ref", "t.ref"]
)
def test_what_has_no_reference(name: str) -> None:
    assert resolve(tuple(name.split(".")), scope(ScopeKind.EXPECT)) is None


def test_a_share_of_another_value_moves_with_it() -> None:
    text = "force.z within norm(force) +- 10 %"
    checked = check(parse(text, "logic"), scope(ScopeKind.GUARD), None)
    components = {"force.x": 3.0, "force.y": -4.0, "force.z": 12.0}
    assert isinstance(checked.tree, tree.WithinNode)
    high = evaluate(checked.tree.high, FloatAlgebra(), lambda name: components[str(name)])
    assert high == pytest.approx(1.1 * 13.0, rel=1e-14)


@pytest.mark.parametrize(
    "text",
    [
        "force.z < -2 N for 10 ms",
        "touching",
        "not path_done and gap > 0",
        "norm(force in tool) > press",
        "max(gap) - min(gap) < 1 mm",
        "mean(force.z) < -press or rms(error.rx) < 1 deg",
        "touch.visits < 3",
        "table.gap < 1 mm and table.force > 2 N",
        "joint.2.torque > 3 N*m",
        "bad < 3 and bad > 2 N",
        "position.x within -1..1 mm",
        "clock > t",
        "max(0, gap) > 0",
        "gap > nil",
    ],
)
def test_guards(text: str) -> None:
    assert codes(text, None, ScopeKind.GUARD) == []


@pytest.mark.parametrize(
    "text",
    [
        "wipe.force.z within -press +- 0.5 N for 93 %",
        "max(norm(wipe.force in world)) < 40 N",
        "wipe.table.gap > 0",
        "touch.gap < 1 mm",
        "wipe.t < 3 s",
        "wipe.joint.1.velocity < 3 deg/s",
        "wipe.visits <= n",
        "last(clock) < 60 s",
    ],
)
def test_expectations(text: str) -> None:
    assert codes(text, None, ScopeKind.EXPECT) == []


@pytest.mark.parametrize(
    ("text", "expected", "kind"),
    [
        ("60 mm * sin(2*pi*t/(4 s))", LENGTH, ScopeKind.PLANNED),
        ("0", LENGTH, ScopeKind.CONSTANT),
        ("-0", FORCE, ScopeKind.CONSTANT),
        ("0 * press", FORCE, ScopeKind.CONSTANT),
        ("sqrt(press^2)", FORCE, ScopeKind.CONSTANT),
        ("atan2(1 mm, 2 mm)", ANGLE, ScopeKind.CONSTANT),
        ("sin(30 deg) * 1 mm", LENGTH, ScopeKind.CONSTANT),
        ("1 mm / (1 s)", VELOCITY, ScopeKind.CONSTANT),
        ("-30 mm/s * clamp(gap/(10 mm), 0, 1)", VELOCITY, ScopeKind.REFERENCE),
        ("2 * clock", TIME, ScopeKind.WORLD),
        ("norm(3 mm, 4 mm, 0)", LENGTH, ScopeKind.CONSTANT),
        ("bad * 3", LENGTH, ScopeKind.CONSTANT),
    ],
)
def test_dimensions(text: str, expected: Dimension, kind: ScopeKind) -> None:
    assert codes(text, expected, kind) == []


@pytest.mark.parametrize(
    ("text", "expected", "kind", "found"),
    [
        ("3", LENGTH, ScopeKind.CONSTANT, ["TS110"]),
        ("-3", LENGTH, ScopeKind.CONSTANT, ["TS110"]),
        ("2*3", LENGTH, ScopeKind.CONSTANT, ["TS112"]),
        ("press", LENGTH, ScopeKind.CONSTANT, ["TS112"]),
        ("press + 1 mm", FORCE, ScopeKind.CONSTANT, ["TS113"]),
        ("press + 1", FORCE, ScopeKind.CONSTANT, ["TS110"]),
        ("n + 1 mm", LENGTH, ScopeKind.CONSTANT, ["TS113"]),
        ("t", TIME, ScopeKind.CONSTANT, ["TS116"]),
        ("t", TIME, ScopeKind.WORLD, ["TS116"]),
        ("gap", LENGTH, ScopeKind.PLANNED, ["TS116"]),
        ("wipe.gap", LENGTH, ScopeKind.REFERENCE, ["TS116"]),
        ("exp(1 N)", NUMBER, ScopeKind.CONSTANT, ["TS112"]),
        ("atan2(1 N, 1 mm)", ANGLE, ScopeKind.CONSTANT, ["TS113"]),
        ("sin(1 s)", NUMBER, ScopeKind.CONSTANT, ["TS112"]),
        ("rms(gap)", LENGTH, ScopeKind.REFERENCE, ["TS119"]),
        ("force", FORCE, ScopeKind.REFERENCE, ["TS114"]),
        ("nope + nope2", FORCE, ScopeKind.REFERENCE, ["TS120", "TS120"]),
        ("sine(nope)", FORCE, ScopeKind.REFERENCE, ["TS120", "TS121"]),
        ("gap < 1 N and nope < 2 and gap < 3", None, ScopeKind.GUARD, ["TS113", "TS120", "TS110"]),
        ("gap and 3 mm", None, ScopeKind.GUARD, ["TS114", "TS114"]),
        ("(gap < 1 mm) < 3", None, ScopeKind.GUARD, ["TS114"]),
        ("gap < 1 mm for 95 %", None, ScopeKind.GUARD, ["TS112"]),
        ("gap < 1 mm for 5 ms", None, ScopeKind.EXPECT, ["TS119"]),
        ("force.z in nowhere < 1 N", None, ScopeKind.GUARD, ["TS122"]),
        ("speed in tool < 1 m/s", None, ScopeKind.GUARD, ["TS116"]),
        ("table.torque < 1 N*m", None, ScopeKind.GUARD, ["TS120"]),
        ("crank.travel < 1 mm", None, ScopeKind.GUARD, ["TS120"]),
        ("crank.angle < 1 mm", None, ScopeKind.GUARD, ["TS113"]),
        ("q1 < 3 deg", None, ScopeKind.GUARD, ["TS120"]),
        ("joint.0.position < 1 deg", None, ScopeKind.GUARD, ["TS120"]),
        ("mean(rms(gap)) < 1 mm", None, ScopeKind.GUARD, ["TS119"]),
        ("wipe < 3", None, ScopeKind.GUARD, ["TS120"]),
    ],
)
def test_what_does_not_fit(
    text: str, expected: Dimension | None, kind: ScopeKind, found: list[str]
) -> None:
    assert codes(text, expected, kind) == found


def test_wrong_part_is_the_one_that_is_pointed_at() -> None:
    text = "force.z < -2 N and gap > 3"
    (problem,) = check(parse(text, "logic"), scope(ScopeKind.GUARD), None).problems
    assert text[problem.start : problem.end] == "3"
    assert problem.hint == "add a unit: mm, cm or m"


def test_a_stage_wins_over_an_object_of_the_same_name() -> None:
    meaning = resolve(("touch", "gap"), scope(ScopeKind.EXPECT))
    assert meaning is not None
    assert (meaning.kind, meaning.stage, meaning.name) == ("signal", "touch", "gap")


def test_norm_of_a_vector_is_written_out() -> None:
    node = parse("max(norm(wipe.force in tool)) < 40 N and norm(torque) < 3 Nm", "logic")
    checked = check(node, scope(ScopeKind.EXPECT), None)
    names = [str(n) for n in tree.walk(checked.tree) if isinstance(n, tree.Name)]
    assert names == [
        "wipe.force.x in tool",
        "wipe.force.y in tool",
        "wipe.force.z in tool",
        "torque.rx",
        "torque.ry",
        "torque.rz",
    ]


@pytest.mark.parametrize("name", [f"{v}.{axis}" for v, s in VECTORS.items() for axis in s.axes])
def test_every_axis_of_every_signal_has_its_dimension(name: str) -> None:
    signal, axis = name.split(".")
    kind, problems = infer(parse(name, "sum"), scope(ScopeKind.GUARD))
    assert (kind.dimension, problems) == (VECTORS[signal].dimensions[axis], ())


@pytest.mark.parametrize("name", [n for n, s in SCALARS.items() if not s.condition])
def test_every_scalar_signal_has_its_dimension(name: str) -> None:
    kind, problems = infer(parse(name, "sum"), scope(ScopeKind.GUARD))
    assert (kind.dimension, problems) == (SCALARS[name].dimension, ())
