"""Whatever a file says, it loads or is told what is wrong with it; nothing else happens."""

from __future__ import annotations

import random
import sys
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from taskspec.spec import load_text
from taskspec.text.diagnostic import Diagnostic, SpecError
from taskspec.text.render import render
from taskspec.text.source import Source

CORPUS = Path(__file__).parent.parent / "corpus"
TEXTS = [p.read_text(encoding="utf-8") for p in sorted(CORPUS.glob("*/*.yaml"))]
GOOD = [p.read_text(encoding="utf-8") for p in sorted(CORPUS.glob("ok/*.yaml"))]
WORDS = sorted({word for text in TEXTS for word in text.split()})
SIGNS = list("{}[],:#&*!|>'\"%@`-?()=<>.^+/~ \n\t\0é🙂\u202e\ud800") + [
    "\n  ",
    ": ",
    " #",
    "..",
    "+-",
]

QUICK = settings(
    max_examples=150,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


def outcome(text: str, overrides: dict[str, str] | None = None) -> tuple[Diagnostic, ...]:
    """Load a text and hold what comes of it to what is promised."""
    try:
        loaded = load_text(text, "t.yaml", overrides)
    except SpecError as error:
        found, sources = error.diagnostics, error.sources
        assert any(d.severity == "error" for d in found)
    else:
        found, sources = loaded.warnings, loaded.sources
        assert all(d.severity == "warning" for d in found)
    for diagnostic in found:
        assert_place(diagnostic, sources[diagnostic.source])
    shown = render(found, sources)
    assert all(c == "\n" or c.isprintable() for c in shown)
    return found


def assert_place(diagnostic: Diagnostic, source: Source) -> None:
    span = diagnostic.span
    if span is not None:
        assert 1 <= span.line <= source.line_count
        assert 1 <= span.column <= len(source.line(span.line)) + 1
        assert (span.line, span.column) < (span.end_line, span.end_column)


def mutate(text: str, choose: random.Random) -> str:
    """Return a text with one to six small injuries."""
    for _ in range(choose.randint(1, 6)):
        at, end = sorted((choose.randint(0, len(text)), choose.randint(0, len(text))))
        kind = choose.randint(0, 5)
        if kind == 0:
            text = text[:at] + choose.choice(SIGNS) + text[at:]
        elif kind == 1:
            text = text[:at] + text[at + choose.randint(1, 4) :]
        elif kind == 2:
            text = text[:at] + choose.choice(WORDS) + text[at:]
        elif kind == 3:
            text = text[:at] + choose.choice(SIGNS) + text[at + 1 :]
        elif kind == 4:
            text = text[:at] + text[at : min(end, at + 80)] + text[at:]
        else:
            lines = text.split("\n")
            choose.shuffle(lines) if choose.random() < 0.2 else lines.pop(
                choose.randrange(len(lines))
            )
            text = "\n".join(lines)
    return text


@QUICK
@given(st.integers(0, 2**32))
def test_injured_files(seed: int) -> None:
    choose = random.Random(seed)
    outcome(mutate(choose.choice(GOOD if choose.random() < 0.7 else TEXTS), choose))


@QUICK
@given(st.text(max_size=200))
def test_any_text(text: str) -> None:
    outcome(text)


EXPRESSIONS = st.lists(
    st.sampled_from(
        [
            "force.z",
            "press",
            "t",
            "clock",
            "gap",
            "wipe",
            "table",
            "x",
            "3",
            "0",
            "2.5",
            "N",
            "mm",
            "s",
            "deg",
            "%",
            "+",
            "-",
            "*",
            "/",
            "^",
            "(",
            ")",
            ",",
            "<",
            ">",
            "<=",
            "=",
            "and",
            "or",
            "not",
            "for",
            "within",
            "in",
            "..",
            "+-",
            "sin",
            "max",
            "norm",
            "rms",
            "clamp",
            "touching",
            "joint.1.torque",
            "tool",
            "1e3",
            "/s",
            "'",
            "é",
        ]
    ),
    max_size=14,
).map(" ".join)

VALUES = st.recursive(
    st.one_of(
        EXPRESSIONS, st.integers(), st.floats(), st.booleans(), st.none(), st.text(max_size=8)
    ),
    lambda inner: st.one_of(
        st.lists(inner, max_size=4),
        st.dictionaries(
            st.sampled_from(
                [
                    "x",
                    "y",
                    "z",
                    "rx",
                    "hold",
                    "position",
                    "velocity",
                    "move",
                    "force",
                    "torque",
                    "ramp",
                    "speed",
                    "time",
                    "travel",
                    "to",
                    "line",
                    "by",
                    "arc",
                    "center",
                    "turns",
                    "lissajous",
                    "file",
                    "until",
                    "within",
                    "fail_if",
                    "next",
                    "on_fail",
                    "attempts",
                    "frame",
                    "law",
                    "kind",
                    "mass",
                    "stiffness",
                    "damping",
                    "linear",
                    "angular",
                    "shape",
                    "xyz",
                    "rpy",
                    "size",
                    "radius",
                    "parent",
                    "surface",
                    "heading",
                    "model",
                    "tool",
                    "start",
                    "joints",
                    "axes",
                    "path",
                    "3",
                ]
            ),
            inner,
            max_size=4,
        ),
    ),
    max_leaves=12,
)


@QUICK
@given(
    st.sampled_from(
        [
            "robot",
            "world",
            "params",
            "frames",
            "frame",
            "law",
            "limits",
            "stages",
            "expect",
            "vary",
            "control",
            "name",
            "about",
        ]
    ),
    VALUES,
    st.booleans(),
)
def test_anything_anywhere(section: str, value: object, named: bool) -> None:
    import json

    text = json.dumps({"one": value} if named else value).replace("NaN", ".nan")
    outcome(
        "taskspec: 1\nrobot: {model: panda}\nworld: {table: {shape: plane}}\n"
        "params: {press: 15 N}\nstages: {wipe: {time: 1 s}}\n".replace(f"{section}:", "about:", 1)
        + f"{section}: {text}\n"
    )


@QUICK
@given(
    st.dictionaries(
        st.one_of(
            st.text(max_size=20),
            st.lists(
                st.sampled_from(
                    [
                        "stages",
                        "wipe",
                        "axes",
                        "z",
                        "force",
                        "law",
                        "world",
                        "table",
                        "xyz",
                        "0",
                        "2",
                        "-1",
                        "expect",
                        "vary",
                    ]
                ),
                min_size=1,
                max_size=5,
            ).map(".".join),
        ),
        st.one_of(EXPRESSIONS, st.text(max_size=20), st.sampled_from(["{a: 1}", "[1]", "{", "*a"])),
        max_size=3,
    )
)
def test_any_override(overrides: dict[str, str]) -> None:
    outcome((CORPUS / "ok" / "wipe_table.yaml").read_text(encoding="utf-8"), overrides)


@pytest.mark.parametrize(
    "text",
    [
        "params: {" + ", ".join(f"p{i}: p{i + 1}" for i in range(3000)) + ", p3000: 3}",
        "params: {" + ", ".join(f"p{i}: q{i}" for i in range(3000)) + "}",
        "params: {" + ", ".join(f"p{i}: p{(i + 1) % 3000}" for i in range(3000)) + "}",
        "frames:\n" + "\n".join(f"  f{i}: {{parent: f{i + 1}}}" for i in range(2000)),
        "frames:\n" + "\n".join(f"  f{i}: {{parent: g{i}}}" for i in range(2000)),
        "stages:\n" + "\n".join(f"  a{i}: {{time: 1 s, next: b{i}}}" for i in range(1500)),
        "stages:\n" + "\n".join(f"  a{i}: {{time: 1 s, on_fail: a0}}" for i in range(1500)),
        "stages:\n" + "\n".join(f"  a{i}: {{nop{i}: 1 s}}" for i in range(2000)),
        "expect: [" + ", ".join("'" + " + ".join(["gap"] * 90) + " < 3'" for _ in range(400)) + "]",
        "expect: [" + ", ".join("(((((gap)))))" for _ in range(3000)) + "]",
        "a: [" + ", ".join("(b" for _ in range(5000)) + "]",
        "a: {" + ", ".join(f"b{i}:c" for i in range(5000)) + "}",
        "about: >\n" + "  word\n" * 1000,
        "\n" * 100_000,
        "# comment\n" * 20_000,
    ],
    ids=range(15),
)
def test_large_files_take_no_more_than_a_few_seconds(text: str) -> None:
    start = time.process_time()
    outcome("taskspec: 1\nrobot: {model: panda}\n" + text)
    assert time.process_time() - start < 4.0


def test_expressions_reach_nothing_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    touched: list[str] = []
    watching = True

    def watch(event: str, _: tuple[object, ...]) -> None:
        if watching and event.split(".")[0] in (
            "open",
            "exec",
            "import",
            "socket",
            "os",
            "subprocess",
        ):
            touched.append(event)

    payloads = [
        "__import__('os').system('id')", "().__class__.__bases__[0]", "open('/etc/passwd').read()",
        "a.__globals__", "(lambda: 0)()", "[x for x in (1).__class__]", "f'{open}'", "exec('1')",
        "eval('1')", "2**9**9**9", "${7*7}", "{{7*7}}", "`id`", "a;b", "x := 3", "yield 1", "*a", "@a",
    ]  # fmt: skip
    outcome("taskspec: 1\n")
    outcome("taskspec: 1\nexpect: ['1 <']\n")
    sys.addaudithook(watch)
    for payload in payloads:
        text = f"taskspec: 1\nrobot: {{model: panda}}\nexpect: [{payload!r}]\nstages: {{a: {{time: 1 s}}}}"
        assert outcome(text)
    watching = False
    assert touched == []
