"""What limits act on where several contacts are there at once."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from taskspec.program.limits.contacts import ContactRow
from taskspec.program.limits.pushes import Contacts

#: A sheet lies on a table, half a millimetre high: the tool touches both.
SHEET = """
taskspec: 1
robot: {model: panda, tool: {shape: sphere, radius: 10 mm}, start: {xyz: [500 mm, 0, 320 mm]}}
world:
  table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}
  sheet: {shape: box, size: [200 mm, 200 mm, 20 mm], xyz: [500 mm, 0, 290.4 mm], stiffness: 20 kN/m}
frame: sheet
law: {kind: hybrid, solve: qp}
limits: {force: 30 N}
stages:
  go: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -2 N for 10 ms, within: 3 s}
  press: {axes: {z: {force: -10 N}}, time: 0.5 s}
  hard: {axes: {z: {force: -60 N}}, time: 0.5 s}
"""


def row(way: np.ndarray, *, there: float = 1.0) -> ContactRow:
    """A contact that the joints press on along `way` (1, n)."""
    zero, on = ca.SX(0), ca.SX(there)
    return ContactRow("x", ca.SX(way), zero, zero, on, zero, False, False, 1e4)


def numbers(found: ca.SX) -> np.ndarray:
    return np.array(ca.evalf(found))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def test_a_contact_along_another_one_is_left_to_that(rng: np.random.Generator) -> None:
    L = ca.SX(np.linalg.cholesky(np.diag([2.0, 1.0, 0.5])))
    first, other = rng.normal(size=(1, 3)), rng.normal(size=(1, 3))
    alone = Contacts([row(first), row(other)], L)
    both = Contacts([row(first), row(2 * first), row(other)], L)
    assert numbers(both.active).ravel().tolist() == [1, 0, 1]
    kept = [0, 2]
    assert numbers(both.inertia)[np.ix_(kept, kept)] == pytest.approx(numbers(alone.inertia))
    # One that is not there has no way of its own to be along.
    first_gone = Contacts([row(first, there=0.0), row(first), row(other)], L)
    assert numbers(first_gone.active).ravel().tolist() == [0, 1, 1]


@pytest.mark.parametrize(("angle", "own"), [(1.0, 0), (3.0, 1), (90.0, 1)])
def test_contacts_that_are_apart_by_some_degrees_count_each(angle: float, own: int) -> None:
    a = np.radians(angle)
    ways = np.array([[1.0, 0.0, 0.0]]), np.array([[np.cos(a), np.sin(a), 0.0]])
    found = Contacts([row(way) for way in ways], ca.SX.eye(3))
    assert numbers(found.active).ravel().tolist() == [1, own]


def test_a_sheet_on_a_table_is_pressed_under_a_program(simulate) -> None:  # type: ignore[no-untyped-def]
    """No number of the program is lost, and its limit on force holds."""
    run = simulate(SHEET)
    assert run.outcome.status == "done"
    forces = run.during("hard", "force.z", start=0.4)
    assert -forces == pytest.approx(0.95 * 30, rel=0.02)
    assert np.abs(run["force.z"]).max() < 30
