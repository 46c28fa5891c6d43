"""Surfaces from within, panels and meshes: the plant's contact against the declared values."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from insertion_rig import PEGS, Rig
from taskspec.native.kernel import vector
from taskspec.shapes import overlap, patches
from taskspec.shapes.round_patch import Bowl, CylinderSegment, SphereCap, Tube
from taskspec.shapes.solid import kind_and_sizes

ZERO, AXES = np.zeros(3), np.eye(3)
RADIUS = 0.15
#: Of each shape that is touched whole: itself, and where its lowest or highest round point is.
PATCHES = {
    "bowl": Bowl(ZERO, AXES, RADIUS, math.pi),
    "shallow bowl": Bowl(ZERO, AXES, RADIUS, 1.0, 0.004),
    "deep bowl": Bowl(ZERO, AXES, RADIUS, 4.5),
    "tube": Tube(ZERO, AXES, RADIUS, 2 * math.pi, 0.3),
    "trough": Tube(ZERO, AXES, RADIUS, 2.0, 0.3, 0.005),
    "cap": SphereCap(ZERO, AXES, RADIUS, 1.0),
    "large cap": SphereCap(ZERO, AXES, RADIUS, 4.0),
    "segment": CylinderSegment(ZERO, AXES, RADIUS, 1.2, 0.3),
    "large segment": CylinderSegment(ZERO, AXES, RADIUS, 4.0, 0.3),
}
BALL = 0.012


def distances_and_slopes(shape, points):
    """Of points (3, n) the distances (n,) and their gradients (3, n)."""
    x = ca.SX.sym("x", 3)
    height = shape.height(x)
    at = ca.Function("at", [x], [height, ca.gradient(height, x)])
    d, slopes = at(points)
    return np.array(d).ravel(), np.array(slopes)


def found(shape, center, radius=BALL):
    """Depth and normal of a ball, as the plant's kernel has them; None where they are apart."""
    kind, sizes = kind_and_sizes(shape)
    tool = np.array([*center, *AXES.ravel(), overlap.BALL, radius, radius, radius, 1e-6])
    work = np.zeros(patches.WORK)
    numbers = np.array([kind, *sizes, *[0.0] * (6 - len(sizes))])
    if not patches.find(vector(tool), vector(numbers), vector(work)):
        return None
    patch = work[patches.POINTS :]
    return patch[6], patch[3:6].copy()


@pytest.mark.parametrize("name", list(PATCHES))
def test_a_ball_is_as_deep_as_it_is_near(name):
    """Depth is the radius less the distance of the centre, the normal is where that grows.

    Round sides, edges, ends and backs, each where a ball touches it. Segments bulge at their ends
    by the 5 um that solids are rounded by.
    """
    shape, rng = PATCHES[name], np.random.default_rng(3)
    centers = []
    for _ in range(3000):
        direction = rng.normal(size=3)
        center = direction / np.linalg.norm(direction) * rng.uniform(0.6, 1.2) * RADIUS
        if rng.random() < 0.3 and shape.straight is not None:
            center[2] = rng.choice([-1, 1]) * rng.uniform(0.13, 0.17)
        centers.append(center)
    distances, slopes = distances_and_slopes(shape, np.array(centers).T)
    touched, sides = 0, set()
    for i, (center, d, slope) in enumerate(zip(centers, distances, slopes.T, strict=True)):
        # Where the centre itself is inside, and where two features are equally near.
        if d < 1e-3 or np.linalg.norm(slope) < 0.99:
            continue
        # Most are far off, where there is nothing to find: a few of those are enough.
        if d > 2 * BALL and i % 20:
            continue
        hit = found(shape, center)
        if d > BALL + 1e-5:
            assert hit is None
        elif d < BALL - 1e-4:
            touched += 1
            depth, normal = hit
            assert depth == pytest.approx(BALL - d, abs=1.1e-5)
            assert normal == pytest.approx(slope, abs=2e-2 if name.endswith("segment") else 1e-3)
            sides.add(tuple(np.round(2 * normal)))
    assert touched > 40
    assert len(sides) > 8


@pytest.mark.parametrize("name", ["bowl", "shallow bowl", "trough"])
def test_the_middle_of_a_cavity_is_seen_along_the_frame(name):
    """The distance that a stage counts z by is the chart's there, and falls as the tool goes in.

    From above the centre too, down to the wall.
    """
    shape = PATCHES[name]
    x = ca.SX.sym("x", 3)
    chart = shape.chart()
    outputs = [shape.height(x), chart.distance(x), chart.normal(x), chart.foot(x)]
    at = ca.Function("at", [x], outputs)
    for share in (0.0, 0.2, 0.35):
        point = np.zeros(3)
        point[shape.middle], point[1] = 0.1, share * RADIUS * math.sin(shape.half)
        for _ in range(20):
            if abs(point[1]) > 0.5 * RADIUS * math.sin(shape.half):
                break
            d, charted, normal, foot = (np.array(each).ravel() for each in at(point))
            assert d == pytest.approx(charted, abs=1e-12)
            closer = float(at(point - 1e-6 * normal)[0])
            # Off the middle the normal turns on the way, and the distance falls faster.
            assert 0.98e-6 < d[0] - closer < (1.02e-6 if share == 0 else 3e-6)
            if point[shape.middle] < -0.5 * RADIUS:
                assert np.linalg.norm(foot) == pytest.approx(RADIUS, abs=1e-12)
            point = point - 0.045 * d[0] * normal
        assert d[0] > 0


@pytest.mark.parametrize(("name", "volume"), [
    ("bowl", 2 / 3 * math.pi * (0.16**3 - 0.15**3)),
    ("tube", math.pi * (0.16**2 - 0.15**2) * 0.3),
    ("trough", 0.5 * 2.0 * (0.155**2 - 0.15**2) * 0.3),
    ("segment", 0.5 * RADIUS**2 * (1.2 - math.sin(1.2)) * 0.3),
    ("cap", math.pi * RADIUS**3 / 3 * (2 + math.cos(0.5)) * (1 - math.cos(0.5)) ** 2),
])  # fmt: skip
def test_what_is_drawn_has_its_volume_and_faces_outwards(name, volume):
    """64 corners of a circle take 0.16 % of its area, and as much of a thin ring."""
    geom = PATCHES[name].visible_geom(ZERO, ZERO)
    a, b, c = np.swapaxes(geom.corners[geom.faces], 0, 1)
    assert np.sum(a * np.cross(b, c)) / 6 == pytest.approx(volume, rel=4e-3)


@pytest.mark.parametrize("tilt", [0.0, 0.3, 5.0])
@pytest.mark.parametrize("tool", list(PEGS))
def test_a_cap_bears_the_declared_stiffness(tool, tilt):
    """Pressed along z where it is highest: with the normal n the stiffness along z is k n_z^2."""
    kind, sizes = kind_and_sizes(PATCHES["cap"])
    rig = Rig(
        kind, sizes, PEGS[tool], joints="z", stiffness=20e3, tilt=math.radians(tilt), height=0.03,
        dampers={"z": 400.0}, at=(0.0, 0.0, -RADIUS),
    )  # fmt: skip
    depths = []
    for force in (20.0, 40.0):
        rig.data.qfrc_applied[:] = -force
        rig.step(6000)
        depths.append(float(rig.data.qpos[0]))
    ((_, normal, _),) = rig.forces()
    declared = 20e3 * normal[2] ** 2
    assert 20.0 / (depths[0] - depths[1]) == pytest.approx(declared, rel=1e-3)
