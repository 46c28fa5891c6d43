"""Distance, foot and frame of every shape, against finite differences and closed forms."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from taskspec.geometry.rotation import from_rpy
from taskspec.program.prepare import chart_at
from taskspec.shapes import SHAPES, BoundedSurface, Box, Cylinder, Plane, SizeKey, Sphere, register
from taskspec.shapes.round_patch import CylinderSegment, SphereCap, Tube


@pytest.fixture
def _open(monkeypatch):
    """The registry as it is before the language is imported; it is forgotten what a test adds."""
    monkeypatch.setattr("taskspec.shapes.registry._read", [])
    monkeypatch.setattr("taskspec.shapes.registry.SHAPES", dict(SHAPES))


RNG = np.random.default_rng(2)
ORIGIN, R = np.array([0.3, -0.2, 0.5]), from_rpy((0.4, -0.3, 0.9))
SURFACES = {
    "plane": Plane(ORIGIN, R),
    "box": Box(ORIGIN, R, size=(0.2, 0.4, 0.3)),
    "cylinder": Cylinder(ORIGIN, R, radius=0.1, length=0.6),
    "sphere": Sphere(ORIGIN, R, radius=0.15),
    "cap": SphereCap(ORIGIN, R, radius=0.15, arc=5.0),
    "segment": CylinderSegment(ORIGIN, R, radius=0.1, arc=5.0, length=0.6),
    "tube": Tube(ORIGIN, R, radius=0.5, arc=2 * np.pi, length=0.6),
}


def number(expression):
    return np.array(ca.evalf(expression)).squeeze()


@pytest.mark.parametrize("name", list(SURFACES))
def test_the_gradient_is_the_slope_of_the_distance(name):
    surface = SURFACES[name]
    for _ in range(50):
        x = ORIGIN + RNG.normal(scale=0.3, size=3)
        slope = [
            (number(surface.distance(ca.SX(x + d))) - number(surface.distance(ca.SX(x - d)))) / 2e-6
            for d in np.eye(3) * 1e-6
        ]
        np.testing.assert_allclose(number(surface.gradient(ca.SX(x))), slope, atol=1e-6)


def test_distances_in_closed_form():
    def at(name, local):
        return float(number(SURFACES[name].distance(ca.SX(ORIGIN + R @ np.array(local)))))

    assert at("plane", [1, 2, -0.03]) == pytest.approx(-0.03)
    assert at("sphere", [0, 0.25, 0]) == pytest.approx(0.1)
    assert at("cylinder", [0.06, 0.08, 0.1]) == pytest.approx(0)
    assert at("cylinder", [0, 0, 0.35]) == pytest.approx(0.05)
    assert at("box", [0.13, 0.24, 0]) == pytest.approx(0.05)
    assert at("box", [0, 0, 0.14]) == pytest.approx(-0.01)


@pytest.mark.parametrize("name", list(SURFACES))
@pytest.mark.parametrize("heading", [None, np.array([0.2, 1.0, 0.1])])
def test_a_following_frame_is_right_handed_with_z_outward(name, heading):
    surface = SURFACES[name]
    for _ in range(20):
        x = ORIGIN + R @ (RNG.normal(size=3) * 0.1 + np.array([0.25, 0.05, 0.2]))
        chart = chart_at(surface, x)
        F = number(chart.frame(ca.SX(x), heading))
        np.testing.assert_allclose(F.T @ F, np.eye(3), atol=1e-9)
        assert np.linalg.det(F) == pytest.approx(1)
        np.testing.assert_allclose(F[:, 2], number(chart.normal(ca.SX(x))), atol=1e-12)
        foot = number(chart.foot(ca.SX(x)))
        assert number(chart.distance(ca.SX(foot))) == pytest.approx(0, abs=1e-9)
        np.testing.assert_allclose(foot + number(chart.distance(ca.SX(x))) * F[:, 2], x, atol=1e-9)


def test_a_cylinders_x_is_its_axis():
    chart = SURFACES["cylinder"].chart()
    F = number(chart.frame(ca.SX(ORIGIN + R @ np.array([0.2, 0.1, 0])), None))
    np.testing.assert_allclose(F[:, 0], R[:, 2], atol=1e-12)


@pytest.mark.parametrize("index", range(6))
def test_box_faces(index):
    surface = SURFACES["box"]
    numbers = surface.face(index)
    F, center = numbers[:9].reshape(3, 3, order="F"), numbers[9:12]
    assert np.linalg.det(F) == pytest.approx(1)
    outside = center + 0.01 * F[:, 2]
    np.testing.assert_array_equal(number(surface.face_at(ca.SX(outside))).ravel(), numbers)
    assert number(surface.distance(ca.SX(outside))) == pytest.approx(0.01)
    # Just inside each edge of the face the margin is what is left of it.
    chart = surface.chart(ca.SX(numbers))
    edge = outside + F[:, 0] * (numbers[12] - 0.002)
    assert number(chart.margin(ca.SX(edge), None)) == pytest.approx(0.002)
    beyond = outside + F[:, 1] * (numbers[13] + 0.001)
    assert number(chart.margin(ca.SX(beyond), None)) == pytest.approx(-0.001)


def test_margins_end_at_a_cylinders_ends_and_a_spheres_pole():
    cylinder, sphere = SURFACES["cylinder"].chart(), SURFACES["sphere"].chart()
    near_end = ORIGIN + R @ np.array([0.12, 0, 0.31])
    assert number(cylinder.margin(ca.SX(near_end), None)) < 0
    pole = ORIGIN + R @ np.array([0.2, 1e-4, 0])
    assert number(sphere.margin(ca.SX(pole), None)) < 0
    assert number(sphere.margin(ca.SX(ORIGIN + R @ np.array([0, 0, 0.2])), None)) > 0


class Slab(Plane):
    """A plane by another name."""

    name = "slab"


def test_shapes_are_listed_by_their_names():
    assert list(SHAPES) == ["plane", "box", "cylinder", "sphere", "hole", "slot", "groove", "mesh"]
    assert all(kind.name == name for name, kind in SHAPES.items())


def test_a_shape_comes_before_the_language():
    with pytest.raises(RuntimeError, match=r"register Slab before 'taskspec\.spec\.world'"):
        register(Slab)


@pytest.mark.usefixtures("_open")
def test_a_name_is_given_once():
    register(Slab)
    with pytest.raises(ValueError, match="there is a shape 'slab' already"):
        register(Slab)


@pytest.mark.usefixtures("_open")
def test_a_key_means_the_same_on_every_shape():
    class Coin(Cylinder):
        name = "coin"
        keys = (SizeKey("radius", "Radius of a coin"),)

    with pytest.raises(ValueError, match="'radius' of 'coin' differs"):
        register(Coin)


@pytest.mark.usefixtures("_open")
def test_a_shape_states_all_that_depends_on_it():
    class Blob(BoundedSurface):
        def height(self, x):
            return x[2]

    facts = "resting_points, name, chart, contact_points, extremes, geom, inertia, volume"
    with pytest.raises(TypeError, match=f"the shape Blob does not state its {facts}"):
        register(Blob)
