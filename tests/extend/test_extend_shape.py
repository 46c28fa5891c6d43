"""A shape that is defined here and nowhere else: the capsule, of which a frame follows the side."""

from __future__ import annotations

import json
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from extension import column
from numpy.typing import NDArray

from taskspec.shapes import BoundedSurface, Geom, SizeKey, SurfaceChart, register
from taskspec.shapes.surface import RADIUS

LAWS = ("hybrid", "parallel")
TASK = """\
taskspec: 1
name: round
robot: {model: planar2, tool: {radius: 100 um}, start: {xyz: [390 mm, 0, 0]}}
world:
  post: {shape: capsule, radius: 60 mm, span: 80 mm, xyz: [451 mm, 0, 0], stiffness: 10 kN/m}
frames: {skin: {surface: post}}
stages:
  press: {axes: {x: {force: 5 N}}, time: 0.5 s}
  along: {frame: skin, axes: {y: {move: 10 mm, speed: 50 mm/s}, z: {force: -5 N}}}
expect: [last(press.post.force) within 5 N +- 0.3 N, along.post.force within 3..7 N]
"""
WRONG = TASK.replace(", span: 80 mm", "")


@dataclass(frozen=True, slots=True)
class Capsule(BoundedSurface):
    """All that is nearer than its radius to a line of length `span` along its z."""

    radius: float
    span: float

    name = "capsule"
    keys = (RADIUS, SizeKey("span", "Length of a capsule's straight part", extent=", inside"))
    start_over = "the side of a capsule"
    resting_points = 2

    def height(self, x: ca.SX) -> ca.SX:
        beyond = x[2] - ca.fmax(-self.span / 2, ca.fmin(self.span / 2, x[2]))
        return ca.sqrt(x[0] ** 2 + x[1] ** 2 + beyond**2 + 1e-30) - self.radius

    def chart(self, face: ca.SX | None = None) -> SurfaceChart:  # noqa: ARG002
        return Side(self)

    def geom(self) -> Geom:
        return Geom("capsule", (self.radius, self.span / 2, 0.0))

    @property
    def volume(self) -> float:
        return float(np.pi * self.radius**2 * (self.span + 4 / 3 * self.radius))

    def inertia(self, mass: float) -> list[float]:
        across = mass * ((self.span + 2 * self.radius) ** 2 / 12 + self.radius**2 / 4)
        return [across, across, mass * self.radius**2 / 2]

    def contact_points(self) -> tuple[NDArray[np.float64], float]:
        return self.extremes()

    def extremes(self) -> tuple[NDArray[np.float64], float]:
        z = self.span / 2
        return np.array([[0.0, 0.0, -z], [0.0, 0.0, z]]), self.radius


@dataclass(frozen=True, slots=True)
class Side(SurfaceChart):
    capsule: Capsule

    def distance(self, point: ca.SX) -> ca.SX:
        x = self.capsule.local(point)
        return ca.sqrt(x[0] ** 2 + x[1] ** 2 + 1e-30) - self.capsule.radius

    def normal(self, point: ca.SX) -> ca.SX:
        x = self.capsule.local(point)
        n = ca.vertcat(x[0], x[1], 0) / ca.sqrt(x[0] ** 2 + x[1] ** 2 + 1e-30)
        return ca.DM(self.capsule.rotation) @ n

    def own_x(self) -> ca.SX:
        return ca.SX(ca.DM(self.capsule.rotation[:, 2]))

    def margin(self, point: ca.SX, heading: NDArray[np.float64] | None) -> ca.SX:
        end = self.capsule.span / 2 - ca.fabs(self.capsule.local(point)[2])
        return ca.fmin(self.away_from_pole(point, heading), end)


def define() -> None:
    register(Capsule)


def test_it_is_validated(said):
    assert said["validate"].exit_code == 0, said["validate"].text
    assert said["mistake"].exit_code == 2
    assert "wrong.yaml:5:" in said["mistake"].text
    assert "span" in said["mistake"].text


def test_it_is_explained(said):
    assert said["explain"].exit_code == 0, said["explain"].text
    assert "capsule" in said["explain"].text


def test_it_is_touched(said):
    """The wall of 10 kN/m gives way by 0.5 mm to 5 N, there where it is round as well."""
    assert said["run"].exit_code == 0, said["run"].text
    force, gap = column(said["run"], "post.force"), column(said["run"], "post.gap")
    press = column(said["run"], "stage") == "press"
    assert force[press][-1] == pytest.approx(5.0, abs=0.3)
    assert gap[press][-1] == pytest.approx(-force[press][-1] / 1e4, rel=0.02)


def test_axes_that_a_stage_does_not_have_are_no_part_of_its_peaks(said):
    """A planar arm has x and y in the world, y and z on the capsule's side."""
    peaks = json.loads(said["run"].file("run/summary.json"))["peaks"]
    force = column(said["run"], "post.force")
    for stage in ("press", "along"):
        during = force[column(said["run"], "stage") == stage]
        assert peaks[stage]["force"] == pytest.approx(during.max(), rel=1e-6)


def test_it_is_compared(said):
    assert said["compare"].exit_code == 0, said["compare"].text
    passed = [line for line in said["compare"].text.splitlines() if " passed " in line]
    assert {line.split()[0] for line in passed} == {"as", *LAWS}  # the file as written too


def test_the_report_draws_it(said):
    assert said["report"].exit_code == 0
    assert "capsule" in said["report"].file("run/report.html")


def test_it_is_in_the_schema(said):
    assert said["schema"].exit_code == 0
    assert '"capsule"' in said["schema"].text
    assert '"span"' in said["schema"].text
