"""Whatever a file says, it loads or is told what is wrong with it; nothing else happens."""

from __future__ import annotations

import json
import random
import sys
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from taskspec.spec import load_text
from taskspec.text.diagnostic import Diagnostic, SpecError
from taskspec.text.render import render

sys.path.insert(0, str(Path(__file__).parent.parent / "corpus"))

from reading import assert_place

CORPUS = Path(__file__).parent.parent / "corpus"
TEXTS = [p.read_text(encoding="utf-8") for p in sorted(CORPUS.glob("*/*.yaml"))]
GOOD = [p.read_text(encoding="utf-8") for p in sorted(CORPUS.glob("ok/*.yaml"))]
WORDS = sorted({word for text in TEXTS for word in text.split()})
SIGNS = [
    *"{}[],:#&*!|>'\"%@`-?()=<>.^+/~ \n\t\0é🙂\u202e\ud800",
    *("\n  ", ": ", " #", "..", "+-"),
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


def injure(text: str, choose: random.Random) -> str:
    """Return a text with one small injury."""
    at = choose.randint(0, len(text))
    match choose.randint(0, 6):
        case 0:
            return text[:at] + choose.choice(SIGNS) + text[at:]
        case 1:
            return text[:at] + text[at + choose.randint(1, 4) :]
        case 2:
            return text[:at] + choose.choice(WORDS) + text[at:]
        case 3:
            return text[:at] + choose.choice(SIGNS) + text[at + 1 :]
        case 4:
            return text[:at] + text[at : at + choose.randint(1, 80)] + text[at:]
        case 5:
            lines = text.split("\n")
            del lines[choose.randrange(len(lines))]
            return "\n".join(lines)
        case _:
            lines = text.split("\n")
            choose.shuffle(lines)
            return "\n".join(lines)


@QUICK
@given(st.integers(0, 2**32))
def test_injured_files(seed: int) -> None:
    choose = random.Random(seed)
    text = choose.choice(GOOD if choose.random() < 0.7 else TEXTS)
    for _ in range(choose.randint(1, 6)):
        text = injure(text, choose)
    outcome(text)


@QUICK
@given(st.text(max_size=200))
def test_any_text(text: str) -> None:
    outcome(text)


def words(text: str) -> st.SearchStrategy[str]:
    return st.sampled_from(text.split())


EXPRESSIONS = st.lists(
    words("""
        force.z press t clock gap wipe table x 3 0 2.5 N mm s deg % + - * / ^ ( ) , < > <= = and or
        not for within in .. +- sin max norm rms clamp touching joint.1.torque tool 1e3 /s ' é
    """),
    max_size=14,
).map(" ".join)

KEYS = words("""
    x y z rx hold position velocity move force torque ramp speed time travel to line by arc center
    turns lissajous file until within fail_if next on_fail attempts frame law kind mass stiffness
    damping linear angular shape xyz rpy size radius parent surface heading model tool start joints
    axes path track filter floor turn 3
""")

SECTIONS = words("robot world params frames frame law limits stages expect vary control name about")

VALUES = st.recursive(
    EXPRESSIONS | st.integers() | st.floats() | st.booleans() | st.none() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEYS, inner, max_size=4),
    max_leaves=12,
)


@QUICK
@given(SECTIONS, VALUES, st.booleans())
def test_anything_anywhere(section: str, value: object, named: bool) -> None:
    file = {
        "taskspec": 1,
        "robot": {"model": "panda"},
        "world": {"table": {"shape": "plane"}},
        "params": {"press": "15 N"},
        "stages": {"wipe": {"time": "1 s"}},
        section: {"one": value} if named else value,
    }
    outcome(json.dumps(file).replace("NaN", ".nan"))


STEPS = words("stages wipe axes z force law world table xyz 0 2 -1 expect vary params press")
TEXT_VALUES = EXPRESSIONS | st.text(max_size=20) | st.sampled_from(["{a: 1}", "[1]", "{", "*a"])


@QUICK
@given(
    st.dictionaries(
        st.text(max_size=20) | st.lists(STEPS, min_size=1, max_size=5).map(".".join),
        TEXT_VALUES,
        max_size=3,
    )
)
def test_any_override(overrides: dict[str, str]) -> None:
    outcome((CORPUS / "ok" / "wipe_table.yaml").read_text(encoding="utf-8"), overrides)
