"""Lines that stand in one chart can be told apart, also without all colours."""

from __future__ import annotations

import re

import numpy as np
import pytest

from taskspec_runner.pages.document import part

#: Linear RGB as seen without one kind of cone (Machado, Oliveira and Fernandes 2009).
SEEN = {
    "all": np.eye(3),
    "protan": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
    "deutan": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
#: Colours that mean different things in one chart.
GROUPS = (("x", "y", "z", "ink"), ("x", "y", "z", "ink", "predicted"), ("good", "bad"))
#: Distance in CIELAB of colours that nobody takes for the same; 2 can just be seen side by side.
APART = 15.0


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("cones", SEEN)
def test_colours_are_apart(scheme: str, cones: str) -> None:
    light, _, dark = str(part("page.css")).partition("prefers-color-scheme: dark")
    chosen = light if scheme == "light" else dark
    colours = dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", chosen.partition("}")[0]))
    for group in GROUPS:
        places = {name: lab(colours[name], SEEN[cones]) for name in group}
        for one in group:
            for other in group[: group.index(one)]:
                apart = float(np.linalg.norm(places[one] - places[other]))
                assert apart >= APART, (one, other, round(apart, 1))


def lab(colour: str, seen: np.ndarray) -> np.ndarray:
    """CIELAB coordinates under D65."""
    srgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    xyz = TO_XYZ @ np.clip(seen @ linear, 0, 1) / TO_XYZ.sum(axis=1)
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])
