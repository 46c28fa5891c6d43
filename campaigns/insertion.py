"""The tables of docs/insertion.md, measured anew: `python campaigns/insertion.py`."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "insertion.md"
sys.path.insert(0, str(ROOT / "tests"))

from seatings import HEAD, cells, seatings  # noqa: E402

from insertion_rig import (  # noqa: E402
    PEGS,
    SOLIDS,
    chamfer,
    press,
    press_on,
    two_points,
    wedged,
)
from taskspec.shapes import patches  # noqa: E402

_CALLED = {
    "box": "box",
    "cylinder": "end of a cylinder",
    "lying": "side of a cylinder",
    "sphere": "sphere",
}


def _press() -> Iterable[Sequence[str]]:
    tilts = (0.0, 0.01, 0.3, 45.0, 90.0)
    yield "tool", "on", *(f"{tilt:g}°" for tilt in tilts)
    for tool in PEGS:
        found = [press(patches.PLATE, (), tool, 20e3, math.radians(tilt)) for tilt in tilts]
        yield tool, "plane", *(f"{x:.6f}" for x in found)
        for solid in SOLIDS:
            found = [press_on(solid, tool, 20e3, math.radians(tilt)) for tilt in tilts]
            yield tool, _CALLED[solid], *(f"{x:.6f}" for x in found)


def _jamming() -> Iterable[Sequence[str]]:
    yield "friction", "depth", "lateral force", "axial force", "over statics", "over Whitney"
    for friction in (0.1, 0.3):
        for depth in (0.012, 0.03):
            for side in (-4.0, 0.0, 4.0):
                measured, statics, whitney = two_points(friction, depth, 0.15, side)
                yield (
                    f"{friction:g}", f"{1e3 * depth:g} mm", f"{side:g} N", f"{measured:.3f} N",
                    f"{measured / statics:.4f}", f"{measured / whitney:.3f}",
                )  # fmt: skip


def _wedging() -> Iterable[Sequence[str]]:
    ratios = (0.3, 0.6, 0.9, 0.95, 1.05, 1.1, 1.5)
    yield "friction", *(f"{ratio:g}" for ratio in ratios)
    for friction in (0.4, 0.5):
        yield f"{friction:g}", *(f"{100 * wedged(friction, ratio):.0f} %" for ratio in ratios)


def _chamfer() -> Iterable[Sequence[str]]:
    yield "stiffness", "friction", "along x", "along z", "over closed form"
    for stiffness in (20e3, 200e3):
        for friction in (0.0, 0.2):
            measured, expected = chamfer(friction, stiffness, 0.0022)
            ratio = measured / expected
            yield (
                f"{1e-3 * stiffness:g} kN/m", f"{friction:g}", f"{measured[0]:.3f} N",
                f"{measured[1]:.3f} N", f"{ratio[0]:.4f}, {ratio[1]:.4f}",
            )  # fmt: skip


#: Random worlds that nothing was chosen by.
JUDGED, WORLDS = 1618, 100
_PLACE = {"vary.world.socket.xyz": "[normal(1.5 mm), normal(1.5 mm), normal(1 mm)]"}
_TIGHT = {
    "`tight-peg`": {},
    "friction 0.3": {"world.socket.friction": "0.3"},
    "friction 1": {"world.socket.friction": "1"},
    "a hole of 8.04 mm": {"world.socket.radius": "4.02 mm"},
    "100 kN/m": {"world.socket.stiffness": "100 kN/m"},
    "800 kN/m": {"world.socket.stiffness": "800 kN/m"},
    "a place known to 1.5 mm": _PLACE,
    "… and no shaking": _PLACE | {"shake": "0 N"},
    "… and no second way": _PLACE | {"stages.insert.next": "end"},
    "… and neither": _PLACE | {"shake": "0 N", "stages.insert.next": "end"},
}


def _tight() -> Iterable[Sequence[str]]:
    yield "file", *HEAD
    spiral = seatings(ROOT / "campaigns" / "fine-spiral.yaml", {}, JUDGED, WORLDS)
    yield "upright, in a spiral", *cells(spiral)
    for name, overrides in _TIGHT.items():
        found = seatings(ROOT / "tasks" / "tight-peg.yaml", overrides, JUDGED, WORLDS)
        yield name, *cells(found)


TABLES = {
    "press": _press,
    "jamming": _jamming,
    "wedging": _wedging,
    "chamfer": _chamfer,
    "tight": _tight,
}


def table(name: str) -> str:
    """A table as Markdown has it."""
    head, *rows = (f"| {' | '.join(row)} |" for row in TABLES[name]())
    rule = "|" + " --- |" * (head.count("|") - 1)
    return "\n".join([head, rule, *rows])


def written(text: str, names: Iterable[str] = TABLES) -> str:
    """The page with its tables measured."""
    for name in names:
        pattern = rf"(<!-- measured: {name} -->\n).*?\n\n"
        text = re.sub(pattern, lambda m, n=name: f"{m[1]}{table(n)}\n\n", text, flags=re.S)
    return text


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
